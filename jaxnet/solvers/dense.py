"""One dense matrix, for small fleets and for graphs that no order makes narrow.

Vehicles that hear none of each other need no elimination. They are those of y in

    [  D  -C ] [ x ]   [ b ]
    [ -B   I ] [ y ] = [ c ],      so (D - C B) x = b + C c and y = c + B x.

Only D - C B is eliminated: 6 equations in a ring of 12 vehicles (1.2 times, lost messages).
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxnet.model.elimination import eliminated, identity, product
from jaxnet.model.shapes import LoopIndex
from jaxnet.solvers.solver import Solver, off_one
from jaxnet.solvers.table import TablePlace, add_each, add_weights

# Of a fleet, one of these parts may need no elimination. Each compiles another program.
FLEET_PARTS = (2, 3, 4)

InverseColumns = Float[Array, "m axes m lanes"]
TableRows = Float[Array, "rows columns axes lanes"]
OtherRows = Float[Array, "others columns axes lanes"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Dense(Solver[InverseColumns]):
    """Gauss–Jordan elimination of one dense matrix. Its factors are the columns of the inverse."""

    coupled: Int[Any, " n"]  # vehicles whose equations are eliminated
    apart: Int[Any, " k"]  # vehicles that hear none of each other
    place: Int[Any, " m"]  # of each vehicle, the coupled ones first; a sort would slow the loop
    slots: Int[Any, " links"]  # first of links from `apart` to `coupled`, then of those back
    listeners: Int[Any, " links"]
    to_coupled: Int[Any, ""]  # number of links from `apart` to `coupled`
    to_apart: Int[Any, ""]

    @classmethod
    def of(cls, sources: Int[np.ndarray, "slots m"]) -> "Dense":
        """The solver for the sources of each listener, slot by slot."""
        m, free = sources.shape[1], deaf_to_each_other(sources)
        parts = [m // part for part in FLEET_PARTS if m // part <= len(free)]
        apart = free[: max(parts, default=0)]
        coupled = np.setdiff1d(np.arange(m), apart)
        listeners = np.broadcast_to(np.arange(m), sources.shape)
        from_apart, to_apart = np.isin(sources - 1, apart), np.isin(listeners, apart)
        used = (sources > 0) & (sources != listeners + 1) & (from_apart != to_apart)
        kind = np.where(used, np.where(to_apart, 1, 0), 2)
        order = np.argsort(kind, axis=None, kind="stable")
        numbers = (np.asarray((kind == which).sum()) for which in (0, 1))
        place = np.argsort(np.append(coupled, apart))
        links = np.unravel_index(order, sources.shape)
        return cls(coupled, apart, place, *links, *numbers)

    def solve(self, hearing, weights, right):
        order = jnp.concatenate([jnp.asarray(self.coupled), jnp.asarray(self.apart)])
        n, m, place = len(self.coupled), len(order), jnp.asarray(self.place)
        carried = jnp.asarray(hearing.carried_sources)
        source = jnp.where(carried > 0, place[carried - 1], m)  # by place; m: the navigator
        heard = jnp.moveaxis(weights, 0, 2)[:, order]
        # Columns of coupled vehicles, of the navigator, and of the others, which nobody reads.
        column = jnp.where(source < n, source, jnp.where(source < m, n + 1, n))
        nothing = jnp.zeros((1, m, n + 2, *heard.shape[2:]))
        table = add_weights(nothing, column[:, None, order], heard[:, None])[0]
        given = right.at[order].get(mode="promise_in_bounds")
        own = jnp.eye(m, n)[:, :, None, None] - table[:, :n]
        rows = jnp.concatenate([own, given, table[:, n : n + 1]], axis=1)

        def plus(
            rows: TableRows, links: Any, first: Any, others: OtherRows, there: int
        ) -> TableRows:
            """Add to rows those of their sources, which begin at a place, by weight."""

            def link(number: LoopIndex) -> tuple[TablePlace, Float[Array, "columns axes lanes"]]:
                slot = jnp.asarray(self.slots)[number + first]
                listener = jnp.asarray(self.listeners)[number + first]
                speaker = source[slot, listener]
                weight = jnp.where(speaker < m, weights[:, slot, listener], 0.0)
                row = others[jnp.clip(speaker - there, 0, len(others) - 1)]
                return (place[listener] - (n - there),), weight[None] * row

            return add_each(rows, self.slots.size, links, link) if n < m else rows

        # D - C B beside b + C c: links to `coupled` take the rows of `apart` with them.
        found = eliminated(plus(rows[:n], self.to_coupled, 0, rows[n:], n))
        rest = plus(rows[n:, n:], self.to_apart, self.to_coupled, found, 0)
        solution = jnp.concatenate([found, rest]).at[place].get(mode="promise_in_bounds")
        return solution[:, :-1], off_one(solution[:, -1])

    def factorise(self, hearing, weights):
        """The columns of `L⁻¹`, and the residual of `L⁻¹ a0 = 1`."""
        m = weights.shape[2]
        unit = identity(jnp.zeros((m, m, len(weights), weights.shape[-1])))
        inverse, residual = self.solve(hearing, weights, unit)
        return jnp.moveaxis(inverse, 0, 2), residual

    def apply(self, hearing, factors, right, start):
        return product(factors, right)


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
