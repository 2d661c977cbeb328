"""Search for the worst choice: populations of CMA-ES, of which one batch simulates a generation.

Every choice has the same starts, those of the study's first samples, and its value is the mean over
them. So the objective is deterministic. It jumps wherever a vehicle decides otherwise, which CMA-ES
tolerates. At the end a line search along the gradient improves the best choice. Where the error is
affine in the choice and no decision changes, a small step gives the exact gradient.

The best choice of each population and the best random points are the finalists. At the horizon,
much of an error may be transient. So each finalist is simulated to a late time, and the worst at
that time wins.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import outputs_of
from jaxnet.config.spacings import multiples
from jaxnet.engine import batch
from jaxnet.engine.plan import Outcome
from jaxnet.explore.box import Box, Coordinates

# raise it when the algorithm changes: older stored searches are then not resumed
SEARCH_VERSION = 4
POPULATIONS = 16  # side by side; more for large budgets
INITIAL_SIGMA = 0.15  # of a new population, per edge of the box
POLISH, SCREEN = 0.1, 0.2  # of the budget: for the line search, and for the first points
MOST_STEPS = 300  # of polishing
MOST_SETS = 20_000  # of attacked vehicles that are enumerated
LEAST_GENERATIONS = 50  # of a population, or there are fewer populations
MOST_GENERATIONS = 3_000  # of a population, or there are more populations
RANDOM_FINALISTS = 16  # among random points, or among sets
CHOICES_AT_ONCE = 4096  # in a batch, at most
SLOPE_STEP = 1e-6  # of the difference quotient
LINE_STEPS = 0.25 * 0.5 ** np.arange(24)  # along the slope
LEAST_IMPROVEMENT = 1e-9  # relative; a smaller one ends the polishing
MOST_LATE_LANES = 256  # of all finalists together, unless fewer finalists than POPULATIONS remain
TIE_TOLERANCE = 1e-6  # of the error at the horizon; late errors that differ by less are equal

Element = TypeVar("Element")
BoxPoint = Float[np.ndarray, " coordinates"]
Means = Float[np.ndarray, " choices"]
Starts = Float[np.ndarray, "choices starts"]
# Not-a-number for a failed lane, minus infinity for a lane that the search does not allow.
Measure = Callable[[Outcome], Float[np.ndarray, " lanes"]]


class Generation(NamedTuple):
    """A batch of choices, and the state of the search after it."""

    generation: int
    phase: str  # sets, random, search or polish
    lanes: int  # of all generations so far
    best: float  # of all generations so far
    generation_best: float
    generation_median: float
    failed: int  # lanes of all generations so far


class Finalist(NamedTuple):
    """The best choice of a population, or one of the best random points."""

    found: float  # mean over the starts
    point: BoxPoint


class LateChoice(NamedTuple):
    point: BoxPoint
    found: float  # mean over the starts, at the horizon
    late: float  # the same at `until`; not-a-number if a lane fails before or is not allowed
    until: float  # [s]


class Trials:
    """Choices tried so far, and the best of them.

    `known` are values of an interrupted search, whose choices the new search makes and reuses.
    """

    def __init__(
        self,
        box: Box,
        starts: int,
        measure: Measure,
        machine: batch.Machine,
        known: Sequence[Starts] = (),
        may_exceed: float = 0.0,
    ):
        self.box, self.starts, self.measure, self.machine = box, starts, measure, machine
        self.known, self.values = list(known), list[Starts]()
        self.may_exceed = may_exceed  # share of starts that the search need not allow
        self.best, self.point = -math.inf, np.full(len(box.places), 0.5)
        self.lanes = self.failed = 0
        self.finalists = list[Finalist]()

    def attempt(self, phase: str, points: Coordinates) -> tuple[Means, Generation]:
        """Mean over starts at each point (NaN where a lane failed), and the generation's record."""
        number = len(self.values)
        values = self.known[number] if number < len(self.known) else self.simulate(points)
        self.values.append(values)
        self.lanes += values.size
        self.failed += int(np.isnan(values).sum())
        means = self.means(values)
        if not np.isnan(means).all():
            leader = int(np.nanargmax(means))
            if means[leader] > self.best:
                self.best, self.point = float(means[leader]), points[leader].copy()
        finite = means[np.isfinite(means)]
        best, median = (finite.max(), np.median(finite)) if finite.size else (math.nan, math.nan)
        found = float(best), float(median)
        return means, Generation(number, phase, self.lanes, self.best, *found, self.failed)

    def simulate(self, points: Coordinates, box: Box | None = None) -> Starts:
        """Value of each point from each start, in this box or another of the same coordinates."""
        samples = np.tile(np.arange(self.starts), len(points))
        lanes = (box or self.box).lanes(points.repeat(self.starts, axis=0), samples)
        outcome = batch.simulate(lanes, self.machine)
        return self.measure(outcome).reshape(len(points), self.starts)

    def means(self, values: Starts) -> Means:
        """Mean over the starts that are allowed; minus infinity where too few are."""
        over = np.isneginf(values)
        number = over.sum(axis=1)
        mean = np.where(over, 0.0, values).sum(axis=1) / np.maximum(1, self.starts - number)
        return np.where(number > round(self.may_exceed * self.starts, 6), -math.inf, mean)

    def choose_finalist(self, until: float) -> LateChoice:
        """The finalist with the greatest error at the late time; of ties, that at the horizon."""
        scenario = self.box.scenario
        time = late_time(scenario, until)
        leader = Finalist(self.best if np.isfinite(self.best) else math.nan, self.point)
        if time == scenario.horizon:
            return LateChoice(leader.point, leader.found, leader.found, time)
        finite = [each for each in self.finalists if np.isfinite(each.found)]
        most = max(POPULATIONS, MOST_LATE_LANES // self.starts)
        finalists = [leader, *sorted(finite, key=lambda each: -each.found)[:most]]
        longer = scenario.model_copy(update={"horizon": time})
        box = Box(longer, self.box.source, self.box.places)
        points = np.stack([each.point for each in finalists])
        late = self.means(self.simulate(points, box))
        late = np.where(np.isfinite(late), late, math.nan)
        if np.isnan(late).all():
            return LateChoice(leader.point, leader.found, math.nan, time)
        least = np.nanmax(late) - TIE_TOLERANCE * np.nan_to_num(abs(leader.found))
        number = max(np.flatnonzero(late >= least), key=lambda number: finalists[number].found)
        chosen = finalists[number]
        return LateChoice(chosen.point, chosen.found, float(late[number]), time)


def late_time(scenario: Scenario, until: float) -> float:
    """First output time [s] at or after both `until` and the horizon."""
    outputs = math.ceil(round(until / scenario.output_step, 6))
    late = multiples(scenario.output_step, [outputs])[0]
    return scenario.horizon if outputs <= outputs_of(scenario) else late


def lowest_if_failed(means: Means) -> Means:
    return np.where(np.isnan(means), -math.inf, means)


def best_of(points: Coordinates, means: Means) -> list[Finalist]:
    order = np.argsort(-lowest_if_failed(means), kind="stable")[:RANDOM_FINALISTS]
    return [Finalist(float(means[number]), points[number]) for number in order]


class Population:
    """CMA-ES over some coordinates of a box; the other coordinates keep the values of `base`.

    The population moves in a space without edges. Angles are periodic; other coordinates are
    mirrored at 0 and 1.
    """

    def __init__(self, box: Box, base: BoxPoint, seed: int):
        from cmaes import CMA  # the import is slow

        self.base, self.free = base, box.free(box.attacked(base))
        self.turns = box.turns[self.free]
        self.strategy = CMA(mean=base[self.free], sigma=INITIAL_SIGMA, seed=seed)
        self.generation = np.empty((0, len(self.free)))
        self.best = Finalist(-math.inf, base)

    def ask(self) -> Coordinates:
        size = self.strategy.population_size
        self.generation = np.stack([self.strategy.ask() for _ in range(size)])
        return self.points()

    def points(self) -> Coordinates:
        points = np.tile(self.base, (len(self.generation), 1))
        mirrored = 1 - np.abs(1 - self.generation % 2)
        points[:, self.free] = np.where(self.turns, self.generation % 1, mirrored)
        return points

    def tell(self, values: Means) -> None:
        """Update by a generation's values; choices with a failed lane or not allowed rank last."""
        leader = best_of(self.points(), values)[0]
        self.best = leader if leader.found > self.best.found else self.best
        losses = -lowest_if_failed(values)
        finite = losses[np.isfinite(losses)]
        losses = np.where(np.isfinite(losses), losses, finite.max(initial=0.0) + 1.0)
        self.strategy.tell(list(zip(self.generation, losses.tolist(), strict=True)))


def search_box(trials: Trials, budget: int, seed: int) -> Iterator[Generation]:
    """Search with at most `budget` lanes; yield each generation. `trials` has the best choice."""
    box, choices, random = trials.box, budget // trials.starts, np.random.default_rng(seed)
    sets = sets_of(box, choices, random)
    if not box.free(sets[0]):
        for some in split_items(sets, CHOICES_AT_ONCE):
            points = np.stack([box.centre(each) for each in some])
            means, generation = trials.attempt("sets", points)
            trials.finalists += best_of(points, means)
            yield generation
        return
    explore = screen_sets if len(sets) > 1 else scout_points
    first_points = yield from explore(trials, sets, int(SCREEN * choices), random)
    step = 2 * len(box.free(sets[0])) + len(LINE_STEPS)
    last = min(POLISH * choices, MOST_STEPS * step)
    yield from evolve_populations(trials, first_points, int(choices - last) * trials.starts, random)
    yield from polish_best(trials, budget - step * trials.starts)


def sets_of(box: Box, most: int, random: np.random.Generator) -> list[Sequence[int]]:
    """Sets of attacked vehicles: all sets, or `most` random sets if there are more."""
    if not box.lots:
        return [box.scenario.attack.targets()]
    vehicles, number = range(1, box.scenario.vehicles + 1), box.scenario.attack.number()
    most = min(most, MOST_SETS)
    if math.comb(len(vehicles), number) <= most:
        return list(itertools.combinations(vehicles, number))
    drawn = (random.choice(vehicles, number, replace=False) for _ in range(most))
    return [tuple(sorted(each.tolist())) for each in drawn]


def random_points(
    box: Box, attacked: Sequence[int], number: int, random: np.random.Generator
) -> Coordinates:
    points, free = np.tile(box.centre(attacked), (number, 1)), box.free(attacked)
    points[:, free] = random.random((number, len(free)))
    return points


def scout_points(
    trials: Trials, sets: list[Sequence[int]], choices: int, random: np.random.Generator
) -> Iterator[Generation]:
    """Try random points for the only attacked set; return the points, the best first."""
    batches, means = list[Coordinates](), list[Means]()
    for some in split_items(range(max(POPULATIONS, choices)), CHOICES_AT_ONCE):
        batches.append(random_points(trials.box, sets[0], len(some), random))
        values, generation = trials.attempt("random", batches[-1])
        means.append(lowest_if_failed(values))
        yield generation
    points, every = np.concatenate(batches), np.concatenate(means)
    trials.finalists += best_of(points, every)
    return list(points[np.argsort(-every, kind="stable")])


def screen_sets(
    trials: Trials, sets: list[Sequence[int]], choices: int, random: np.random.Generator
) -> Iterator[Generation]:
    """Best points of attacked sets, the best first; successive halving keeps the better half."""
    rounds = max(1, math.ceil(math.log2(len(sets) / POPULATIONS)))
    left = [sets[number] for number in random.permutation(len(sets))][: max(1, choices // rounds)]
    best: dict[Sequence[int], tuple[float, BoxPoint]] = {}
    for _ in range(rounds):
        each = max(1, choices // rounds // len(left))
        for some in split_items(left, max(1, CHOICES_AT_ONCE // each)):
            drawn = [random_points(trials.box, attacked, each, random) for attacked in some]
            points = np.concatenate(drawn)
            values, generation = trials.attempt("sets", points)
            yield generation
            values = lowest_if_failed(values).reshape(len(some), each)
            by_set = points.reshape(len(some), each, -1)
            for attacked, means, tried in zip(some, values, by_set, strict=True):
                found = float(means.max()), tried[means.argmax()]
                best[attacked] = max(best.get(attacked, found), found, key=lambda pair: pair[0])
        left.sort(key=lambda attacked: -best[attacked][0])
        left = left[: max(POPULATIONS, len(left) // 2)]
    ordered = sorted(best.values(), key=lambda pair: -pair[0])
    trials.finalists += [Finalist(*each) for each in ordered[:RANDOM_FINALISTS]]
    return [point for _, point in ordered]


def evolve_populations(
    trials: Trials, first_points: list[BoxPoint], until: int, random: np.random.Generator
) -> Iterator[Generation]:
    """Evolve populations until `until` lanes; one that stops restarts from the next point."""
    box, points = trials.box, itertools.cycle(first_points)

    def new_population() -> Population:
        return Population(box, next(points), int(random.integers(2**32)))

    size = new_population().strategy.population_size * trials.starts
    generations = (until - trials.lanes) // size  # of one population alone
    usual = min(POPULATIONS, generations // LEAST_GENERATIONS)
    side_by_side = max(1, generations // MOST_GENERATIONS, usual)
    populations = [new_population() for _ in range(side_by_side)]
    while trials.lanes + size * len(populations) <= until:
        generations_points = [population.ask() for population in populations]
        values, generation = trials.attempt("search", np.concatenate(generations_points))
        yield generation
        parts = np.split(values, np.cumsum([len(each) for each in generations_points])[:-1])
        for number, (population, means) in enumerate(zip(populations, parts, strict=True)):
            population.tell(means)
            if population.strategy.should_stop():
                trials.finalists.append(population.best)
                populations[number] = new_population()
    trials.finalists += [population.best for population in populations]


def polish_best(trials: Trials, until: int) -> Iterator[Generation]:
    """Move the best choice along its gradient while it improves and lanes are at most `until`."""
    box = trials.box
    free = box.free(box.attacked(trials.point))
    while trials.lanes <= until:
        before, point = trials.best, trials.point
        steps = np.zeros((len(free), len(point)))
        steps[np.arange(len(free)), free] = SLOPE_STEP
        around = shifted_points(box, point, np.concatenate([steps, -steps]))
        values, generation = trials.attempt("polish", around)
        yield generation
        values = np.where(np.isfinite(values), values, math.nan)
        slope = np.nan_to_num(values[: len(free)] - values[len(free) :])
        if not slope.any():
            return
        along = np.zeros(len(point))
        along[free] = slope / np.abs(slope).max()
        on_line = shifted_points(box, point, LINE_STEPS[:, None] * along)
        _, generation = trials.attempt("polish", on_line)
        yield generation
        if not trials.best > before + LEAST_IMPROVEMENT * abs(before):
            return


def shifted_points(box: Box, point: BoxPoint, steps: Coordinates) -> Coordinates:
    points = point + steps
    return np.where(box.turns, points % 1, np.clip(points, 0, 1))


def split_items(items: Sequence[Element], size: int) -> Iterator[Sequence[Element]]:
    return (items[first : first + size] for first in range(0, len(items), size))
