"""Progress of long work on stderr: a live bar, or without a terminal a line each half minute."""

import contextlib
import importlib.util
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from datetime import timedelta
from typing import TYPE_CHECKING

import numpy as np

from jaxnet.config.cells import is_leaderless
from jaxnet.model.wording import number_text
from jaxnet.statistics.recovery import share_name
from jaxnet.statistics.steps import Steps
from jaxnet.view.text.width import cell_title, digits_text

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress, ProgressColumn
    from rich.text import Text

    from jaxnet.runs.tally import Tally

HEARTBEAT = 30.0  # [s]
FORETOLD_AFTER = 5.0  # [s] of work before its end is foretold
QUIET = 30.0  # [s] without an end that are said
REFRESH = 2.0  # [1/s], for a notebook may keep every picture of the bar
MOST_LINES = 8  # of cells below the bar
OTHER_LINES = 5  # that are no cell's: the bar, the head, two notes, the one that the cursor is in

ReportLanes = Callable[[int, int, int], None]  # lanes done, lanes in all, lanes failed
ShowTally = Callable[["Tally"], None]


@contextlib.contextmanager
def report_progress(progress: ReportLanes | bool | None) -> Iterator[ShowTally]:
    """Yield a function that takes the tally of a run and reports its progress.

    A function `progress` receives the numbers of lanes done, in all and failed. None means a live
    bar on a terminal or in a notebook, else no report. True means a line each half minute where no
    bar is possible. False means no report.
    """
    if callable(progress):
        yield lambda tally: progress(tally.done, tally.total, tally.failed)
        return
    ipython = "IPython" in sys.modules and sys.modules["IPython"].get_ipython() is not None
    bar = progress is not False and (sys.stderr.isatty() or ipython)
    if not bar and not progress:
        yield lambda tally: None
        return
    speed, now = Speed(), list["Tally"]()

    def report(tally: "Tally") -> None:
        now[:] = [tally]
        speed.note(tally.done)

    def line() -> str:
        if not now:
            return "preparing"
        if now[0].done >= now[0].aim:
            return now[0].phase
        return f"{now[0].done}/{now[0].aim} lanes  {speed.told(now[0])}"

    with show_bar(speed, now) if bar else print_regularly(line):
        yield report


