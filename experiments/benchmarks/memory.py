"""Does the memory of a study grow with its lanes?

`jaxnet run` simulates 10⁴ and then 10⁵ lanes of the default scenario with the exact engine,
trimming each 0.05 s. Printed is the greatest memory that each of the two processes held.

Run it with `python experiments/benchmarks/memory.py`; it takes a few minutes.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

MOST_GROWTH = 1.2  # times, for ten times the lanes


def main() -> None:
    """A line for each number of lanes, and their ratio."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--lanes", type=int, nargs=2, default=[10_000, 100_000], metavar=("FEW", "MANY")
    )
    peaks = [measured(lanes) for lanes in parser.parse_args().lanes]
    ratio = peaks[1] / peaks[0]
    print(f"ratio {ratio:.2f}: memory {'GROWS' if ratio > MOST_GROWTH else 'does not grow'}")


def measured(lanes: int) -> float:
    """Peak memory [MiB] of so many lanes, printed."""
    peak = peak_memory(lanes)
    print(f"{lanes:9,} lanes: {peak:7,.0f} MiB", flush=True)
    return peak


def peak_memory(lanes: int) -> float:
    """Peak memory [MiB] of the command line; raises CalledProcessError if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "memory.yaml"
        config.write_text(f"name: memory\nsamples: {lanes}\nengine: exact\n")
        command = [
            sys.executable,
            "-m",
            "jaxnet",
            "run",
            str(config),
            "--out",
            str(Path(folder) / "out"),
        ]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return used.ru_maxrss / 1024


if __name__ == "__main__":
    main()
