"""How far a run is: where there is no terminal, and where there is one."""

import io
import sys
import time
import types

import jaxnet
from jaxnet.view.text import progress


def test_a_line_now_and_then_whether_or_not_anything_has_ended(capsys, monkeypatch):
    """Lanes done and in all, speed, failures and time left; no line after the end."""
    monkeypatch.setattr(progress, "HEARTBEAT", 0.05)

    def line_of(lanes: str) -> str:
        deadline, said = time.monotonic() + 20, ""
        while not said.startswith(lanes) and time.monotonic() < deadline:
            time.sleep(0.01)
            said = (capsys.readouterr().err.splitlines() or [""])[-1]
        return said

    with progress.reporting() as report:
        report(0, 100, 0)
        assert line_of("0/100") == "0/100 lanes  0 failed  unknown time left"
        report(50, 100, 2)
        assert " lanes/s  2 failed  0:00:" in line_of("50/100 lanes")
    capsys.readouterr()
    time.sleep(0.15)
    assert not capsys.readouterr().err


class Terminal(io.StringIO):
    """A terminal that remembers what was written."""

    def isatty(self) -> bool:
        """It is one."""
        return True


def said_of(monkeypatch, stream: io.StringIO, given) -> str:
    """What is written of ten lanes with this `progress` and this standard error."""
    monkeypatch.setattr(sys, "stderr", stream)
    with progress.reporting_to(given) as report:
        report(10, 10, 1)
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
