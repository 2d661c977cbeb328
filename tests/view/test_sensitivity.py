"""The figure and the table of Sobol's indices."""

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

from jaxnet.statistics.groups import evenly_over
from jaxnet.view.drawings.analyses import sensitivity_drawing
from jaxnet.view.figures import style
from jaxnet.view.figures.printed import printed
from jaxnet.view.text import analyses as words
from tests import systems

NAMES = ["initial.position", "initial.heading", "initial.speed", "attack.phase", "gain"]


def made(cells):
    """A study of so many cells, and a table of indices that tell their cell and quantity."""
    study = systems.study(sweep={"attack.magnitude": list(range(1, cells + 1))})
    rows = []
    for cell in range(cells):
        for number, name in enumerate(NAMES):
            first, total = 0.1 * number + 0.001 * cell, 0.2 * number
            rows.append({"cell": cell, "metric": "tail_mean", "quantity": name, "samples": 64})
            rows[-1]["left_out"] = cell == 1
            rows[-1] |= {"first": first, "first_low": first - 0.1, "first_high": first + 0.2}
            rows[-1] |= {"total": total, "total_low": total - 0.1, "total_high": total + 0.2}
    return study, pd.DataFrame(rows)


@pytest.mark.parametrize(("cells", "width"), [(1, 3.5), (30, 3.5), (6, 7.16)])
@mpl.rc_context(style.PRINT_STYLE)
def test_the_figure_has_what_the_table_says(cells, width):
    """Each panel the cell's numbers beside the quantities; what has no room is told."""
    study, table = made(cells)
    drawn = printed(sensitivity_drawing(table, study.cells), width)
    drawn.canvas.draw()
    panels = [panel for panel in drawn.axes if panel.containers]
    assert [tick.get_text() for tick in panels[0].get_yticklabels()] == NAMES
    labels = [cell.labels for cell in study.cells]
    for cell, panel in zip(evenly_over(labels, len(panels)), panels, strict=True):
        marked = [line for line in panel.lines if line.get_marker() in ("o", "s")]
        for order, line in zip(("first", "total"), marked, strict=True):
            np.testing.assert_array_equal(line.get_xdata(), table[table["cell"] == cell][order])
    assert len(
        panels
    ) == cells or f"{len(panels)} of {cells} cells are drawn" in drawn.get_supxlabel().replace(
        "\n", " "
    )
    assert drawn.get_figheight() <= 9.5


def test_the_printed_table_names_cells_and_quantities():
    """In 80 columns, with the samples that were left out."""
    study, table = made(3)
    said = words.indices_text(table, study, "tail_mean").splitlines()
    assert max(map(len, said)) <= 80
    line = next(line for line in said if line.split()[0] == "2" and "gain" in line)
    assert "0.40 (0.30 to 0.60)" in line
    assert "0.80 (0.70 to 1.00)" in line
    assert "left out: samples of which a lane failed, of 64" in said


def test_rare_failures_are_told_in_80_columns():
    """With the names that `show` has; a label is wrapped, and what does not fit is told."""
    label = "a ring with three links to the vehicles before"
    topology = [{"kind": "cyclic", "label": label}, "complete"]
    study = systems.study(sweep={"topology": topology, "defence": ["trusted_trim", "w_msr"]})
    numbers = ["share", "low", "high", "levels", "points", "threshold", "lanes", "failed"]
    rows = [
        {"cell": cell.number, **cell.labels, **dict.fromkeys([*numbers, "plain_lanes"], 12345.0)}
        for cell in study.cells
    ]
    said = words.rare_text(pd.DataFrame(rows), study)
    assert max(map(len, said.splitlines())) <= 80
    assert "trusted trimming" in said
    assert "w_msr" not in said
    assert "left out: levels" in said
