"""The worst choice: many populations of CMA-ES side by side, a generation of all of them one batch of lanes.

Every choice is tried from the same starts, those of the study's first samples, and counts by their mean: what
is maximised is then no random function, but one that jumps wherever a vehicle decides otherwise. CMA-ES
does not mind. In the end the best is polished along its gradient, which a small step shows exactly where the
error is affine in what is chosen and no decision changes.

The best of each population and the best random points are the finalists. `explore.late` runs them further.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from cmaes import CMA
from jaxtyping import Float

from jaxnet.engine import batch
from jaxnet.engine.plan import Outcome
from jaxnet.explore.box import Box, Coordinates

SEARCH_VERSION = 4  # to be raised when searches begin to go another way, so that none kept before goes on
POPULATIONS = 16  # side by side, or more where budgets are large
INITIAL_SIGMA = 0.15  # of a population at first, of the box's edge
POLISH, SCREEN = 0.1, 0.2  # of the budget: for the end, and for finding where to begin
MOST_STEPS = 300  # of polishing, where its share of the budget would be more
MOST_SETS = 20_000  # that are enumerated
LEAST_GENERATIONS = 50  # that a population is to have, or there are fewer
MOST_GENERATIONS = 3_000  # that it is to have, or there are more
RANDOM_FINALISTS = 16  # of random points, or of sets
CHOICES_AT_ONCE = 4096  # choices tried in a batch, where they could be more
SLOPE_STEP = 1e-6  # step by which a slope is found
LINE_STEPS = 0.25 * 0.5 ** np.arange(24)  # steps along it
LEAST_IMPROVEMENT = 1e-9  # relative, or the polishing ends

BoxPoint = Float[np.ndarray, " coordinates"]
Means = Float[np.ndarray, " choices"]
Starts = Float[np.ndarray, "choices starts"]
Measure = Callable[[Outcome], Float[np.ndarray, " lanes"]]  # not a number of a lane that failed


class Generation(NamedTuple):
    """A batch of choices that were tried, and how things stood after it."""

    generation: int
    phase: str  # sets, random, search or polish
    lanes: int  # in all until then
    best: float  # of all until then
    generation_best: float
    generation_median: float
    failed: int  # lanes, in all until then


class Finalist(NamedTuple):
    """A choice that is the best of its kind: of a population, or one of the best random points."""

    found: float  # mean over the starts
    point: BoxPoint


class Trials:
    """Choices that are tried, and the best of them so far.

    `known` are values of a search that was broken off: this one goes the same way, and takes them.
    """

    def __init__(
        self, box: Box, starts: int, measure: Measure, machine: batch.Machine, known: Sequence[Starts] = ()
    ):
        self.box, self.starts, self.measure, self.machine = box, starts, measure, machine
        self.known, self.values = list(known), list[Starts]()
        self.best, self.point = -math.inf, np.full(len(box.places), 0.5)
        self.lanes = self.failed = 0
        self.finalists = list[Finalist]()

    def attempt(self, phase: str, points: Coordinates) -> tuple[Means, Generation]:
        """The mean over the starts at each point, not a number where a lane failed."""
        number = len(self.values)
        values = self.known[number] if number < len(self.known) else self.simulated(points)
        self.values.append(values)
        self.lanes += values.size
        self.failed += int(np.isnan(values).sum())
        means = values.mean(axis=1)
        if not np.isnan(means).all():
            leader = int(np.nanargmax(means))
            if means[leader] > self.best:
                self.best, self.point = float(means[leader]), points[leader].copy()
        there = means[~np.isnan(means)]
        best, median = (there.max(), np.median(there)) if there.size else (math.nan, math.nan)
        return means, Generation(
            number, phase, self.lanes, self.best, float(best), float(median), self.failed
        )

    def simulated(self, points: Coordinates) -> Starts:
        """What lanes come to."""
        samples = np.tile(np.arange(self.starts), len(points))
        outcome = batch.simulate(self.box.lanes(points.repeat(self.starts, axis=0), samples), self.machine)
        return self.measure(outcome).reshape(len(points), self.starts)


def best_of(points: Coordinates, means: Means) -> list[Finalist]:
    """The best of some points, the very best first; a mean that is not a number comes last."""
    order = np.argsort(-np.nan_to_num(means, nan=-math.inf), kind="stable")[:RANDOM_FINALISTS]
    return [Finalist(float(means[number]), points[number]) for number in order]


class Population:
    """CMA-ES in some coordinates of a box; the others keep the values of `base`.

    It moves in a space without edges: angles go round, other coordinates are mirrored at 0 and 1.
    """

    def __init__(self, box: Box, base: BoxPoint, seed: int):
        self.base, self.free = base, box.free(box.attacked(base))
        self.turns = box.turns[self.free]
        self.strategy = CMA(mean=base[self.free], sigma=INITIAL_SIGMA, seed=seed)
        self.asked = np.empty((0, len(self.free)))
        self.best = Finalist(-math.inf, base)

    def ask(self) -> Coordinates:
        """A generation."""
        self.asked = np.stack([self.strategy.ask() for _ in range(self.strategy.population_size)])
        return self.points()

    def points(self) -> Coordinates:
        """The generation's points in the box."""
        points = np.tile(self.base, (len(self.asked), 1))
        points[:, self.free] = np.where(self.turns, self.asked % 1, 1 - np.abs(1 - self.asked % 2))
        return points

    def tell(self, values: Means) -> None:
        """What the generation came to; a choice of which a lane failed counts less than all others."""
        leader = best_of(self.points(), values)[0]
        self.best = leader if leader.found > self.best.found else self.best
        losses = np.where(np.isnan(values), math.inf, -values)
        finite = losses[np.isfinite(losses)]
        losses = np.where(np.isfinite(losses), losses, finite.max(initial=0.0) + 1.0)
        self.strategy.tell(list(zip(self.asked, losses.tolist(), strict=True)))

    def ended(self) -> bool:
        """Whether there is nothing more to find where it is."""
        return self.strategy.should_stop()


