"""The local law at every instant, against matrix exponentials and a plain integration."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import jaxnet
from jaxnet.view.text.check import check_text
from tests.matrices import matrix_of

LOCAL = {"kind": "local", "hold": False}
LIARS = [2, 5, 8, 11]


def paths(**keys):
    """Results, times and positions (times, vehicles, 2) of one lane in the exact engine."""
    keys = {
        "law": LOCAL,
        "engine": "exact",
        "horizon": 4.0,
        "tail": 1.0,
        "save": {"trajectories": "all"},
    } | keys
    results = jaxnet.simulate(keys, progress=False)
    data = results.trajectories.sel(cell=0, sample=0)
    return results, data["time"].values, data["states"].values


@pytest.mark.parametrize(("tick", "gain"), [(0.01, 4.0), (0.5, 4.0), (0.5, 60.0)])
def test_a_laplacian_flow_is_its_exponential(tick, gain):
    """`ẏ = -k0 L y` with weights as they are: `expm(-k0 L t)`, to rounding, also for long ticks."""
    edges = [[i, j % 6 + 1, 0.5 + i / 10] for i in range(1, 7) for j in (i, i + 1, i + 3)]
    L = np.zeros((6, 6))
    for i, j, w in edges:
        L[i - 1, j - 1], L[i - 1, i - 1] = -w, L[i - 1, i - 1] + w
    keys = {"topology": {"kind": "edges", "edges": edges, "normalised": False}, "navigator": "none"}
    keys |= {
        "vehicle": "single_integrator",
        "gain": [gain],
        "attack": "none",
        "tick": tick,
        "output_step": 0.5,
    }
    _, times, states = paths(**keys)
    for time, now in zip(times, states, strict=True):
        np.testing.assert_allclose(now, expm(-gain * L * time) @ states[0], rtol=0, atol=2e-10)


def test_the_law_agrees_with_a_plain_integration():
    """Of `y^(r) = a0 y_0^(r) - P(ε)`, plus the attack's, by a Runge–Kutta method."""
    order, gain = 3, [1.5, 3.5, 3.0]
    attack = {"kind": "rotating", "vehicles": LIARS, "magnitude": 5.0, "frequency": 1.7}
    keys = {"vehicle": "two_wheeled", "gain": gain, "attack": attack, "defence": "none"}
    results, times, states = paths(**keys, initial={"speed": 20.0})
    jets = results.study.config.vehicle.output_jets(np.moveaxis(states, -1, 0)[..., None])
    jets = np.stack([jet[..., 0] for jet in jets])  # (order, 2, times, vehicles)
    weights = matrix_of(results.study.config.topology, 12)
    A, a0 = weights[:, 1:], weights[:, 0]
    data = results.trajectories.sel(cell=0, sample=0)
    first = data["attack"].values[0]
    turned = np.stack([-first[:, 1], first[:, 0]], axis=1)

    def attacked(time, k):
        """The k-th derivative of the signals."""
        angle = 1.7 * time + k * math.pi / 2
        return 1.7**k * (math.cos(angle) * first + math.sin(angle) * turned)

    def rates(time, flat):
        """Derivatives of all jets, from the law vehicle by vehicle."""
        y = flat.reshape(order, 12, 2)
        navigator = np.asarray(results.study.config.navigator.jets(np.asarray(time)))
        asked = a0[:, None] * navigator[order]
        for k in range(order):
            heard = a0[:, None] * navigator[k] + A @ (y[k] + attacked(time, k))
            asked = asked - gain[k] * (y[k] - heard)
        return np.concatenate([y[1:].ravel(), asked.ravel()])

    start = np.moveaxis(jets[:, :, 0], 1, 2).ravel()
    plain = solve_ivp(
        rates, (0.0, 4.0), start, t_eval=times, rtol=1e-11, atol=1e-11, method="DOP853"
    )
    positions = plain.y.T.reshape(len(times), order, 12, 2)[:, 0]
    np.testing.assert_allclose(states[..., :2], positions, rtol=0, atol=1e-7)


def test_shorter_and_shorter_holds_come_to_the_law_at_every_instant():
    """Under trimming, noise and loss off: the held law is off by a multiple of the tick."""
    keys = {
        "attack": {"kind": "bias", "magnitude": 3.0},
        "defence": "none",
        "initial": {"speed": 20.0},
    }
    _, _, states = paths(**keys, vehicle="double_integrator")
    apart = []
    for tick in (0.02, 0.01):
        _, _, held = paths(**keys, vehicle="double_integrator", law="local", tick=tick)
        apart.append(np.abs(held - states).max())
    assert apart[0] / apart[1] == pytest.approx(2.0, abs=0.05)
    assert apart[0] < 2.0


