"""How often is the interval of a mean shown, and how often is it then wrong?

Numbers of 42 distributions: near to normal, skewed, with heavy tails, whole, in clusters, and with
zeros. A mean of n numbers of skewness G has Student's 95 % interval, widened, where n ≥ 28 + 25 G²
(`statistics/intervals.py`). For each n stand, in percent: how often the interval is shown, how
often it then holds the mean, and how often it is shown and wrong. The last is what a reader of
tables meets. It is 5 or less, but for `UNSEEN`: no rule knows a far cluster that no number shows.

Run it with `python experiments/means.py`; `--repeats 40000` takes some ten minutes.
"""

from collections.abc import Callable
from typing import NamedTuple

import click
import numpy as np
from scipy import special

from jaxnet.statistics.intervals import mean_interval

SIZES = (30, 50, 64, 100, 256, 1024)
Draw = Callable[[np.random.Generator, int], np.ndarray]
ZEROS = (0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99)  # shares of zeros
UNSEEN = ("0.9 to 1.1, 1% zeros", "0.9 to 1.1, 5% zeros")  # all numbers of a sample may be near 1


def with_zeros(share: float, others: Draw) -> Draw:
    """Zeros in this share, else other numbers."""
    return lambda random, n: (random.random(n) >= share) * others(random, n)


def clusters(share: float) -> Draw:
    """Numbers near 0 in this share, else near 5."""
    normal = [(0.0, 0.1), (5.0, 0.5)]
    return lambda random, n: np.where(
        random.random(n) < share, *(random.normal(mean, width, n) for mean, width in normal)
    )


OTHERS: dict[str, Draw] = {  # of mean 1
    "0.5 to 1.5": lambda random, n: random.uniform(0.5, 1.5, n),
    "0.9 to 1.1": lambda random, n: random.uniform(0.9, 1.1, n),
    "exponential": lambda random, n: random.exponential(size=n),
    "ones": lambda random, n: np.ones(n),
}
DISTRIBUTIONS: dict[str, tuple[Draw, float]] = {  # with their means
    "normal": (lambda random, n: random.normal(size=n), 0.0),
    "uniform": (lambda random, n: random.random(n), 0.5),
    "arcsine": (lambda random, n: random.beta(0.5, 0.5, n), 0.5),
    "Student, 5": (lambda random, n: random.standard_t(5, n), 0.0),
    "Student, 3": (lambda random, n: random.standard_t(3, n), 0.0),
    "exponential": (lambda random, n: random.exponential(size=n), 1.0),
    "gamma, 2": (lambda random, n: random.gamma(2.0, size=n), 2.0),
    "Weibull, 0.7": (lambda random, n: random.weibull(0.7, n), special.gamma(1 + 1 / 0.7)),
    "Pareto, 3": (lambda random, n: random.pareto(3, n), 0.5),
    "lognormal, 0.5": (lambda random, n: random.lognormal(0, 0.5, n), np.exp(0.125)),
    "lognormal, 1": (lambda random, n: random.lognormal(0, 1, n), np.exp(0.5)),
    "Poisson, 2": (lambda random, n: random.poisson(2, n).astype(float), 2.0),
    "0, 1 or 10": (lambda random, n: random.choice([0.0, 1, 10], n, p=[0.5, 0.4, 0.1]), 1.4),
    "clusters, 30%": (clusters(0.3), 3.5),
    **{
        f"{name}, {share:.0%} zeros": (with_zeros(share, others), 1 - share)
        for name, others in OTHERS.items()
        for share in ZEROS
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
