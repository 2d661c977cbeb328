"""Sensitivity: Sobol's indices of each metric with respect to each random quantity of a scenario.

A quantity comprises all numbers under one dotted name, for all vehicles. The method picks and
freezes quantities by sample number, without an array of coordinates. It draws the first samples, as
many later samples, and the first samples again with one quantity of the later samples at a time.
The draws are random for every value of `draws`.
"""

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.study import Study
from jaxnet.engine import batch
from jaxnet.engine.batch import EVERYTHING
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.explore.cells import AnalysisRow, CellTable
from jaxnet.lanes.jobs import job, recorded
from jaxnet.lanes.uniforms import Keyed, Later
from jaxnet.statistics.indices import sobol_indices
from jaxnet.statistics.recovery import threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError

SENSITIVITY_FILE = "sensitivity.csv"
FAILURES_NAMED = 5  # failed lanes of a cell in a warning


def quantities(study: Study, cell: Cell) -> list[str]:
    return list(recorded(cell.scenario, Keyed(study.config.seed)).names)


def lanes_needed(study: Study, samples: int) -> dict[int, int]:
    """Number of lanes of each cell with random quantities; FolderError without such a cell."""
    drawn = {cell.number: len(quantities(study, cell)) for cell in study.cells}
    if not any(drawn.values()):
        raise FolderError(f"{study.config.name}: nothing is drawn, so nothing varies")
    return {cell: samples * (number + 2) for cell, number in drawn.items() if number}


def write_indices(
    study: Study, folder: Folder, samples: int, progress: Steps = no_progress
) -> UPath:
    """Write `sensitivity.csv`; a stored row with as many samples is not computed again."""
    table = CellTable(study, folder, SENSITIVITY_FILE, "samples", samples)
    needed = lanes_needed(study, samples)
    done = sum(lanes for cell, lanes in needed.items() if cell in table.known)

    def load_done(lanes: int) -> None:
        nonlocal done
        done += lanes
        progress("lanes", done, sum(needed.values()))

    for cell in study.cells:
        if cell.number in needed.keys() - table.known:
            names, keyed = quantities(study, cell), Keyed(study.config.seed)
            outcomes = pick_freeze_outcomes(cell, keyed, names, samples, load_done)
            over = threshold(cell, study.config.recovery)
            table.add(index_rows(cell, names, outcomes, over))
    return table.path


def pick_freeze_outcomes(
    cell: Cell, keyed: Keyed, names: Sequence[str], samples: int, load_done: Callable[[int], None]
) -> list[Outcome]:
    """Outcomes of the first samples, the later samples, and the mixed samples per quantity.

    A mixed sample is a first sample with one quantity of the later sample.
    """
    later = [names, *([name] for name in names)]
    sources = [keyed, *(Later(keyed, samples, some) for some in later)]
    one = job(cell.scenario, keyed, [0])
    inputs = (job(cell.scenario, source, range(samples)).inputs for source in sources)
    alike, lanes = (one.network, one.clock, one.plan), samples * len(sources)
    return list(batch.simulate_each(inputs, lanes, *alike, EVERYTHING, load_done))


def index_rows(
    cell: Cell, names: Sequence[str], outcomes: Sequence[Outcome], over: float
) -> list[AnalysisRow]:
    """Rows of a cell by metric and quantity; a sample with a failed lane is left out.

    `over` is the error above which a lane is unrecovered [m], not-a-number where nothing is.
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
    runs, samples = np.nonzero(status)
    if not len(runs):
        return
    draws = ["its own draws", "the later draws", *(f"the later {name}" for name in names)]
    failures = [
        f"sample {sample} with {draws[run]}: {Status(status[run, sample]).name}"
        for run, sample in zip(runs[:FAILURES_NAMED], samples[:FAILURES_NAMED], strict=True)
    ]
    more = f" and {len(runs) - FAILURES_NAMED} more" if len(runs) > FAILURES_NAMED else ""
    told = f"{len(runs)} lanes failed, whose samples are left out: {', '.join(failures)}{more}"
    warnings.warn(f"cell {cell.number}: {told}", stacklevel=2)
