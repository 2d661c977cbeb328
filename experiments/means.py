"""How often is the interval of a mean shown, and how often is it then wrong?

Numbers of fifteen distributions: near to normal, skewed, with heavy tails, and with zeros. A mean
of n numbers of skewness G has Student's 95 % interval where n ≥ 28 + 25 G²
(`statistics/intervals.py`). For each n stand, in percent: how often the interval is shown, how
often it then holds the mean, and how often it is shown and wrong. The last is what a reader of
tables meets; it is about 5 or less.

Run it with `python experiments/means.py`.
"""

from collections.abc import Callable
from typing import NamedTuple

import click
import numpy as np

from jaxnet.statistics.intervals import mean_interval

SIZES = (30, 50, 64, 100, 256, 1024)
Draw = Callable[[np.random.Generator, int], np.ndarray]


def with_zeros(share: float) -> Draw:
    """Numbers from 0.5 to 1.5, this share of them 0."""
    return lambda random, n: (random.random(n) >= share) * random.uniform(0.5, 1.5, n)


def two_valued(share: float) -> Draw:
    """Zeros in this share, else ones."""
    return lambda random, n: (random.random(n) >= share).astype(float)


DISTRIBUTIONS: dict[str, tuple[Draw, float]] = {  # with their means
    "normal": (lambda random, n: random.normal(size=n), 0.0),
    "uniform": (lambda random, n: random.random(n), 0.5),
    "arcsine": (lambda random, n: random.beta(0.5, 0.5, n), 0.5),
    "Student, 5": (lambda random, n: random.standard_t(5, n), 0.0),
    "exponential": (lambda random, n: random.exponential(size=n), 1.0),
    "lognormal, 0.5": (lambda random, n: random.lognormal(0, 0.5, n), np.exp(0.125)),
    "lognormal, 1": (lambda random, n: random.lognormal(0, 1, n), np.exp(0.5)),
    **{
        f"{name}, {share:.0%} zeros": (made(share), 1 - share)
        for made, name in ((with_zeros, "0.5 to 1.5"), (two_valued, "ones"))
        for share in (0.01, 0.2, 0.5, 0.95)
    },
}


class Told(NamedTuple):
    """Shares of samples: with an interval, held by it where it is shown, shown and wrong."""

    shown: float
    held: float
    wrong: float


@click.command()
@click.option("--repeats", default=4000, show_default=True)
def main(repeats: int) -> None:
    """A line per distribution."""
    print("shown, held where shown, shown and wrong [%]")
    print(f"{'':22}" + "".join(f"{f'n = {size}':>20}" for size in SIZES))
    for name in DISTRIBUTIONS:
        found = (told(name, size, repeats) for size in SIZES)
        words = (f"{100 * s:7.1f}{100 * h:6.1f}{100 * w:7.2f}" for s, h, w in found)
        print(f"{name:22}" + "".join(words), flush=True)


def told(name: str, size: int, repeats: int, seed: int = 0) -> Told:
    """What samples of this size of a distribution tell."""
    draw, mean = DISTRIBUTIONS[name]
    random = np.random.default_rng(seed)
    ends = np.array([mean_interval(draw(random, size), 0.95) for _ in range(repeats)])
    shown = np.isfinite(ends[:, 0])
    held = (ends[:, 0] <= mean) & (mean <= ends[:, 1])
    share = held.sum() / shown.sum() if shown.any() else np.nan
    return Told(float(shown.mean()), float(share), float((shown & ~held).mean()))


if __name__ == "__main__":
    main()
