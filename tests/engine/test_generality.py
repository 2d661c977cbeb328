"""What no kind of ours uses all of: weights as numbers, by axis, with a memory; choosing attacks.

Each is written twice, as a kind and as a plain program, and both engines are held to the latter.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.engine.status import Status
from jaxnet.kinds.attacks import Attack, constant_basis
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import Positive
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from tests import reference, systems
from tests.reference import march, navigator_at, received

TICK, SMOOTHING = 0.05, 0.2
FINER = {"kind": "nonlinear", "rtol": 1e-9, "atol": 1e-11}
RANDOM = {"kind": "random_regular", "degree": 3, "navigator_weight": 0.2, "redraw": True}


class Filtered(Defence):
    """Weights by `w / (1 + filtered² )` of the distance by axis of what is received to `own + ė/k1
    + ë/k2`.

    The memory is the filtered distance, a low-pass over ticks.
    """

    kind = "filtered"

    smoothing: Positive = SMOOTHING

    def start(self, around):
        return {"distance": jnp.zeros((2, *around.weights.shape))}

    def decide(self, own, received, last, memory, around):
        apart = [there - here[:, None] for there, here in zip(received, own, strict=True)]
        _, k1, k2 = (each[None, None, None] for each in around.gain)
        distance = jnp.abs(apart[0] + apart[1] / k1 + apart[2] / k2)
        share = self.smoothing[None, None, None]
        distance = memory["distance"] + share * (distance - memory["distance"])
        return around.weights[None] / (1.0 + distance**2), {"distance": distance}


class Alike(Filtered):
    """By distance in the plane, one weight for both axes; it weighs where nobody is heard too."""

    kind = "alike"

    def decide(self, own, received, last, memory, around):
        _, memory = super().decide(own, received, last, memory, around)
        distance = memory["distance"].mean(axis=0)
        return jnp.maximum(around.weights, 0.01) / (1.0 + distance**2), memory


class Withdrawing(Defence):
    """From 2.4375 s on the navigator alone is retained; needs no memory."""

    kind = "withdrawing"

    def needs_ticks(self):
        return False

    def decide(self, own, received, last, memory, around):
        late = (around.time >= 2.4375)[None, None]
        return ~late | (around.sources == 0)[:, :, None], memory


class Steering(Attack):
    """Each tick against the fleet's mean error, each third along it; the memory counts ticks."""

    kind = "steering"
    strategic: ClassVar[bool] = True

    scale: Positive = 5.0

    def basis(self, time):
        return constant_basis(time)

    def sizes(self, horizon):
        return np.eye(4, 1)

    def begin(self, seen):
        return jnp.zeros(seen.time.shape, int)

    def aim(self, seen, memory):
        mean = seen.errors[0].mean(axis=1, keepdims=True)
        turn = jnp.where(memory % 3 == 2, 1.0, -1.0)[None, None]
        vectors = turn * self.scale[None, None] * mean
        return jnp.broadcast_to(vectors, seen.errors[0].shape)[:, :, None], memory + 1


class Returning(Steering):
    """Whatever number it is given, from the fifth tick on and at everybody."""

    kind = "returning"

    def aim(self, seen, memory):
        number = jnp.where(memory < 4, 1.0, self.scale)[None, None, None]
        vectors = jnp.stack([number, 0.0 * number])[:, 0]
        return jnp.broadcast_to(
            vectors, (2, seen.errors[0].shape[1], 1, memory.shape[0])
        ), memory + 1


def plain(kind, lane):
    """The plain program of a defence and an attack's choice, `choose` for `march`: its choice."""
    carried, chosen = np.ones(lane.weights.shape, bool), []
    memory = np.zeros((2, *lane.weights.shape))

    def choose(n, error):
        nonlocal memory
        vector = (1.0 if n % 3 == 2 else -1.0) * 5.0 * error[0].mean(axis=0)
        vector = MAGNITUDE * vector / max(1.0, np.hypot(*vector))
        chosen.append(vector)
        added = np.zeros((3, *lane.weights.shape, 2))
        added[0][lane.links] = vector
        apart = received(error, carried, added) - error[:, :, None]
        distance = np.abs(apart[0] + apart[1] / lane.gain[1] + apart[2] / lane.gain[2])
        memory = memory + SMOOTHING * (np.moveaxis(distance, -1, 0) - memory)
        seen = memory if kind == "filtered" else np.stack([memory.mean(axis=0)] * 2)
        raw = lane.weights if kind == "filtered" else np.maximum(lane.weights, 0.01)
        return np.where(lane.weights > 0, raw, 0.0) / (1.0 + seen**2), lambda t: added

    return choose, carried, chosen


def named(kind):
    """How a config names a class of this file."""
    return {"kind": f"{__name__}:{kind.__name__}"}


