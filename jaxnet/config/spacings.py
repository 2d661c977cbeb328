"""Spaced values, rounded to the nearest doubles, so that `linspace` and a list give the same numbers.

A bound means the decimal number that its double prints.
"""

import decimal
from collections.abc import Iterable
from fractions import Fraction

DIGITS = 60  # digits of a factor that is multiplied up to 100,000 times


def linspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low + k (high - low)/(count - 1)`, each rounded once."""
    if count == 1:
        return [low]
    first, last = Fraction(repr(low)), Fraction(repr(high))
    whole = first.denominator * last.denominator
    a, b = int(first * whole), int(last * whole)
    steps = count - 1
    return [(a * (steps - k) + b * k) / (whole * steps) for k in range(count)]


def multiples(step: float, numbers: Iterable[int]) -> list[float]:
    """Return `k step` for some k, each rounded once: a reader's 0.35 is 35 times 0.01."""
    exact = Fraction(repr(step))
    return [k * exact.numerator / exact.denominator for k in numbers]


def geomspace(low: float, high: float, count: int) -> list[float]:
    """Return `count` values `low (high/low)^(k/(count - 1))`, computed with 60 digits and rounded once."""
    if count == 1:
        return [low]
    with decimal.localcontext(decimal.Context(prec=DIGITS)):
        value, last = decimal.Decimal(repr(low)), decimal.Decimal(repr(high))
        factor = (last / value) ** (decimal.Decimal(1) / (count - 1))
        spaced = []
        for _ in range(count - 1):
            spaced.append(float(value))
            value *= factor
    return [*spaced, high]
