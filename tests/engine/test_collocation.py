"""Windows of the nonlinear engine, against the exact engine and against Runge–Kutta steps."""

import jax
import numpy as np
import pytest

from jaxnet.engine.status import Status
from jaxnet.kinds.fields import NotNegative, Positive
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.vehicles import HEADING
from jaxnet.kinds.vehicles.two_wheeled import FORCE, TwoWheeled
from tests import systems

STEPS = {"solver": "dopri5", "rtol": 1e-10, "atol": 1e-12}
SHORT = {"horizon": 6.0, "tail": 2.0}


def outcome(lanes=4, **keys):
    """Lanes of a study, with what vehicles do at output times."""
    return systems.outcome(lanes, **{**SHORT, **keys})


def apart(one, other):
    """Greatest distance [m] of any vehicle at any output time."""
    return np.abs(one.series["state"][..., :2] - other.series["state"][..., :2]).max()


class Odd(TwoWheeled):
    """A robot with a push [m/s³] where it heads along x, and a force told from jets so many times.

    The law is told of neither.
    """

    kind = "odd"

    push: NotNegative = 0.0
    times: Positive = 1.0

    def motion(self, state, inputs):
        xp = state.__array_namespace__()
        rates = super().motion(state, inputs)
        pushed = rates[FORCE] + self.push[None] * xp.cos(state[HEADING])
        return xp.concatenate([rates[:FORCE], pushed[None], rates[FORCE + 1 :]])

    def state_of(self, jets):
        state = super().state_of(jets)
        told = state[FORCE] * self.times[None]
        return state.__array_namespace__().concatenate(
            [state[:FORCE], told[None], state[FORCE + 1 :]]
        )


PUSHED = Odd(push=0.3)


@pytest.mark.parametrize("attack", [pytest.param("none", marks=pytest.mark.long), "rotating"])
def test_what_the_law_does_not_cancel_is_integrated(attack):
    """The first guess takes a vehicle to move as asked; this one follows its own equations."""
    keys = {"vehicle": PUSHED, "attack": attack, "defence": "none"}
    ours, known = outcome(**keys), outcome(**keys, engine=STEPS)
    assert (ours.status == Status.ok).all()
    assert apart(ours, known) < 3e-6
    assert apart(ours, outcome(**{**keys, "vehicle": Odd()})) > 0.1
    for mine, alone in zip(*map(jax.tree.leaves, (ours, outcome(2, **keys))), strict=True):
        np.testing.assert_array_equal(mine[:2], alone)  # though others take more passes


def test_a_state_that_does_not_return_the_jets_is_refused():
    with pytest.raises(KindError, match=r"Odd\.state_of: derivative 2 of the output"):
        outcome(vehicle=Odd(times=2.0), attack="none", defence="none")


VARIATIONS = {
    "gains": {"gain": [2.0, {"uniform": [4.0, 6.0]}, {"uniform": [3.0, 5.0]}]},
    "fast": {"attack": {"kind": "rotating", "magnitude": 5, "frequency": 100.0}},
    "far": {"attack": {"kind": "rotating", "magnitude": 1000, "frequency": 0.5}},
    "slow starts": {"initial": {"speed": {"uniform": [1e-3, 1e-2]}}},
    "loose": {"engine": {"rtol": 1e-5, "atol": 1e-7}},
    "each tick": {"tick": 0.01, "output_step": 0.01},
    "steps over links": {
        "vehicles": 100,
        "topology": {"kind": "random_regular", "degree": 4},
        "engine": STEPS,
        "horizon": 1.0,
        "tail": 0.5,
    },
}


@pytest.mark.long
@pytest.mark.parametrize("name", VARIATIONS)
def test_windows_and_steps_lead_where_the_exact_engine_does(name):
    keys = {"attack": "rotating", "defence": "none", **VARIATIONS[name]}
    exact = outcome(**{**keys, "engine": "exact"})
    ours = outcome(**keys)
    assert ours.status.tolist() == exact.status.tolist() == [Status.ok] * 4
    np.testing.assert_array_equal(ours.switches, exact.switches)
    assert apart(ours, exact) < (3e-4 if name == "loose" else 3e-6)


@pytest.mark.long
def test_an_attack_is_seen_whenever_it_begins():
    """Also where it begins just before or after the end of a window."""
    envelope = {"kind": "envelope", "of": "bias", "start": {"uniform": [0.5, 5.5]}, "rise": 1.0}
    keys = {"attack": {**envelope, "magnitude": 10}, "defence": "none"}
    ours, exact = outcome(12, **keys), outcome(12, **keys, engine="exact")
    assert apart(ours, exact) < 3e-6
    nothing = {"attack": {**envelope, "magnitude": 0}, "defence": "none"}
    assert apart(exact, outcome(12, **nothing, engine="exact")) > 0.05


@pytest.mark.long
def test_a_window_serves_ticks_and_outputs_until_a_decision_changes():
    """Ten times as many ticks and outputs take no more windows where nobody decides."""
    coarse, fine = (
        outcome(attack="rotating", defence="none", tick=tick, output_step=tick)
        for tick in (0.5, 0.05)
    )
    np.testing.assert_array_equal(coarse.steps, fine.steps)
    assert coarse.steps.max() < 12
    trimmed = outcome(attack="rotating", defence="trusted_trim", tick=0.01, output_step=0.5)
    assert trimmed.steps.max() < 600 / 4
