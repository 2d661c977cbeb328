"""Theorems of docs/guarantees.md by a plain program: rate, noise, delay and filter."""

import itertools

import numpy as np
import pytest

from jaxnet.model import graph, safety
from tests.model.test_safety import VEHICLES, drops_of, greatest, scenario


def rounds(network, liar, *, number=60, noise=0.0, delay=0, start=10.0, seed=0, constant=None):
    """Greatest ‖ρ‖ of each vehicle round by round: drop the ϑ greatest untrusted, average the
    others.

    `liar` says what attacked links carry, knowing all that is announced. Honest announcements reach
    each listener wrong by `noise` and late by up to `delay` rounds. With a time `constant`, in
    rounds, scores are filtered before they are compared.
    """
    weights, attacked, trusted, theta = network
    rng, m = np.random.default_rng(seed), len(weights)
    history = [np.concatenate([np.zeros((1, 2)), start * directions(rng, m)])]
    score = None
    for _ in range(number):
        late = rng.integers(0, delay + 1, weights.shape)
        told = np.array(history)[np.maximum(len(history) - 1 - late, 0), np.arange(m + 1)[None]]
        told[:, 1:] += noise * directions(rng, m, m)
        told = np.where(attacked[..., None], liar(rng, told, attacked, weights), told)
        now = np.linalg.norm(told, axis=-1)
        share = 1.0 if constant is None or score is None else -np.expm1(-1 / constant)
        score = now if score is None else score + share * (now - score)
        kept = retained(weights, score, trusted, theta)
        kept /= kept.sum(axis=1, keepdims=True)
        history.append(np.concatenate([np.zeros((1, 2)), (kept[..., None] * told).sum(axis=1)]))
    return np.linalg.norm(np.array(history)[:, 1:], axis=-1)


def directions(rng, *shape):
    """Unit vectors."""
    angle = rng.uniform(0, 2 * np.pi, shape)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def retained(weights, score, trusted, theta):
    """Weights without the ϑ greatest untrusted of each vehicle that hears more than ϑ."""
    kept = weights.copy()
    for i, row in enumerate(kept):
        if (row > 0).sum() > theta[i]:
            untrusted = np.flatnonzero((row > 0) & ~trusted[i])
            row[untrusted[np.argsort(-score[i, untrusted], kind="stable")][: theta[i]]] = 0.0
    return kept


def at_random(rng, told, attacked, weights):
    """Of any size."""
    return directions(rng, *attacked.shape) * rng.exponential(5.0, (*attacked.shape, 1))


def greedy(rng, told, attacked, weights):
    """Each link just below the greatest good score of its listener, along what the others say."""
    good = (weights > 0) & ~attacked
    size = np.linalg.norm(told, axis=-1).max(axis=1, initial=0.0, where=good)
    along = (weights * good)[..., None] * told
    along = along.sum(axis=1) + 1e-12 * directions(rng, len(weights))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    return np.broadcast_to((0.999999 * size[:, None] * along)[:, None], told.shape)


def certified(number):
    """Random networks whose vehicles are all safe, with the last one's steps from the navigator."""
    for seed in itertools.count():
        heard, attacked, trusted, theta = scenario(seed)
        steps = percolation(heard, attacked, trusted, theta)
        if attacked.any() and steps:
            weights = heard * np.random.default_rng(seed).uniform(0.2, 1.0, heard.shape)
            yield (weights / weights.sum(axis=1, keepdims=True), attacked, trusted, theta), steps
            number -= 1
            if not number:
                return


def told_to_shrink(number):
    """Random networks with equal weights, whose safe vehicles forget at a rate that is told."""
    for seed in itertools.count():
        heard, attacked, trusted, theta = scenario(seed)
        drops = drops_of(heard, trusted, theta)
        safe = greatest(drops, attacked)
        if rate := safety.contraction(drops, safe):
            yield (graph.dense(drops.graph), attacked, trusted, theta), safe, rate
            number -= 1
            if not number:
                return


