"""What a scenario draws, as a box: a coordinate from 0 to 1 for each number."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxnet.config.keys import Scenario
from jaxnet.engine.batch import Job
from jaxnet.kinds import fields
from jaxnet.lanes.draws import quantile
from jaxnet.lanes.jobs import job, recorded
from jaxnet.lanes.uniforms import Given, Place, Source

INSIDE = 2.0**-54  # from the edges, where a normal number is infinite
TURN = 1e-9  # [rad] of a full turn
VEHICLES = "attack.vehicles"  # that are drawn by lots

Coordinates = Float[np.ndarray, "points coordinates"]


class Box:
    """Some of the numbers that a scenario draws; the others stay those of a lane's sample."""

    def __init__(self, scenario: Scenario, source: Source, places: Sequence[Place]):
        self.scenario, self.places, self.source = scenario, list(places), Remembered(source)
        self.columns = {place: column for column, place in enumerate(places)}
        self.lots = [column for place, column in self.columns.items() if place.name == VEHICLES]
        self.turns = np.array(
            [place.name != VEHICLES and is_turn(value_at(scenario, place)) for place in places], bool
        )

    def lanes(self, points: Coordinates, samples: Int[np.ndarray, " lanes"]) -> Job:
        """A lane for each point, of the sample that stands beside it."""
        inside = np.clip(points, INSIDE, 1 - INSIDE)
        given = Given(inside, self.columns, samples, self.source)
        return job(self.scenario, given, range(len(points)))

    def number(self, place: Place, coordinate: float) -> float:
        """The number that a coordinate stands for."""
        inside = np.clip(np.array([coordinate]), INSIDE, 1 - INSIDE)
        return float(quantile(value_at(self.scenario, place), inside)[0])

    def free(self, attacked: Collection[int]) -> list[int]:
        """Coordinates that matter where these vehicles are attacked: not those of the attack on others."""
        return [
            column
            for place, column in self.columns.items()
            if column not in self.lots
            and (place.vehicle in (0, *attacked) or not place.name.startswith("attack."))
        ]

    def centre(self, attacked: Collection[int]) -> Float[np.ndarray, " coordinates"]:
        """The middle of the box, with lots by which these vehicles are attacked."""
        point = np.full(len(self.places), 0.5)
        point[self.lots] = [0.25 if self.places[column].vehicle in attacked else 0.75 for column in self.lots]
        return point

    def attacked(self, point: Float[np.ndarray, " coordinates"]) -> list[int]:
        """Who is attacked at a point."""
        if not self.lots:
            return self.scenario.attack.targets()
        order = np.argsort(point[self.lots], kind="stable")[: self.scenario.attack.number()]
        return sorted(self.places[self.lots[number]].vehicle for number in order)


class Remembered:
    """A source that is asked for the same numbers again and again."""

    def __init__(self, source: Source):
        self.source, self.known = source, dict[Any, np.ndarray]()

    def uniforms(self, name: str, samples: Sequence[int], places: Sequence[Any]) -> np.ndarray:
        """Its own."""
        asked = name, tuple(samples), tuple(places)
        if asked not in self.known:
            self.known[asked] = self.source.uniforms(name, samples, places)
        return self.known[asked]

    def generator(self, name: str, sample: int) -> np.random.Generator:
        """Its own, from its beginning."""
        return self.source.generator(name, sample)


def places_of(scenario: Scenario, source: Source) -> list[Place]:
    """All that a scenario draws, in the order in which it does."""
    return list(recorded(scenario, source).places)


def value_at(scenario: Scenario, place: Place) -> Any:
    """The distribution that a place's number has."""
    value: Any = scenario
    for key in place.name.split("."):
        value = getattr(value, key)
    match value:
        case list():
            return value[place.component]
        case fields.Apiece(each=inner) | fields.Shared(shared=inner):
            return inner
    return value


def is_turn(number: Any) -> bool:
    """Whether a distribution is an angle's, over a full turn, so that its two ends are the same."""
    low, high = fields.value_range(number) if fields.is_drawn(number) else (0.0, 0.0)
    return isinstance(number, fields.Uniform) and abs(high - low - 2 * fields.PI) < TURN
