"""Is an interval still honest when one stops as soon as it is narrow enough?

Runs of `samples: {until: …}` are imitated with lanes that fail with a known probability: at each
look, which lie ever further apart, the exact binomial interval is told, and the run stops when it
is narrow enough. Counted is how often the interval of that last look holds the truth, and how often
every interval looked at on the way does (who may stop whenever she likes, can stop at one that does
not), with jaxnet's looks, which share the error among them, and with plain 95 % intervals, as if
each look were the only one. Beside it the lanes that it takes.

Run it with `python experiments/stopping.py`.
"""

from collections.abc import Callable
from typing import NamedTuple

import click
import numpy as np

from jaxnet.statistics import intervals, recovery

CONFIDENCE = 0.95
LOOKS = 16  # at most, 112,000 lanes
RELATIVE = 0.3  # half width asked for, in units of the truth: lucky runs stop early


class Coverage(NamedTuple):
    """Shares of runs whose last, and whose every, interval holds the truth; mean lanes of a run."""

    last: float
    every: float
    lanes: float


def plain(look: int, confidence: float) -> float:
    """Confidence of a look that forgets all others."""
    return confidence


def coverage(share: float, repeats: int, at: Callable[[int, float], float]) -> Coverage:
    """The confidence of each look by `at`: so many runs, lanes that fail with this probability."""
    random = np.random.default_rng(0)
    lanes = np.array([recovery.samples_at(look) for look in range(1, LOOKS + 1)])
    failures = random.binomial(np.diff(lanes, prepend=0), share, (repeats, LOOKS)).cumsum(axis=1)
    told = [
        intervals.clopper_pearson(failures[:, n], np.full(repeats, lanes[n]), at(n + 1, CONFIDENCE))
        for n in range(LOOKS)
    ]
    low, high = (np.stack(ends, axis=1) for ends in zip(*told, strict=True))
    enough = high - low <= 2 * RELATIVE * share
    last = np.where(enough.any(axis=1), enough.argmax(axis=1), LOOKS - 1)
    holds = (low <= share) & (share <= high)
    at_last = np.take_along_axis(holds, last[:, None], axis=1)
    held = np.where(np.arange(LOOKS) <= last[:, None], holds, True).all(axis=1)
    return Coverage(float(at_last.mean()), float(held.mean()), float(lanes[last].mean()))


@click.command()
@click.option("--repeats", default=1000, show_default=True)
def main(repeats: int) -> None:
    """A line per probability."""
    print("           looks share the error     each look at 95 %")
    print("share     last  every   lanes        last  every   lanes")
    for share in (0.02, 0.05, 0.1, 0.3, 0.5):
        honest, naive = (coverage(share, repeats, at) for at in (recovery.confidence_at, plain))
        words = (
            f"{each.last:6.1%} {each.every:6.1%} {each.lanes:7.0f}" for each in (honest, naive)
        )
        print(f"{share:5.2f}   {'      '.join(words)}")


if __name__ == "__main__":
    main()
