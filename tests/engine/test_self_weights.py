"""Weights of vehicles on themselves, and weights as they are, against short plain programs."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.view.text.check import check_text
from tests import systems

H = 0.1
KEYS = {**systems.AGENTS, "gain": [1 / H], "tick": H}
KEYS |= {"engine": "exact", "horizon": 5.0, "output_step": H, "tail": 0.0}
RING = [[i, j % 6 + 1, 1.0 + i / 10] for i in range(1, 7) for j in (i, i + 1, i + 3)]


def paths(**keys):
    """States (times, vehicles, 2) of one lane, and what the attacks add (times, vehicles, 2)."""
    series = systems.outcome(1, **KEYS | keys).series
    return series["state"][0], series["attack"][0]


def test_vehicles_step_by_weights_that_count_themselves():
    """`x ← W x`, where W has the diagonal of the edges and rows that sum to 1."""
    own = [[i, i, 0.5 * i] for i in range(1, 5)]
    states, _ = paths(topology={"kind": "edges", "edges": RING + own}, attack="none")
    W = np.zeros((6, 6))
    for i, j, w in RING + own:
        W[i - 1, j - 1] = w
    W /= W.sum(axis=1, keepdims=True)
    x = states[0]
    for now in states:
        np.testing.assert_allclose(now, x, rtol=0, atol=1e-11)
        x = W @ x


def subsequence(own, received):
    """W-MSR with F = 1 on one axis: what it retains, and its mean; the own value of nothing."""
    equal = 1e-12 * np.maximum(1, np.maximum(np.abs(received), abs(own)))  # as the engine compares
    numbers = range(len(received))
    above = [n for n in numbers if received[n] - own > equal[n]]
    below = [n for n in numbers if own - received[n] > equal[n]]
    dropped = {max(above, key=received.__getitem__, default=None)}
    dropped |= {min(below, key=received.__getitem__, default=None)}
    kept = [n for n in numbers if n not in dropped]
    return kept, received[kept].mean() if kept else own


AS_THEY_ARE = [[i, j, 0.1 * i] for i in range(1, 8) for j in range(1, 8) if i != j]


@pytest.mark.long
@pytest.mark.parametrize("counts_itself", [True, False])
def test_w_msr_drops_the_farthest_on_each_side(counts_itself):
    """Published W-MSR counts the vehicle itself: each weight is 1/(1 + d) of the d retained.

    With weights as they are, those that are dropped weaken a row: `x_i ← x_i - k0 h Σ w_ij (x_i -
    x_j)` over those retained, without renormalisation.
    """
    attack = {"kind": "rotating", "magnitude": 150.0, "frequency": 0.9, "vehicles": [2]}
    keys = {"topology": {"kind": "complete", "own_weight": 1.0}, "vehicles": 7}
    if not counts_itself:
        topology = {"kind": "edges", "edges": AS_THEY_ARE, "normalised": False}
        keys = {"topology": topology, "gain": [1.5]}
    states, lies = paths(**keys, attack=attack, defence="w_msr", horizon=0.6)
    x, dropped = states[0].copy(), 0
    for now, lie in zip(states, lies, strict=True):
        np.testing.assert_allclose(now, x, rtol=0, atol=1e-11)
        sent, new = x + lie, np.empty_like(x)
        for i in range(7):
            heard = [j for j in range(7) if j != i]
            for axis in range(2):
                kept, _ = subsequence(x[i, axis], sent[heard, axis])
                dropped += 6 - len(kept)
                apart = (x[i, axis] - sent[heard, axis])[list(kept)]
                share = 1 / (1 + len(kept)) if counts_itself else 1.5 * H * 0.1 * (i + 1)
                new[i, axis] = x[i, axis] - share * apart.sum()
        x = new
    assert dropped > 50


def test_weights_as_they_are_make_the_laplacian():
    """`x ← x - k0 h L x` with L of the raw weights; shorter ticks come closer to `exp(-k0 L t)`."""
    topology = {"kind": "edges", "edges": [[i, j, w / 3] for i, j, w in RING], "normalised": False}
    L = np.zeros((6, 6))
    for i, j, w in topology["edges"]:
        L[i - 1, j - 1], L[i - 1, i - 1] = -w, L[i - 1, i - 1] + w
    keys = {"topology": topology, "attack": "none", "gain": [2.0], "horizon": 1.0}
    states, _ = paths(**keys)
    x = states[0]
    for now in states:
        np.testing.assert_allclose(now, x, rtol=0, atol=1e-11)
        x = x - 2.0 * H * L @ x
    fine, _ = paths(**keys, tick=1e-4)
    np.testing.assert_allclose(fine[-1], expm(-2.0 * L) @ fine[0], atol=2e-2)


CYCLE = [[i, i % 6 + 1, 1.0] for i in range(1, 7)]
QUARTERS = [[i, j, 0.25] for i, j, _ in CYCLE]
LOOPS = [[i, i, 1.0] for i in range(1, 7)]
TURN = np.exp(1j * np.pi / 3)  # of the ring of six, in which each hears the next


@pytest.mark.parametrize(
    ("topology", "radius"),
    [
        ({"edges": CYCLE + LOOPS}, abs(1 + TURN) / 2),
        pytest.param(
            {"edges": QUARTERS, "normalised": False},
            abs(0.75 + 0.25 * TURN),
            marks=pytest.mark.long,
        ),
        ({"edges": CYCLE, "own_weight": 3.0}, abs(3 + TURN) / 4),
    ],
)
def test_check_tells_the_factor_of_the_slowest_disagreement(topology, radius):
    """The second greatest eigenvalue of W, in closed form on a ring; a run decays by it."""
    keys = {"topology": {"kind": "edges", **topology}, "attack": "none", "horizon": 12.0}
    assert f"times {radius:.4f} at each tick" in check_text(jaxnet.load(KEYS | keys))
    states, _ = paths(**keys)
    apart = np.linalg.norm(states - states.mean(axis=1, keepdims=True), axis=(1, 2))
    assert (apart[-1] / apart[60]) ** (1 / 60) == pytest.approx(radius, abs=1e-3)
