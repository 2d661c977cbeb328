"""Weights by reputation, against the published example and a plain program in the plane."""

import numpy as np
import pytest

from tests import systems

STARTS = [2.0, 4.8, 3.7, 3.5, 2.8, 2.5, 0.5, 4.7, 1.0, 3.6]
HEARD = [[9, 1, 4, 7, 6], [0, 9, 2, 3, 8, 5, 6], [3, 9, 5, 1, 6, 4], [2, 9, 5, 8, 4, 6, 1]]
HEARD += [[0, 6, 8, 7, 9, 1], [3, 8, 7, 6, 1, 9, 4, 2], [5, 8, 7, 4, 1, 3, 0], [8, 6, 4, 0, 5]]
HEARD += [[7, 5, 3, 6, 4, 1, 9], [2, 0, 3, 1, 5, 8, 6, 4]]
KEYS = {"navigator": "none", "vehicle": "single_integrator", "law": "local", "gain": [1.0]}
KEYS |= {"tick": 1.0, "output_step": 1.0, "tail": 0.0}


def states(starts, heard, liars, engine="exact", steps=80, **keys):
    """Places at ticks, (times, vehicles, 2)."""
    edges = [[i + 1, j + 1, 1.0] for i, each in enumerate(heard) for j in each]
    liar = {"kind": "own_path", "swing": [0.0, 0.0], "moves": "as_told"}
    given = {
        "vehicles": len(starts),
        "topology": {"kind": "edges", "edges": edges},
        "initial": {"position": starts},
        "attack": {**liar, "vehicles": [one + 1 for one in liars]},
        "defence": {"kind": "reputation", **keys},
        "engine": engine,
        "horizon": float(steps),
    }
    return systems.outcome(1, **KEYS, **given).series["state"][0]


@pytest.mark.parametrize(
    "engine", ["exact", pytest.param({"kind": "sampled", "move": "euler"}, marks=pytest.mark.long)]
)
def test_published_example(engine):
    """After 1 and 5 steps and in the end (Ramos, Silvestre and Silvestre, arXiv 2107.00431)."""
    found = states(STARTS, HEARD, [0, 8], engine, f=2, epsilon=0.1)[..., 0]
    first, fifth = [2.55789474, 3.19550562, 3.02624729], [2.74167600, 2.74344293, 2.73981662]
    np.testing.assert_allclose(found[1, 1:4], first, rtol=0, atol=5e-9)
    np.testing.assert_allclose(found[5, 1:4], fifth, rtol=0, atol=5e-9)
    honest = np.delete(found[-1], [0, 8])
    np.testing.assert_allclose(honest, 2.73722048, rtol=0, atol=5e-9)


def stepped(x, heard, f, epsilon, tick):
    """One step of the rule with distances in the plane."""
    new = x.copy()
    for i, sources in enumerate(heard):
        raw = [1 - np.mean([np.hypot(*(x[j] - x[v])) for v in sources]) for j in sources]
        distinct = []
        for each in sorted(raw):
            distinct += [each] if not distinct or each > distinct[-1] + 1e-12 else []
        below = distinct[:-1] or distinct
        least, most = below[min(f, len(below) - 1)], distinct[-1]
        c = [
            (each - least) / (most - least) if each > least + 1e-12 else epsilon ** (tick + 1)
            for each in raw
        ]
        new[i] = sum(weight * x[j] for weight, j in zip(c, sources, strict=True)) / sum(c)
    return new


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.long) for s in (1, 2, 3))])
def test_it_moves_as_a_plain_program_in_the_plane(seed):
    """Drawn fleets; some vehicles start at one place, some hear few or one."""
    rng = np.random.default_rng(seed)
    m, f, epsilon = int(rng.integers(5, 9)), int(rng.integers(0, 4)), [0.3, 0.05][seed % 2]
    x = np.round(rng.uniform(-5, 5, (m, 2)), 2)
    x[1] = x[2]
    heard = [
        rng.choice(np.delete(np.arange(m), i), int(rng.integers(1, m)), replace=False).tolist()
        for i in range(m)
    ]
    liars = [m - 1]
    found = states(x.tolist(), heard, liars, steps=8, f=f, epsilon=epsilon)
    for tick, now in enumerate(found):
        np.testing.assert_allclose(now, x, rtol=0, atol=1e-8)
        x = np.where(np.isin(np.arange(m), liars)[:, None], x, stepped(x, heard, f, epsilon, tick))
