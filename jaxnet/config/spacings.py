"""Spaced values as the doubles nearest to the decimals: 0.3, not 0.30000000000000004."""

from collections.abc import Iterable
from decimal import Decimal


def linspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low + k (high - low)/(count - 1)`."""
    first, last = Decimal(repr(low)), Decimal(repr(high))
    return [float(first + (last - first) * k / max(count - 1, 1)) for k in range(count)]


def geomspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low (high/low)^(k/(count - 1))`."""
    first, last = Decimal(repr(low)), Decimal(repr(high))
    steps = Decimal(max(count - 1, 1))
    return [float(first * (last / first) ** (k / steps)) for k in range(count)]


def multiples(step: float, numbers: Iterable[int]) -> list[float]:
    """Return `k step` for some k: a reader's 0.35 is 35 times 0.01."""
    exact = Decimal(repr(step))
    return [float(exact * k) for k in numbers]
