"""How far a run is: where there is no terminal, and where there is one."""

import io
import re
import sys
import time
import types

import numpy as np
import pandas as pd

import jaxnet
from jaxnet.config.keys import Recovery
from jaxnet.engine import programs
from jaxnet.runs.tally import Done, Sums, Tally, sums_of
from jaxnet.view.text import progress
from tests import systems


def tally_of(done: int, total: int) -> Tally:
    """Of a study of one cell."""
    tally = Tally(systems.study().cells, total, recovery=False)
    tally.under_way = done
    return tally


def test_a_line_now_and_then_whether_or_not_anything_has_ended(capsys, monkeypatch):
    """Lanes done and in all, speed, failures and time left; no line after the end."""
    monkeypatch.setattr(progress, "HEARTBEAT", 0.05)
    monkeypatch.setattr(progress, "FORETOLD_AFTER", 0.0)

    def line_of(lanes: str) -> str:
        return next_line(capsys, lanes)

    with progress.report_progress(True) as report:
        assert line_of("preparing") == "preparing"
        report(tally := tally_of(0, 100))
        assert line_of("0/100") == "0/100 lanes  first lanes under way  0 failed"
        programs.COMPILING.add(0)
        assert line_of("0/100 lanes  compiling") == "0/100 lanes  compiling  0 failed"
        programs.COMPILING.clear()
        tally.record([Done(0, 0, Sums(50, 48, 0, 0.0))])
        report(tally)
        assert " lanes/s  2 failed  0:00:" in line_of("50/100 lanes")
        tally.record([Done(1, 0, Sums(50, 50, 0, 0.0))])
        assert line_of("writing") == "writing results"
        tally.phase = "trajectories, cell 12 of 40"
        assert line_of("trajectories") == "trajectories, cell 12 of 40"
    capsys.readouterr()
    time.sleep(0.15)
    assert not capsys.readouterr().err


