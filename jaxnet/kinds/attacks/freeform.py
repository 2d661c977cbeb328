"""Any sum of a few harmonics: what a search gives its shape."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import Field

from jaxnet.kinds.fields import Several, Uniform
from jaxnet.kinds.harmonics import Harmonics
from jaxnet.kinds.kind import Fault


class Freeform(Harmonics):
    """`Σ_l c_l cos(l · frequency · t) + s_l sin(l · frequency · t)`, vectors c and s, as great as ā allows.

    Each attacker has vectors of its own.
    """

    kind = "freeform"

    coefficients: Several = Field(
        default=Uniform(uniform=[-1.0, 1.0]),
        description="of each harmonic of each attacker x and y of its cosine, then of its sine; their size"
        " counts for nothing",
    )

    def drawn(self, draw: Any, name: str) -> Any:
        """Four numbers for each harmonic."""
        return self.with_several(draw, name, coefficients=4)

    def pairs(self) -> np.ndarray:
        """As they are given."""
        given = np.asarray(self.coefficients)  # (4 · harmonics, m, lanes)
        return given.reshape(-1, 2, *given.shape[1:]).transpose(1, 2, 0, 3)

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """A table has a row for each attacker."""
        yield from super().faults(scenario)
        yield from self.tables(scenario, coefficients=4)
