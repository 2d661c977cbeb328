"""What is read of a results folder, which a stranger may have made, and what is refused unopened.

Below the folder there are regular files and folders. A link, a pipe or a device is refused before
anything opens it. The folder itself, and the folders above it, may be links.
"""

import contextlib
import os
import stat
from collections.abc import Container, Iterator
from pathlib import Path
from typing import cast

from upath import UPath

MOST_TEXT = 2**28  # bytes of a table or of a manifest
IRREGULAR = {stat.S_IFLNK: "a link", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}


class FolderError(ValueError):
    """A results folder that cannot be used for the request.

    Examples
    --------
    >>> import jaxnet
    >>> try:
    ...     jaxnet.open("nowhere")
    ... except jaxnet.FolderError as error:
    ...     print(error)
    nowhere is not a results folder: it has no manifest.json
    """


def refuse_strange(root: UPath, names: Container[str]) -> None:
    """Refuse a link, pipe or device that has one of these names, or is in such a folder."""
    if not isinstance(root, Path) or not root.is_dir():
        return
    ahead = [entry for entry in os.scandir(root) if entry.name in names]
    while ahead:
        entry = ahead.pop()
        if entry.is_dir(follow_symlinks=False):
            ahead += os.scandir(entry.path)
        else:
            refuse_irregular(Path(entry.path))


def refuse_irregular(file: Path) -> None:
    kind = stat.S_IFMT(file.lstat().st_mode)
    if kind not in (stat.S_IFREG, stat.S_IFDIR):
        raise FolderError(
            f"{file} is {IRREGULAR.get(kind, 'a device')}, and only files and folders count here"
        )


def read_whole(file: UPath, most: int = MOST_TEXT, fault: str = "cannot be read") -> bytes:
    """Content of a regular file, at most `most` bytes, at once: others may replace it."""
    with reading(file, fault):
        if isinstance(file, Path):
            refuse_irregular(file)
        if (size := file.stat().st_size) > most:
            raise FolderError(f"{file} has {size:,} bytes, and {most:,} at most are due")
        return cast(bytes, file.fs.cat_file(file.path))


@contextlib.contextmanager
def reading(file: object, fault: str = "cannot be read") -> Iterator[None]:
    """Turn an error of a file's reader, but for a missing file, into a line that names the file."""
    try:
        yield
    except (FolderError, FileNotFoundError, NotADirectoryError):
        raise
    except Exception as error:  # each reader has its own
        told = getattr(error, "strerror", None) or str(error).strip() or type(error).__name__
        raise FolderError(f"{file} {fault} ({told.splitlines()[0].rstrip('.')})") from error
