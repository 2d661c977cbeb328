"""What a theorem is: its name, the premises that it needs, and what it tells of a cell."""

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import Situation, attacked_draws, missing, situation_of
from jaxnet.kinds.fields import median
from jaxnet.model.graph import Links, Weights, dense


class Case:
    """A cell's scenario, and what several theorems ask of it; each part is computed once.

    Weights and gains that are drawn count with their medians. `seconds` is the time for searches
    over sets of vehicles.
    """

    def __init__(self, scenario: Scenario, seconds: float = 0.0) -> None:
        self.scenario = scenario
        self.seconds = seconds

    @cached_property
    def situation(self) -> Situation:
        return situation_of(self.scenario)

    @cached_property
    def draws(self) -> list[Links] | None:
        """Attacked links of each set that a lane may draw; None for too many sets."""
        return attacked_draws(self.scenario, self.situation.graph)

    @cached_property
    def weights(self) -> Weights:
        return dense(self.situation.graph)

    @cached_property
    def gain(self) -> Float[np.ndarray, " r"]:
        return np.array([median(each) for each in self.scenario.gain])


class Theorem(NamedTuple):
    """A result and its premises.

    Attributes
    ----------
    name
        Where it is proved: O12 of docs/theorems.md, theorem 3 of docs/guarantees.md, Lemma 1.
    quantity
        What it tells.
    unit
        Unit of the value, "" without one.
    needs
        Names of premises (`jaxnet.config.scenario.PREMISES`).
    value
        From a case to the value; None where the theorem tells nothing.
    """

    name: str
    quantity: str
    unit: str
    needs: tuple[str, ...]
    value: Callable[[Case], Any]


class Finding(NamedTuple):
    """What a theorem tells of one cell."""

    quantity: str
    value: Any
    unit: str
    theorem: str


def rows(theorems: Iterable[Theorem], case: Case) -> dict[str, Finding]:
    """What theorems tell of a case whose premises it has, by quantity."""
    found = {}
    for theorem in theorems:
        if missing(case.scenario, theorem.needs):
            continue
        value = theorem.value(case)
        if value is not None:
            found[theorem.quantity] = Finding(theorem.quantity, value, theorem.unit, theorem.name)
    return found