def test_decisions_noise_and_loss_act_at_ticks():
    """Single integrators under W-MSR, noise and loss, tick by tick, with expm of each tick's matrix."""
    h = 0.1
    keys = {
        "vehicle": "single_integrator",
        "navigator": "none",
        "gain": [2.0],
        "tick": h,
        "output_step": h,
    }
    keys |= {
        "attack": {"kind": "bias", "magnitude": 150.0, "vehicles": [2]},
        "defence": "w_msr",
        "vehicles": 7,
    }
    keys |= {"topology": "complete", "horizon": 1.0, "tail": 0.0}
    results, _, states = paths(**keys)
    lie = results.trajectories.sel(cell=0, sample=0)["attack"].values[0]
    for before, after in itertools.pairwise(states):
        sent = before + lie
        for axis in range(2):
            W, forced = np.zeros((7, 7)), np.zeros(7)
            for i in range(7):
                heard = [j for j in range(7) if j != i]
                above = sorted(
                    (j for j in heard if sent[j, axis] > before[i, axis]),
                    key=lambda j: sent[j, axis],
                )
                below = sorted(
                    (j for j in heard if sent[j, axis] < before[i, axis]),
                    key=lambda j: sent[j, axis],
                )
                kept = [j for j in heard if j not in (*above[-1:], *below[:1])]
                W[i, kept] = 1 / len(kept)
                forced[i] = W[i] @ lie[:, axis]
            A = np.zeros((8, 8))  # ẋ = -2 (I - W) x + 2 W lie, with a constant as the eighth state
            A[:7, :7], A[:7, 7] = -2 * (np.eye(7) - W), 2 * forced
            now = expm(A * h) @ np.append(before[:, axis], 1.0)
            np.testing.assert_allclose(after[:, axis], now[:7], rtol=0, atol=1e-10)


def test_engines_agree_path_by_path():
    """Under an attack, W-MSR and weights on oneself: to 1e-5 m while nobody stands still.

    The nonlinear engine moves as a plain program does: tests/engine/test_drawn.py.
    """
    keys = {
        "vehicle": "unicycle",
        "attack": {"kind": "rotating", "magnitude": 10},
        "defence": "w_msr",
        "tick": 0.1,
    }
    keys |= {
        "topology": {"kind": "circulant", "offsets": [1, 2, 3], "own_weight": 1.0},
        "vehicles": 6,
    }
    keys |= {"horizon": 2.0, "initial": {"speed": 20.0}}
    keys["attack"] |= {"vehicles": [2, 4]}
    _, _, exact = paths(**keys)
    _, _, other = paths(**keys, engine="stacked")
    assert np.isfinite(other).all()
    np.testing.assert_allclose(other[..., :2], exact[..., :2], rtol=0, atol=1e-5)


def test_a_vehicle_that_comes_to_rest_fails_alone():
    """A robot on the navigator's line that has to turn back stands still on the way, and no other does."""
    keys = {"topology": {"kind": "edges", "edges": [[1, 0, 1.0]]}, "vehicles": 1, "attack": "none"}
    keys |= {
        "navigator": {"kind": "lissajous", "amplitude": [1000.0, 0.0], "frequency": [0.01, 0.01]}
    }
    keys |= {
        "initial": {"position": [[-50.0, 0.0]], "speed": 10.0},
        "sweep": {"initial.heading": [0.0, 3.141592653589793]},
    }
    results, *_ = paths(**keys)
    assert results.lanes["status"].to_list() == ["ok", "singular"]


def test_check_tells_the_rate_of_the_slowest_motion():
    """On a ring of six without navigator, order 2: the roots of `s² + (1 - λ)(k1 s + k0)`, and a run."""
    edges = [[i, i % 6 + 1, 1.0] for i in range(1, 7)]
    keys = {
        "topology": {"kind": "edges", "edges": edges},
        "navigator": "none",
        "attack": "none",
        "law": LOCAL,
    }
    keys |= {"vehicle": "double_integrator", "gain": [1.0, 4.0], "engine": "exact"}
    turn = 1 - np.exp(1j * np.pi / 3 * np.arange(1, 6))
    rate = max(np.roots([1.0, 4.0 * each, each]).real.max() for each in turn)
    assert rate < 0
    assert f"stable, deviations behave as exp({rate:.4f} t)" in check_text(jaxnet.load(keys))
    assert "UNSTABLE" in check_text(jaxnet.load({**keys, "gain": [4.0, 1.0]}))
