"""Does the interval of a mean hold where few lanes are not 0?

Populations of 6,000 lanes of the ring (ā = 10 m, 90 s, exact engine): the paper's trimming against rotating
attacks and sinusoids, with a filter, with noise in judging; no defence; and differences between these, lane
by lane. Samples are drawn from each with replacement. Counted is how often the interval of the sample's mean
holds the mean of the population: of Student's t, of the bootstrap's percentiles, and of jaxnet. Beside it
stand the widths [m].

Run it with `python experiments/means.py`; `--keep` writes the populations to tests/statistics/lanes.npz,
which tests read.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from scipy import special

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.statistics import means
from jaxnet.statistics.limits import ceilings

KEPT = Path(__file__).parents[1] / "tests" / "statistics" / "lanes.npz"
RESULTS = Path("results")
LANES = 6000
SIZES = (30, 64, 100, 256, 1024)
TRIM = "trusted_trim"
POPULATIONS: dict[str, dict[str, Any]] = {
    "rotating": {"attack": {"kind": "rotating"}, "defence": TRIM},
    "filter": {"attack": {"kind": "rotating"}, "defence": {"kind": TRIM, "filter": 3.0}},
    "noise": {"attack": {"kind": "rotating"}, "defence": {"kind": TRIM, "noise": 1.0}},
    "slower": {"attack": {"kind": "rotating", "frequency": 0.65}, "defence": TRIM},
    "sinusoid": {"attack": {"kind": "sinusoid"}, "defence": TRIM},
    "sinusoid 0.35": {"attack": {"kind": "sinusoid", "frequency": 0.35}, "defence": TRIM},
    "no defence": {"attack": {"kind": "rotating"}, "defence": "none"},
}
DIFFERENCES = {
    "filter − rotating": ("filter", "rotating"),
    "noise − rotating": ("noise", "rotating"),
    "no defence − rotating": ("no defence", "rotating"),
}
Interval = Callable[[np.ndarray], tuple[float, float]]


class Population(NamedTuple):
    """Lanes, and the least and the greatest that one may be [m]."""

    lanes: np.ndarray
    least: float
    most: float

    def ours(self, sample: np.ndarray) -> tuple[float, float]:
        """What jaxnet tells."""
        return means.mean_interval(sample, self.least, self.most, 0.95)


@click.command()
@click.option("--repeats", default=2000, show_default=True)
@click.option("--keep", is_flag=True, help="Write the populations for the tests.")
def main(repeats: int, keep: bool) -> None:
    """A line per population and number of lanes."""
    enable()
    made = simulated()
    if keep:
        np.savez_compressed(KEPT, allow_pickle=False, **made)
    print("coverage [%] and median width [m] of 95 % intervals of the mean tail error")
    print(f"{'lanes':24}{'not 0':>7}{'n':>6}   {'t':>14}   {'bootstrap':>14}   {'jaxnet':>14}")
    for name, population in populations(made).items():
        off = np.mean(np.abs(population.lanes) > 0.1)
        for size in SIZES:
            found = (
                coverage(population.lanes, size, repeats, each)
                for each in (student, bootstrap, population.ours)
            )
            words = "   ".join(f"{100 * held:5.1f} {width:8.3g}" for held, width in found)
            print(f"{name:24}{off:7.1%}{size:6}   {words}", flush=True)


def simulated() -> dict[str, np.ndarray]:
    """Each population's tail_mean [m] and, first, the greatest that theory allows; in single precision."""
    found = {}
    for name, keys in POPULATIONS.items():
        attack = {**keys["attack"], "magnitude": 10}
        study = jaxnet.load(
            {
                "name": "means",
                "samples": LANES,
                "horizon": 90.0,
                "output_step": 0.5,
                "topology": "cyclic",
                "engine": "exact",
                **keys,
                "attack": attack,
            }
        )
        results = jaxnet.run(study, RESULTS / f"means-{name.replace(' ', '-')}", progress=True)
        most = ceilings(study.config, study.cells[0], range(LANES))["tail_mean"]
        lanes = results.lanes.sort_values("sample")["tail_mean"].to_numpy()
        found[name] = np.append(most, lanes).astype(np.float32)
    return found


def populations(made: Mapping[str, np.ndarray]) -> dict[str, Population]:
    """Those simulated, and their differences."""
    parts = {name: (float(made[name][0]), made[name][1:].astype(float)) for name in POPULATIONS}
    found = {name: Population(lanes, 0.0, most) for name, (most, lanes) in parts.items()}
    for name, (b, a) in DIFFERENCES.items():
        found[name] = Population(parts[b][1] - parts[a][1], -parts[a][0], parts[b][0])
    return found


def coverage(lanes: np.ndarray, size: int, repeats: int, interval: Interval) -> tuple[float, float]:
    """Share of samples whose interval holds the mean of all lanes, and the median width."""
    true, random = lanes.mean(), np.random.default_rng(0)
    ends = np.array([interval(random.choice(lanes, size)) for _ in range(repeats)])
    held = (ends[:, 0] <= true) & (true <= ends[:, 1])
    return float(held.mean()), float(np.median(ends[:, 1] - ends[:, 0]))


def student(sample: np.ndarray) -> tuple[float, float]:
    """Student's t."""
    half = special.stdtrit(len(sample) - 1, 0.975) * sample.std(ddof=1) / np.sqrt(len(sample))
    return sample.mean() - half, sample.mean() + half


def bootstrap(sample: np.ndarray) -> tuple[float, float]:
    """Percentiles of the means of 300 resamples."""
    drawn = np.random.default_rng(1).choice(sample, (300, len(sample))).mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return low, high


if __name__ == "__main__":
    main()
