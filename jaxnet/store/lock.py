"""Who holds a results folder: one writer, or several that write shards of their own.

On a local or shared disk the system's file lock says so, which dies with its holder. Elsewhere `.lock` is an
object that its holder rewrites every `BEAT` seconds; one that stays the same for `SILENCE` is a dead one's.
A holder that was silent for so long without being dead finds another's object there, and is interrupted.
"""

import contextlib
import fcntl
import itertools
import json
import os
import platform
import signal
import threading
import time
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from upath import UPath

BEAT, SILENCE = 5.0, 20.0  # [s]


class HeldError(Exception):
    """Somebody else holds the folder; says who."""


@contextlib.contextmanager
def held(folder: UPath, alone: bool = True) -> Iterator[None]:
    """Hold the folder as its one writer, or beside others who do not want it alone.

    Raises HeldError, or OSError where nothing can be written. An object can be held alone only: whoever does
    not want it alone is kept away by its holder, and keeps nobody away.
    """
    file = folder / ".lock"
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        with by_system(file, alone):
            yield
    elif alone:
        with by_signs_of_life(file):
            yield
    elif file.exists() and not outlived(file):
        raise HeldError(owner(content_of(file)))
    else:
        yield


def me() -> str:
    """What others are told of this process."""
    return f"process {os.getpid()} on {platform.node()}"


@contextlib.contextmanager
def by_system(file: UPath, alone: bool) -> Iterator[None]:
    """Hold a file's lock, which is free again when this process is no more."""
    with file.open("a+") as lock:
        try:
            fcntl.flock(lock, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.seek(0)
            raise HeldError(lock.read().strip() or "another process") from error
        lock.truncate(0)
        lock.write(me() if alone else f"parts of a run, the last that began by {me()}")
        lock.flush()
        yield


@contextlib.contextmanager
def by_signs_of_life(file: UPath) -> Iterator[None]:
    """Hold an object, and rewrite it now and then."""
    token, ended, lost = uuid.uuid4().hex, threading.Event(), threading.Event()
    if not (acquire(file, token) or (outlived(file) and acquire(file, token))):
        raise HeldError(owner(content_of(file)))

    def beat() -> None:
        there = b""
        for number in itertools.count(1):
            if ended.wait(BEAT):
                return
            with contextlib.suppress(Exception):  # of the network: the next beat may come through
                if token.encode() not in (there := content_of(file)):
                    break
                file.fs.pipe_file(file.path, content(token, number))
        lost.set()
        warnings.warn(f"{file.parent} was taken over by {owner(there)}", stacklevel=2)
        os.kill(os.getpid(), signal.SIGINT)

    beating = threading.Thread(target=beat, daemon=True)
    beating.start()
    try:
        yield
    finally:
        ended.set()
        beating.join()
        if not lost.is_set():
            file.unlink(missing_ok=True)


def content(token: str, beat: int) -> bytes:
    """What a lock holds; no two holders or beats write the same."""
    return json.dumps({"owner": me(), "token": token, "beat": beat}).encode()


def acquire(file: UPath, token: str) -> bool:
    """Whether the lock was not there and is ours now.

    One that is there is looked for first, for not every store heeds that a new object is asked for.
    """
    if file.exists():
        return False
    try:
        file.fs.pipe_file(file.path, content(token, 0), mode="create")
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
    except FileNotFoundError:
        return b""


def owner(held: bytes) -> str:
    """Who wrote a lock."""
    try:
        return str(json.loads(held)["owner"])
    except (ValueError, KeyError, TypeError):
        return "another process"
