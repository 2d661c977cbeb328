"""Delays of one's own motion alike: the margin of Olfati-Saber and Murray, 2004.

Lossy channels, errors and other orders: tests/engine/test_reference.py.
"""

import numpy as np
import pytest
from scipy.special import lambertw

import jaxnet
from jaxnet.theory import delay
from jaxnet.view.text.check import check_text
from tests import systems

AGENTS = 10
MARGIN = np.pi / (2 * AGENTS)  # of the complete network with weights of 1, 0.157 s


def keys(late, tick=0.005, **others):
    heard = [[i, j, 1.0] for i in range(1, 11) for j in range(1, 11) if i != j]
    return {
        "vehicles": AGENTS,
        "vehicle": "single_integrator",
        "navigator": "none",
        "topology": {"kind": "edges", "edges": heard, "normalised": False},
        "law": {"kind": "local", "hold": False},
        "gain": [1.0],
        "channel": {"delay": late, "own_delay": True},
        **systems.QUIET,
        "engine": "exact",
        "horizon": 20.0,
        "tail": 0.0,
        "output_step": 0.02,
        "tick": tick,
        "save": {"trajectories": "all"},
    } | others


@pytest.mark.long
@pytest.mark.parametrize("late", [0.95, 1.05])
def test_a_complete_network_is_stable_up_to_the_margin(late):
    """Deviations behave as exp(s t), `s + 10 exp(-s τ) = 0`, so `s τ = W(-10 τ)`."""
    late = round(late * MARGIN / 0.005) * 0.005
    results = jaxnet.simulate(keys(late), samples=1, progress=False)
    x = results.trajectories["states"].values[0, 0, ..., 0]
    apart = np.abs(x - x.mean(axis=1, keepdims=True)).max(axis=1)
    early, end = apart[400:600].max(), apart[800:].max()
    rate = (lambertw(-AGENTS * late) / late).real
    assert (rate < 0) == (late < MARGIN)
    assert np.log(end / early) == pytest.approx(8 * rate, abs=0.15)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("late", [0.15, 0.16])
def test_check_tells_the_margin(late, hold):
    """Under a law that holds q, also the growth at a tick, of the whole fleet's matrix."""
    law = {"kind": "local", "hold": hold}
    told = check_text(jaxnet.load(keys(late, tick=0.01, law=law)))
    assert f"the delay must be below {MARGIN:.6g} s" in " ".join(told.split())
    if not hold:
        assert ("UNSTABLE" in told) == (late > MARGIN)
        return
    ticks, eye = round(late / 0.01), np.eye(AGENTS)
    step = np.kron(np.eye(ticks + 1, k=-1), eye)
    step[:AGENTS, :AGENTS] = eye
    step[:AGENTS, -AGENTS:] = 0.01 * (np.ones_like(eye) - AGENTS * eye)
    factors = np.linalg.eigvals(step)
    factor = np.abs(np.delete(factors, np.abs(factors - 1).argmin())).max()
    assert f"deviations times {factor:.6f} at each tick" in " ".join(told.split())
    assert ("UNSTABLE" in told) == (factor > 1)


def test_a_margin_on_a_directed_ring():
    """(π/2 - |arg μ|) / |μ| for μ = 1 - exp(2πi/3)."""
    pull = 1 - np.exp(2j * np.pi / 3)
    found = min(delay.first_crossing(each, np.ones(1), np.zeros(1)) for each in (pull, pull.conj()))
    assert found == pytest.approx((np.pi / 2 - np.pi / 6) / np.sqrt(3), abs=1e-12)


@pytest.mark.parametrize(
    ("gain", "damping"), [([0.7, 1.9], [0.0, 0.0]), ([1.3, 0.0], [0.0, 0.8])], ids=str
)
def test_a_margin_of_order_two_is_where_short_ticks_lose_stability(gain, damping):
    """By the loop of a law that holds q over ticks of 2e-3 s, 1 % below and above."""
    gain, damping, pull = np.array(gain), np.array(damping), 1.4
    margin, tick = delay.first_crossing(pull, gain, damping), 2e-3
    message = np.array([*gain, 0.0])
    ticks = margin / tick - 0.5  # a held q is half a tick older on the mean
    for share in (0.99, 1.01):
        given = np.array([-pull]), damping, message, tick, round(share * ticks)
        assert (delay.late_growth(*given) < 1) == (share < 1)