def percolation(heard, attacked, trusted, theta):
    """The most steps of assumption A3, if it holds of all vehicles as A1 and A2 do, else None."""
    theta = np.where(heard.sum(axis=1) > theta, theta, 0)
    for_good = (theta > 0) & ((heard & ~trusted).sum(axis=1) <= theta)
    heard, theta = heard & (trusted | ~for_good[:, None]), np.where(for_good, 0, theta)
    bad = heard & attacked
    if (bad & trusted).any() or (bad.sum(axis=1) > theta).any():
        return None
    near, steps = np.zeros(VEHICLES + 1, bool), 0
    near[0] = True
    while not near.all():
        new = (heard & trusted & near).any(axis=1) | ((heard & near).sum(axis=1) > theta)
        if not (new & ~near[1:]).any():
            return None
        near[1:] |= new
        steps += 1
    return steps


NETWORKS = list(certified(10))
LIARS = pytest.mark.parametrize("liar", [at_random, greedy])


def share(network):
    """The least weight ω that a source has in a mean."""
    return network[0][network[0] > 0].min()


def test_the_networks_tried_are_worth_it():
    """Several hops, ϑ over 1, and not everybody hears the navigator."""
    assert max(steps for _, steps in NETWORKS) >= 3
    assert any((network[3] > 1).any() for network, _ in NETWORKS)
    assert sum((network[0][:, 0] == 0).any() for network, _ in NETWORKS) >= 4


@LIARS
def test_what_safe_vehicles_announce_shrinks_as_told(liar):
    """By `1 - ω^D` in D rounds at least, and it never grows (T1); others may announce anything."""
    for seed, (network, safe, (number, factor)) in enumerate(told_to_shrink(12)):
        sizes = rounds(network, liar, number=150, seed=seed)[:, safe].max(axis=1)
        assert (np.diff(sizes) <= 1e-12).all()
        assert (sizes[number:] <= factor * sizes[:-number] + 1e-12).all()


@LIARS
def test_noise_leaves_no_more_than_the_theorem_says(liar):
    """`(D/ω^D + D - 1) ν` (corollary 1)."""
    for seed, (network, steps) in enumerate(NETWORKS):
        left = rounds(network, liar, number=150, noise=0.01, start=0.0, seed=seed).max()
        bound = (steps / share(network) ** steps + steps - 1) * 0.01
        assert 0.001 < left <= bound


@LIARS
def test_late_announcements_do_no_harm(liar):
    """Each up to four rounds old, differently for every listener and round (corollary 2)."""
    for seed, (network, _) in enumerate(NETWORKS):
        greatest = rounds(network, liar, number=200, delay=4, seed=seed).max(axis=1)
        before = np.lib.stride_tricks.sliding_window_view(greatest, 5).max(axis=1)
        assert (greatest[5:] <= before[:-1] + 1e-12).all()
        assert greatest[-1] < 0.1 * greatest[0]


@LIARS
def test_filtered_announcements_shrink_where_all_hear_the_navigator(liar):
    """One hop and equal weights, ϑ of 1 and 2 (T2)."""
    for heard, theta in ((3, 1), (4, 1), (4, 2)):
        m = 8
        weights = np.zeros((m, m + 1))
        weights[:, 0] = 0.2
        for i in range(m):
            weights[i, 1 + (i + np.arange(1, heard + 1)) % m] = 0.8 / heard
        attacked = np.zeros(weights.shape, bool)
        attacked[:, [1, 5] if theta == 2 else [1]] = True
        trusted = np.zeros(weights.shape, bool)
        trusted[:, 0] = True
        network = weights, attacked & (weights > 0), trusted, np.full(m, theta)
        assert ((network[1]).sum(axis=1) <= theta).all()
        for constant in (2.0, 10.0):
            greatest = rounds(network, liar, number=400, constant=constant).max(axis=1)
            assert greatest[-1] < 1e-6 * greatest[0]
