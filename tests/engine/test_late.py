"""Late messages: closed forms of harmonics, ramps and exchanges, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.engine.stages.late import DrawnDelay
from jaxnet.engine.status import Status
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.view.text.check import check_text
from tests import systems
from tests.matrices import matrix_of
from tests.reference import Powers

QUIET = {"attack": "none", "defence": "none", "engine": "exact", "tail": 0.0}


def factors(weights, frequency, delay):
    """What each vehicle makes of a navigator's harmonic: `(1 - A e)⁻¹ a0 e`, e = exp(-iωτ)."""
    turn = np.exp(-1j * frequency * delay)
    return np.linalg.solve(np.eye(len(weights)) - turn * weights[:, 1:], turn * weights[:, 0])


@pytest.mark.parametrize(
    ("graph", "vehicle", "tick", "known"),
    [
        (Cyclic(), "two_wheeled", 0.05, (19.649121, 18.697850)),
        *[
            pytest.param(*given, marks=pytest.mark.long)
            for given in [
                (Path(), "two_wheeled", 0.1, (23.942441, None)),
                (Star(), "planar_quadrotor", 0.005, (1.999967, 1.999867)),
            ]
        ],
    ],
)
def test_a_figure_eight_is_off_as_the_closed_form_says(graph, vehicle, tick, known):
    """Path 100 sin 0.2 t, 50 sin 0.4 t [m] and words 0.1 s late: the last vehicle, along each axis.

    Neither the order of the vehicles nor the gain nor the tick matters.
    """
    given = {"vehicle": vehicle, "topology": graph.kind, "channel": {"delay": 0.1}}
    given |= {"tick": tick, "output_step": 0.5}
    outcome = systems.outcome(1, horizon=100.0, **given, **QUIET)
    assert (outcome.status == Status.ok).all()
    time = np.arange(201) * 0.5
    settled = slice(140, None)
    for axis, (size, frequency) in enumerate([(100.0, 0.2), (50.0, 0.4)]):
        found = outcome.series["state"][0, settled, -1, axis]
        expected = (
            size * factors(matrix_of(graph, 12), frequency, 0.1)[-1] * np.exp(1j * frequency * time)
        )
        assert found == pytest.approx(expected.imag[settled], abs=2e-6)
        off = abs(expected[0] - size)
        assert known[axis] is None or off == pytest.approx(known[axis], abs=6e-7)


@pytest.mark.long
def test_messages_are_late_as_often_as_the_distribution_says():
    """Each number of ticks, within five standard deviations."""
    H, channel = 0.1, {"delay": {"uniform": [0.05, 0.3]}, "delay_of": "message"}
    lane = systems.lanes(systems.study(channel=channel, tick=H, **QUIET), 2).inputs.lane
    delay = DrawnDelay(*(jnp.asarray(np.moveaxis(leaf, 0, -1)) for leaf in lane.delay))
    draw = jax.jit(lambda time: delay.draw(time, (6, 6)))
    drawn = np.stack([np.asarray(draw(jnp.full(2, n * H))) for n in range(100)])
    for ticks, share in {1: 0.4, 2: 0.4, 3: 0.2}.items():
        assert abs((drawn == ticks).mean() - share) < 5 * np.sqrt(share * (1 - share) / drawn.size)


def test_a_place_is_reached_as_it_is_told():
    """Vehicles of order 1 end at a resting navigator's rounded word, at most half a step off."""
    keys = {"vehicle": "single_integrator", "gain": [2.0], "vehicles": 2, "horizon": 20.0}
    keys |= {"navigator": Powers(x=[3.37], y=[-1.24]), "topology": "star"} | QUIET
    study = systems.study(**keys, channel={"quantisation": 0.5})
    ends = systems.simulate(systems.lanes(study, 1)).series["state"][0, -1]
    np.testing.assert_allclose(ends, [[3.5, -1.0]] * 2, rtol=0, atol=1e-9)
    told = " ".join(check_text(study).split())
    assert "like an attack of at most 0.25 on each axis" in told
