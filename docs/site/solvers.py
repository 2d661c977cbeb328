"""Write solvers.md, which solver runs for which fleet: `python docs/site/solvers.py`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import sparse

from jaxnet.model import patterns
from jaxnet.model.graph import slotted
from jaxnet.model.patterns import Neighbours
from jaxnet.solvers import choice
from jaxnet.solvers.choice import LARGEST_BLOCK, LEAST_BLOCKS, LEAST_WINDOWED, ONE_BLOCK

PAGE = Path(__file__).parents[1] / "solvers.md"
SIZES = (12, 100, 5_000)  # vehicles
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

With this page you can see which solver runs for your fleet. The law couples the vehicles by a
linear system `L x = b`. A solver solves or factorises L at ticks where weights changed:

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
- With at least {LEAST_BLOCKS} blocks of at most {LARGEST_BLOCK} vehicles the solver is `Blocks`,
  from {LEAST_WINDOWED} blocks on `Windowed`. With larger blocks it is `Iterative`.
- With fewer blocks the solver is `Dense` for at most {LARGEST_BLOCK} vehicles, else `Iterative`.
- A local law needs no solver. The stacked engine always solves one dense matrix.

No key changes the choice; `engine.solver` is the integrator's method.

"Lanes at once" is the number of lanes that the exact engine solves, or the nonlinear engine
factorises, in one pass.

`python docs/site/solvers.py` writes this page.

| graph | vehicles | solver | why | lanes at once, exact | lanes at once, nonlinear |
|---|---|---|---|---|---|
"""


def current() -> str:
    """The page as the code would write it."""
    return HEAD + "".join(row(name, m) for name in GRAPHS for m in SIZES)


def row(name: str, m: int) -> str:
    listeners, heard = sparse.csr_array(GRAPHS[name](m)).nonzero()
    solver, why = choice.choose_solver(slotted(m, listeners, heard + 1)[2].T)
    cells = (
        name,
        f"{m:,}",
        f"`{type(solver).__name__}`",
        why,
        choice.solved_at_once(m),
        choice.factorised_at_once(m),
    )
    return f"| {' | '.join(map(str, cells))} |\n"


if __name__ == "__main__":
    PAGE.write_text(current())
