"""Output of `jaxnet search`: the worst choice in each cell, beside random lanes and bounds."""

from typing import Any

import numpy as np
import pandas as pd

from jaxnet.config.cells import is_leaderless
from jaxnet.config.keys import SearchSettings
from jaxnet.config.naming import choices_words, key_name, quantity, worded
from jaxnet.explore.box import places_of
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.wording import cells_named
from jaxnet.statistics.amplitude import without_rounding
from jaxnet.statistics.curves import BOUND_NAMES
from jaxnet.statistics.recovery import criterion_words
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.view.text.printer import fitted_text
from jaxnet.view.text.width import filled

LENGTHS = {  # columns of worst.csv that are told per ā, with their titles
    "greatest": "greatest tried",
    "found": "found by the search",
    "late": "found, later",
    "random": "worst random lane",
    "bound": "bound of theory",
    "fresh": "other draws, mean",
    "fresh_low": "other draws, 5 %",
    "nonlinear": "found, nonlinear engine",
}
SEARCH_LANES = "lanes of the search"
SEARCH_DROP_ORDER = [[SEARCH_LANES], *([LENGTHS[n]] for n in ("fresh_low", "nonlinear", "fresh"))]


def search_text(results: Results) -> str:
    labels, file = [*map(quantity, results.study.cells[0].labels)], str(results.path / "worst.csv")
    text = fitted_text(worst_rows(results).to_dict("list"), labels, SEARCH_DROP_ORDER, file)
    notes = [*search_notes(results), *limit_lines(results)]
    return "\n".join([f"{maximised_text(results)}, by search", text, *map(filled, notes)])


def asked_search(results: Results) -> SearchSettings:
    asked = results.study.config.search
    assert asked is not None
    return asked


def search_notes(results: Results) -> list[str]:
    """What the columns of `worst_rows` are."""
    asked = asked_search(results)
    late = " or ".join(f"{time:g} s" for time in sorted(set(results.worst["until"])))
    draw = "one draw" if asked.starts == 1 else f"{asked.starts:,} draws, their mean,"
    others, over = known_or("", lambda: drawn_words(results)), ", ".join(map(key_name, asked.over))
    return [
        f"greatest tried: the worst choice over {over}, from {draw} of all else{others}; found by"
        f" the search: of the best choices the worst at {late}; later: the same choice then",
        "worst random lane: the worst of as many random choices, each from a draw of its own",
        "other draws: the found choice from 10,000 other draws of all else",
        *filter(None, [bounds_told(results)]),
    ]


def drawn_words(results: Results) -> str:
    """What lanes of a search draw in the first cell, beside what it chooses."""
    over, source = asked_search(results).over, Keyed(0)
    names = sorted({place.name for place in places_of(results.study.cells[0].scenario, source)})
    told = [key_name(name.removesuffix(".key")) for name in names if name not in over]
    first = "in cell 0: " * (len(results.study.cells) > 1)
    return f" ({first}{', '.join(told)})" * bool(told)


def bounds_told(results: Results) -> str:
    """Which bound of theory stands in the table; "" if none does."""
    found: Any = results.worst.reindex(columns=["cell", "bound_name"]).dropna()
    cells = [cell.labels for cell in results.study.cells]
    told = [
        f"{BOUND_NAMES[name]} ({' / '.join(choices_words([cells[n] for n in mine], cells))})"
        for name, mine in found.groupby("bound_name")["cell"]
    ]
    words = f"bound of theory after transients, the least for the attack: {', '.join(told)}"
    return words.removesuffix(" (all)") if told else ""


def limit_lines(results: Results) -> list[str]:
    """Limits of `subject_to`, how many further draws fulfil them, and where no choice does."""
    asked = asked_search(results)
    limits, part = asked.subject_to, asked.may_exceed
    found: Any = results.worst
    if not limits:
        return []
    told = ", ".join(f"{name} ≤ {most:g}" for name, most in limits.items())
    where = f"at least {1 - part:.3g} of the draws" if part else "every draw"
    lines = [f"subject to {told} from {where} of the search"]
    none = found["found"].isna()
    shares = found["fresh_allowed"][~none].dropna()
    if len(shares):
        lines.append(f"of other draws {shares.min():.1%} to {shares.max():.1%} fulfil it")
    if none.any():
        cells = cells_named(found["cell"][none].tolist()) if len(found) > 1 else "the study"
        lines += [f"no choice that was tried in {cells} fulfils it: search where more of them do"]
    return ["; ".join(lines)]


def maximised_text(results: Results) -> str:
    """What the search maximises, in words with its unit."""
    words = metric_with_unit(results)
    return words.replace(" [m]", ", per ā") if is_per_size(results) else words


def is_per_size(results: Results) -> bool:
    """Whether lengths are told per ā: every cell follows a navigator and has a known ā > 0."""
    sized = bool((results.worst["magnitude"] > 0).all())
    led = not is_leaderless(results.study.cells)
    return sized and led and metric_with_unit(results).endswith(" [m]")


def metric_words(results: Results) -> str:
    """Name in words of what the search maximises."""
    metric = asked_search(results).maximise
    words = {each.name: each.told for each in results.study.config.measured()}.get(metric)
    return words or metric.replace("_", " ")


def metric_with_unit(results: Results) -> str:
    config, metric = results.study.config, asked_search(results).maximise
    unit = {each.name: each.column_unit for each in config.measured()}.get(metric)
    told = f"{metric_words(results)} [{unit}]" if unit else metric_words(results)
    if metric != "unrecovered" or config.recovery is None:
        return told
    return f"{told} ({criterion_words(config.recovery, results.study.cells)})"


def worst_rows(results: Results) -> pd.DataFrame:
    """Return the results of a search, a row per cell; lengths are as `maximised_text` says.

    Bounds are left out where none is known.
    """
    found: Any = results.worst
    lengths = found[list(LENGTHS)]
    if is_per_size(results):
        lengths = lengths.div(found["magnitude"], axis="index")
        lengths = lengths.map(lambda each: without_rounding(each, 1.0))
    if not np.isfinite(found["bound"].to_numpy(dtype=float)).any():
        lengths = lengths.drop(columns=["bound"])
    swept = pd.DataFrame([worded(results.study.cells[number].labels) for number in found["cell"]])
    who = found[["cell"]].join(swept).join(found["attacked"])
    lanes = found["lanes"].rename(SEARCH_LANES)
    return pd.concat([who, lengths.rename(columns=LENGTHS), lanes], axis="columns")
