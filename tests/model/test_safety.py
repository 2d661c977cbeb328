"""Who is safe: by enumeration on small digraphs, and against liars that announce what they like."""

import itertools

import numpy as np
import pytest

from jaxnet.model import safety

VEHICLES = 5


def scenario(seed):
    """A digraph of five vehicles, attacked and trusted links, and ϑ of each."""
    rng = np.random.default_rng(seed)
    shape = (VEHICLES, VEHICLES + 1)
    heard = rng.random(shape) < rng.uniform(0.3, 0.9)
    heard[range(VEHICLES), range(1, VEHICLES + 1)] = False
    heard[:, 0] |= ~heard.any(axis=1)
    liars = np.concatenate([[False], rng.random(VEHICLES) < 0.3])
    attacked = heard & (liars | (rng.random(shape) < 0.1))
    trusted = heard & (rng.random(shape) < 0.25)
    trusted[:, 0] = heard[:, 0]
    return heard, attacked, trusted, rng.integers(0, 3, VEHICLES)


def closed(inside, heard, attacked, trusted, theta):
    """Whether a set of vehicles (from 1) meets the theorem's assumptions, by its words."""
    for i in inside:
        sources = set(np.flatnonzero(heard[i - 1]))
        bad = {j for j in sources if attacked[i - 1, j] or (j > 0 and j not in inside)}
        if len(bad) > theta[i - 1] or any(trusted[i - 1, j] for j in bad) or len(sources) <= theta[i - 1]:
            return False
    reached = {0}
    for _ in range(VEHICLES):
        for i in inside:
            retains = (heard[i - 1] & ~trusted[i - 1]).sum() > theta[i - 1]
            good = {j for j in reached if heard[i - 1, j] and not attacked[i - 1, j]}
            if any(trusted[i - 1, j] or retains for j in good):
                reached.add(i)
    return set(inside) <= reached


@pytest.mark.parametrize("seed", range(200))
def test_it_is_the_greatest_set_that_meets_the_assumptions(seed):
    """Found by trying all 32 sets; a union of two such sets is one, so that there is a greatest."""
    given = scenario(seed)
    everyone = range(1, VEHICLES + 1)
    sets = [set(s) for n in range(VEHICLES + 1) for s in itertools.combinations(everyone, n)]
    known = set().union(*(s for s in sets if closed(s, *given)))
    found = safety.contracting(*given)
    assert set(np.flatnonzero(found) + 1) == known


def test_what_safe_vehicles_announce_vanishes_whatever_liars_announce():
    """From any start, with liars who announce at random, at times just what passes."""
    given = ((seed, *scenario(seed)) for seed in itertools.count())
    partly = ((safety.contracting(*each), seed, *each) for seed, *each in given)
    for safe, seed, *each in itertools.islice((one for one in partly if one[0].any()), 12):
        left = announced_in_the_end(safe, *each, np.random.default_rng(seed))
        assert (left[safe] < 1e-6).all()


def announced_in_the_end(safe, heard, attacked, trusted, theta, rng):
    """‖ρ_i‖ after many rounds of a plain program: drop the ϑ greatest untrusted, average the others."""
    weights = heard * rng.uniform(0.2, 1.0, heard.shape)
    announced = rng.normal(size=(VEHICLES + 1, 2)) * 10
    announced[0] = 0.0
    for _ in range(800):
        heard_of = np.repeat(announced[None], VEHICLES, axis=0)
        greatest = np.linalg.norm(announced[1:], axis=1).max(initial=0.0, where=safe)
        size = rng.choice([0.3 * greatest, 0.999 * greatest, greatest, 10.0])
        lies = rng.normal(size=heard_of.shape)
        lies *= size / np.linalg.norm(lies, axis=2, keepdims=True)
        heard_of = np.where(attacked[..., None], lies, heard_of)
        new = announced.copy()
        for i in range(VEHICLES):
            row, score = weights[i].copy(), np.linalg.norm(heard_of[i], axis=1)
            if heard[i].sum() > theta[i]:
                candidates = np.flatnonzero(heard[i] & ~trusted[i])
                row[candidates[np.argsort(-score[candidates], kind="stable")][: theta[i]]] = 0.0
            new[i + 1] = row @ heard_of[i] / row.sum()
        announced = new
    return np.linalg.norm(announced[1:], axis=1)


def test_who_hears_no_attacked_link_however_far_upstream_is_untouched():
    """A path of five whose third transmits falsely."""
    heard = np.eye(VEHICLES, VEHICLES + 1, dtype=bool)
    attacked = np.zeros_like(heard)
    attacked[3, 3] = True
    assert safety.untouched(heard, attacked).tolist() == [True, True, True, False, False]
