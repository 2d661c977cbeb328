"""The gate of a results folder, which a stranger may have made: what is read there, and what is not followed.

Below the folder there are regular files and folders. A link, a pipe or a device is refused before anything
opens it. A file is read up to a size, and whatever its reader cannot bear is one line with the file's name.
The folder itself, and the folders above it, may be links.
"""

import contextlib
import os
import stat
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

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
    """Raise FolderError for a link, pipe or device that has one of these names, or is in such a folder."""
    if not isinstance(root, Path) or not root.is_dir():
        return
    ahead = [entry for entry in os.scandir(root) if entry.name in names]
    while ahead:
        entry = ahead.pop()
        if entry.is_dir(follow_symlinks=False):
            ahead += os.scandir(entry.path)
        elif not entry.is_file(follow_symlinks=False):
            refuse_irregular(Path(entry.path))


def refuse_irregular(file: Path) -> None:
    """Raise FolderError for a link, a pipe or a device, without opening it."""
    kind = stat.S_IFMT(file.lstat().st_mode)
    if kind not in (stat.S_IFREG, stat.S_IFDIR):
        raise FolderError(
            f"{file} is {IRREGULAR.get(kind, 'a device')}, and only files and folders count here"
        )


def read_whole(file: UPath, most: int = MOST_TEXT, fault: str = "cannot be read") -> bytes:
    """Read a file at once, since another process may replace it.

    Raises FileNotFoundError, or FolderError for a file that is irregular or has more than `most` bytes.
    """
    with reading(file, fault):
        if isinstance(file, Path):
            refuse_irregular(file)
        if (size := file.stat().st_size) > most:
            raise FolderError(f"{file} has {size:,} bytes, and {most:,} at most are due")
        content: Any = file.fs.cat_file(file.path)
        return content


@contextlib.contextmanager
def reading(file: object, fault: str = "cannot be read") -> Iterator[None]:
    """Raise FolderError with the name of the file for any error of its reader, but for a missing file."""
    try:
        yield
    except (FolderError, FileNotFoundError, NotADirectoryError):
        raise
    except Exception as error:  # each reader has its own
        told = getattr(error, "strerror", None) or str(error).strip() or type(error).__name__
        raise FolderError(f"{file} {fault} ({told.splitlines()[0].rstrip('.')})") from error
