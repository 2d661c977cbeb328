"""The choice of a solver for a graph, and all thresholds at which the numerics change.

`python -m jaxnet.solvers.choice > docs/solvers.md` writes the page that shows the choices.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Int
from scipy import sparse

from jaxnet.model import patterns
from jaxnet.model.graph import slotted
from jaxnet.model.patterns import Neighbours
from jaxnet.solvers.blocks import Blocks
from jaxnet.solvers.dense import Dense
from jaxnet.solvers.iterative import Iterative
from jaxnet.solvers.solver import Solver
from jaxnet.solvers.windowed import Windowed

ONE_BLOCK = 12  # vehicles; up to here one dense matrix is faster than blocks
LEAST_BLOCKS = 8  # fewer blocks are no faster than one dense matrix
LARGEST_BLOCK = 96  # vehicles; iteration is faster than larger blocks
LEAST_WINDOWED = 528  # blocks; below, a whole solve is as fast as windows
SOLVED, SOLVED_OF_LARGE = 16, 4  # lanes that the exact engine solves at once
SOLVED_IN_A_ROW = 64  # lanes that the exact engine solves at once where nearly all lanes change
LARGE_TO_SOLVE = 128  # vehicles; from here on, padding lanes cost more than another pass
FACTORISED, FACTORISED_OF_LARGE = 16, 2  # lanes that the nonlinear engine factorises at once
LARGE_TO_FACTORISE = 24  # vehicles; from here on, padding lanes cost more than another pass

Sources = Int[np.ndarray, "slots m"]


class Choice(NamedTuple):
    """A solver, and the reason for it in a few words."""

    solver: Solver
    why: str


def choose_solver(sources: Sources) -> Choice:
    """The solver for the sources of each listener, slot by slot."""
    m = sources.shape[1]
    if m <= ONE_BLOCK:
        return Choice(Dense.of(sources), f"at most {ONE_BLOCK} vehicles")
    vehicles, place, size = near_each_other(sources)
    blocks = -(-m // size)
    if blocks < LEAST_BLOCKS and m <= LARGEST_BLOCK:
        return Choice(
            Dense.of(sources),
            f"fewer than {LEAST_BLOCKS} blocks ({blocks}), at most {LARGEST_BLOCK} vehicles",
        )
    if blocks < LEAST_BLOCKS:
        return Choice(Iterative(), f"fewer than {LEAST_BLOCKS} blocks ({blocks})")
    if size > LARGEST_BLOCK:
        return Choice(Iterative(), f"blocks of more than {LARGEST_BLOCK} vehicles ({size:,})")
    filled = np.append(vehicles, np.full(blocks * size - m, m)).reshape(blocks, size)
    why = f"{blocks:,} blocks of {size} vehicles"
    return Choice((Windowed if blocks >= LEAST_WINDOWED else Blocks)(filled, place), why)


def near_each_other(sources: Sources) -> tuple[np.ndarray, np.ndarray, int]:
    """The vehicles in reverse Cuthill–McKee order, the place of each vehicle, and the bandwidth.

    The bandwidth is the greatest distance in that order of a listener and its source, at least 2.
    """
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    m = sources.shape[1]
    listeners, heard = np.nonzero(sources > 0)[1], sources[sources > 0] - 1
    pairs = np.concatenate([[listeners, heard], [heard, listeners]], axis=1)
    mutual = sparse.csr_array((np.ones(pairs.shape[1]), pairs), shape=(m, m))
    vehicles = np.asarray(reverse_cuthill_mckee(mutual, symmetric_mode=True), dtype=int)
    place = np.argsort(vehicles)
    return vehicles, place, max(2, int(np.abs(place[listeners] - place[heard]).max(initial=0)))


def solved_at_once(vehicles: int) -> int:
    """The number of lanes that the exact engine solves at once."""
    return SOLVED if vehicles < LARGE_TO_SOLVE else SOLVED_OF_LARGE


def solved_in_a_row(vehicles: int) -> int:
    """The number of lanes that the exact engine solves at once where nearly all lanes change."""
    return SOLVED_IN_A_ROW if vehicles < LARGE_TO_SOLVE else SOLVED_OF_LARGE


def factorised_at_once(vehicles: int) -> int:
    """The number of lanes that the nonlinear engine factorises at once."""
    return FACTORISED if vehicles < LARGE_TO_FACTORISE else FACTORISED_OF_LARGE


# --- the page
# --------------------------------------------------------------------------------------

SIZES = (12, 50, 100, 1_000, 10_000)  # vehicles
GRAPHS: dict[str, Callable[[int], Neighbours]] = {
    "`cyclic` (ring)": lambda m: patterns.circulant(m, (-1, 1)),
    "`path`": lambda m: patterns.of_pairs(m, np.arange(1, m), np.arange(m - 1)),
    "`lattice` of 4 neighbours": lambda m: patterns.lattice(m, 4),
    "`random_regular` of degree 4": lambda m: patterns.drawn_regular(
        m, 4, np.random.default_rng(0)
    ),
    "`erdos_renyi`, 8 sources on average": lambda m: patterns.of_pairs(
        m, *np.random.default_rng(0).integers(m, size=(2, 8 * m))
    ),
}
HEAD = f"""# Solvers

The law couples the vehicles by a linear system `L x = b`. A solver solves or factorises L at
ticks where weights changed:

- `Dense` eliminates one dense matrix. Up to half of the vehicles, which hear none of each other,
  need no elimination.
- `Blocks` eliminates from block to block. A block hears only itself and the two adjacent blocks.
- `Windowed` is `Blocks` with an update of the solution near the vehicles that changed their
  decision.
- `Iterative` iterates over links until the certified error is small enough.

The graph alone decides which solver runs, not the number of lanes. The vehicles are ordered so
that listeners are near their sources (reverse Cuthill–McKee). The greatest distance in that order
is the size of a block.

- For at most {ONE_BLOCK} vehicles the solver is `Dense`.
- With at least {LEAST_BLOCKS} blocks the solver is `Blocks`, or `Windowed` for large fleets.
- With fewer blocks the solver is `Dense` for at most {LARGEST_BLOCK} vehicles, else `Iterative`.

No key changes the choice; `engine.solver` is the integrator's method.

"Lanes at once" is the number of lanes that the exact engine solves, or the nonlinear engine
factorises, in one pass.

`python -m jaxnet.solvers.choice > docs/solvers.md` writes this page.

| graph | vehicles | solver | why | lanes at once, exact | lanes at once, nonlinear |
|---|---|---|---|---|---|
"""


def page() -> str:
    """The page of the choices, in Markdown."""
    return HEAD + "".join(row(name, m) for name in GRAPHS for m in SIZES)


def row(name: str, m: int) -> str:
    listeners, heard = sparse.csr_array(GRAPHS[name](m)).nonzero()
    solver, why = choose_solver(slotted(m, listeners, heard + 1)[2].T)
    cells = (
        name,
        f"{m:,}",
        f"`{type(solver).__name__}`",
        why,
        solved_at_once(m),
        factorised_at_once(m),
    )
    return f"| {' | '.join(map(str, cells))} |\n"


if __name__ == "__main__":
    print(page(), end="")
