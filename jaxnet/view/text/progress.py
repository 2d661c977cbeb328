"""Progress of runs and other long work on stderr: a live bar, or a line each half minute."""

import contextlib
import importlib.util
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from jaxnet.statistics.steps import Steps
from jaxnet.view.text import standing

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress, ProgressColumn

    from jaxnet.runs.tally import Tally

HEARTBEAT = 30.0  # [s]
REFRESH = 2.0  # [1/s], for a notebook may keep every picture of the bar

ReportLanes = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed
ShowTally = Callable[["Tally"], None]


@contextlib.contextmanager
def report_progress(progress: ReportLanes | bool | None) -> Iterator[ShowTally]:
    """Yield a function that takes the tally of a run and reports its progress.

    A function `progress` receives the numbers of lanes done, in all and failed. None means a live bar on a
    terminal or in a notebook, else no report. True means a line each half minute where no bar is possible.
    False means no report.
    """
    if callable(progress):
        yield lambda tally: progress(tally.done, tally.total, tally.failed)
    elif progress is not False and has_viewer():
        with report_by_bar() as report:
            yield report
    elif progress:
        with report_by_lines() as report:
            yield report
    else:
        yield lambda tally: None


def has_viewer() -> bool:
    """Return whether stderr belongs to a terminal or a notebook."""
    ipython = "IPython" in sys.modules and sys.modules["IPython"].get_ipython() is not None
    return sys.stderr.isatty() or ipython


@contextlib.contextmanager
def report_by_bar() -> Iterator[ShowTally]:
    """Yield a function that updates a live bar, with the cells' results so far below it."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    columns = [
        TextColumn("lanes"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[speed]}"),
        TextColumn("{task.fields[failed]} failed"),
        TimeRemainingColumn(),
    ]
    speed, now = Speed(), list["Tally"]()

    def below() -> "Iterable[RenderableType]":
        if now:
            live.update(task, speed=speed.words(now[0]))
            yield from standing.standing_lines(now[0], live.console.width, live.console.height)

    live = live_bar(columns, below)
    task = live.add_task("lanes", total=None, speed="", failed=0)

    def report(tally: "Tally") -> None:
        now[:] = [tally]
        speed.note(tally.done)
        live.update(task, completed=tally.done, total=tally.aim, failed=tally.failed)

    with live:
        yield report
        now.clear()  # the summary comes next


def live_bar(
    columns: Iterable["ProgressColumn"], below: Callable[[], "Iterable[RenderableType]"]
) -> "Progress":
    """Return a bar of these columns, drawn twice a second, with the output of `below` under it."""
    from rich.console import Console
    from rich.progress import Progress

    class Live(Progress):
        """With more than bars."""

        def get_renderables(self) -> "Iterable[RenderableType]":
            """Yield the bar, then the lines below it; `below` runs first, as it may change the bar."""
            beneath = list(below())
            yield from super().get_renderables()
            yield from beneath

    console = Console(stderr=True)
    if console.is_jupyter and not importlib.util.find_spec(
        "ipywidgets"
    ):  # which rich would ask for
        console = Console(stderr=True, force_jupyter=False, force_terminal=True)
    return Live(*columns, console=console, refresh_per_second=REFRESH)


@contextlib.contextmanager
def report_by_lines() -> Iterator[ShowTally]:
    """Yield a function that takes the tally; a line appears each half minute, even without news."""
    speed, now = Speed(), list["Tally"]()

    def report(tally: "Tally") -> None:
        now[:] = [tally]
        speed.note(tally.done)

    def line() -> str:
        if not now:
            return ""
        tally = now[0]
        left = f"{speed.left(tally.aim - tally.done)} left"
        return "  ".join(
            [f"{tally.done}/{tally.aim} lanes", speed.words(tally), f"{tally.failed} failed", left]
        )

    with print_regularly(line):
        yield report


@contextlib.contextmanager
def print_regularly(line: Callable[[], str]) -> Iterator[None]:
    """Print a line to stderr each half minute, unless it is empty."""
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(HEARTBEAT):
            if said := line():
                print(said, file=sys.stderr, flush=True)

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def report_steps() -> Iterator[Steps]:
    """Yield a function that reports the steps of work other than a run; a terminal keeps no trace."""
    if not sys.stderr.isatty():
        now = [""]

        def note(what: str, done: int, total: int) -> None:
            now[:] = [f"{what}: {done}/{total}"]

        with print_regularly(lambda: now[0]):
            yield note
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

    live = live_bar([TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()], list)
    live.live.transient = True
    task = live.add_task("", total=None, visible=False)

    def show(what: str, done: int, total: int) -> None:
        live.update(task, description=what, completed=done, total=total, visible=True)

    with live:
        yield show


class Speed:
    """Lanes per second since the first note."""

    def __init__(self):
        self.start: tuple[float, int] | None = None
        self.rate = 0.0

    def note(self, done: int) -> None:
        """Record the number of lanes done at this moment."""
        now = time.monotonic()
        if self.start is None:
            self.start = (now, done)
        elif now > self.start[0]:
            self.rate = (done - self.start[1]) / (now - self.start[0])

    def words(self, tally: "Tally") -> str:
        """Return the speed, or the present stage if no lane is done."""
        if tally.compiling:
            return "compiling"
        return f"{self.rate:.3g} lanes/s" if self.rate else "first lanes under way"

    def left(self, lanes: int) -> str:
        """Return the time for the remaining lanes, as h:mm:ss."""
        if not self.rate:
            return "unknown time"
        seconds = round(lanes / self.rate)
        return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
