"""r- and (r, s)-robustness of digraphs with more than 16 nodes, by integer linear programming.

For each of two sets, binary variables tell which nodes the set contains, and which of them are
r-reachable. HiGHS solves the programs. Source: Usevitch and Panagou, Determining r- and
(r,s)-robustness of digraphs using mixed integer linear programming, 2020.
"""

from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import sparse

from jaxnet.theory.robustness import most_local

MOST_PROGRAMMED = 200  # nodes in a program; of a larger digraph, no program ends in some seconds
INFEASIBLE = 2  # SciPy's status
SOLVER_TOLERANCE = 1e-6  # tolerance of the solver's bounds, which are whole numbers

Heard = Bool[np.ndarray, "n n"]  # entry (i, j): node i hears node j
Constraint = tuple[Any, Any, Any]  # matrix of constraints with lower and upper limits


class RobustnessBracket(NamedTuple):
    """Bounds on the greatest r, or on the greatest s: low ≤ greatest ≤ high.

    Attributes
    ----------
    low : int
        The digraph is proved to be robust with this number.
    high : int
        Two sets of nodes are known that exclude any greater number.

    Examples
    --------
    >>> from jaxnet.theory.integer import RobustnessBracket
    >>> RobustnessBracket(low=2, high=4)
    RobustnessBracket(low=2, high=4)
    """

    low: int
    high: int

    @property
    def known(self) -> bool:
        """Whether the bounds are equal."""
        return self.low >= self.high

    def narrowed(self, more: Callable[[int], bool | None]) -> "RobustnessBracket":
        """Bounds after proofs for low + 1, low + 2, …

        `more(low)` tells whether the greatest number is over `low`, None without time to prove it.
        """
        low, high = self
        while low < high and (holds := more(low)) is not None:
            low, high = (low + 1, high) if holds else (low, low)
        return RobustnessBracket(low, high)


def robustness_bracket(heard: Heard, seconds: float) -> RobustnessBracket:
    """Bounds on the greatest r for which a digraph is r-robust.

    The greatest r is the minimum, over disjoint nonempty sets of nodes, of the most sources outside
    its set that any node of the two sets hears. Bounds by the in-degree come first. Half of the
    time goes to the minimisation of r, the rest to proofs for r = low + 1, low + 2, ….

    Times to equal bounds, measured with SciPy 1.17 on two cores: 0.1 to 5 s for random digraphs of
    20 to 30 nodes, up to 60 s for dense ones of 30. Random digraphs of 60 nodes are open after
    20 s. HiGHS may exceed a time limit of 2 s by 1 s, for 150 nodes or more.

    Parameters
    ----------
    heard : array of bool, shape (n, n)
        Entry (i, j) tells whether node i hears node j; `heard_matrix` makes it of pairs.
    seconds : float
        Time limit [s]. The bounds hold for any limit.

    Returns
    -------
    RobustnessBracket
        Bounds `low` and `high` on the greatest r.

    Examples
    --------
    >>> from jaxnet.theory.integer import robustness_bracket
    >>> from jaxnet.theory.robustness import heard_matrix
    >>> ring = [[i, (i + step) % 20 + 1] for i in range(1, 21) for step in range(4)]
    >>> robustness_bracket(heard_matrix(ring, 20), seconds=60.0)
    RobustnessBracket(low=2, high=2)
    """
    end, found = monotonic() + seconds, degree_bracket(heard)
    if not found.known:
        found = minimised(heard, found, seconds / 2)
    return found.narrowed(lambda low: is_robust(heard, low + 1, 1, end - monotonic()))


