"""The local law at every instant, against matrix exponentials and a plain integration."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.view.text.check import check_text

LOCAL = {"kind": "local", "hold": False}


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


@pytest.mark.long
def test_engines_agree_path_by_path():
    """Under an attack, W-MSR and weights on oneself: to 1e-5 m while nobody stands still.

    The nonlinear engine moves as a plain program does: tests/engine/test_reference.py.
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
    """A robot on the navigator's line that has to turn back stands still on the way, alone."""
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
    """Ring of six without navigator, order 2: roots of `s² + (1 - λ)(k1 s + k0)`, and a run."""
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
