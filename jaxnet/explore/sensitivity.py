"""Sensitivity: Sobol's indices of each metric with respect to each random quantity of a scenario.

A quantity comprises all numbers under one dotted name, for all vehicles. The method picks and freezes
quantities by sample number, without an array of coordinates. It draws the first samples, as many later
samples, and the first samples again with one quantity of the later samples at a time. The draws are random
for every value of `draws`.
"""

import functools
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import EVERYTHING, Machine
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.lanes.jobs import job, recorded
from jaxnet.lanes.uniforms import Keyed, Later
from jaxnet.statistics.indices import sobol_indices
from jaxnet.statistics.recovery import same_thresholds, threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import COLUMNS
from jaxnet.store.tables import read_table, write_table

SENSITIVITY_FILE = "sensitivity.csv"
FAILURES_NAMED = 5  # failed lanes of a cell in a warning


def quantities(study: Study, cell: Cell) -> list[str]:
    """Return the names of the random quantities of a cell."""
    return list(recorded(cell.scenario, Keyed(study.config.seed)).names)


def lanes_needed(study: Study, samples: int) -> dict[int, int]:
    """Return the number of lanes of each cell with random quantities.

    Raises FolderError if there is no such cell.
    """
    drawn = {cell.number: len(quantities(study, cell)) for cell in study.cells}
    if not any(drawn.values()):
        raise FolderError(f"{study.config.name}: nothing is drawn, so nothing varies")
    return {cell: samples * (number + 2) for cell, number in drawn.items() if number}


def write_indices(
    study: Study,
    folder: Folder,
    samples: int,
    machine: Machine = EVERYTHING,
    progress: Steps = no_progress,
) -> UPath:
    """Write `sensitivity.csv` cell by cell; a stored row with as many samples is not computed again."""
    rows = known_index_rows(study, folder, samples)
    known, needed = {row["cell"] for row in rows}, lanes_needed(study, samples)
    done, total = (
        sum(lanes for cell, lanes in needed.items() if cell in known),
        sum(needed.values()),
    )

    def load_done(lanes: int) -> None:
        nonlocal done
        done += lanes
        progress("lanes", done, total)

    for cell in study.cells:
        if cell.number in needed.keys() - known:
            names = quantities(study, cell)
            outcomes = pick_freeze_outcomes(
                cell, Keyed(study.config.seed), names, samples, machine, load_done
            )
            rows += index_rows(cell, names, outcomes, threshold(cell, study.config.recovery))
            table = pd.DataFrame(rows).sort_values("cell", kind="stable")
            folder.put(SENSITIVITY_FILE, functools.partial(write_table, table))
    return folder.path / SENSITIVITY_FILE


def known_index_rows(study: Study, folder: Folder, samples: int) -> list[dict[str, object]]:
    """Return the stored rows with the same number of samples and the same thresholds."""
    if not (folder.path / SENSITIVITY_FILE).exists():
        return []
    needed = COLUMNS[SENSITIVITY_FILE].split()
    table: Any = read_table(folder.path / SENSITIVITY_FILE, needed=needed)
    return table[(table["samples"] == samples) & same_thresholds(study, table)].to_dict("records")


def pick_freeze_outcomes(
    cell: Cell,
    keyed: Keyed,
    names: Sequence[str],
    samples: int,
    machine: Machine,
    load_done: Callable[[int], None],
) -> list[Outcome]:
    """Return the outcomes of the first samples, the later samples, and the mixed samples per quantity.

    A mixed sample is a first sample with one quantity of the later sample.
    """
    later = [names, *([name] for name in names)]
    sources = [keyed, *(Later(keyed, samples, some) for some in later)]
    one = job(cell.scenario, keyed, [0])
    inputs = (job(cell.scenario, source, range(samples)).inputs for source in sources)
    lanes = samples * len(sources)
    return list(
        batch.simulate_each(inputs, lanes, one.network, one.clock, one.plan, machine, load_done)
    )


def index_rows(
    cell: Cell, names: Sequence[str], outcomes: Sequence[Outcome], over: float
) -> list[dict[str, object]]:
    """Return a cell's rows by metric and quantity; a sample with a failed lane is left out.

    `over` is the error above which a lane is unrecovered [m], not-a-number where nothing is unrecovered.
    """
    status = np.stack([outcome.status for outcome in outcomes])
    ok = (status == Status.ok).all(axis=0)
    warn_of_failures(cell, names, status)
    measured = {
        metric.name: np.stack([outcome.metrics[metric.name][ok] for outcome in outcomes])
        for metric in cell.scenario.measured()
    }
    if over > 0:
        measured["unrecovered"] = (measured[cell.scenario.judged] > over).astype(float)
    identity = {"cell": cell.number, **cell.labels}
    counts = {"samples": len(ok), "left_out": int((~ok).sum()), "threshold": over}
    found = []
    for metric, (a, b, *mixed) in measured.items():
        of = sobol_indices(a, b, np.stack(mixed))
        for number, name in enumerate(names):
            row = {
                f"{order}{end}": float(values[place, number])
                for place, order in enumerate(("first", "total"))
                for end, values in zip(("", "_low", "_high"), of, strict=True)
            }
            found.append({**identity, "metric": metric, "quantity": name, **row, **counts})
    return found


def warn_of_failures(cell: Cell, names: Sequence[str], status: np.ndarray) -> None:
    """Warn of failed lanes in a cell."""
    runs, samples = np.nonzero(status)
    if len(runs):
        draws = ["its own draws", "the later draws", *(f"the later {name}" for name in names)]
        failures = [
            f"sample {sample} with {draws[run]}: {Status(status[run, sample]).name}"
            for run, sample in zip(runs[:FAILURES_NAMED], samples[:FAILURES_NAMED], strict=True)
        ]
        more = f" and {len(runs) - FAILURES_NAMED} more" if len(runs) > FAILURES_NAMED else ""
        warnings.warn(
            f"cell {cell.number}: {len(runs)} lanes failed, whose samples are left out: "
            f"{', '.join(failures)}{more}",
            stacklevel=2,
        )
