"""Errors of kinds from outside, as messages with the file and line where they arose."""

import contextlib
from collections.abc import Iterator

from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError


def with_place(error: BaseException) -> str:
    """Return an error's type and message after the file and line of the innermost frame from outside.

    Without such a frame the place is that of the innermost frame.
    """
    frames = list(traceback_lines(error))
    outside = outside_files()
    place = next((f"{file}:{line}" for file, line in reversed(frames) if file in outside), None)
    message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"{place or '{}:{}'.format(*frames[-1]) if frames else ''}: {message}"


def traceback_lines(error: BaseException) -> Iterator[tuple[str, int]]:
    """Yield the file and line of each frame of an error's traceback, outermost first."""
    frame = error.__traceback__
    while frame is not None:
        yield frame.tb_frame.f_code.co_filename, frame.tb_lineno
        frame = frame.tb_next


def outside_files() -> set[str]:
    """Return all files from which kinds from outside were loaded or imported."""
    return modules.loaded_files() | {each.file for each in provenance.IMPORTED_SOURCES.values() if each.file}


def blame(error: BaseException) -> KindError | None:
    """Return a KindError with the place if an error passed through a file from outside, else None."""
    outside = outside_files()
    if isinstance(error, KindError) or not any(file in outside for file, _ in traceback_lines(error)):
        return None
    return KindError(with_place(error))


@contextlib.contextmanager
def blaming() -> Iterator[None]:
    """Turn an error that a kind from outside raises into a KindError with its file and line."""
    try:
        yield
    except Exception as error:
        blamed = blame(error)
        if blamed is None:
            raise
        raise blamed from error