KEYS = {"horizon": 5.0, "tail": 1.0, "output_step": TICK, "tick": TICK}
INSTANTS = np.arange(101) * TICK
MAGNITUDE = 0.3
CIRCLE = {"kind": "lissajous", "amplitude": [1, 1], "frequency": [0.4, 0.4], "phase": [0, 1.57]}
SMALL = {"vehicles": 6, "topology": RANDOM, "navigator": CIRCLE, "gain": [6.0, 11.0, 6.0]}
SMALL |= {"initial": {"position": {"uniform": [-2, 2]}}}


def simulated(engine, samples=2, **keys):
    """Lanes of a study with an output time at each tick, and what came of them."""
    study = systems.study(engine=engine, **KEYS, **keys)
    one = systems.lanes(study, samples)
    return one, systems.simulate(one)


def errors_of(one, outcome, number):
    """Stored positions relative to the navigator's: (ticks + 1, m, 2)."""
    path = np.stack([navigator_at(one, number)(t)[0] for t in INSTANTS])
    return outcome.series["state"][number, :, :, :2] - path[:, None]


def start_of(one, number):
    """E and two derivatives at t = 0: (3, m, 2)."""
    return (
        reference.flat_jets(systems.lane(one, number).initial.T)
        - navigator_at(one, number)(0.0)[:3, None]
    )


@pytest.mark.parametrize(
    ("engine", "kind", "accuracy"),
    [
        pytest.param("exact", Alike, 1e-9, marks=pytest.mark.long),
        ("exact", Filtered, 1e-9),
        pytest.param("nonlinear", Filtered, 1e-5, marks=pytest.mark.long),
    ],
)
def test_weights_that_are_numbers_and_an_attack_that_chooses_at_ticks(engine, kind, accuracy):
    """Weights follow received positions, velocities, accelerations and the gain; each lane's own
    graph.

    The attack is against or along the mean error, scaled down to ā where far, not where near.
    """
    attack = named(Steering) | {"magnitude": MAGNITUDE, "vehicles": [2, 5]}
    one, outcome = simulated(engine, defence=named(kind), attack=attack, **SMALL)
    assert (outcome.status == Status.ok).all()
    sizes = []
    for number in range(2):
        lane = systems.lane(one, number)
        choose, carried, chosen = plain(kind.kind, lane)
        known = march(choose, carried, lane.gain, start_of(one, number), TICK, 100)
        assert np.abs(errors_of(one, outcome, number) - known[:, 0]).max() <= accuracy
        kept, signal = outcome.series["kept"][number], outcome.series["attack"][number]
        assert not kept[:, lane.weights == 0].any()
        assert np.ptp(kept, axis=0).max() > 0.1
        np.testing.assert_allclose(signal[:100, 1], chosen, rtol=0, atol=10 * accuracy)
        assert not signal[:, 0].any()
        sizes += np.linalg.norm(signal[:, 1], axis=-1).tolist()
    assert outcome.switches.tolist() == [0, 0]
    assert max(sizes) <= MAGNITUDE * (1 + 1e-12)
    assert min(sizes) < 0.29


@pytest.mark.long
def test_a_defence_in_the_vector_field_is_told_the_time():
    """As at ticks one of which is the time that it waits for; whatever the magnitude."""
    keys = {"defence": named(Withdrawing), "horizon": 4.0, "tail": 1.0, "output_step": 0.25}
    ticked, literal = (
        systems.outcome(1, engine=engine, tick=tick, **keys)
        for engine, tick in (("exact", 0.0625), (FINER, 0.0))
    )
    assert ticked.status.tolist() == literal.status.tolist() == [0]
    positions = (outcome.series["state"][..., :2] for outcome in (ticked, literal))
    assert np.abs(np.subtract(*positions)).max() <= 1e-5
    assert (ticked.series["kept"][0, [0, -1], 0, 0] == [0.1, 1.0]).all()


@pytest.mark.parametrize("number", [0.5, 1.0, 7.0, 1e150, 1e300, float("nan"), float("inf")])
def test_no_attack_that_chooses_is_over_its_magnitude(number):
    """Whatever it returns, for whomever; without a direction no lane calls itself ok."""
    attack = named(Returning) | {"magnitude": 3.0}
    scenario = (
        systems.study(engine="exact", attack=attack, defence="none", **KEYS).cells[0].scenario
    )
    made = scenario.attack.model_copy(update={"scale": number})
    outcome = systems.simulate(
        job(scenario.model_copy(update={"attack": made}), Keyed(0), [0], systems.EVERYTHING)
    )
    signal = outcome.series["attack"][0]
    if not np.isfinite(number):
        assert outcome.status.tolist() == [Status.nonfinite]
        assert np.isnan(outcome.metrics["tail_mean"]).all()
        return
    assert outcome.status.tolist() == [Status.ok]
    attacked = signal[4:, [1, 4, 7, 10]]
    np.testing.assert_allclose(
        attacked, np.broadcast_to([3 * min(1, number), 0], attacked.shape), rtol=1e-14
    )
    assert not np.delete(signal, [1, 4, 7, 10], axis=1).any()
