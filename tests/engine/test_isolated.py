"""Vehicles that decisions cut off from the navigator: lanes fail or they coast. Who, since when."""

import numpy as np
import pytest

import jaxnet
from jaxnet.engine.status import Status
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import NotNegative
from jaxnet.store import rows
from jaxnet.view.text import tables
from tests import systems

TICK, TICKS = 0.1, 30
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}
NEAR = {"initial": {"position": {"uniform": [-20.0, 20.0]}}}


class LastDrops(Defence):
    """From one time on, vehicle 3 drops its only source; from another on it believes it again."""

    kind = "last_drops"

    since: NotNegative = 0.0
    until: NotNegative = 100.0

    def decide(self, own, received, last, memory, around):
        """By the time alone."""
        on = (around.time > self.since - 1e-9) & (around.time < self.until - 1e-9)
        third = (around.sources == 2)[:, :, None]
        return ~(third & on[None, None]), memory


def test_a_vehicle_cut_off_is_counted_from_that_tick_on():
    """The path's last vehicle keeps its drive; how it moves: test_stopping.py."""
    defence = {"kind": f"{__name__}:LastDrops", "isolated": "coast"}
    keys = KEYS | NEAR | {"topology": "path", "vehicles": 3, "attack": "none"}
    begins = [0.0, 0.7]
    study = systems.study(engine="exact", defence=defence, sweep={"defence.since": begins}, **keys)
    outcome = systems.simulate(systems.lanes(study, 1))
    assert (outcome.status == Status.ok).all()
    counted, ticks = outcome.cut_off, TICKS + 1 - np.round(np.array(begins) / TICK)
    assert counted["cut_off"].tolist() == [3, 3]
    np.testing.assert_allclose(counted["cut_off_at"], begins, atol=1e-12)
    assert counted["cut_off_vehicles"].tolist() == [1, 1]
    assert outcome.unheard.tolist() == ticks.tolist()
    np.testing.assert_allclose(counted["cut_off_share"], ticks / (3 * (TICKS + 1)))


LINKS = [[1, 0], [2, 0], [1, 3], [2, 4], [3, 1], [3, 2], [4, 2], [4, 3], [4, 5], [5, 3], [5, 4]]
LINKS += [[5, 1]]
ATTACKED = {
    "topology": {"kind": "edges", "edges": [[*link, 1.0] for link in LINKS]},
    "vehicles": 5,
    "gain": [2.0, 4.0, 2.5],
    "attack": {"kind": "rotating", "vehicles": [2, 4], "magnitude": 8.0, "frequency": 2.0},
}


@pytest.fixture(scope="module")
def results():
    """Lanes without decisions, lanes that fail, and lanes whose vehicles coast, two of each."""
    coasts = {"kind": "w_msr", "isolated": "coast", "label": "coasts"}
    defences = [{"kind": "none"}, {"kind": "w_msr"}, coasts]
    keys = {"engine": "exact", "seed": 6, "samples": 2, "sweep": {"defence": defences}}
    return jaxnet.simulate({**keys, **ATTACKED, **KEYS, **NEAR}, progress=False)


def test_rows_tell_who_since_when_and_how_long(results):
    """All rows of a study have the same columns; `show` names the vehicle of a failed lane."""
    counted = results.lanes[["cut_off", "cut_off_at", "cut_off_vehicles", "cut_off_share"]]
    assert counted["cut_off"].tolist() == [0, 0, 3, 4, 3, 4]
    np.testing.assert_array_equal(counted["cut_off_at"], [np.nan, np.nan, 0.0, 1.2, 0.0, 1.2])
    assert counted["cut_off_vehicles"][4:].tolist() == [3, 2]
    np.testing.assert_allclose(counted["cut_off_share"][4:], [44 / 155, 20 / 155])
    count, failed = results.failed(9)
    assert count == 2
    assert failed["cut_off"].tolist() == [3, 4]
    told = " ".join(tables.failures_text(results).split())
    assert "disconnected, vehicle 3 since 0 s" in told
    cut_off = ["cut_off", "cut_off_at"]
    for law, defence, known in (
        ("local", "w_msr", []),
        ("exact", "w_msr", cut_off),
        ("exact", "none", []),
    ):
        given = jaxnet.load({"defence": defence, "law": law})
        assert rows.row_columns(given.config, given.cells).isolation == known
