"""The law by exchanges: growth and lateness against theory (its motion: test_reference.py)."""

import jax
import numpy as np
import pytest

from experiments.rounds import lateness, parted, slowest
from jaxnet.engine.status import Status
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.laws import Law
from jaxnet.model.graph import dense
from jaxnet.theory import rounds as theory
from jaxnet.view.text import check
from tests import systems

TICK, TICKS = 0.05, 120
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}


def growths(study):
    """A's eigenvalues, and the growth along each eigenvector as simulated."""
    scenario = study.cells[0].scenario
    weights = dense(scenario.topology.normalised_rows(scenario.vehicles))
    values, vectors = np.linalg.eig(weights[:, 1:])
    outcome = systems.simulate(parted(systems.lanes(study, len(weights) + 1), vectors))
    return values, slowest(outcome.series["state"], vectors)


@pytest.mark.long
@pytest.mark.parametrize("topology", ["cyclic", "path"])
def test_the_fleet_is_late_for_a_slow_navigator(topology):
    """Vehicle by vehicle, by what theory says; on the path the farther back the more.

    E follows what drives it k1/k0 = 3 s later.
    """
    slow = {"kind": "lissajous", "frequency": [0.01, 0.02]}
    keys = {"tick": 0.02, "horizon": 60.0, "tail": 0.1, "output_step": 0.1}
    keys |= {"navigator": slow, "topology": topology}
    law = {"kind": "rounds", "rounds": 2}
    study = systems.study(engine="exact", law=law, attack="none", defence="none", **keys)
    one = systems.lanes(study, 1)
    position = systems.simulate(one).series["state"][0, -1, :, :2]
    navigator = systems.lane(one, 0).navigator
    before, after = (
        np.asarray(navigator.jets(np.asarray(60.0 - 3.0 + by)))[3] for by in (-1e-3, 1e-3)
    )
    weights = dense(study.cells[0].scenario.topology.normalised_rows(12))
    known = lateness(weights, 0.02, 2) * np.linalg.norm(after - before) / 2e-3
    found = np.linalg.norm(position - np.asarray(navigator.jets(np.asarray(60.0)))[0], axis=1)
    np.testing.assert_allclose(found, known, rtol=0.02)


@pytest.mark.long
def test_what_a_lane_that_diverges_comes_to():
    """Its error up to 1e100 m, the same in both engines."""
    keys = {"law": "rounds", "tick": 0.5, "output_step": 1.0, "attack": "none", "defence": "none"}
    ends = {
        (engine, horizon): systems.outcome(1, engine=engine, horizon=horizon, **keys)
        for engine in ("exact", "nonlinear")
        for horizon in (30.0, 400.0)
    }
    for (_, horizon), end in ends.items():
        near = horizon == 30.0
        assert end.status == [Status.ok if near else Status.diverged]
        assert near == (end.metrics["tail_mean"] > 1e25)
    exact, nonlinear = (
        ends[engine, 30.0].metrics["tail_mean"] for engine in ("exact", "nonlinear")
    )
    np.testing.assert_allclose(nonlinear, exact, rtol=1e-9)


def test_numbers_of_rounds_share_a_program_and_lanes_may_differ():
    """A program depends on the shapes of its arguments; each lane takes its own rounds."""
    one, two = systems.lanes(
        systems.study(engine="exact", sweep={"law.rounds": [1, 2]}, law="rounds", **KEYS), 2
    ).jobs
    assert jax.tree.structure(one.inputs) == jax.tree.structure(two.inputs)
    assert one.plan == two.plan
    mixed = jax.tree.map(lambda a, b: np.concatenate([a[:1], b[1:]]), one.inputs, two.inputs)
    both = systems.simulate(one._replace(inputs=mixed))
    for number, alone in enumerate(map(systems.simulate, (one, two))):
        np.testing.assert_array_equal(both.series["state"][number], alone.series["state"][number])


class Withdrawn(Defence):
    """From 0.5 s on nobody retains the navigator, whom vehicle 1 alone hears."""

    kind = "withdrawn"

    def decide(self, own, received, last, memory, around):
        return (around.time < 0.5)[None, None] | (around.sources != 0)[:, :, None], memory


def test_who_is_cut_off_has_failed():
    """As with the law itself, though rounds know nothing of it: from that tick on."""
    keys = {
        "topology": {"kind": "cyclic", "navigator": [1]},
        "defence": {"kind": f"{__name__}:Withdrawn"},
    }
    law = {"kind": "rounds", "rounds": 6}
    outcome = systems.outcome(1, engine="exact", law=law, **keys, **KEYS)
    assert outcome.status == [Status.disconnected]
    told = np.isfinite(outcome.series["tracking"][0])
    assert told[:10].all()
    assert not told[10:].any()


class Halfway(Law):
    """From what was held halfway to what a round makes of it."""

    kind = "halfway"

    def exchange(self, last, demand, heard):
        return (last + heard(last) + demand) / 2

    def left(self, eigenvalues):
        return (1 + eigenvalues) / 2


def test_a_law_from_outside():
    """Stable at a tick at which one round is not, as its growth and `check` say."""
    law = {"kind": f"{__name__}:Halfway"}
    times = {"tick": 0.04, "output_step": 0.04, "horizon": 0.8, "tail": 0.4}
    study = systems.study(engine="exact", law=law, attack="none", defence="none", **times)
    values, found = growths(study)
    known = theory.growth((1 + values) / 2, np.array([1.0, 3.0, 3.0]), 0.04)
    assert max(found) == pytest.approx(known, rel=1e-6)
    assert known < 1 < theory.growth(values, np.array([1.0, 3.0, 3.0]), 0.04)
    told = " ".join(check.check_text(study).split())
    assert (
        f"law stable, deviations times {max(found):.4f} at each tick of 0.04 s"
        " safe nothing is proved" in told
    )


@pytest.mark.long
def test_fleets_that_diverge_end_and_leave_the_others_alone():
    """A sampled law with fast gains at a coarse tick; calm lanes have the numbers they have alone.

    Squares of the numbers would overflow after 50 s; the search for a standstill then never ended.
    """
    keys = {"vehicles": 3, "vehicle": "unicycle", "topology": "path", "law": "local", "tick": 0.2}
    keys |= {"defence": "none", "horizon": 66.0, "output_step": 6.6, "tail": 6.6, "seed": 4060}
    keys |= {
        "attack": {"kind": "sinusoid", "magnitude": 14.5, "vehicles": [2]},
        "engine": "nonlinear",
    }
    keys["initial"] = {"position": {"uniform": [-50, 50]}}
    gains = [[90.0, 19.0], [1.0, 2.0]]
    wild, calm = systems.lanes(systems.study(**keys, sweep={"gain": gains}), 2, ()).jobs
    both = jax.tree.map(lambda *leaves: np.concatenate(leaves), wild.inputs, calm.inputs)
    outcome, alone = (systems.simulate(calm._replace(inputs=each)) for each in (both, calm.inputs))
    assert outcome.status.tolist() == [*[Status.diverged] * 2, *[Status.ok] * 2]
    assert (outcome.metrics["tail_mean"][2:] == alone.metrics["tail_mean"]).all()
