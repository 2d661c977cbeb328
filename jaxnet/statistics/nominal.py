"""Whether honest messages raise alarms as often as the detector of a cell is asked for."""

from collections.abc import Sequence

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import situation_of
from jaxnet.kinds.fields import is_drawn
from jaxnet.model.wording import cells_named, number_text
from jaxnet.statistics.intervals import CONFIDENCE, clopper_pearson
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

FAR = 2  # times the nominal rate, or its part


def misfit_words(results: Results, cells: Sequence[Cell]) -> list[str]:
    """Tell where the measured rate of false alarms is far from the nominal one, and why."""
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
        why = "errors are not as its test supposes" if exact else "the observer does not fit"
        words = f"honest messages raise {' to '.join(ends)} % alarms, nominal"
        told.append(f"{words} {number_text(100 * nominal)} %: {why} ({cells_named([*shares])})")
    return told


def honest_messages(cell: Cell) -> int:
    """The most messages on honest links in a lane: one a tick on each."""
    known, scenario = situation_of(cell.scenario), cell.scenario
    links = int((known.graph.heard & ~known.attacked).sum())
    return links * int(scenario.horizon / scenario.tick) if scenario.tick else 0


def is_far(share: float, messages: int, nominal: float) -> bool:
    """Whether the exact binomial interval of a share lies beyond twice or half a nominal rate."""
    if not messages or np.isnan(share):
        return False
    alarms, of = np.array([round(share * messages)]), np.array([messages])
    (low,), (high,) = clopper_pearson(alarms, of, CONFIDENCE)
    return bool(low > FAR * nominal or FAR * high < nominal)
