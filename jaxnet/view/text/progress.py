"""How far a run or other long work is, on stderr: live where one may look, or a line each half minute."""

import contextlib
import importlib.util
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from jaxnet.statistics.steps import Steps
from jaxnet.view.text import standing

if TYPE_CHECKING:
    from jaxnet.runs.tally import Tally

HEARTBEAT = 30.0  # [s]
REFRESH = 2.0  # [1/s], for a notebook may keep every picture of the bar

Progress = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed
Report = Callable[["Tally"], None]


@contextlib.contextmanager
def reporting(progress: Progress | bool | None) -> Iterator[Report]:
    """A function to tell how a run stands, who passes it on to the one given.

    For None that is a live bar where somebody may look at it, and else nobody; for True a line each half
    minute there; for False nobody.
    """
    if callable(progress):
        yield lambda tally: progress(tally.done, tally.total, tally.failed)
    elif progress is not False and looked_at():
        with bar() as report:
            yield report
    elif progress:
        with heartbeat() as report:
            yield report
    else:
        yield lambda tally: None


def looked_at() -> bool:
    """Whether stderr is a terminal's or a notebook's."""
    ipython = "IPython" in sys.modules and sys.modules["IPython"].get_ipython() is not None
    return sys.stderr.isatty() or ipython


@contextlib.contextmanager
def bar() -> Iterator[Report]:
    """A live bar, and below it how the cells stand."""
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

    def below() -> Iterable[Any]:
        if now:
            live.update(task, speed=speed.words(now[0]))
            yield from standing.lines(now[0], live.console.width, live.console.height)

    live = live_bar(columns, below)
    task = live.add_task("lanes", total=None, speed="", failed=0)

    def report(tally: "Tally") -> None:
        now[:] = [tally]
        speed.note(tally.done)
        live.update(task, completed=tally.done, total=tally.aim, failed=tally.failed)

    with live:
        yield report
        now.clear()  # the summary comes next


def live_bar(columns: Iterable[Any], below: Callable[[], Iterable[Any]]) -> Any:
    """A bar of these columns, drawn twice a second, and what is `below` it then."""
    from rich.console import Console
    from rich.progress import Progress

    class Live(Progress):
        """With more than bars."""

        def get_renderables(self) -> Iterable[Any]:
            """What is below is asked for first, for it may change the bar."""
            beneath = list(below())
            yield from super().get_renderables()
            yield from beneath

    console = Console(stderr=True)
    if console.is_jupyter and not importlib.util.find_spec("ipywidgets"):  # which rich would ask for
        console = Console(stderr=True, force_jupyter=False, force_terminal=True)
    return Live(*columns, console=console, refresh_per_second=REFRESH)


@contextlib.contextmanager
def heartbeat() -> Iterator[Report]:
    """A line each half minute, also while nothing comes to its end."""
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

    with beating(line):
        yield report


@contextlib.contextmanager
def beating(line: Callable[[], str]) -> Iterator[None]:
    """Write a line to stderr each half minute, unless it is empty."""
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
def stepping() -> Iterator[Steps]:
    """A function to tell of the steps of work other than a run's; nothing of it stays on a terminal."""
    if not sys.stderr.isatty():
        now = [""]

        def note(what: str, done: int, total: int) -> None:
            now[:] = [f"{what}: {done}/{total}"]

        with beating(lambda: now[0]):
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
        """So many lanes are done now."""
        now = time.monotonic()
        if self.start is None:
            self.start = (now, done)
        elif now > self.start[0]:
            self.rate = (done - self.start[1]) / (now - self.start[0])

    def words(self, tally: "Tally") -> str:
        """The speed, or what is waited for."""
        if tally.compiling:
            return "compiling"
        return f"{self.rate:.3g} lanes/s" if self.rate else "first lanes under way"

    def left(self, lanes: int) -> str:
        """Time for so many lanes, as minutes and seconds."""
        if not self.rate:
            return "unknown time"
        seconds = round(lanes / self.rate)
        return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