def test_no_time_is_foretold_while_nothing_ends(monkeypatch):
    """240 of 1,440 lanes in ten seconds in two chunks, then none: a dash after ten seconds more."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    speed, tally = progress.Speed(), tally_of(0, 1440)
    speed.note(0)
    assert speed.told(tally) == "first lanes under way  0 failed"
    now[0], tally.under_way = 102.0, 100
    speed.note(100)
    assert speed.told(tally) == "50 lanes/s  0 failed"  # too early to foretell the end
    now[0], tally.under_way = 110.0, 240
    speed.note(240)
    assert speed.told(tally) == "24 lanes/s  0 failed  0:00:50 left"
    now[0] = 120.0
    assert speed.told(tally) == "12 lanes/s  0 failed  0:01:40 left"
    now[0] = 121.0
    assert speed.told(tally) == "11.4 lanes/s  0 failed  - left"
    now[0] = 640.0
    assert speed.told(tally) == "0.444 lanes/s  0 failed  - left  nothing finished for 0:08:50"
    now[0], tally.under_way = 650.0, 1440
    speed.note(1440)
    assert speed.told(tally) == "writing results  0 failed"


def next_line(capsys, begin: str) -> str:
    """The next line that begins so after the time that has passed, or the last one in 20 s."""
    deadline, said = time.monotonic() + 20, ""
    while not said.startswith(begin) and time.monotonic() < deadline:
        time.sleep(0.01)
        passed, _, said = (capsys.readouterr().err.splitlines() or [""])[-1].partition("  ")
        assert re.fullmatch(r"(0:00:\d\d)?", passed)
    return said


def test_work_without_a_terminal_is_named(capsys, monkeypatch):
    """With steps and without; the first step, which may compile, foretells no end."""
    monkeypatch.setattr(progress, "HEARTBEAT", 0.05)
    monkeypatch.setattr(progress, "FORETOLD_AFTER", 0.0)
    with progress.report_work("comparing lanes"):
        assert next_line(capsys, "comparing") == "comparing lanes"
    with progress.report_steps() as note:
        assert next_line(capsys, "preparing") == "preparing"
        note("curves fitted", 0, 12)
        assert next_line(capsys, "curves") == "curves fitted: 0/12"
        note("curves fitted", 1, 12)
        assert next_line(capsys, "curves fitted: 1") == "curves fitted: 1/12"
        note("curves fitted", 3, 12)
        told = next_line(capsys, "curves fitted: 3")
        assert re.fullmatch(r"curves fitted: 3/12  0:00:\d\d left", told)


def test_nothing_compiles_while_lanes_move(monkeypatch):
    """A program is compiled, then runs; its first load is not told as compiling."""
    told, compile_one = list[bool](), programs.by_kept_trace

    def watched(described, *given):
        program = compile_one(described, *given)
        if described == b"bits":  # draws lanes
            return program
        told.append(programs.compiling())
        return lambda *leaves: (told.append(programs.compiling()), program(*leaves))[1]

    monkeypatch.setattr(programs, "by_kept_trace", watched)
    programs.compiled.cache_clear()  # whatever ran before
    keys = {"horizon": 1.0, "tail": 0.4, "topology": "star", "engine": "exact", "vehicles": 3}
    jaxnet.simulate({**keys, "attack": "none", "defence": "none"}, samples=3, progress=False)
    programs.compiled.cache_clear()  # of the program that is watched
    assert told == [True, False]


class Terminal(io.StringIO):
    """A terminal that remembers what was written."""

    def isatty(self) -> bool:
        """It is one."""
        return True


def said_of(monkeypatch, stream: io.StringIO, given) -> str:
    """What is written of ten lanes with this `progress` and this standard error."""
    monkeypatch.setattr(sys, "stderr", stream)
    with progress.report_progress(given) as report:
        tally = tally_of(0, 10)
        tally.record([Done(0, 0, Sums(10, 9, 0, 0.0))])
        report(tally)
    return stream.getvalue()


def test_a_script_is_told_where_somebody_may_look(monkeypatch):
    """By default on a terminal and in IPython; never where it is turned off, or goes elsewhere."""
    told = []
    assert "10/10" in said_of(monkeypatch, Terminal(), None)
    assert said_of(monkeypatch, io.StringIO(), None) == ""
    assert said_of(monkeypatch, Terminal(), False) == ""
    assert said_of(monkeypatch, Terminal(), lambda *numbers: told.append(numbers)) == ""
    assert told == [(10, 10, 1)]
    shell = types.SimpleNamespace(get_ipython=lambda: "a shell")
    monkeypatch.setitem(sys.modules, "IPython", shell)
    assert "10/10" in said_of(monkeypatch, io.StringIO(), None)
    shell.get_ipython = lambda: None  # imported, by a script
    assert said_of(monkeypatch, io.StringIO(), None) == ""


def test_a_run_reports_by_default_on_a_terminal(monkeypatch):
    """And is silent where it is asked to be."""
    keys = {"horizon": 1.0, "tail": 0.5, "topology": "star", "engine": "exact", "defence": "none"}
    for given, said in ((None, True), (False, False)):
        monkeypatch.setattr(sys, "stderr", terminal := Terminal())
        jaxnet.simulate(keys, progress=given)
        assert ("1/1" in terminal.getvalue()) == said


def test_a_tally_has_the_mean_of_all_rows_however_they_came():
    """Shards told twice, the second time with more rows, in parts; as pandas says."""
    cells, random = (
        systems.study(sweep={"attack.magnitude": [0, 2]}).cells,
        np.random.default_rng(0),
    )
    errors = random.exponential(1.0, 40)
    rows = pd.DataFrame({"status": ["ok"] * 39 + ["singular"], "tail_mean": [*errors[:39], np.nan]})
    tally = Tally(cells, 80, recovery=True)
    tally.under_way = 25
    for shard, part in ((0, rows[:10]), (1, rows[25:]), (0, rows[:25])):
        tally.record([Done(shard, 1, sums_of(cells[1], part, Recovery(tau=0.5)))])
    (told,) = tally.standing()
    assert (told.cell, told.lanes, tally.done, tally.failed, tally.under_way) == (1, 40, 40, 1, 0)
    ok = rows["tail_mean"].dropna()
    assert abs(told.mean - ok.mean()) < 1e-12
    assert told.unrecovered == (ok > 1.0).mean()
    assert tally.counts.unrecovered.tolist() == [0, (ok > 1.0).sum()]


def test_the_lines_below_a_bar_fit_and_name_the_worst_cells():
    """Eight of thirty, with too long labels; fewer in a low terminal, none in a lower one."""
    label = {"kind": "cyclic", "label": "a ring whose name is as long as forty letters"}
    sweep = {"topology": [label], "attack.magnitude": list(range(1, 31)), "gain": [[1, 3, 3]]}
    tally = Tally(systems.study(sweep=sweep).cells, 300, recovery=True)
    tally.record(Done(n, n, Sums(10, 10, n % 10, 1e3 * n)) for n in range(30))
    lines = [str(line) for line in progress.standing_lines(tally, 80, 24)]
    assert max(map(len, lines)) <= 80
    told = [int(line.split(":")[0].removeprefix("cell ")) for line in lines[1:-1]]
    assert told == sorted(sorted(range(30), key=lambda n: (n % 10, n))[-8:])
    assert lines[-1] == "of 30 cells those with the greatest shares unrecovered"
    assert len(list(progress.standing_lines(tally, 80, 7))) == 4
    assert not list(progress.standing_lines(tally, 80, 4))


def test_a_bar_shows_cells_while_it_goes_and_not_after(monkeypatch):
    """What stays on the terminal is the bar alone."""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    with progress.report_progress(None) as report:
        tally = tally_of(0, 10)
        tally.record([Done(0, 0, Sums(10, 10, 0, 20.0))])
        report(tally)
        time.sleep(1.5 / progress.REFRESH)
        assert "error [m]" in terminal.getvalue()
    last = terminal.getvalue().split("10/10")[-1]
    assert "error [m]" not in last
