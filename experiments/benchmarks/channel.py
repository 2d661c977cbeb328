"""What does a channel cost, and what a detector?

Twelve vehicles, cyclic, rotating attack, trimming, the exact engine, 20 s, the defaults elsewhere;
processor time on one core.

- Channels: each line is the best of several runs that take turns, and the plain lane's time over
  it.
- Detectors: each run of a χ² test follows a run with the same noise and no detector. The ratio is
  the second's time over the first's: median of the pairs, with its exact 95 % interval.

Run it with `python experiments/benchmarks/channel.py`; it takes about six minutes.
"""

import argparse
import itertools
import os
import time
from typing import Any

import numpy as np

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.statistics.intervals import quantile_interval

BASE = {
    "engine": "exact",
    "attack": "rotating",
    "defence": "trusted_trim",
    "horizon": 20.0,
    "tail": 5.0,
}
BURSTS = {"kind": "gilbert_elliott", "fail": 0.05, "recover": 0.25}
NOISE = {"noise": {"position": 0.1}}
SCATTERED = {"kind": "bernoulli", "probability": 0.1}
CHANNELS: dict[str, dict[str, Any]] = {
    "plain": {},
    "loss, 10 %": {"loss": SCATTERED},
    "loss in bursts": {"loss": BURSTS},
    "loss, held words": {"loss": SCATTERED, "missing": "hold"},
    "noise of positions": NOISE,
    "delay of 0.1 s": {"delay": 0.1},
    "delay, extrapolated": {"delay": 0.1, "extrapolate": "jets"},
}


PREDICTS, CUTS = ("truth", "kalman"), ("never", "message", "link")


def main() -> None:
    """Print a line for each channel and each detector."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--lanes", type=int, default=4096)
    parser.add_argument("--runs", type=int, default=5, help="of a channel")
    parser.add_argument("--pairs", type=int, default=9, help="of noise with and without a detector")
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    enable()
    channels(options.lanes, options.runs)
    detectors(options.lanes, options.pairs)


def channels(lanes: int, runs: int) -> None:
    if not runs:
        return
    best = {name: seconds(lanes, channel=keys) for name, keys in CHANNELS.items()}  # compiles
    for _ in range(runs):
        for name, keys in CHANNELS.items():
            best[name] = min(best[name], seconds(lanes, channel=keys))
    print(f"{'channel':22} {'µs a lane':>10} {'plain over it':>14}")
    for name, least in best.items():
        print(f"{name:22} {1e6 * least / lanes:10.0f} {best['plain'] / least:14.3f}")


def detectors(lanes: int, pairs: int) -> None:
    if not pairs:
        return
    print(f"\n{'predicts':10} {'cuts':10} {'µs a lane':>10}   noise alone over it")
    for predicts, cuts in itertools.product(PREDICTS, CUTS):
        detector = {"kind": "chi_squared", "predicts": predicts, "cuts": cuts}
        both = {"channel": NOISE}, {"channel": NOISE, "detector": detector}
        for keys in both:
            seconds(lanes, **keys)  # compiles
        alone, tested = np.array(
            [[seconds(lanes, **keys) for keys in both] for _ in range(pairs)]
        ).T
        low, high = quantile_interval(alone / tested, 0.5, 0.95)
        print(f"{predicts:10} {cuts:10} {1e6 * np.median(tested) / lanes:10.0f}", end="   ")
        print(f"{np.median(alone / tested):.3f} [{low:.3f}, {high:.3f}]", flush=True)


def seconds(lanes: int, **keys: Any) -> float:
    """Processor time of a study [s]."""
    study = jaxnet.load({**BASE, **keys})
    begin = time.process_time()
    jaxnet.simulate(study, samples=lanes, progress=False, devices=1)
    return time.process_time() - begin


if __name__ == "__main__":
    main()