@contextlib.contextmanager
def show_bar(speed: "Speed", now: list["Tally"]) -> Iterator[None]:
    """Show a live bar of the tally in `now`, with the cells' results so far below it."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

    told = TextColumn("{task.fields[told]}")

    def below() -> "Iterable[RenderableType]":
        for tally in now:
            live.update(task, completed=tally.done, total=tally.aim, told=speed.told(tally))
            yield from standing_lines(tally, live.console.width, live.console.height)

    live = live_bar([TextColumn("lanes"), BarColumn(), MofNCompleteColumn(), told], below)
    task = live.add_task("lanes", total=None, told="")
    with live:
        yield
        live.refresh()
        now.clear()  # the summary comes next


def live_bar(
    columns: Iterable["ProgressColumn"], below: Callable[[], "Iterable[RenderableType]"]
) -> "Progress":
    """A bar of these columns, drawn twice a second, with the output of `below` under it."""
    from rich.console import Console
    from rich.progress import Progress

    class Live(Progress):
        def get_renderables(self) -> "Iterable[RenderableType]":
            beneath = list(below())  # first, as it may change the bar
            yield from super().get_renderables()
            yield from beneath

    console = Console(stderr=True)
    if console.is_jupyter and not importlib.util.find_spec("ipywidgets"):  # which rich asks for
        console = Console(stderr=True, force_jupyter=False, force_terminal=True)
    return Live(*columns, console=console, refresh_per_second=REFRESH)


@contextlib.contextmanager
def print_regularly(line: Callable[[], str]) -> Iterator[None]:
    """Print to stderr each half minute what is done, after the time since the start."""
    ended, start = threading.Event(), time.monotonic()

    def beat() -> None:
        while not ended.wait(HEARTBEAT):
            passed = timedelta(seconds=round(time.monotonic() - start))
            print(f"{passed}  {line()}", file=sys.stderr, flush=True)

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def report_work(what: str) -> Iterator[None]:
    """Name work that has no steps each half minute, where there is no terminal."""
    with contextlib.nullcontext() if sys.stderr.isatty() else print_regularly(lambda: what):
        yield


@contextlib.contextmanager
def report_steps() -> Iterator[Steps]:
    """Yield a function that reports steps of work; a terminal keeps no trace."""
    if not sys.stderr.isatty():
        now: list[Callable[[], str]] = [lambda: "preparing"]
        speeds = dict[str, Speed]()

        def note(what: str, done: int, total: int) -> None:
            speed = speeds.setdefault(what, Speed())
            if done:  # the clock starts after the first step, which may compile
                speed.note(done)
            now[:] = [lambda: "  ".join([f"{what}: {done}/{total}", *speed.left(total - done)])]

        with print_regularly(lambda: now[0]()):
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
    """Lanes or steps per second from the first note until now: less and less while none end."""

    def __init__(self):
        self.notes: list[tuple[float, int]] = []  # the first one, and the last one with an end
        self.ends = 0  # notes with an end

    def note(self, done: int) -> None:
        if not self.notes or done != self.notes[-1][1]:
            self.ends += bool(self.notes)
            self.notes[1:] = [(time.monotonic(), done)]

    @property
    def rate(self) -> float:
        if len(self.notes) < 2:
            return 0.0
        (start, there), (_, done) = self.notes
        return (done - there) / (time.monotonic() - start or np.inf)

    def told(self, tally: "Tally") -> str:
        failed = f"{tally.failed} failed"
        return "  ".join([self.words(tally), failed, *self.left(tally.aim - tally.done)])

    def words(self, tally: "Tally") -> str:
        """The speed, the present stage if no lane is done, or what follows if all are."""
        if tally.done >= tally.aim:
            return tally.phase
        if tally.compiling:
            return "compiling"
        return f"{number_text(self.rate)} lanes/s" if self.rate else "first lanes under way"

    def left(self, number: int) -> list[str]:
        """The time that so many lanes or steps more take, and for how long none has ended.

        The time is not foretold while none has ended for twice the mean time between ends.
        """
        if not number or not (rate := self.rate):
            return []
        now = time.monotonic()
        passed, quiet = (now - when for when, _ in self.notes)
        ahead, still = (timedelta(seconds=round(each)) for each in (number / rate, quiet))
        slow = quiet > 2 * (passed - quiet) / self.ends
        told = {
            f"{'-' if slow else ahead} left": passed > FORETOLD_AFTER,
            f"nothing finished for {still}": quiet > QUIET,
        }
        return [words for words, said in told.items() if said]


def standing_lines(tally: "Tally", width: int, height: int) -> "Iterator[str | Text]":
    """Yield a header, a line for each of the worst cells, and notes, as the height permits.

    Nothing is yielded before the first lanes end, or in a terminal of a few lines.
    """
    found, room = tally.standing(), min(MOST_LINES, height - OTHER_LINES)
    if not found or room < 1:
        return
    from rich.text import Text

    asked = any(np.isfinite(each.unrecovered) for each in found)
    mean = "spread [m]" if is_leaderless(tally.cells) else "error [m]"
    heads = ["lanes", mean, f"{share_name(tally.cells)} [%]"][: 3 if asked else 2]
    found.sort(key=lambda each: (-np.nan_to_num(each.unrecovered, nan=-1.0), -each.mean))
    worst = sorted(found[:room])
    rows = [heads]
    for each in worst:
        share = digits_text(100 * each.unrecovered, whole=100.0)
        rows.append([f"{each.lanes:,}", number_text(each.mean), share][: len(heads)])
    columns = [2 + max(map(len, column)) for column in zip(*rows, strict=True)]
    left = width - sum(columns)
    names = ["so far", *(cell_title(tally.cells[each.cell], left) for each in worst)]
    longest = max(map(len, names))
    for name, words in zip(names, rows, strict=True):
        numbers = "".join(f"{word:>{wide}}" for word, wide in zip(words, columns, strict=True))
        yield Text(f"{name:<{longest}}{numbers}", no_wrap=True)
    if len(tally.cells) > room:
        by = f"shares {share_name(tally.cells)}" if asked else "means"
        yield f"of {len(tally.cells)} cells those with the greatest {by}"
    if tally.last_look:
        yield Text(f"widest interval: {tally.last_look}", no_wrap=True)
