"""Errors of kinds from outside, as messages with the file and line where they arose."""

import contextlib
import traceback
from collections.abc import Iterator

from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError


def with_place(error: BaseException) -> str:
    """Place where an error arose, its type, and the first line of its message.

    The place is the file and line of a syntax error, else of the innermost frame from outside, else
    of the innermost frame.
    """
    frames, outside = traceback_lines(error), outside_files()
    places = [(file, line) for file, line in frames if file in outside] or frames
    told = str(error)
    if isinstance(error, SyntaxError) and error.filename:
        places, told = [(error.filename, error.lineno or 1)], error.msg
    first = modules.without_private(told.strip().partition("\n")[0])
    message = f"{type(error).__name__}: {first}" if first else type(error).__name__
    return f"{places[-1][0]}:{places[-1][1]}: {message}" if places else message


def traceback_lines(error: BaseException) -> list[tuple[str, int]]:
    frames = traceback.walk_tb(error.__traceback__)
    return [(frame.f_code.co_filename, line) for frame, line in frames]


def outside_files() -> set[str]:
    loaded = {str(file) for held in modules.STATES.values() for file in held.sources}
    return loaded | {each.file for each in provenance.IMPORTED_SOURCES.values() if each.file}


@contextlib.contextmanager
def blaming() -> Iterator[None]:
    """Turn an error or exit of a kind from outside into a KindError with its file and line."""
    try:
        yield
    except (Exception, SystemExit) as error:
        files = {file for file, _ in traceback_lines(error)}
        if isinstance(error, KindError) or not files & outside_files():
            raise
        raise KindError(with_place(error)) from error
