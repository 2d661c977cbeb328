"""Who may write a results folder: one writer alone, or several that write shards of their own.

`.lock` names the holder: its process, since when, and a token that no other holder has. On a disk the system
locks the file, and the lock ends with the holder's process. In an object store the holder rewrites the object
every `BEAT` seconds; another process may take the folder over when the object stays the same for `SILENCE`.

A holder reads `.lock` before each write (`Hold.lost`). A holder that finds another token, or no lock, does
not write again. No signal and no thread takes part in this, so it also works where signals are ignored.

Between the look and the write another process may take the folder over. Then at most one file of each thread
of the earlier holder arrives late:

- The file is whole, since a file is renamed and an object is put whole.
- A shard of the same study has the same rows and arrays, whoever writes it.
- Tables and the manifest are written once more by the new holder, at its end.
- Rows of another study (after `--fresh`) carry its hash. `rows.scan` refuses them, a run replaces them.
- A chunk of another study differs from the checksum in its shard's rows. A run replaces it.
"""

import contextlib
import fcntl
import itertools
import json
import os
import platform
import threading
import time
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from upath import UPath

BEAT, SILENCE = 5.0, 20.0  # [s]
PARTS = "parts"  # the token that all writers of parts share on a disk


class HeldError(Exception):
    """Another process holds the folder; the message names it."""


class Hold(NamedTuple):
    """A lock as its holder knows it: the file, and the token that must be in it.

    Without a token there must be no lock.
    """

    file: UPath
    token: str

    def lost(self) -> str:
        """Who holds the folder instead, and since when; empty while the lock is as it should be."""
        there = content_of(self.file)
        if self.token.encode() in there if self.token else not there:
            return ""
        if not there:
            return "was removed, or its .lock was"
        return f"was taken over by {owner(there)} at {said(there, 'since', 'an unknown time')}"


@contextlib.contextmanager
def held(folder: UPath, alone: bool = True) -> Iterator[Hold]:
    """Hold the folder as its one writer, or beside others who do not want it alone.

    Raises HeldError, or OSError where nothing can be written. An object can be held alone only: whoever does
    not want it alone is kept away by its holder, and keeps nobody away.
    """
    file = folder.absolute() / ".lock"
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        with by_system(file, alone) as hold:
            yield hold
    elif alone:
        with by_signs_of_life(file) as hold:
            yield hold
    elif file.exists() and not outlived(file):
        raise HeldError(owner(content_of(file)))
    else:
        yield Hold(file, "")


def me() -> str:
    """What others are told of this process."""
    return f"process {os.getpid()} on {platform.node()}"


@contextlib.contextmanager
def by_system(file: UPath, alone: bool) -> Iterator[Hold]:
    """Hold a file's lock, which is free again when this process is no more."""
    lock = os.open(str(file), os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(lock, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise HeldError(owner(content_of(file))) from error
        token = uuid.uuid4().hex if alone else PARTS
        text = content(signed(token, "" if alone else "parts of a run, the last that began by "), 0)
        os.pwrite(lock, text, 0)  # over what is there, so that whoever reads meanwhile finds a token
        os.ftruncate(lock, len(text))
        yield Hold(file, token)
    finally:
        os.close(lock)


@contextlib.contextmanager
def by_signs_of_life(file: UPath) -> Iterator[Hold]:
    """Hold an object, and rewrite it now and then."""
    hold, ended = Hold(file, uuid.uuid4().hex), threading.Event()
    mine = signed(hold.token)
    if not (acquire(file, mine) or (outlived(file) and acquire(file, mine))):
        raise HeldError(owner(content_of(file)))

    def beat() -> None:
        for number in itertools.count(1):
            if ended.wait(BEAT):
                return
            with contextlib.suppress(Exception):  # of the network: the next beat may come through
                if hold.lost():
                    return
                file.fs.pipe_file(file.path, content(mine, number))

    beating = threading.Thread(target=beat, daemon=True)
    beating.start()
    try:
        yield hold
    finally:
        ended.set()
        beating.join()
        if not hold.lost():
            file.unlink(missing_ok=True)


def signed(token: str, role: str = "") -> dict[str, str]:
    """What a lock says of its holder."""
    since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    return {"owner": f"{role}{me()}", "since": since, "token": token}


def content(holder: dict[str, str], beat: int) -> bytes:
    """What a lock holds; no two holders or beats write the same, but for writers of parts."""
    return json.dumps(holder | {"beat": beat}).encode() + b"\n"


def acquire(file: UPath, mine: dict[str, str]) -> bool:
    """Whether the lock was not there and is ours now.

    One that is there is looked for first, for not every store heeds that a new object is asked for.
    """
    if file.exists():
        return False
    try:
        file.fs.pipe_file(file.path, content(mine, 0), mode="create")
    except FileExistsError:
        return False
    return True


def outlived(file: UPath) -> bool:
    """Watch the lock; whether its holder gave no sign of life, in which case it is removed."""
    before, deadline = content_of(file), time.monotonic() + SILENCE
    warnings.warn(
        f"{file.parent} is held by {owner(before)}: waiting {SILENCE:g} s for a sign of life", stacklevel=2
    )
    while time.monotonic() < deadline:
        time.sleep(min(1.0, SILENCE / 10))
        if content_of(file) != before:
            return not file.exists()
    file.unlink(missing_ok=True)
    return True


def content_of(file: UPath) -> bytes:
    """What the lock holds; nothing if it is gone."""
    try:
        content: Any = file.fs.cat_file(file.path)  # at once: what is opened may be another when it is read
        return content
    except (FileNotFoundError, NotADirectoryError):
        return b""


def owner(held: bytes) -> str:
    """Who wrote a lock."""
    return said(held, "owner", "another process")


def said(held: bytes, entry: str, unknown: str) -> str:
    """An entry of a lock."""
    try:
        return str(json.loads(held.split(b"\n")[0])[entry])  # a longer one may end behind it
    except (ValueError, KeyError, TypeError):
        return unknown
