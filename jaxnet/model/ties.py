"""Comparisons that rounding does not decide: numbers within a relative 1e-12 count as equal.

A rule that breaks ties by number then chooses alike on every machine, whatever the last bits.
"""

from jaxnet.model.shapes import Flags, Numbers

ROUNDING = 1e-12  # relative; sums of a few terms differ by 1e-15 or so


def over(a: Numbers, b: Numbers) -> Flags:
    """Where nonnegative sizes a exceed sizes b by more than rounding."""
    return a > b * (1.0 + ROUNDING)


def apart(a: Numbers, b: Numbers) -> Flags:
    """Where coordinates a exceed coordinates b [m] by more than rounding.

    The tolerance is relative for coordinates above 1 m, and 1e-12 m below.
    """
    xp = a.__array_namespace__()
    return a - b > ROUNDING * xp.maximum(1.0, xp.maximum(xp.abs(a), xp.abs(b)))
