"""The random numbers of a scenario as points of a box, one coordinate from 0 to 1 per number."""

import operator
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxnet.config.keys import Scenario
from jaxnet.engine.batch import Job
from jaxnet.kinds import fields
from jaxnet.lanes.draws import quantile
from jaxnet.lanes.jobs import job, recorded
from jaxnet.lanes.uniforms import Given, Place, Source

INSIDE = 2.0**-54  # least distance to the edges, where a normal number is infinite
TURN = 1e-9  # [rad] tolerance of a full turn
VEHICLES = "attack.vehicles"  # key whose vehicles are drawn by lots

Coordinates = Float[np.ndarray, "points coordinates"]


class Box:
    """Box of some random numbers of a scenario; the other numbers are those of a lane's sample."""

    def __init__(self, scenario: Scenario, source: Source, places: Sequence[Place]):
        self.scenario, self.places, self.source = scenario, list(places), source
        self.columns = {place: column for column, place in enumerate(places)}
        self.lots = [column for place, column in self.columns.items() if place.name == VEHICLES]
        self.turns = np.array(
            [place.name != VEHICLES and is_turn(value_at(scenario, place)) for place in places],
            bool,
        )

    def lanes(self, points: Coordinates, samples: Int[np.ndarray, " lanes"]) -> Job:
        inside = np.clip(points, INSIDE, 1 - INSIDE)
        given = Given(inside, self.columns, samples, self.source)
        return job(self.scenario, given, range(len(points)))

    def number(self, place: Place, coordinate: float) -> float:
        inside = np.clip(np.array([coordinate]), INSIDE, 1 - INSIDE)
        return float(quantile(value_at(self.scenario, place), inside)[0])

    def free(self, attacked: Collection[int]) -> list[int]:
        """Coordinates that affect the lanes if these vehicles are attacked."""
        return [
            column
            for place, column in self.columns.items()
            if column not in self.lots
            and (place.vehicle in (0, *attacked) or not place.name.startswith("attack."))
        ]

    def centre(self, attacked: Collection[int]) -> Float[np.ndarray, " coordinates"]:
        point = np.full(len(self.places), 0.5)
        point[self.lots] = [
            0.25 if self.places[column].vehicle in attacked else 0.75 for column in self.lots
        ]
        return point

    def attacked(self, point: Float[np.ndarray, " coordinates"]) -> list[int]:
        if not self.lots:
            return self.scenario.attack.targets()
        order = np.argsort(point[self.lots], kind="stable")[: self.scenario.attack.number()]
        return sorted(self.places[self.lots[number]].vehicle for number in order)


def places_of(scenario: Scenario, source: Source) -> list[Place]:
    return list(recorded(scenario, source).places)


def value_at(scenario: Scenario, place: Place) -> object:
    if place.name.endswith(".key"):  # of what is drawn anew at each tick, such as noise
        return fields.Uniform(uniform=[0.0, 1.0])
    value = operator.attrgetter(place.name)(scenario)
    match value:
        case list():
            return value[place.component]
        case fields.Apiece(each=inner) | fields.Shared(shared=inner):
            return inner
    return value


def is_turn(number: object) -> bool:
    low, high = fields.value_range(number) if isinstance(number, fields.Uniform) else (0.0, 0.0)
    return abs(high - low - 2 * fields.PI) < TURN
