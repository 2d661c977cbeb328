"""Indices of variance: Ishigami's function through lanes, SciPy's formula, what is alone."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import jaxnet
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.explore.sensitivity import index_rows, pick_freeze_outcomes
from jaxnet.kinds.fields import PI, Number, Uniform
from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.vehicles.two_wheeled import TwoWheeled
from jaxnet.statistics.indices import sobol_indices
from tests import systems

pytestmark = pytest.mark.usefixtures("many_side_by_side")

TURN = Uniform(uniform=[-PI, PI])
QUICK = {
    "vehicles": 1,
    "topology": "star",
    **systems.QUIET,
    "engine": "exact",
    "horizon": 0.1,
    "tail": 0.0,
    "initial": {"position": 10.0, "heading": 0.0, "speed": 0.3},
}


class Carrier(TwoWheeled):
    """The paper's robot, which carries three numbers about."""

    states = (*TwoWheeled.states, "a", "b", "c")
    units = (*TwoWheeled.units, "", "", "")

    a: Number = TURN
    b: Number = TURN
    c: Number = TURN

    def state_of(self, jets):
        """With the numbers."""
        state = super().state_of(jets)
        xp = state.__array_namespace__()
        carried = [xp.broadcast_to(each, state[0].shape) for each in (self.a, self.b, self.c)]
        return xp.concat([state, xp.stack(carried)])

    def motion(self, state, inputs):
        """The numbers stay."""
        rates = super().motion(state[:-3], inputs)
        return rates.__array_namespace__().concat([rates, 0 * state[-3:]])


def ishigami(seen):
    """Of the three numbers carried."""
    xp = seen.state.__array_namespace__()
    a, b, c = seen.state[-3:]
    return xp.sin(a) + 7 * xp.sin(b) ** 2 + 0.1 * c**4 * xp.sin(a)


ISHIGAMI = Metric("ishigami", "", ishigami, "run", "mean", "mean")


@pytest.mark.long
def test_ishigamis_indices_come_out_of_lanes(tmp_path):
    """As Ishigami and Homma (1990) have them; a heading that is drawn too does not matter."""
    heading = QUICK["initial"] | {"heading": {"uniform": [0, 1]}}
    keys = QUICK | {"vehicle": Carrier(), "metrics": [ISHIGAMI], "initial": heading}
    found = jaxnet.sensitivity(keys, samples=8192, out=tmp_path / "out")
    rows = found[found["metric"] == "ishigami"].set_index("quantity")
    exact = pd.DataFrame(
        {"first": [0.3139, 0.4424, 0.0, 0.0], "total": [0.5576, 0.4424, 0.2437, 0.0]},
        index=["vehicle.a", "vehicle.b", "vehicle.c", "initial.heading"],
    )
    assert set(rows.index) == set(exact.index)
    for order in exact:
        known = exact.loc[rows.index, order]
        np.testing.assert_allclose(rows[order], known, atol=0.02)
        assert ((rows[f"{order}_low"] <= known) & (known <= rows[f"{order}_high"])).all()
    assert (rows.loc["initial.heading", ["first", "total", "total_high"]] == 0).all()


def test_the_formula_is_scipys():
    """Of random values, to rounding."""
    a, b, *mixed = np.random.default_rng(0).normal(3.0, 1.0, (5, 256))
    known = stats.sobol_indices(
        func={"f_A": a[None], "f_B": b[None], "f_AB": np.stack(mixed)[:, None]}, n=len(a)
    )
    found = sobol_indices(a, b, np.stack(mixed)).estimate
    np.testing.assert_allclose(found, [known.first_order, known.total_order], rtol=1e-12)


