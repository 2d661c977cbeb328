"""Whether honest messages raise alarms far more often than the detector of a cell is asked for."""

from collections.abc import Sequence

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import situation_of
from jaxnet.kinds.fields import is_drawn
from jaxnet.model.wording import cells_named, number_text
from jaxnet.statistics.intervals import CONFIDENCE, clopper_pearson
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

FAR = 2  # times the nominal rate


def misfit_words(results: Results, cells: Sequence[Cell]) -> list[str]:
    """Tell where the measured rate of false alarms is far above the nominal one, and why."""
    if "false_alarms_mean" not in results.cells:
        return []
    found: dict[tuple[float, bool], dict[int, float]] = {}
    for cell in cells:
        row, detector = results.cells.loc[cell.number], cell.scenario.detector
        nominal = getattr(detector, "false_alarms", None)
        if nominal is None or is_drawn(nominal) or not row["ok"]:
            continue
        share, lanes = float(row["false_alarms_mean"]), int(row["ok"])
        messages = known_or(0, lambda cell=cell: honest_messages(cell))
        if is_far(share, lanes * messages, nominal):
            found.setdefault((nominal, detector.predicts.exact), {})[cell.number] = share
    told = []
    for (nominal, exact), shares in found.items():
        ends = dict.fromkeys(
            number_text(100 * end) for end in (min(shares.values()), max(shares.values()))
        )
        why = "errors are not as the test supposes" if exact else "the observer does not fit"
        words = f"honest messages raise {' to '.join(ends)} % alarms, nominal"
        told.append(f"{words} {number_text(100 * nominal)} %: {why} ({cells_named([*shares])})")
    return told


def honest_messages(cell: Cell) -> int:
    """The most independent tests of honest messages in a lane: one a window on each link."""
    known, scenario = situation_of(cell.scenario), cell.scenario
    links = int((known.graph.heard & ~known.attacked).sum())
    interval = scenario.tick * getattr(scenario.detector, "window", 1)
    return links * int(scenario.horizon / interval) if interval else 0


def is_far(share: float, messages: int, nominal: float) -> bool:
    """Whether the exact binomial interval of a share lies above twice a nominal rate."""
    if not messages or np.isnan(share):
        return False
    alarms, of = np.array([round(share * messages)]), np.array([messages])
    (low,), _ = clopper_pearson(alarms, of, CONFIDENCE)
    return bool(low > FAR * nominal)
