"""Comparisons that rounding does not decide: numbers that differ by 1e-12 of them are equal.

Whoever breaks ties by number so breaks the same ones on every machine, whatever the last bits are.
"""

from typing import Any

ROUNDING = 1e-12  # relative; sums of a few terms differ by 1e-15 or so


def over(a: Any, b: Any) -> Any:
    """Where sizes a, 0 or more, exceed sizes b."""
    return a > b * (1.0 + ROUNDING)


def apart(a: Any, b: Any) -> Any:
    """Where coordinates a exceed coordinates b [m]; under 1 m it is 1e-12 m that makes no difference."""
    xp = a.__array_namespace__()
    return a - b > ROUNDING * xp.maximum(1.0, xp.maximum(xp.abs(a), xp.abs(b)))