def degree_bracket(heard: Heard) -> RobustnessBracket:
    """Bounds on the greatest r by the least in-degree δ of n nodes.

    - Of two disjoint sets, one has at most ⌊n/2⌋ nodes. Its nodes hear at least δ + 1 - ⌊n/2⌋ nodes
      outside.
    - Two halves give r ≤ ⌈n/2⌉.
    - A node with in-degree δ, and all others, give r ≤ max(δ, 1).
    """
    n, least = len(heard), int(heard.sum(axis=1).min())
    half = (n + 1) // 2
    low = max(0, least + 1 - n // 2)
    return RobustnessBracket(min(low, half), max(low, min(half, max(least, 1))))


def minimised(heard: Heard, known: RobustnessBracket, seconds: float) -> RobustnessBracket:
    """Bounds on the greatest r by minimising r: a set's nodes hear at most r nodes outside."""
    n, degrees = len(heard), heard.sum(axis=1)
    # r ≥ low: the row of a node outside a set always holds
    slack = np.maximum(degrees - known.low, 0)
    outside = sparse.hstack([twice(np.diag(slack) - heard), -np.ones((2 * n, 1))])
    rows = [(outside, -np.inf, np.tile(slack - degrees, 2)), *two_sets(n, 1)]
    found = solve(np.append(np.zeros(2 * n), 1), rows, known, seconds)
    if found is None:
        return known
    high = known.high
    if found.x is not None:
        high = min(high, max(int(counts.max()) for counts in outside_counts(heard, found.x)))
    return RobustnessBracket(min(high, max(known.low, proved(found))), high)


def s_bracket(heard: Heard, r: int, seconds: float) -> RobustnessBracket:
    """Bounds on the greatest s for which a digraph is (r, s)-robust.

    The greatest s is the least number of r-reachable nodes in two disjoint sets that both contain a
    node that is not r-reachable. It is the number of nodes if there are no such sets.

    Parameters
    ----------
    heard : array of bool, shape (n, n)
        Entry (i, j) tells whether node i hears node j.
    r : int
        The number of sources outside its set that an r-reachable node hears.
    seconds : float
        Time limit [s]. The bounds hold for any limit.

    Returns
    -------
    RobustnessBracket
        Bounds `low` and `high` on the greatest s.

    Examples
    --------
    >>> from jaxnet.theory.integer import s_bracket
    >>> from jaxnet.theory.robustness import heard_matrix
    >>> ring = [[i, (i + step) % 14 + 1] for i in range(1, 15) for step in range(4)]
    >>> s_bracket(heard_matrix(ring, 14), r=2, seconds=60.0)
    RobustnessBracket(low=6, high=6)
    """
    n = len(heard)
    found = violation(heard, r, n, np.repeat([0, 1], 2 * n), seconds)
    if found is None:
        return RobustnessBracket(0, n)
    if found.status == INFEASIBLE:
        return RobustnessBracket(n, n)
    high = n
    if found.x is not None:
        high = sum(int((counts >= r).sum()) for counts in outside_counts(heard, found.x))
    return RobustnessBracket(min(high, max(0, proved(found))), high)


def is_robust(heard: Heard, r: int, s: int, seconds: float) -> bool | None:
    """Whether a digraph is (r, s)-robust, or None if the time ends first."""
    n = len(heard)
    found = violation(heard, r, s - 1, np.repeat([1, 0], [n, 3 * n]), seconds)
    if found is None or (found.x is None and found.status != INFEASIBLE):
        return None
    return found.x is None


def total_bracket(heard: Heard, known: RobustnessBracket, seconds: float) -> RobustnessBracket:
    """Bounds on the greatest F for which a digraph is (F + 1, F + 1)-robust, from bounds on r.

    Every (2F + 1)-robust digraph is (F + 1, F + 1)-robust. F is -1 if the digraph is not 1-robust.
    """
    end, found = monotonic() + seconds, RobustnessBracket(most_local(known.low), known.high - 1)
    return found.narrowed(lambda low: is_robust(heard, low + 2, low + 2, end - monotonic()))


def violation(heard: Heard, r: int, most: int, cost: np.ndarray, seconds: float) -> Any:
    """Solver's result for two sets that violate (r, most + 1)-robustness, or None without time.

    Each set contains a node that is not r-reachable, and both sets together at most `most`
    r-reachable nodes. The variables are the two sets, and then the r-reachable nodes of the two
    sets.
    """
    n = len(heard)
    one, none = np.ones((1, n)), np.zeros((1, n))
    slack = np.maximum(heard.sum(axis=1) - r + 1, 0)
    outside = sparse.hstack([twice(np.diag(slack) - heard), -twice(np.diag(slack))])
    inside = sparse.hstack([-sparse.eye_array(2 * n), sparse.eye_array(2 * n)])
    other = np.block([[one, none, -one, none], [none, one, none, -one]])
    few = np.block([none, none, one, one])
    rows = [(outside, -np.inf, 0), (inside, -np.inf, 0), (other, 1, np.inf), (few, 0, most)]
    return solve(cost, [*rows, *two_sets(n, 2 * n)], (0, 1), seconds)


def two_sets(n: int, more: int) -> list[Constraint]:
    """Constraints that two sets are disjoint and nonempty, and the first is not the larger one.

    `more` is the number of further variables.
    """
    one, rest = np.ones((1, n)), np.zeros((1, more))
    each = sparse.eye_array(n)
    disjoint = sparse.hstack([each, each, sparse.csr_array((n, more))])
    sizes = np.block([[one, 0 * one, rest], [-one, one, rest]])
    return [(disjoint, 0, 1), (sizes, [1, 0], np.inf)]


def twice(block: Shaped[np.ndarray, "n n"]) -> Any:
    return sparse.block_diag([sparse.csr_array(block)] * 2)


def solve(
    cost: np.ndarray, rows: Sequence[Constraint], last: tuple[int, int], seconds: float
) -> Any:
    """SciPy's result for a program with binary variables, or None if no time is left.

    The last variable is a whole number within the bounds `last`.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    if seconds <= 0:
        return None
    low, high = np.zeros(len(cost)), np.ones(len(cost))
    low[-1], high[-1] = last
    return milp(
        cost,
        constraints=[LinearConstraint(*each) for each in rows],
        integrality=1,
        bounds=Bounds(low, high),  # pyright: ignore[reportArgumentType]
        options={"time_limit": seconds},
    )


def proved(found: Any) -> int:
    """Solver's lower bound on a minimum, as a whole number; 0 if the solver has none."""
    bound = found.mip_dual_bound
    return 0 if bound is None or not np.isfinite(bound) else int(np.ceil(bound - SOLVER_TOLERANCE))


def outside_counts(
    heard: Heard, x: Float[np.ndarray, " variables"]
) -> list[Int[np.ndarray, " inside"]]:
    """How many sources outside its set each node hears, of the two sets that a solver found."""
    sets = x[: 2 * len(heard)].reshape(2, -1) > 0.5
    return [heard[nodes][:, ~nodes].sum(axis=1) for nodes in sets]
