"""Spaced values as the doubles nearest to the decimals: 0.3, not 0.30000000000000004."""

import itertools
from collections.abc import Iterable
from decimal import Decimal, localcontext
from operator import mul

DIGITS = 60  # of a product of many ratios, to whose nearest double no rounding comes through


def linspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low + k (high - low)/(count - 1)`."""
    first, last = Decimal(repr(low)), Decimal(repr(high))
    return [float(first + (last - first) * k / max(count - 1, 1)) for k in range(count)]


def geomspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low (high/low)^(k/(count - 1))`."""
    first, last = Decimal(repr(low)), Decimal(repr(high))
    with localcontext(prec=DIGITS):
        ratio = (last / first) ** (1 / Decimal(max(count - 1, 1)))
        spaced = itertools.accumulate(itertools.repeat(ratio, count - 1), mul, initial=first)
        return [float(value) for value in spaced]


def multiples(step: float, numbers: Iterable[int]) -> list[float]:
    """Return `k step` for some k: a reader's 0.35 is 35 times 0.01."""
    exact = Decimal(repr(step))
    return [float(exact * k) for k in numbers]
