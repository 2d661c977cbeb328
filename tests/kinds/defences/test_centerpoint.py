"""The centerpoint: its depth, that it is in the middle, its least weights, what liars can do."""

import itertools
import math

import jax
import numpy as np
import pytest

from jaxnet.model import centerpoint

SLOTS, VEHICLES, LANES = 6, 4, 2500
WEIGHTS = jax.jit(centerpoint.weights)


def drawn(seed, heard=0.8):
    """10,000 neighbourhoods on whole numbers, with ties and many on a line, and weights found."""
    rng = np.random.default_rng(seed)
    shape = (SLOTS, VEHICLES, LANES)
    position = rng.integers(-3, 4, (2, *shape)).astype(float)
    weights = rng.integers(1, 4, shape) * (rng.random(shape) < heard) / 4.0
    weights[0] = np.maximum(weights[0], 0.25)
    return position, weights


def depth(position, heard, point):
    """Fewest positions in a closed half-plane through a point, by brute force beside each of them.

    Positions are (2, slots, …), points (2, …); a half-plane is as good as another while no position
    enters or leaves it, so those are looked at whose edge has just passed one.
    """
    apart = position - point[:, None]
    angle, fewest = np.arctan2(apart[1], apart[0]), np.full(point.shape[1:], len(heard))
    for slot, side, beside in itertools.product(range(len(heard)), (-1, 1), (-1e-4, 1e-4)):
        normal = angle[slot] + side * math.pi / 2 + beside
        inside = np.cos(normal) * apart[0] + np.sin(normal) * apart[1] >= -1e-6
        fewest = np.minimum(fewest, (inside & heard).sum(axis=0))
    return fewest


@pytest.mark.parametrize("heard", [0.8, pytest.param(1.0, marks=pytest.mark.long)])
def test_each_half_plane_holds_a_third(heard):
    """Of 10,000 neighbourhoods, of which most have a mean that is no centerpoint."""
    position, weights = drawn(1, heard)
    found = np.asarray(WEIGHTS(position, weights))
    assert (found >= 0).all()
    assert not found[weights == 0].any()
    np.testing.assert_allclose(found.sum(axis=0), 1.0, rtol=1e-12)
    needed = -(-(weights > 0).sum(axis=0) // 3)
    point, mean = (
        (each[None] * position).sum(axis=1) for each in (found, weights / weights.sum(axis=0))
    )
    assert (depth(position, weights > 0, point) >= needed).all()
    assert (depth(position, weights > 0, mean) < needed).mean() > 0.3


def cut(corners, normal, offset):
    """A polygon, corner by corner, without what is beyond a line."""
    left = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        here, there = normal @ a - offset, normal @ b - offset
        if here <= 0:
            left.append(a)
        if min(here, there) < 0 < max(here, there):
            left.append(a + (b - a) * here / (here - there))
    return left


def middle(positions):
    """Mean of the boundary of all centerpoints, cut out of a square, half-plane by half-plane."""
    third = -(-len(positions) // 3)
    normals = [np.array(axis, float) for axis in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    for a, b in itertools.permutations(positions, 2):
        if (along := b - a).any():
            normals.append(np.array([-along[1], along[0]]) / np.hypot(*along))
    corners = [np.array(corner, float) for corner in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
    for normal in normals:
        corners = cut(corners, normal, np.sort(positions @ normal)[-third] + 1e-11)
    ends = np.array(corners), np.roll(corners, -1, axis=0)
    sizes = np.hypot(*(ends[1] - ends[0]).T) + 1e-15
    return (sizes[:, None] * (ends[0] + ends[1]) / 2).sum(axis=0) / sizes.sum()


def least(positions, weights, point):
    """Least `Σ λ²/w` of weights whose mean is a point, by trying everybody who may have one."""
    costs = []
    for size in range(1, len(positions) + 1):
        for chosen in map(list, itertools.combinations(range(len(positions)), size)):
            rows = np.vstack([np.ones(size), (positions[chosen] - point).T])
            root = np.sqrt(weights[chosen])
            scaled = np.linalg.lstsq(rows * root, np.array([1.0, 0.0, 0.0]), rcond=1e-9)[0]
            off = np.abs(rows @ (root * scaled) - [1.0, 0.0, 0.0]).max()
            if off < 1e-6 and (scaled > -1e-9).all():
                costs.append(scaled @ scaled)
    return min(costs)


def test_it_is_the_middle_with_the_least_weights():
    """40 points to 1e-6 m of a cut polygon, 20 weights to 1e-5 against all sets of sources."""
    position, weights = drawn(2)
    found = np.asarray(WEIGHTS(position, weights))
    for lane in range(40):
        heard = weights[:, 0, lane] > 0
        of = weights[heard, 0, lane] / weights[:, 0, lane].sum()
        positions, ours = position[:, heard, 0, lane].T, found[heard, 0, lane]
        known = middle(positions) if len(positions) > 3 else of @ positions
        point = ours @ positions
        assert math.dist(point, known) < 1e-6
        if lane < 20:
            assert ours @ (ours / of) == pytest.approx(least(positions, of, point), rel=1e-5)


@pytest.mark.parametrize("liars", [1, 2])
def test_fewer_than_a_third_cannot_pull_it_out_of_the_honest(liars):
    """One liar of six stays in their hull wherever it is; two, a third, pull it anywhere."""
    position, weights = drawn(3, heard=1.0)
    position[:, :liars] = 1e3 * np.random.default_rng(4).normal(size=(2, 1, VEHICLES, LANES))
    point = (np.asarray(WEIGHTS(position, weights))[None] * position).sum(axis=1)
    honest = position[:, liars:]
    angles = np.linspace(0, 2 * math.pi, 60, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reach = np.tensordot(directions, honest, 1).max(axis=1)
    beyond = (np.tensordot(directions, point, 1) - reach).max(axis=0)
    assert np.quantile(beyond, 0.999) < 1e-8 if liars == 1 else np.median(beyond) > 10.0
    assert beyond.max() < 1e-2 or liars > 1  # where honest ones nearly lie on a line
