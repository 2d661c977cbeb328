"""The choice of a solver for a graph, and all thresholds at which the numerics change."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jaxnet.lazy import sparse
from jaxnet.solvers.blocks import Blocks
from jaxnet.solvers.dense import Dense
from jaxnet.solvers.iterative import Iterative
from jaxnet.solvers.solver import Solver
from jaxnet.solvers.windowed import Windowed

ONE_BLOCK = 12  # vehicles; up to here one dense matrix is faster than blocks
LEAST_BLOCKS = 8  # fewer blocks are no faster than one dense matrix
LARGEST_BLOCK = 96  # vehicles; iteration is faster than larger blocks
LEAST_WINDOWED = 528  # blocks; below, a whole solve is as fast as windows
SOLVED, SOLVED_OF_LARGE = 16, 8  # lanes that the exact engine solves at once
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
    if blocks < LEAST_BLOCKS:
        why = f"fewer than {LEAST_BLOCKS} blocks ({blocks})"
        if m > LARGEST_BLOCK:
            return Choice(Iterative(), why)
        return Choice(Dense.of(sources), f"{why}, at most {LARGEST_BLOCK} vehicles")
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
    return SOLVED if vehicles < LARGE_TO_SOLVE else SOLVED_OF_LARGE


def solved_in_a_row(vehicles: int) -> int:
    return SOLVED_IN_A_ROW if vehicles < LARGE_TO_SOLVE else SOLVED_OF_LARGE


def factorised_at_once(vehicles: int) -> int:
    return FACTORISED if vehicles < LARGE_TO_FACTORISE else FACTORISED_OF_LARGE
