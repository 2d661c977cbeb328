"""What does a channel cost? Lanes under loss, noise or delay beside lanes with an ideal channel.

Twelve vehicles, cyclic, rotating attack, trimming, the exact engine, 20 s, the defaults elsewhere.
Each line is the best of several runs that take turns, on one core: processor time of a lane, and
the plain lane's time over it.

Run it with `python experiments/benchmarks/channel.py`; it takes about three minutes.
"""

import argparse
import os
import time
from typing import Any

import jaxnet
from jaxnet.runs.cache import enable

BASE = {
    "engine": "exact",
    "attack": "rotating",
    "defence": "trusted_trim",
    "horizon": 20.0,
    "tail": 5.0,
}
BURSTS = {"kind": "gilbert_elliott", "fail": 0.05, "recover": 0.25}
SCATTERED = {"kind": "bernoulli", "probability": 0.1}
CHANNELS: dict[str, dict[str, Any]] = {
    "plain": {},
    "loss, 10 %": {"loss": SCATTERED},
    "loss in bursts": {"loss": BURSTS},
    "loss, held words": {"loss": SCATTERED, "missing": "hold"},
    "noise of positions": {"noise": {"position": 0.1}},
    "delay of 0.1 s": {"delay": 0.1},
    "delay, extrapolated": {"delay": 0.1, "extrapolate": "jets"},
}


def main() -> None:
    """Print a line for each channel."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--lanes", type=int, default=4096)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    enable()
    best = {name: seconds(name, options.lanes) for name in CHANNELS}  # compiles
    for _ in range(options.runs):
        best = {name: min(least, seconds(name, options.lanes)) for name, least in best.items()}
    print(f"{'channel':22} {'µs a lane':>10} {'plain over it':>14}")
    for name, least in best.items():
        print(f"{name:22} {1e6 * least / options.lanes:10.0f} {best['plain'] / least:14.3f}")


def seconds(name: str, lanes: int) -> float:
    """Return the processor time of a study [s]."""
    study = jaxnet.load({**BASE, "channel": CHANNELS[name]})
    begin = time.process_time()
    jaxnet.simulate(study, samples=lanes, progress=False, devices=1)
    return time.process_time() - begin


if __name__ == "__main__":
    main()
