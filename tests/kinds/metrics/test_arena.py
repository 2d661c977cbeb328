"""Collisions and robots outside, against a count in NumPy over stored places."""

import numpy as np

import jaxnet

KEYS = {"vehicles": 5, "engine": {"kind": "sampled", "move": "euler"}, "law": "local"}
KEYS |= {"tick": 0.05, "output_step": 0.05, "horizon": 3.0, "tail": 1.0, "defence": "none"}
KEYS |= {"navigator": "none", "initial": {"position": {"uniform": [-1.5, 1.5]}}, "gain": [1.0]}
KEYS |= {"vehicle": "robotarium", "topology": "complete", "save": {"trajectories": "all"}}
KEYS |= {"attack": {"kind": "bias", "magnitude": 1.0, "vehicles": [2]}}
ANY = {"kind": "collisions", "distance": 0.4, "forward": 0.0}


def counts(states, distance, forward, x, y):
    """Both counts of one lane, (outputs, m, n), pair by pair and step by step."""
    touching = outside = 0
    for state in states[:-1]:  # no step follows the last place
        centres = [
            place + forward * np.array([np.cos(heading), np.sin(heading)])
            for *place, heading in state
        ]
        pairs = ((a, b) for i, a in enumerate(centres) for b in centres[:i])
        touching += sum(np.linalg.norm(a - b) <= distance for a, b in pairs)
        outside += any(abs(state[:, 0]) > x) or any(abs(state[:, 1]) > y)
    return touching, outside


def test_both_counts_are_those_of_the_places():
    metrics = [
        {"kind": "collisions", "distance": 0.3, "forward": 0.1},
        {"kind": "outside_arena", "x": 1.2, "y": 1.1},
    ]
    results = jaxnet.simulate({**KEYS, "metrics": metrics}, samples=8, progress=False)
    states = results.trajectories["states"].values[0]
    expected = np.array([counts(each, 0.3, 0.1, 1.2, 1.1) for each in states])
    assert (np.ptp(expected, axis=0) > 20).all()
    np.testing.assert_array_equal(results.lanes[["collisions", "outside_arena"]], expected)


def test_agents_without_heading_collide_at_their_places():
    keys = {**KEYS, "vehicle": "single_integrator", "metrics": [ANY]}
    results = jaxnet.simulate(keys, samples=4, progress=False)
    states = results.trajectories["states"].values[0]
    bare = np.concatenate([states, np.zeros_like(states[..., :1])], axis=-1)
    expected = [counts(each, 0.4, 0.0, np.inf, np.inf)[0] for each in bare]
    assert max(expected) > 20
    assert results.lanes["collisions"].tolist() == expected
