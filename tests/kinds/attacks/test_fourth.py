"""Attacks on vehicles of order 4, which hear four derivatives."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.attacks.envelope import LAST_SLOPES, smooth_rise
from tests import systems

QUADROTOR = {
    "vehicle": "planar_quadrotor",
    "horizon": 6.0,
    "tail": 1.0,
    "vehicles": 5,
    "defence": "none",
}
CHIRP = {"kind": "chirp", "frequency": 0.9, "rate": 0.3}
ENVELOPE = {"kind": "envelope", "of": CHIRP, "start": 0.5, "rise": 3}
KINDS = {
    "chirp": CHIRP,
    "envelope": ENVELOPE,
    "multisine": {"kind": "multisine", "frequency": 0.5},
    "freeform": {"kind": "freeform", "frequency": 0.3, "harmonics": 6},
    "enveloped harmonics": ENVELOPE
    | {"of": "multisine", "rise": {"each": {"uniform": [2.0, 4.0]}}},
    "replay": {"kind": "replay"},
    "freeze": {"kind": "freeze"},
    "own_path": {"kind": "own_path", "frequency": 1.4},
}
UNBOUNDED = ("replay", "freeze", "own_path")


@pytest.mark.parametrize("name", KINDS)
def test_each_row_is_the_derivative_of_the_one_before(name):
    """By differences of sixth order at the engines' functions; norms are within ā, and one comes near it."""
    attack = KINDS[name] | {"vehicles": [2, 4], "magnitude": 5.0}
    one = systems.lanes(systems.study(**QUADROTOR, engine="exact", attack=attack), 1)
    lane = jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), 0, -1), one.inputs.lane)
    with jax.enable_x64(True):
        step, times = 2e-3, np.linspace(0.01, 5.99, 300)
        around = times[:, None] + step * np.arange(-3, 4)
        basis = jax.jit(jax.vmap(jax.vmap(lambda t: lane.basis(jnp.full(1, t)))))(around)
    basis = np.asarray(basis)[..., 0]  # (times, 7, 5, functions)
    assert basis.shape[2] == 5
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
    slopes = np.einsum("tnkb,n->tkb", basis, weights) / step
    now = basis[:, 3]
    scale = np.abs(now).max(axis=(0, 1))
    rough = 1e-3 if "envelope" in name else 2e-6  # the fifth derivative jumps where the rise ends
    np.testing.assert_allclose(slopes[:, :4] / scale, now[:, 1:] / scale, atol=rough)
    norms = np.linalg.norm(np.einsum("xjb,tkb->tkxj", lane.vectors[..., 0], now), axis=2)
    if name in UNBOUNDED:
        functions = np.linalg.norm(now, axis=2).max(axis=0)
        assert (functions <= lane.sizes[1][:, 0] * (1 + 1e-6)).all()
    else:
        assert 0.3 * 5.0 <= norms.max() <= 5.0 * (1 + 1e-9)


def test_the_smoother_rise_has_four_continuous_derivatives():
    """The chance that at least five of nine trials are lucky, as a polynomial with whole coefficients."""
    lucky, other = np.polynomial.Polynomial([0.0, 1.0]), np.polynomial.Polynomial([1.0, -1.0])
    risen = sum(math.comb(9, j) * lucky**j * other ** (9 - j) for j in range(5, 10))
    places = np.linspace(0.0, 1.0, 41)
    known = np.stack([risen(places), *(risen.deriv(k)(places) for k in range(1, 6))])
    found = smooth_rise(places, 0.5, order=4)
    np.testing.assert_allclose(found, known[:5] / 0.5 ** np.arange(5.0)[:, None], atol=1e-7)
    assert np.abs(found[1:, [0, -1]]).max() < 1e-12
    assert np.abs(known[5]).max() == pytest.approx(LAST_SLOPES[4])


def test_the_engines_agree_on_planar_quadrotors():
    """Path by path, to 1e-5 m, and in speeds, by windows and by steps, in the rise of an envelope."""
    attack = ENVELOPE | {"of": "sinusoid", "vehicles": [2, 4]}
    keys = QUADROTOR | {"attack": attack, "horizon": 2.0, "save": {"trajectories": "all"}}
    keys |= {"sweep": {"engine": ["exact", "nonlinear", {"kind": "nonlinear", "solver": "dopri8"}]}}
    results = jaxnet.simulate(keys, samples=1, progress=False)
    exact, *others = (
        results.trajectories["states"].sel(cell=cell).values[..., :2] for cell in range(3)
    )
    assert np.isfinite(exact).all()
    for other in others:
        np.testing.assert_allclose(other, exact, rtol=0, atol=1e-5)
    slowest = results.lanes["min_speed"].to_numpy()
    np.testing.assert_allclose(slowest[1:], slowest[0], rtol=0, atol=1e-4)
