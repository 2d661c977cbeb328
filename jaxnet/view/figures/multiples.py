"""Small multiples: a panel per group of cells, all on the same axes, rows by the first swept key."""

import functools
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from jaxnet.config.keys import KINDS, Scenario
from jaxnet.kinds import registry
from jaxnet.view.figures import style
from jaxnet.view.figures.style import Figure

PANEL_HEIGHT = 1.45  # [in]
ACROSS = 4  # panels in a row
NO_BREAK = "\N{NO-BREAK SPACE}"


def columns(labels: Sequence[dict[str, Any]]) -> int:
    """How many panels stand in a row: those that share the first swept value, if they are few."""
    firsts = [next(iter(each.values()), None) for each in labels]
    run = firsts.count(firsts[0])
    return run if 2 <= run <= ACROSS and len(firsts) % run == 0 else min(len(firsts), ACROSS)


def title(labels: dict[str, Any]) -> str:
    """A panel's or row's name: the values that it is about, with their keys where they do not say which."""
    return ", ".join(called(key, value) for key, value in labels.items())


def log_ticks(axis: Axis) -> None:
    """Have numbers on a log axis whose ends are settled: where it has few decades also between them."""
    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    if decades >= 2:
        axis.set_minor_locator(NullLocator())
        return
    if decades >= 0.7:  # so that two of the numbers are there at least
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades <= 1 else (1, 3)))
    else:
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axis.set_minor_formatter(NullFormatter())


def as_text(words: str) -> str:
    """Words in which matplotlib finds no formula."""
    return words.replace("$", r"\$")


def called(key: str, value: Any) -> str:
    """One swept value, with its unit if it has one; the two are never on different lines."""
    if value == "none":
        return f"no {key}"
    if key in KINDS:
        return str(value)
    amount = f"{value:.4g}" if isinstance(value, float) else str(value)
    return NO_BREAK.join(filter(None, [f"{key} =", amount, unit(key)]))


@functools.cache
def unit(key: str) -> str:
    """The unit that the config's models give a dotted key in brackets; nothing where none of them does."""
    root, name = key.partition(".")[0], key.rpartition(".")[2]
    base: Any = Scenario
    if name != key:
        base = registry.base_of(root) if root in KINDS else Scenario.model_fields[root].annotation
    models = [model for model in family(base) if name in model.model_fields]
    described = (model.model_fields[name].description or "" for model in models)
    found = (re.match(r"\[([^],]+)", words) for words in described)
    return next((match[1] for match in found if match), "")


def family(model: Any) -> Iterator[Any]:
    """A model and all that are made from it."""
    yield model
    for each in model.__subclasses__():
        yield from family(each)


def note_left_out(drawn: Figure, *parts: tuple[int, int, str], where: str) -> None:
    """Have a figure say how many it shows of how many there are, if not all, and where they are."""
    lacking = [f"{shown:,} of {there:,} {noun}" for shown, there, noun in parts if shown < there]
    if lacking:
        note(drawn, f"{' and '.join(lacking)} are drawn; all are in {where}")


def note(drawn: Figure, words: str) -> None:
    """Write a small line above all panels."""
    drawn.suptitle(words, x=0.01, ha="left", fontsize=7)


def panels(
    labels: Sequence[dict[str, Any]], x: str, y: str, height: float = PANEL_HEIGHT
) -> tuple[Figure, list[Axes]]:
    """A figure with a titled panel for each of these labels, its outer axes named."""
    across = columns(labels)
    rows = -(-len(labels) // across)
    drawn = Figure(figsize=(style.WIDTH, height * rows + 0.7))
    grid = drawn.subplots(rows, across, sharex=True, sharey=True, squeeze=False).ravel().tolist()
    for panel, each in zip(grid, labels, strict=False):
        wrapped = textwrap.fill(as_text(title(each)), 120 // across)
        panel.set_title(wrapped, pad=3, fontsize=7.5)
        panel.grid(True, color="0.92", linewidth=0.5)
        panel.set_axisbelow(True)
    for number, panel in enumerate(grid[len(labels) :], len(labels)):
        panel.axis("off")
        grid[number - across].tick_params(labelbottom=True)
    for panel in grid[::across]:
        panel.set_ylabel(y)
    for panel in grid[max(0, len(labels) - across) : len(labels)]:
        panel.set_xlabel(x)
    return drawn, grid[: len(labels)]
