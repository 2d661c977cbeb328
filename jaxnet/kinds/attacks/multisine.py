"""The multisine: harmonics of one frequency with random phases and directions."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Several
from jaxnet.kinds.harmonics import Harmonics
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.protocols import LaneDraw, ScenarioView


class Multisine(Harmonics):
    """`Σ_l u(direction_l) cos(l · frequency · t + phase_l)`, l = 1 … harmonics, scaled to ā."""

    kind = "multisine"

    phase: Several = Field(
        default=FULL_TURN, description="[rad], of each harmonic of each attacker"
    )
    direction: Several = Field(default=FULL_TURN, description="[rad], likewise")

    def drawn(self, draw: LaneDraw, name: str) -> "Multisine":
        """Return the attack with a drawn phase and direction for each harmonic."""
        return self.with_several(draw, name, phase=1, direction=1)

    def pairs(self) -> np.ndarray:
        """Return the vectors of cosine and sine by the addition theorem."""
        unit, phase = unit_vectors(np.asarray(self.direction)), np.asarray(self.phase)
        pairs = np.stack(
            [unit * np.cos(phase), -unit * np.sin(phase)], axis=2
        )  # (2, n, 2, m, lanes)
        return np.moveaxis(pairs.reshape(2, -1, *pairs.shape[3:]), 1, 2)

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault if a table has not one row for each attacker."""
        yield from super().faults(scenario)
        yield from self.tables(scenario, phase=1, direction=1)
