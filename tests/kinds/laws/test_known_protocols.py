"""Protocols of the literature as laws by link from outside: closed forms and plain steps."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.fields import Number
from jaxnet.kinds.laws import LinkLaw
from tests import systems

STARTS = [[-3.0, 1.0], [4.0, -2.0], [0.5, 6.0], [2.5, -5.0]]
EDGES = [[1, 2, 1.0], [2, 1, 1.0], [2, 3, 0.5], [3, 2, 0.5], [3, 4, 2.0], [4, 3, 2.0]]

TWO = {"vehicles": 2, "topology": {"kind": "edges", "edges": EDGES[:2], "normalised": False}}


def places(law, **keys):
    """Times, and places of four single integrators on a weighted path: (times, 4, 2)."""
    fixed = {
        "law": law,
        "engine": "exact",
        "navigator": "none",
        "vehicles": 4,
        "vehicle": "single_integrator",
        "topology": {"kind": "edges", "edges": EDGES, "normalised": False},
        "gain": [1.0],
        "initial": {"position": STARTS},
        **systems.QUIET,
        **systems.clock(0.01, 2.0),
        "save": {"trajectories": "all"},
    }
    results = jaxnet.simulate({**fixed, **keys}, samples=1, progress=False)
    assert results.lanes["status"].to_list() == ["ok"]
    data = results.trajectories.sel(cell=0, sample=0)
    return data["time"].values, data["states"].values


def stepped(demand, steps, tick=0.01):
    """Plain steps: `demand(x, n)` gives the velocities."""
    path = [np.array(STARTS)]
    for n in range(steps):
        path.append(path[-1] + tick * demand(path[-1], n))
    return np.array(path)


def sums(pull, x):
    """`Σ_j a_ij pull(x_j - x_i)`."""
    found = np.zeros_like(x)
    for i, j, weight in EDGES:
        found[i - 1] += weight * pull(x[j - 1] - x[i - 1])
    return found


class FixedTime(LinkLaw):
    """`q_i = k0 Σ_j a_ij (sig(Δ)^½ + sig(Δ)^1.5)`, by axis (Zuo and Tie, 2014)."""

    def demand(self, apart, links):
        size = abs(apart[0])
        pull = jnp.sign(apart[0]) * (size**0.5 + size**1.5)
        return links.gain[0][None, None] * (links.weights * pull).sum(axis=1)


def test_a_protocol_in_fixed_time_steps_as_a_plain_program():
    """Each step to 1e-12."""

    def pull(d):
        return np.sign(d) * (abs(d) ** 0.5 + abs(d) ** 1.5)

    _, found = places(FixedTime(), horizon=0.2)
    expected = stepped(lambda x, n: sums(pull, x), 20)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


class PrescribedTime(LinkLaw):
    """`q_i = (k0 + 2 / (T - t)) Σ_j a_ij Δ`, until T (Wang, Song, Hill and Krstić, 2019)."""

    end: float

    def demand(self, apart, links):
        left = self.end - links.time
        rate = links.gain[0] + jnp.where(left > 1e-9, 2.0 / jnp.where(left > 1e-9, left, 1.0), 0.0)
        return rate[None, None] * (links.weights * apart[0]).sum(axis=1)


@pytest.mark.parametrize("tick", [0.01, pytest.param(0.001, marks=pytest.mark.long)])
def test_a_protocol_in_prescribed_time(tick):
    """Two agents: x' = -(k0 + 2/(T - t)) 2 x, so `x = x(0) exp(-2 k0 t) ((T - t) / T)^4`.

    A step of h multiplies x by `1 - 2 h (k0 + 2 / (T - t))`, to rounding.
    """
    start = {"initial": {"position": [[0.0, 0.0], [8.0, 0.0]]}, "horizon": 1.0}
    steps_of = {"tick": tick, "output_step": tick}
    time, found = places(PrescribedTime(end=1.0), **TWO | start | steps_of)
    apart, left = found[:, 1, 0] - found[:, 0, 0], 1.0 - time[:-1]
    steps = np.concatenate([[1.0], np.cumprod(1 - 2 * tick * (1.0 + 2.0 / left))])
    np.testing.assert_allclose(apart, 8.0 * steps, rtol=0, atol=1e-12)
    closed = 8.0 * np.exp(-2.0 * time) * (1.0 - time) ** 4
    assert abs(apart - closed).max() < 16.0 * tick


class EventTriggered(LinkLaw):
    """A vehicle takes a new q only when its q is a share of the new one off, by axis.

    Source: Fan, Feng, Wang and Song, Automatica 49, 2013 (combinational measurements). What a
    vehicle remembers is the q that it holds.
    """

    share: Number

    def demand(self, apart, links):
        return links.gain[0][None, None] * (links.weights * apart[0]).sum(axis=1)

    def exchange(self, last, demand, heard):
        return jnp.where(abs(last - demand) > self.share[None, None] * abs(demand), demand, last)


def test_a_protocol_that_acts_at_events():
    """Each step to 1e-12, fewer events than ticks, and agreement on the mean."""
    held = {"q": np.zeros((4, 2)), "events": 0}

    def demand(x, n):
        new = sums(lambda d: d, x)
        event = abs(held["q"] - new) > 0.3 * abs(new)
        held["events"] += event.sum()
        held["q"] = np.where(event, new, held["q"])
        return held["q"]

    _, found = places(EventTriggered(share=0.3), horizon=20.0)
    np.testing.assert_allclose(found, stepped(demand, 2000), rtol=0, atol=1e-12)
    assert 0 < held["events"] < 0.2 * 2000 * 8
    assert abs(found[-1] - np.mean(STARTS, axis=0)).max() < 0.05
