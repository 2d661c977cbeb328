"""How far a run is, on stderr: a live bar on a terminal or in a notebook, or a line each half minute."""

import contextlib
import importlib.util
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Literal

HEARTBEAT = 30.0  # [s]
REFRESH = 2.0  # [1/s], for a notebook may keep every picture of the bar

Report = Callable[[int, int, int], None]


@contextlib.contextmanager
def reporting() -> Iterator[Report]:
    """A function to tell of lanes done, lanes in all, lanes failed."""
    with bar() if sys.stderr.isatty() else heartbeat() as report:
        yield report


@contextlib.contextmanager
def reporting_to(progress: Report | Literal[False] | None) -> Iterator[Report]:
    """The function given; for None a live bar where somebody may look at it; else one that tells nobody."""
    if callable(progress):
        yield progress
    elif progress is not False and (sys.stderr.isatty() or in_ipython()):
        with bar() as report:
            yield report
    else:
        yield lambda done, total, failed: None


def in_ipython() -> bool:
    """Whether IPython runs this, as it does a notebook's cells."""
    return "IPython" in sys.modules and sys.modules["IPython"].get_ipython() is not None


@contextlib.contextmanager
def bar() -> Iterator[Report]:
    """A live bar."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = [
        TextColumn("lanes"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TextColumn("{task.fields[failed]} failed"),
        TimeRemainingColumn(),
    ]
    console = Console(stderr=True)
    if console.is_jupyter and not importlib.util.find_spec("ipywidgets"):  # which rich would ask for
        console = Console(stderr=True, force_jupyter=False, force_terminal=True)
    with Progress(*columns, console=console, refresh_per_second=REFRESH) as progress:
        task = progress.add_task("lanes", total=None, rate="", failed=0)
        speed = Speed()

        def report(done: int, total: int, failed: int) -> None:
            speed.note(done)
            progress.update(task, completed=done, total=total, failed=failed, rate=speed.text())

        yield report


@contextlib.contextmanager
def heartbeat() -> Iterator[Report]:
    """A line each half minute, also while nothing comes to its end."""
    speed, ended, now = Speed(), threading.Event(), (0, 0, 0)

    def report(done: int, total: int, failed: int) -> None:
        nonlocal now
        speed.note(done)
        now = done, total, failed

    def beat() -> None:
        while not ended.wait(HEARTBEAT):
            done, total, failed = now
            words = [
                f"{done}/{total} lanes",
                speed.text(),
                f"{failed} failed",
                f"{speed.left(total - done)} left",
            ]
            print("  ".join(filter(None, words)), file=sys.stderr, flush=True)

    beating = threading.Thread(target=beat, daemon=True)
    beating.start()
    try:
        yield report
    finally:
        ended.set()
        beating.join()


class Speed:
    """Lanes per second since the first note."""

    def __init__(self):
        self.start: tuple[float, int] | None = None
        self.rate = 0.0

    def note(self, done: int) -> None:
        """So many lanes are done now."""
        now = time.monotonic()
        if self.start is None:
            self.start = (now, done)
        elif now > self.start[0]:
            self.rate = (done - self.start[1]) / (now - self.start[0])

    def text(self) -> str:
        """The speed in words."""
        return f"{self.rate:.3g} lanes/s" if self.rate else ""

    def left(self, lanes: int) -> str:
        """Time for so many lanes, as minutes and seconds."""
        if not self.rate:
            return "unknown time"
        seconds = round(lanes / self.rate)
        return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