def search_box(trials: Trials, budget: int, seed: int) -> Iterator[Generation]:
    """Spend so many lanes, or fewer; what the trials came to then is their best."""
    box, choices, random = trials.box, budget // trials.starts, np.random.default_rng(seed)
    sets = sets_of(box, choices, random)
    if not box.free(sets[0]):
        for some in split_items(sets, CHOICES_AT_ONCE):
            points = np.stack([box.centre(each) for each in some])
            means, generation = trials.attempt("sets", points)
            trials.finalists += best_of(points, means)
            yield generation
        return
    look = screen_sets if len(sets) > 1 else scout_points
    begun = yield from look(trials, sets, int(SCREEN * choices), random)
    step = 2 * len(box.free(sets[0])) + len(LINE_STEPS)
    last = min(POLISH * choices, MOST_STEPS * step)
    yield from evolve_populations(trials, begun, int(choices - last) * trials.starts, random)
    yield from polish_best(trials, budget - step * trials.starts)


def sets_of(box: Box, most: int, random: np.random.Generator) -> list[Sequence[int]]:
    """Sets of attacked vehicles: all that there are, or so many of them at random if there are more."""
    if not box.lots:
        return [box.scenario.attack.targets()]
    vehicles, number = range(1, box.scenario.vehicles + 1), box.scenario.attack.number()
    most = min(most, MOST_SETS)
    if math.comb(len(vehicles), number) <= most:
        return list(itertools.combinations(vehicles, number))
    return [tuple(sorted(random.choice(vehicles, number, replace=False).tolist())) for _ in range(most)]


def random_points(box: Box, attacked: Sequence[int], number: int, random: np.random.Generator) -> Coordinates:
    """Points anywhere in the box where these vehicles are attacked."""
    points, free = np.tile(box.centre(attacked), (number, 1)), box.free(attacked)
    points[:, free] = random.random((number, len(free)))
    return points


def scout_points(
    trials: Trials, sets: list[Sequence[int]], choices: int, random: np.random.Generator
) -> Iterator[Generation]:
    """Random points where the one set is attacked; returns them, the best first."""
    tried, means = list[Coordinates](), list[Means]()
    for some in split_items(range(max(POPULATIONS, choices)), CHOICES_AT_ONCE):
        tried.append(random_points(trials.box, sets[0], len(some), random))
        values, generation = trials.attempt("random", tried[-1])
        means.append(np.nan_to_num(values, nan=-math.inf))
        yield generation
    points, every = np.concatenate(tried), np.concatenate(means)
    trials.finalists += best_of(points, every)
    return list(points[np.argsort(-every, kind="stable")])


