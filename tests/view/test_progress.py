"""How far a run is, where there is no terminal."""

import time

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
