"""One line of a table, measured in its own process, so that peak memory and cores are its own.

`apart(...)` starts that process, which prints what it found as JSON. What is timed is simulating
alone: lanes are drawn before, programs are compiled by a call before, and calls are repeated until
`seconds` have passed. Memory is read before any lane is compared with the exact solution.

Memory is that of the whole process, or of its largest child: some 250 MiB of every line is JAX,
with which all lanes are drawn. Whoever calls `apart` must be small, for Linux counts the parent
into a child's peak.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from jaxnet.lanes.uniforms import Keyed

SEED = 0
PIECE = (
    16_384  # lanes drawn and simulated by one call, so that memory does not grow with their number
)
WARM = 1_024  # lanes of the call that compiles, at most


def apart(
    request: Mapping[str, Any], cores: Collection[int] = (), timeout: float | None = None
) -> Any:
    """What `measure(**request)` finds in a new process, on these cores if any are named.

    Raises TimeoutExpired.
    """
    done = subprocess.run(
        [sys.executable, __file__, json.dumps(request)],
        stdout=subprocess.PIPE,
        check=True,
        timeout=timeout,
        env={
            **os.environ,
            "OPENBLAS_NUM_THREADS": "1",
        },  # small matrices are solved faster by one thread
        preexec_fn=(lambda: os.sched_setaffinity(0, cores)) if cores else None,
    )
    return json.loads(done.stdout)


class Simulator(NamedTuple):
    """A program: its function of a job, and how many lanes must be simulated before it is warm."""

    run: Callable[[Any], Any]
    warm: int


def simulator(what: str, tolerance: float) -> Simulator:
    """A program by name; a peer has this tolerance. Raises NotInstalledError if it is absent."""
    import peers
    import with_heyoka

    from jaxnet.engine import batch

    if what == "numba":
        import with_numba  # which needs numba to define its functions

        return Simulator(lambda job: with_numba.with_numba(job, tolerance), WARM)
    return {
        "jaxnet": Simulator(batch.simulate, WARM),
        "diffrax dense": Simulator(lambda job: peers.with_diffrax(job, True, tolerance), WARM),
        "diffrax structured": Simulator(
            lambda job: peers.with_diffrax(job, False, tolerance), WARM
        ),
        "scipy dense": Simulator(lambda job: peers.with_scipy(job, True, tolerance), 0),
        "scipy structured": Simulator(lambda job: peers.with_scipy(job, False, tolerance), 0),
        "heyoka": Simulator(lambda job: with_heyoka.with_heyoka(job, tolerance), WARM),
        "octave dense": Simulator(peers.with_octave, 0),
        "by hand": Simulator(peers.by_hand, WARM),
    }[what]


def measure(
    what: str,
    keys: Mapping[str, Any],
    lanes: int,
    seconds: float = 0,
    checked: int = 0,
    tolerance: float = 1e-7,
    warmed: bool = True,
) -> Any:
    """Lanes per second, cores kept busy, peak memory [MiB], lanes that failed.

    Unless `warmed`, the time includes what a program does at its first call. With `checked`, also
    the greatest error [m] of the first lanes. A program that is not on this machine is named under
    `missing`, and nothing else is there.
    """
    import peers

    from jaxnet.lanes.jobs import job
    from jaxnet.runs.cache import enable

    enable()
    scenario = scenario_of(keys)
    try:
        run, warm = simulator(what, tolerance)
        if warm and warmed:
            run(job(scenario, Keyed(SEED), range(min(lanes, warm))))
        found = race(run, lambda samples: job(scenario, Keyed(SEED), samples), lanes, seconds)
    except peers.NotInstalledError as missing:
        return {"missing": str(missing)}
    error = greatest_error(run, what, scenario, checked) if checked else None
    return {**found, "error": error}


def race(
    run: Callable[[Any], Any], draw: Callable[[range], Any], lanes: int, seconds: float
) -> Any:
    """Run all lanes, piece by piece, again and again until the time is up."""
    from jaxnet.engine.status import Status

    wall = busy = 0.0
    rounds = failed = 0
    while rounds == 0 or wall < seconds:
        for start in range(0, lanes, PIECE):
            piece = draw(range(start, min(start + PIECE, lanes)))
            began, before = time.perf_counter(), sum(os.times()[:4])
            outcome = run(piece)
            wall += time.perf_counter() - began
            busy += sum(os.times()[:4]) - before
            failed += int((outcome.status != Status.ok).sum()) if hasattr(outcome, "status") else 0
        rounds += 1
    peak = max(
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return {
        "rate": rounds * lanes / wall,
        "lanes": rounds * lanes,
        "cores": busy / wall,
        "memory": peak / 1024,
        "failed": failed,
    }


def greatest_error(run: Callable[[Any], Any], what: str, scenario: Any, lanes: int) -> float:
    """Greatest distance [m] from the exact solution over the first lanes, simulated once more."""
    import peers

    from experiments import exactness
    from jaxnet.lanes.jobs import job

    if scenario.defence.kind != "none":
        return float(
            exactness.deviations(exactness.lanes_at_ticks(scenario, SEED, range(lanes))).max()
        )
    one = job(scenario, Keyed(SEED), range(lanes), ("state",) if what == "jaxnet" else ())
    found = run(one)
    positions = found.series["state"][..., :2] if what == "jaxnet" else found
    return peers.greatest_error(one, positions)


def scenario_of(keys: Mapping[str, Any]) -> Any:
    """The scenario of these keys, the defaults elsewhere."""
    import jaxnet

    (cell,) = jaxnet.load(keys).cells
    return cell.scenario


def spread(rates: Sequence[float]) -> str:
    """Median, least and greatest; a single rate by itself."""
    if len(rates) == 1:
        return shown(rates[0])
    low, middle, high = (shown(rate) for rate in (min(rates), statistics.median(rates), max(rates)))
    return f"{middle} ({low} to {high})"


def shown(number: float) -> str:
    """Three significant digits, none in exponent form."""
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def main() -> None:
    """Measure what the first word asks for, in JSON."""
    parser = argparse.ArgumentParser(description="One line of a table, in a process of its own.")
    parser.add_argument("request", type=json.loads, help="arguments of measure, as JSON")
    print(json.dumps(measure(**parser.parse_args().request)))


if __name__ == "__main__":
    main()
