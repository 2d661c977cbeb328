"""Shares of lanes in `cells.csv`, tables and figures: one declaration each.

- `unrecovered`: the tail error, or without a navigator the spread, stays above τ ā (theorems.md
  O6).
- `in_hull`: no vehicle leaves the hull of the starts, attacked vehicles aside. The metric `outside`
  is at most the accuracy of the engine, 1e-8 m for the exact engine and 1e-5 m for others.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.recovery import attack_size, share_definition, share_name, threshold

Counted = Bool[np.ndarray, " lanes"] | None  # None in a cell that has no such share


class Share(NamedTuple):
    """A share of the lanes that ended."""

    name: str
    words: Callable[[Sequence[Cell]], str]
    note: Callable[[Config, Sequence[Cell]], str]
    which: Callable[[Config, Cell, pd.DataFrame], Counted]


def count_unrecovered(study: Config, cell: Cell, ok: pd.DataFrame) -> Counted:
    """Whether each lane is unrecovered; None without an attack of a known ā."""
    if not attack_size(cell) > 0:
        return None
    return ok[cell.scenario.judged].to_numpy() > threshold(cell, study.recovery)


def unrecovered_note(study: Config, cells: Sequence[Cell]) -> str:
    if study.recovery is None:
        return ""
    reduced = amplitude_note(cells) if study.recovery.of == "magnitude" else ""
    return "; ".join(filter(None, [share_definition(study.recovery, cells), reduced]))


def count_in_hull(study: Config, cell: Cell, ok: pd.DataFrame) -> Counted:
    """Whether each lane stays in the hull; None where a navigator leads."""
    if not cell.scenario.leaderless:
        return None
    return ok["outside"].to_numpy() <= cell.scenario.engine.accuracy


def hull_note(study: Config, cells: Sequence[Cell]) -> str:
    tolerance = max(cell.scenario.engine.accuracy for cell in cells)
    who = "no vehicle that is not attacked leaves the convex hull of their starts"
    return f"in the hull (in_hull): {who} by over {tolerance:g} m"


LANE_SHARES = {
    share.name: share
    for share in (
        Share("in_hull", lambda cells: "in the hull", hull_note, count_in_hull),
        Share("unrecovered", share_name, unrecovered_note, count_unrecovered),
    )
}


def shares_of(study: Config, cells: Sequence[Cell]) -> list[Share]:
    asked = {
        "in_hull": any(cell.scenario.leaderless for cell in cells),
        "unrecovered": study.recovery is not None,
    }
    return [share for name, share in LANE_SHARES.items() if asked[name]]


def share_columns(share: Share, counted: Counted, confidence: float) -> dict[str, object]:
    """Share and both ends of its exact interval; not-a-number without a lane."""
    names = share_names(share.name)
    if counted is None or not len(counted):
        return dict.fromkeys(names, np.nan)
    many = np.count_nonzero(counted)
    low, high = clopper_pearson(np.array([many]), np.array([len(counted)]), confidence)
    return dict(zip(names, (many / len(counted), float(low[0]), float(high[0])), strict=True))


def share_names(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]
