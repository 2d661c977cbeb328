"""The driven robot as navigator: closed forms, the Lissajous figure, and its own derivatives."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxnet.kinds.navigators.driven import Driven
from jaxnet.kinds.navigators.lissajous import Lissajous

TIMES = np.linspace(0.0, 30.0, 301)
WEAVING = Driven(
    speed=[15.0, 25.0, 5.0, -20.0], turn_rate=[0.4, -1.9, 3.0, 0.0], every=10.1, heading=1.0
)


def along_figure(every):
    """A robot with the speed and turn rate of the figure eight at every so many seconds."""
    times = np.arange(0.0, 30.0 + every, every)
    position, velocity, acceleration, _ = Lissajous().jets(times)
    speed = np.hypot(*velocity)
    turn = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / speed**2
    start = {"position": position[:, 0].tolist(), "heading": float(np.arctan2(*velocity[::-1, 0]))}
    return Driven(speed=speed.tolist(), turn_rate=turn.tolist(), every=every, **start)


def test_constant_inputs_give_a_circle():
    start = {"position": [3.0, -4.0], "heading": 0.5}
    given = Driven(speed=[12.0, 12.0], turn_rate=[-0.8, -0.8], every=30.0, **start)
    angle, radius = 0.5 - 0.8 * TIMES, 12.0 / -0.8
    x = 3.0 + radius * (np.sin(angle) - np.sin(0.5))
    y = -4.0 - radius * (np.cos(angle) - np.cos(0.5))
    found, along = given.jets(TIMES), np.stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(found[0], [x, y], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found[1], 12.0 * along, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[3], -(0.8**2) * found[1], rtol=0, atol=1e-11)


def test_the_figure_eight_comes_back_with_order_four():
    figure = Lissajous().jets(TIMES)[0]
    off = [np.abs(along_figure(every).jets(TIMES)[0] - figure).max() for every in (0.25, 0.125)]
    assert off[1] < 1e-5
    assert 12 < off[0] / off[1] < 24


def test_jets_are_derivatives_across_pieces_and_lanes():
    """Each is the next lower one by autodiff; drawn for lanes, each with its time; no jumps."""
    times = np.array([0.1, 7.3, 9.9999, 12.0, 21.7, 29.0])
    slopes = jax.jit(jax.vmap(jax.jacfwd(lambda time: WEAVING.jets(time)[:3]), 0, 2))(times)
    np.testing.assert_allclose(WEAVING.jets(times)[1:], slopes, rtol=0, atol=1e-7)

    class Alike:
        def same(self, value):
            return np.broadcast_to(value, (6, *np.shape(value)))

    drawn = WEAVING.drawn(Alike(), "navigator")
    for given in (times, np.stack([times, times[::-1]]), jnp.asarray(times)):
        known = WEAVING.jets(np.asarray(given))
        np.testing.assert_allclose(drawn.jets(given), known, rtol=0, atol=1e-12)
    before, behind = (WEAVING.jets(np.array([10.1, 20.2]) + side) for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, behind, rtol=0, atol=1e-5)
