"""A cell as theorems see it."""

from functools import cached_property

import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import Situation, attacked_draws, situation_of
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
    def parts(self) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, " r"]]:
        """The gains of differences from neighbours, and those of own derivatives."""
        compared, damping = self.scenario.law.parts(self.gain[None])
        return compared[0], np.zeros_like(self.gain) if damping is None else damping[0]

    @cached_property
    def gain(self) -> Float[np.ndarray, " r"]:
        return np.array([median(each) for each in self.scenario.gain])
