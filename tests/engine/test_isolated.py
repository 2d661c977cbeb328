"""Vehicles that decisions cut off from the navigator: lanes fail or they coast. Who, since when."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.engine.status import Status
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import NotNegative
from jaxnet.store import rows
from jaxnet.view.text import tables
from tests import reference, systems
from tests.reference import companion, navigator_at

TICK, TICKS = 0.1, 30
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}
NEAR = {"initial": {"position": {"uniform": [-20.0, 20.0]}}}
TIMES = np.arange(TICKS + 1) * TICK


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


def test_a_vehicle_cut_off_goes_to_rest_where_its_last_drive_leads():
    """The path's last vehicle keeps z and moves by `y^(r) + … + k0 y = z`; others are nominal."""
    defence = {"kind": f"{__name__}:LastDrops", "isolated": "coast"}
    keys = (
        KEYS | NEAR | {"topology": "path", "vehicles": 3, "gain": [2.0, 4.0, 2.5], "attack": "none"}
    )
    begins = [0.0, 0.7]
    given = systems.study(engine="exact", defence=defence, sweep={"defence.since": begins}, **keys)
    one = systems.lanes(given, 1)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number, since in enumerate(begins):
        known = coasting(one, number, since)
        apart = np.abs(outcome.series["state"][number, :, :, :2] - known).max()
        assert apart <= 1e-9
    counted, ticks = outcome.cut_off, TICKS + 1 - np.round(np.array(begins) / TICK)
    assert counted["cut_off"].tolist() == [3, 3]
    np.testing.assert_allclose(counted["cut_off_at"], begins, atol=1e-12)
    assert counted["cut_off_vehicles"].tolist() == [1, 1]
    assert outcome.unheard.tolist() == ticks.tolist()
    np.testing.assert_allclose(counted["cut_off_share"], ticks / (3 * (TICKS + 1)))


def coasting(one, number, since):
    """Positions (ticks + 1, m, 2): nominal, but the last vehicle keeps z from `since` on.

    Until then z is R(y_0); before the first tick, it is the drive of a vehicle without jerk.
    """
    navigator, lane = navigator_at(one, number), systems.lane(one, number)
    gain, initial = lane.gain, lane.initial
    r = len(gain)
    start = reference.flat_jets(initial.T)
    flow, error = companion(gain), start - navigator(0.0)[:r, None]

    def ahead(jets, time):
        return np.einsum("kl,lmx->kmx", expm(flow * time), jets)

    known = np.array([navigator(t)[0] + ahead(error, t)[0] for t in TIMES])
    z = (
        np.append(gain, 1.0) @ navigator(since)[: r + 1]
        if since
        else np.tensordot(gain, start, 1)[2]
    )
    rest = np.concatenate([z[None] / gain[0], np.zeros((r - 1, 2))])[:, None]
    away = ahead(error, since)[:, 2:] + navigator(since)[:r, None] - rest
    for n, t in enumerate(TIMES):
        if t > since - 1e-9:
            known[n, 2] = (rest + ahead(away, t - since))[0, 0]
    return known


LINKS = [
    [1, 0],
    [2, 0],
    [1, 3],
    [2, 4],
    [3, 1],
    [3, 2],
    [4, 2],
    [4, 3],
    [4, 5],
    [5, 3],
    [5, 4],
    [5, 1],
]
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
    keys["save"] = {"trajectories": "all"}
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
    assert "disconnected, vehicle 4 since 1.2 s" in tables.failures_text(results)
    cut_off = ["cut_off", "cut_off_at"]
    for law, defence, known in (
        ("local", "w_msr", []),
        ("exact", "w_msr", cut_off),
        ("exact", "none", []),
    ):
        given = jaxnet.load({"defence": defence, "law": law})
        assert rows.row_columns(given.config, given.cells).isolation == known
