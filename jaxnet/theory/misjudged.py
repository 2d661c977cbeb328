"""How likely trust by random observations misjudges a source after t of them.

A source is trusted iff `Σ_k (α_k - 1/2) ≥ 0`, with independent α_k of one distribution on [0, 1].
The probability to misjudge is at most `exp(-2 t (E α - 1/2)²)` (Hoeffding; Yemini, Nedić, Goldsmith
and Gil, 2022). It is computed here exactly: for uniform α by the distribution of a sum of uniform
numbers (Irwin and Hall) in whole numbers, for others by a convolution.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from jaxnet.config.scenario import interval_of
from jaxnet.kinds.fields import DiscreteChoice, OneNumber, Uniform, mean
from jaxnet.theory.case import Case

MOST_EXACT = 1_000  # observations
MOST_SUMS = 2**20  # different sums of a convolution


class Misjudged(NamedTuple):
    """Probabilities after a number of observations; nan where no exact one is computed."""

    after: int  # observations
    dropped: float  # an honest source
    kept: float  # a liar
    bounds: tuple[float, float]  # of both


def misjudged(case: Case) -> list[Misjudged] | None:
    """After 1, 10, 100, … observations, at the first motion, and at the end."""
    scenario, observed = case.scenario, case.scenario.defence.observes()
    if observed is None:
        return None
    honest, liar, wait = observed
    tick = interval_of(scenario)
    last = round(scenario.horizon / tick)
    first = math.ceil(wait / tick - 1e-9) + 1  # a vehicle observes, then decides
    powers = (10**k for k in range(len(str(last))))
    return [
        after_observations(honest, liar, t) for t in sorted({*powers, first, last}) if t <= last
    ]


def after_observations(honest: OneNumber, liar: OneNumber, t: int) -> Misjudged:
    def bound(observed: OneNumber) -> float:
        return math.exp(-2 * t * (mean(observed) - 0.5) ** 2)

    exact = below_half(honest, t), 1.0 - below_half(liar, t)
    return Misjudged(t, *exact, (bound(honest), bound(liar)))


def below_half(observed: OneNumber, t: int) -> float:
    """The probability that the sum of t observations is below t/2; nan where it is not known.

    Error below 1e-12.
    """
    if t > MOST_EXACT:
        return math.nan
    if isinstance(observed, Uniform):
        low, high = map(exactly, observed.uniform)
        if low < high:
            return sum_of_uniforms((Fraction(t, 2) - t * low) / (high - low), t)
        observed = DiscreteChoice(choice=[float(low)])
    if isinstance(observed, DiscreteChoice):
        values, shares = observed.choice, np.full(len(observed.choice), 1 / len(observed.choice))
    else:
        one = mean(observed)
        values, shares = [0.0, 1.0], np.array([1.0 - one, one])
    return sum_of_choices([exactly(each) for each in values], shares, t)


def exactly(number: float) -> Fraction:
    """The decimal number that a config gives."""
    return Fraction(repr(float(number)))


def sum_of_uniforms(x: Fraction, t: int) -> float:
    """`P(U_1 + … + U_t < x) = Σ_{k < x} (-1)^k C(t, k) (x - k)^t / t!` for U on [0, 1]."""
    if x <= 0:
        return 0.0
    if x >= t:
        return 1.0
    over, under = x.numerator, x.denominator
    terms = ((-1) ** k * math.comb(t, k) * (over - k * under) ** t for k in range(math.ceil(x)))
    return float(Fraction(sum(terms), math.factorial(t) * under**t))


def sum_of_choices(values: list[Fraction], shares: np.ndarray, t: int) -> float:
    """`P(Σ < t/2)` for t independent numbers with these values, by a transform of their lattice."""
    unit = math.lcm(*(each.denominator for each in values), 2)
    least = min(values)
    places = [int((each - least) * unit) for each in values]
    size = max(places) * t + 1
    if size > MOST_SUMS:
        return math.nan
    one = np.bincount(places, weights=shares, minlength=size)
    whole = np.fft.irfft(np.fft.rfft(one, size) ** t, size)
    below = math.ceil((Fraction(t, 2) - t * least) * unit)
    return float(np.clip(whole[: max(below, 0)].sum(), 0.0, 1.0))
