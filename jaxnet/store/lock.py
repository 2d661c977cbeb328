"""The lock of a results folder: one writer alone, or several that write shards of their own.

`.lock` names the holder: its process, since when, and a token that no other holder has. On a disk
the system locks the file, and the lock ends with the holder's process. In an object store the
holder rewrites the object every `BEAT` seconds; another process may take the folder over when the
object stays the same for `SILENCE`.

A holder reads `.lock` before each write (`Hold.lost`). A holder that finds another token, or no
lock, does not write again. No signal and no thread takes part in this, so it also works where
signals are ignored.

Between the look and the write another process may take the folder over. Then at most one file of
each thread of the earlier holder arrives late; docs/architecture.md says why that does no harm.
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
from typing import NamedTuple, cast

from upath import UPath

BEAT, SILENCE = 5.0, 20.0  # [s]
MOST_LOCK = 2**12  # bytes of a lock
PARTS = "parts"  # the token that all writers of parts share on a disk


class HeldError(Exception):
    """A folder that another process holds; the message names the process."""


class Hold(NamedTuple):
    """A lock as its holder knows it: a file and the token in it, or no token and no lock."""

    file: UPath
    token: str

    def lost(self) -> str:
        """Who holds the folder instead, and since when; "" while the lock is intact."""
        there = read_lock(self.file)
        if self.token.encode() in there if self.token else not there:
            return ""
        if not there:
            return "was removed, or its .lock was"
        since = lock_entry(there, "since", "an unknown time")
        return f"was taken over by {owner(there)} at {since}"


@contextlib.contextmanager
def hold_folder(folder: UPath, alone: bool = True) -> Iterator[Hold]:
    """Hold the folder as its only writer, or beside other writers of shards.

    Raises HeldError, or OSError where the folder cannot be written. In an object store, a writer of
    shards takes no lock. A single writer keeps it away, and it keeps no writer away.
    """
    file = folder.absolute() / ".lock"
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        with hold_file(file, alone) as hold:
            yield hold
    elif alone:
        with hold_object(file) as hold:
            yield hold
    elif file.exists() and not remove_silent(file):
        raise HeldError(owner(read_lock(file)))
    else:
        yield Hold(file, "")


@contextlib.contextmanager
def hold_file(file: UPath, alone: bool) -> Iterator[Hold]:
    lock = os.open(str(file), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    try:
        try:
            fcntl.flock(lock, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise HeldError(owner(read_lock(file))) from error
        token = uuid.uuid4().hex if alone else PARTS
        role = "" if alone else "parts of a run, the last that began by "
        text = lock_content(holder_entries(token, role), 0)
        # over what is there, so that whoever reads meanwhile finds a token
        os.pwrite(lock, text, 0)
        os.ftruncate(lock, len(text))
        yield Hold(file, token)
    finally:
        os.close(lock)


@contextlib.contextmanager
def hold_object(file: UPath) -> Iterator[Hold]:
    hold, ended = Hold(file, uuid.uuid4().hex), threading.Event()
    mine = holder_entries(hold.token)
    if not (acquire(file, mine) or (remove_silent(file) and acquire(file, mine))):
        raise HeldError(owner(read_lock(file)))

    def beat() -> None:
        for number in itertools.count(1):
            if ended.wait(BEAT):
                return
            with contextlib.suppress(Exception):  # of the network: the next beat may come through
                if hold.lost():
                    return
                file.fs.pipe_file(file.path, lock_content(mine, number))

    beating = threading.Thread(target=beat, daemon=True)
    beating.start()
    try:
        yield hold
    finally:
        ended.set()
        beating.join()
        if not hold.lost():
            file.unlink(missing_ok=True)


def holder_entries(token: str, role: str = "") -> dict[str, str]:
    since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    process = f"{role}process {os.getpid()} on {platform.node()}"
    return {"owner": process, "since": since, "token": token}


def lock_content(holder: dict[str, str], beat: int) -> bytes:
    """Bytes of a lock. They differ between holders and beats, except for writers of shards."""
    return json.dumps(holder | {"beat": beat}).encode() + b"\n"


def acquire(file: UPath, mine: dict[str, str]) -> bool:
    if file.exists():  # some stores ignore exclusive creation
        return False
    try:
        file.fs.pipe_file(file.path, lock_content(mine, 0), mode="create")
    except FileExistsError:
        return False
    return True


def remove_silent(file: UPath) -> bool:
    """Remove the lock if its holder does not change it for `SILENCE`; return whether it is gone."""
    before, deadline = read_lock(file), time.monotonic() + SILENCE
    told = f"is held by {owner(before)}: waiting {SILENCE:g} s for a sign of life"
    warnings.warn(f"{file.parent} {told}", stacklevel=2)
    while time.monotonic() < deadline:
        time.sleep(min(1.0, SILENCE / 10))
        if read_lock(file) != before:
            return not file.exists()
    file.unlink(missing_ok=True)
    return True


def read_lock(file: UPath) -> bytes:
    """Bytes of the lock, read at once, since it may be replaced meanwhile; empty without one."""
    most = {"start": 0, "end": MOST_LOCK} if isinstance(file, Path) else {}
    try:
        return cast(bytes, file.fs.cat_file(file.path, **most))
    except (FileNotFoundError, NotADirectoryError):
        return b""


def owner(held: bytes) -> str:
    return lock_entry(held, "owner", "another process")


def lock_entry(held: bytes, entry: str, unknown: str) -> str:
    try:
        return str(json.loads(held.split(b"\n")[0])[entry])  # a longer one may end behind it
    except (ValueError, KeyError, TypeError):
        return unknown