@pytest.mark.long
def test_intervals_hold_the_indices_as_often_as_they_say():
    """Of a + 2 b, whose parts are 1/5 and 4/5: in 200 trials about 95 % of the time."""
    held = []
    for seed in range(200):
        a, b = np.random.default_rng(seed).normal(size=(2, 2, 300))
        mixed = [b[0] + 2 * a[1], a[0] + 2 * b[1]]
        found = sobol_indices(a[0] + 2 * a[1], b[0] + 2 * b[1], np.stack(mixed))
        held.append((found.low <= [[0.2, 0.8]] * 2) & (found.high >= [[0.2, 0.8]] * 2))
    assert (np.abs(np.mean(held, axis=0) - 0.95) < 0.05).all()


BIAS = {"kind": "bias", "vehicles": [2], "direction": {"shared": {"uniform": [0.0, 6.0]}}}
RING = {
    "vehicles": 3,
    "engine": "exact",
    "horizon": 2.0,
    "tail": 1.0,
    "topology": "complete",
    "defence": "none",
    "initial": QUICK["initial"],
    "attack": BIAS,
    "recovery": {"tau": 2.3},
}


def test_what_is_alone_is_everything(tmp_path):
    """One number is drawn: it has the whole variance, by itself, of whatever varies."""
    found = jaxnet.sensitivity(RING, samples=512, out=tmp_path / "out").dropna(subset="first")
    assert {"tail_mean", "unrecovered"} <= set(found["metric"])
    assert set(found["quantity"]) == {"attack.direction"}
    for order in ("first", "total"):
        assert ((found[f"{order}_low"] <= 1) & (found[f"{order}_high"] >= 1)).all()
        np.testing.assert_allclose(found[order], 1.0, atol=0.15)


def test_a_failed_lane_takes_its_sample_with_it_and_is_named():
    """The others' rows are those that there would be without it."""
    study = jaxnet.load(RING)
    names = ["x", "y"]
    values = np.random.default_rng(1).uniform(0, 2, (4, 200))
    status = np.zeros((4, 200), int)
    status[3, 7] = Status.disconnected

    def outcomes(kept):
        metrics = [metric.name for metric in study.cells[0].scenario.measured()]
        return [
            Outcome(
                codes[kept],
                dict.fromkeys(metrics, lane[kept]),
                *[codes[kept]] * 3,
                {},
                {},
                lane[kept],
            )
            for codes, lane in zip(status, values, strict=True)
        ]

    with pytest.warns(UserWarning, match="sample 7 with the later y: disconnected"):
        found = index_rows(study.cells[0], names, outcomes(slice(None)), 1.5)
    known = index_rows(study.cells[0], names, outcomes(np.arange(200) != 7), 1.5)
    counted = {"samples": 200, "left_out": 1}
    assert found == [row | counted for row in known]
    assert np.isfinite(pd.DataFrame(found)["first"]).all()


def test_cells_that_are_there_are_not_done_again(tmp_path, monkeypatch):
    """After an interruption those that are missing are; in the folder of a run too."""
    study = jaxnet.load(RING, {"sweep.attack.magnitude": [1.0, 2.0, 4.0]})
    whole = jaxnet.sensitivity(study, 64, tmp_path / "whole")
    done = []

    def interrupted(cell, *rest):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(cell.number)
        return pick_freeze_outcomes(cell, *rest)

    def assert_as_whole(*more):
        found = jaxnet.sensitivity(study, 64, tmp_path / "parts")
        pd.testing.assert_frame_equal(found, whole)
        assert done == [*more]

    monkeypatch.setattr("jaxnet.explore.sensitivity.pick_freeze_outcomes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        jaxnet.sensitivity(study, 64, tmp_path / "parts")
    assert done == [0, 1]
    done.clear()
    assert_as_whole(2)
    results = jaxnet.run(study, tmp_path / "parts", progress=False)
    assert [*(tmp_path / "parts" / "figures").glob("sensitivity*")]  # they are not of its rows
    assert_as_whole(2)
    assert results.lanes["status"].eq("ok").all()
    with pytest.raises(jaxnet.FolderError, match="another study"):
        jaxnet.sensitivity(jaxnet.load(study, {"horizon": 3.0}), 64, tmp_path / "parts")
