"""Each attack's signal against its formula, differentiated by JAX; keys that exclude each other."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.attacks import signal_scale
from jaxnet.kinds.attacks.envelope import LAST_SLOPES, smooth_rise
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.signal import up_to
from tests import systems

HORIZON, ATTACKED = 20.0, [2, 5, 8, 11]
CHIRP = {"kind": "chirp", "frequency": 0.9, "rate": -0.07}
ENVELOPE = {"kind": "envelope", "of": CHIRP, "start": 2.0, "rise": 3.0}
MULTISINE = {"kind": "multisine", "frequency": 0.5}
SIGNALS = {
    "bias": {"kind": "bias", "direction": {"uniform": [-7, 7]}},
    "rotating": {"kind": "rotating", "frequency": -1.7},
    "slow rotating": {"kind": "rotating", "frequency": 0.3},
    "sinusoid": {"kind": "sinusoid", "frequency": 0.9, "direction": {"uniform": [-7, 7]}},
    "chirp": CHIRP,
    "envelope": ENVELOPE | {"stop": 9.0},
    "envelope of multisine": ENVELOPE | {"of": MULTISINE, "rise": 9.0},
    "multisine": MULTISINE,
    "freeform": {"kind": "freeform", "frequency": 0.3, "harmonics": 6},
}


def along(angle):
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def risen(x, smoothness):
    """The chance that of 7 or 9 trials, each lucky with probability x, more than half are."""
    trials = 2 * smoothness + 1
    lucky = range(smoothness + 1, trials + 1)
    return sum(math.comb(trials, j) * x**j * (1 - x) ** (trials - j) for j in lucky)


def formula(kind, smoothness, numbers, t):
    """The signal of one vehicle at a time, of any size: (2,)."""
    n = numbers
    match kind[0]:
        case "bias":
            return along(n["direction"]) + 0 * t
        case "sinusoid":
            return jnp.sin(n["frequency"] * t + n["phase"]) * along(n["direction"])
        case "rotating":
            return along(n["frequency"] * t + n["phase"])
        case "chirp":
            return along(n["frequency"] * t + n["rate"] * t * t / 2 + n["phase"])
        case "multisine":
            order = jnp.arange(1.0, len(n["phase"]) + 1)
            swing = jnp.cos(order * n["frequency"] * t + n["phase"])
            return along(n["direction"]) @ swing
        case "freeform":
            c, s = jnp.moveaxis(n["coefficients"].reshape(-1, 2, 2), 1, 0)
            turn = jnp.arange(1.0, len(c) + 1) * n["frequency"] * t
            return jnp.cos(turn) @ c + jnp.sin(turn) @ s
    height = risen(jnp.clip((t - n["start"]) / n["rise"], 0, 1), smoothness)
    if "stop" in n:
        height = height - risen(jnp.clip((t - n["stop"]) / n["rise"], 0, 1), smoothness)
    return height * formula(kind[1:], smoothness, n["of"], t)


@functools.partial(jax.jit, static_argnums=(0, 1))
def jets(kind, order, numbers, times):
    """A signal and its derivatives up to an order: (order + 1, times, 2)."""
    found = [functools.partial(formula, kind, order, numbers)]
    for _ in range(order):
        found.append(jax.jacfwd(found[-1]))
    return jnp.stack([jax.vmap(each)(times) for each in found])


def numbers_of(drawn, vehicle):
    """Kinds from the outside in, and their numbers for one vehicle of the first lane."""
    values, kind = {}, (drawn.kind,)
    for key, each in vars(drawn).items():
        if isinstance(each, np.ndarray):
            values[key] = jnp.asarray(each[..., vehicle - 1, 0] if each.ndim > 1 else each[0])
        elif key == "of":
            inside, values["of"] = numbers_of(each, vehicle)
            kind += inside
    return kind, values


@pytest.mark.parametrize(
    ("name", "order"),
    [
        *((name, 4) for name in SIGNALS),
        ("envelope", 3),
        *(pytest.param(n, 3, marks=pytest.mark.long) for n in SIGNALS if n != "envelope"),
    ],
)
def test_a_signal_is_its_formula_within_the_magnitude_which_is_nearly_reached(name, order):
    """For vehicles that hear three and four derivatives; each attacker has numbers of its own."""
    attack = jaxnet.load({"attack": SIGNALS[name] | {"magnitude": 5.0}}).config.attack
    drawn = attack.drawn(Draw(Keyed(3), [0], 12), "attack").of_order(order)
    times = np.linspace(0.01, HORIZON, 401)
    basis = np.asarray(up_to(order, drawn.signal().basis, times))
    scale = signal_scale(drawn, drawn.sizes(HORIZON), order)
    vectors = np.broadcast_to(drawn.vectors()[..., 0] * scale, (2, 12, basis.shape[1]))
    ours = np.einsum("xmb,kbt->mktx", vectors, basis)
    greatest = np.linalg.norm(ours, axis=-1).max(axis=(1, 2))
    for vehicle in ATTACKED:
        kind, numbers = numbers_of(drawn, vehicle)
        known = np.asarray(jets(kind, order, numbers, times))
        known = known * greatest[vehicle - 1] / np.linalg.norm(known, axis=-1).max()
        np.testing.assert_allclose(ours[vehicle - 1], known, rtol=0, atol=1e-8)
    assert greatest.max() <= 5.0 * (1 + 1e-12)
    least = {"envelope": 0.3, "envelope of multisine": 0.1}.get(name, 0.97)
    assert (greatest[np.array(ATTACKED) - 1] >= least * 5.0).all()


@pytest.mark.parametrize("kind", ["replay", "freeze", "own_path"])
def test_a_replaced_message_is_a_path_with_its_derivatives(kind):
    """By differences of sixth order; no function is greater than the sizes that the engines use."""
    keys = {"vehicle": "planar_quadrotor", "horizon": 6.0, "tail": 1.0, "vehicles": 5}
    attack = {"kind": kind, "vehicles": [2]}
    one = systems.lanes(systems.study(engine="exact", attack=attack, **keys), 1)
    lane = jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), 0, -1), one.inputs.lane)
    step, times = 2e-3, np.linspace(0.01, 5.99, 100)
    around = (times[:, None] + step * np.arange(-3, 4)).ravel()
    with jax.enable_x64(True):
        basis = jax.jit(jax.vmap(lambda t: lane.basis(jnp.full(1, t))))(around)
    basis = np.asarray(basis)[..., 0].reshape(100, 7, 5, -1)
    slopes = np.einsum("tnkb,n->tkb", basis, np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 / step)
    now = basis[:, 3]
    np.testing.assert_allclose(slopes[:, :4], now[:, 1:], atol=2e-6 * np.abs(now).max())
    functions = np.linalg.norm(now, axis=2).max(axis=0)
    assert (functions <= lane.sizes[1][:, 0] * (1 + 1e-6)).all()


@pytest.mark.parametrize("order", [3, 4])
def test_a_rise_is_smooth_at_both_ends(order):
    """A polynomial with as many continuous derivatives, and its greatest next one."""
    x = np.polynomial.Polynomial([0.0, 1.0])
    rise, places = risen(x, order), np.linspace(0.0, 1.0, 41)
    known = np.stack([rise.deriv(k)(places) if k else rise(places) for k in range(order + 2)])
    found = smooth_rise(places, 0.5, order)
    np.testing.assert_allclose(found, known[:-1] / 0.5 ** np.arange(order + 1)[:, None], atol=1e-7)
    assert np.abs(found[1:, [0, -1]]).max() < 1e-12
    assert np.abs(known[-1]).max() == pytest.approx(LAST_SLOPES[order])
