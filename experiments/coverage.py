"""Do the fits' 95 % intervals cover 95 %?

Errors of a known slope: y = x·w·e at twelve magnitudes x from 0.1 to 100, with w lognormal and the
sample's own at all magnitudes, as its draw is in each cell, and e lognormal from lane to lane. The
logarithm of y/x is normal with the variance of both, which gives the slopes that the fits look
for: the median and the 0.95 quantile of y/x. Counts over many such studies how
often the bootstrap's interval holds the slope. A thousand studies tell a share of 94 % to ± 1.5 %
alone. The slope of least squares is a mean, and experiments/means.py measures its interval.

Run it with `python experiments/coverage.py`, or with `--repeats 200`; two thousand take some ten
minutes.
"""

from concurrent.futures import ThreadPoolExecutor

import click
import numpy as np
from scipy import special

from jaxnet.engine.cores import cores
from jaxnet.runs.cache import enable
from jaxnet.statistics import fits as fit
from jaxnet.statistics.fits import Errors

SPREADS = {"samples alike at all magnitudes": (0.8, 0.05), "both": (0.5, 0.5), "lanes": (0.05, 0.8)}


@click.command()
@click.option("--repeats", default=2000, show_default=True)
def main(repeats: int) -> None:
    """A line per kind of scatter."""
    enable()
    names = "".join(f"{name:>15}" for name in fit.FITTED_QUANTILES)
    print(f"{'what scatters':32}{names}   covered of {repeats}, nominal 95 %")
    for what, spread in SPREADS.items():
        covered = coverage(repeats, spread)
        print(f"{what:32}" + "".join(f"{share:15.1%}" for share in covered), flush=True)


def coverage(
    repeats: int,
    spread: tuple[float, float],
    magnitudes: int = 12,
    samples: int = 256,
    seed: int = 0,
) -> np.ndarray:
    """Share of studies whose interval holds the slope of each quantile."""
    counts = list(fit.draw_resamples(samples, fit.RESAMPLES_TOGETHER))
    slopes = true_slopes(spread)

    def covers(repeat: int) -> np.ndarray:
        errors = synthetic(np.random.default_rng([seed, repeat]), spread, magnitudes, samples)
        quantiles = list(fit.FITTED_QUANTILES)
        drawn = [fit.quantile_slopes(errors, each, quantiles) for each in counts]
        low, high = fit.percentile_interval(np.concatenate(drawn))
        return (low <= slopes) & (slopes <= high)

    with ThreadPoolExecutor(cores()) as pool:
        return np.mean(list(pool.map(covers, range(repeats))), axis=0)


def synthetic(
    random: np.random.Generator, spread: tuple[float, float], magnitudes: int, samples: int
) -> Errors:
    """One study: standard deviations of log w, the sample's, and log e, the lane's."""
    x = np.geomspace(0.1, 100, magnitudes)
    shared, own = random.normal(size=samples), random.normal(size=(magnitudes, samples))
    return Errors(x, x[:, None] * np.exp(spread[0] * shared + spread[1] * own))


def true_slopes(spread: tuple[float, float]) -> np.ndarray:
    """Quantiles of y/x."""
    return np.exp(np.hypot(*spread) * special.ndtri(fit.FITTED_QUANTILES))


if __name__ == "__main__":
    main()
