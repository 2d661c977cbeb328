"""How far a run is: a live bar on a terminal, otherwise a plain line each half minute, on stderr."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

HEARTBEAT = 30.0  # [s]

Report = Callable[[int, int, int], None]


@contextlib.contextmanager
def reporting() -> Iterator[Report]:
    """A function to tell of lanes done, lanes in all, lanes failed."""
    if sys.stderr.isatty():
        with bar() as report:
            yield report
    else:
        yield heartbeat()


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
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("lanes", total=None, rate="", failed=0)
        speed = Speed()

        def report(done: int, total: int, failed: int) -> None:
            speed.note(done)
            progress.update(task, completed=done, total=total, failed=failed, rate=speed.text())

        yield report


def heartbeat() -> Report:
    """A line now and then."""
    speed, last = Speed(), [time.monotonic()]

    def report(done: int, total: int, failed: int) -> None:
        speed.note(done)
        if time.monotonic() - last[0] >= HEARTBEAT and done < total:
            last[0] = time.monotonic()
            left = speed.left(total - done)
            print(
                f"{done}/{total} lanes  {speed.text()}  {failed} failed  {left} left",
                file=sys.stderr,
                flush=True,
            )

    return report


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
