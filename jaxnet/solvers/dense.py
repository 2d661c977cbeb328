"""One dense matrix, for small fleets and for graphs that no order makes narrow.

Vehicles that hear none of each other need no elimination. They are those of y in

    [  D  -C ] [ x ]   [ b ]
    [ -B   I ] [ y ] = [ c ],      so (D - C B) x = b + C c and y = c + B x.

Only D - C B is eliminated: 6 equations in a ring of 12 vehicles.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxnet.model.elimination import eliminated, identity, product
from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import LoopIndex
from jaxnet.solvers.solver import Columns, PlaneVector, Residual, Solver, off_one
from jaxnet.solvers.table import TablePlace, add_each

# Of a fleet, one of these parts may need no elimination. Each compiles another program.
FLEET_PARTS = (2, 3, 4)

InverseColumns = Float[Array, "m axes m lanes"]
PartRows = Float[Array, "some columns axes lanes"]
OtherPartRows = Float[Array, "others columns axes lanes"]


class FleetPart(NamedTuple):
    """Vehicles, and the links that they hear, first those from vehicles of the other part."""

    vehicles: Int[Any, " some"]
    slots: Int[Any, " links"]
    listeners: Int[Any, " links"]
    across: Int[Any, ""]  # number of links from vehicles of the other part
    links: Int[Any, ""]  # number of links; further entries are padding


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Dense(Solver[InverseColumns]):
    """Gauss–Jordan elimination of one dense matrix. Its factors are the columns of the inverse."""

    coupled: FleetPart  # vehicles whose equations are eliminated
    apart: FleetPart  # vehicles that hear none of each other
    place: Int[Any, " m"]  # of each vehicle, the coupled ones first

    @classmethod
    def of(cls, sources: Int[np.ndarray, "slots m"]) -> "Dense":
        """The solver for the sources of each listener, slot by slot."""
        m, apart = sources.shape[1], deaf_to_each_other(sources)
        apart = apart[
            : max((m // part for part in FLEET_PARTS if m // part <= len(apart)), default=0)
        ]
        coupled = np.setdiff1d(np.arange(m), apart)
        place = np.argsort(np.append(coupled, apart))
        return cls(part_of(coupled, sources), part_of(apart, sources), place)

    def solve(
        self, hearing: Hearing, weights: AxisWeights, right: Columns
    ) -> tuple[Columns, Residual]:
        n, m, columns = len(self.coupled.vehicles), *right.shape[:2]
        heard, place = hearing.carried_sources, jnp.asarray(self.place)
        sources = jnp.where(heard > 0, place[heard - 1], m)  # by place; m: the navigator

        def rows(part: FleetPart, first: int) -> PartRows:
            """The rows `[D | b | a0]` or `[-B | c | a0]` of a part, whose first place is given."""
            own = identity(jnp.zeros((m, m, *right.shape[2:])))[
                first : first + len(part.vehicles), :n
            ]
            given = right.at[jnp.asarray(part.vehicles)].get(mode="promise_in_bounds")

            def weight(number: LoopIndex) -> tuple[TablePlace, Float[Array, "axes lanes"]]:
                slot, listener = link_of(part, number)
                source = sources[slot, listener]
                sign = jnp.where(source < n, -1.0, jnp.where(source < m, 0.0, 1.0))
                column = jnp.where(source < n, source, n + columns)
                return (place[listener] - first, column), sign * weights[:, slot, listener]

            table = jnp.concatenate([own, given, jnp.zeros_like(given[:, :1])], axis=1)
            return add_each(table, part.slots.size, part.links, weight)

        def plus(
            table: PartRows, part: FleetPart, first: int, others: OtherPartRows, of_others: int
        ) -> PartRows:
            """Add to the rows of a part those of its sources in the other part, by weight."""

            def row(number: LoopIndex) -> tuple[TablePlace, Float[Array, "columns axes lanes"]]:
                slot, listener = link_of(part, number)
                source = sources[slot, listener]
                weight = jnp.where(source < m, weights[:, slot, listener], 0.0)
                theirs = others[jnp.minimum(source, m - 1) - of_others]
                return (place[listener] - first,), weight[None] * theirs

            return add_each(table, part.slots.size, part.across, row) if len(others) else table

        apart = rows(self.apart, n)
        found = eliminated(plus(rows(self.coupled, 0), self.coupled, 0, apart, n))
        rest = plus(apart[:, n:], self.apart, n, found, 0)
        solution = found.at[jnp.minimum(place, max(n - 1, 0))].get(mode="promise_in_bounds")
        if m > n:
            theirs = rest.at[jnp.maximum(place - n, 0)].get(mode="promise_in_bounds")
            solution = jnp.where((place < n)[:, None, None, None], solution, theirs)
        return solution[:, :-1], off_one(solution[:, -1])

    def factorise(self, hearing: Hearing, weights: AxisWeights) -> tuple[InverseColumns, Residual]:
        """The columns of `L⁻¹`, and the residual of `L⁻¹ a0 = 1`."""
        m = len(self.place)
        unit = identity(jnp.zeros((m, m, len(weights), weights.shape[-1])))
        inverse, residual = self.solve(hearing, weights, unit)
        return jnp.moveaxis(inverse, 0, 2), residual

    def apply(
        self,
        hearing: Hearing,
        factors: InverseColumns,
        right: PlaneVector,
        start: PlaneVector | None,
    ) -> PlaneVector:
        return product(factors, right)


def part_of(vehicles: Int[np.ndarray, " some"], sources: Int[np.ndarray, "slots m"]) -> FleetPart:
    listeners = np.broadcast_to(np.arange(sources.shape[1]), sources.shape)
    heard = np.isin(listeners, vehicles) & (sources != listeners + 1)
    across = heard & (sources > 0) & ~np.isin(sources - 1, vehicles)
    order = np.argsort(np.where(across, 0, np.where(heard, 1, 2)), axis=None, kind="stable")
    slots, listeners = np.unravel_index(order, sources.shape)
    return FleetPart(vehicles, slots, listeners, across.sum(), heard.sum())


def link_of(part: FleetPart, number: LoopIndex) -> tuple[LoopIndex, LoopIndex]:
    """Slot and listener of a link of a part."""
    return jnp.asarray(part.slots)[number], jnp.asarray(part.listeners)[number]


def deaf_to_each_other(sources: Int[np.ndarray, "slots m"]) -> Int[np.ndarray, " k"]:
    """Vehicles that hear none of each other, chosen in turn, each with the fewest links."""
    m = sources.shape[1]
    linked = np.zeros((m, m + 1), bool)
    linked[np.arange(m)[None], sources] = True
    linked = linked[:, 1:] | linked[:, 1:].T | np.eye(m, dtype=bool)
    chosen, free = list[int](), np.ones(m, bool)
    while free.any():
        chosen.append(int(np.where(free, (linked & free).sum(axis=1), m + 1).argmin()))
        free &= ~linked[chosen[-1]]
    return np.array(chosen, dtype=int)