def screen_sets(
    trials: Trials, sets: list[Sequence[int]], choices: int, random: np.random.Generator
) -> Iterator[Generation]:
    """The sets by their best of some random points: the best half of them gets as many again, and so on.

    Returns the best point of each set that was tried, the best set first.
    """
    rounds = max(1, math.ceil(math.log2(len(sets) / POPULATIONS)))
    left = [sets[number] for number in random.permutation(len(sets))][: max(1, choices // rounds)]
    best: dict[Sequence[int], tuple[float, BoxPoint]] = {}
    for _ in range(rounds):
        each = max(1, choices // rounds // len(left))
        for some in split_items(left, max(1, CHOICES_AT_ONCE // each)):
            points = np.concatenate([random_points(trials.box, attacked, each, random) for attacked in some])
            values, generation = trials.attempt("sets", points)
            yield generation
            values = np.nan_to_num(values, nan=-math.inf).reshape(len(some), each)
            for attacked, theirs, at in zip(some, values, points.reshape(len(some), each, -1), strict=True):
                found = float(theirs.max()), at[theirs.argmax()]
                best[attacked] = max(best.get(attacked, found), found, key=lambda pair: pair[0])
        left.sort(key=lambda attacked: -best[attacked][0])
        left = left[: max(POPULATIONS, len(left) // 2)]
    ordered = sorted(best.values(), key=lambda pair: -pair[0])
    trials.finalists += [Finalist(*each) for each in ordered[:RANDOM_FINALISTS]]
    return [point for _, point in ordered]


def evolve_populations(
    trials: Trials, begun: list[BoxPoint], until: int, random: np.random.Generator
) -> Iterator[Generation]:
    """Populations from these points on, until so many lanes are spent; one that has ended begins anew."""
    box, points = trials.box, itertools.cycle(begun)

    def another() -> Population:
        return Population(box, next(points), int(random.integers(2**32)))

    size = another().strategy.population_size * trials.starts
    generations = (until - trials.lanes) // size  # of one population alone
    side_by_side = max(1, generations // MOST_GENERATIONS, min(POPULATIONS, generations // LEAST_GENERATIONS))
    populations = [another() for _ in range(side_by_side)]
    while trials.lanes + size * len(populations) <= until:
        asked = [population.ask() for population in populations]
        values, generation = trials.attempt("search", np.concatenate(asked))
        yield generation
        parts = np.split(values, np.cumsum([len(each) for each in asked])[:-1])
        for number, (population, theirs) in enumerate(zip(populations, parts, strict=True)):
            population.tell(theirs)
            if population.ended():
                trials.finalists.append(population.best)
                populations[number] = another()
    trials.finalists += [population.best for population in populations]


def polish_best(trials: Trials, until: int) -> Iterator[Generation]:
    """From the best up its slope, as long as it gets better and a step begins before so many lanes."""
    box = trials.box
    free = box.free(box.attacked(trials.point))
    while trials.lanes <= until:
        before, point = trials.best, trials.point
        steps = np.zeros((len(free), len(point)))
        steps[np.arange(len(free)), free] = SLOPE_STEP
        values, generation = trials.attempt(
            "polish", shifted_points(box, point, np.concatenate([steps, -steps]))
        )
        yield generation
        slope = np.nan_to_num(values[: len(free)] - values[len(free) :])
        if not slope.any():
            return
        along = np.zeros(len(point))
        along[free] = slope / np.abs(slope).max()
        _, generation = trials.attempt("polish", shifted_points(box, point, LINE_STEPS[:, None] * along))
        yield generation
        if not trials.best > before + LEAST_IMPROVEMENT * abs(before):
            return


def shifted_points(box: Box, point: BoxPoint, steps: Coordinates) -> Coordinates:
    """Points so far from one, inside the box; angles go round."""
    points = point + steps
    return np.where(box.turns, points % 1, np.clip(points, 0, 1))


def split_items(items: Sequence[Any], size: int) -> Iterator[Sequence[Any]]:
    """So many at a time."""
    return (items[first : first + size] for first in range(0, len(items), size))
