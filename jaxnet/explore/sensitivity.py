"""What matters: Sobol's indices of each thing that a row measures to each quantity that a scenario draws.

A quantity is all that stands under one dotted name, numbers of all vehicles together. No array of coordinates
is needed to pick one and freeze the others: the samples from 0 on are drawn, as many after them, and the
first ones again, each time with one quantity of the later ones. They are drawn at random, whatever `draws`
says.
"""

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
from jaxnet.statistics.recovery import threshold
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import read_table

SENSITIVITY_FILE = "sensitivity.csv"
FAILURES_NAMED = 5  # failed lanes of a cell


def quantities(study: Study, cell: Cell) -> list[str]:
    """What a cell's lanes draw."""
    return list(recorded(cell.scenario, Keyed(study.config.seed)).names)


def lanes_needed(study: Study, samples: int) -> dict[int, int]:
    """Lanes of each cell that draws anything; raises FolderError if none does."""
    drawn = {cell.number: len(quantities(study, cell)) for cell in study.cells}
    if not any(drawn.values()):
        raise FolderError(f"{study.config.name}: nothing is drawn, so nothing varies")
    return {cell: samples * (number + 2) for cell, number in drawn.items() if number}


def write_indices(
    study: Study, folder: Folder, samples: int, machine: Machine = EVERYTHING, told: Steps = no_progress
) -> UPath:
    """Write `sensitivity.csv`, cell by cell: one that is there, of as many samples, is not done again."""
    tau = None if study.config.recovery is None else study.config.recovery.tau
    rows = known_index_rows(folder, samples, tau)
    known, needed = {row["cell"] for row in rows}, lanes_needed(study, samples)
    done, total = sum(needed[cell] for cell in known), sum(needed.values())

    def load_done(lanes: int) -> None:
        nonlocal done
        done += lanes
        told("lanes", done, total)

    for cell in study.cells:
        if cell.number in needed.keys() - known:
            names = quantities(study, cell)
            outcomes = pick_freeze_outcomes(
                cell, Keyed(study.config.seed), names, samples, machine, load_done
            )
            rows += index_rows(cell, names, outcomes, tau)
            table = pd.DataFrame(rows).sort_values("cell", kind="stable")
            folder.put(SENSITIVITY_FILE, lambda file, table=table: table.to_csv(file, index=False))
    return folder.path / SENSITIVITY_FILE


def known_index_rows(folder: Folder, samples: int, tau: float | None) -> list[dict[str, Any]]:
    """Rows that the folder holds of the same question."""
    if not (folder.path / SENSITIVITY_FILE).exists():
        return []
    table: Any = read_table(folder.path / SENSITIVITY_FILE)
    same = (table["samples"] == samples) & (table["tau"].isna() if tau is None else table["tau"] == tau)
    return table[same].to_dict("records")


def pick_freeze_outcomes(
    cell: Cell,
    keyed: Keyed,
    names: Sequence[str],
    samples: int,
    machine: Machine,
    load_done: Callable[[int], None],
) -> list[Outcome]:
    """Outcomes of the first samples, of as many later ones, and of the first with each quantity of those."""
    later = [names, *([name] for name in names)]
    sources = [keyed, *(Later(keyed, samples, some) for some in later)]
    one = job(cell.scenario, keyed, [0])
    inputs = (job(cell.scenario, source, range(samples)).inputs for source in sources)
    lanes = samples * len(sources)
    return list(batch.simulate_each(inputs, lanes, one.network, one.clock, one.plan, machine, load_done))


def index_rows(
    cell: Cell, names: Sequence[str], outcomes: Sequence[Outcome], tau: float | None
) -> list[dict[str, Any]]:
    """Rows of a cell, by metric and quantity; a sample of which a lane failed counts nowhere."""
    status = np.stack([outcome.status for outcome in outcomes])
    ok = (status == Status.ok).all(axis=0)
    warn_of_failures(cell, names, status)
    measured = {
        metric.name: np.stack([outcome.metrics[metric.name][ok] for outcome in outcomes])
        for metric in cell.scenario.measured()
    }
    if tau is not None and threshold(cell, tau) > 0:
        measured["unrecovered"] = (measured["tail_mean"] > threshold(cell, tau)).astype(float)
    about = {"cell": cell.number, **cell.labels}
    counts = {"samples": len(ok), "left_out": int((~ok).sum()), "tau": tau}
    found = []
    for metric, (a, b, *mixed) in measured.items():
        of = sobol_indices(a, b, np.stack(mixed))
        for number, name in enumerate(names):
            row = {
                f"{order}{end}": float(values[place, number])
                for place, order in enumerate(("first", "total"))
                for end, values in zip(("", "_low", "_high"), of, strict=True)
            }
            found.append({**about, "metric": metric, "quantity": name, **row, **counts})
    return found


def warn_of_failures(cell: Cell, names: Sequence[str], status: np.ndarray) -> None:
    """Warn of lanes that failed."""
    runs, samples = np.nonzero(status)
    if len(runs):
        draws = ["its own draws", "the later draws", *(f"the later {name}" for name in names)]
        told = [
            f"sample {sample} with {draws[run]}: {Status(status[run, sample]).name}"
            for run, sample in zip(runs[:FAILURES_NAMED], samples[:FAILURES_NAMED], strict=True)
        ]
        more = f" and {len(runs) - FAILURES_NAMED} more" if len(runs) > FAILURES_NAMED else ""
        warnings.warn(
            f"cell {cell.number}: {len(runs)} lanes failed, whose samples are left out: "
            f"{', '.join(told)}{more}",
            stacklevel=2,
        )
