"""The tables of a terminal: what they show, and what they say they leave out."""

from types import SimpleNamespace

import pandas as pd
import pytest
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.store.results import Results
from jaxnet.view.text import tables
from jaxnet.view.text.tables import RECOVERY_COLUMNS, SUMMARY_COLUMNS
from tests import systems


def results_of(labels: dict[str, object], columns: dict[str, str]) -> Results:
    """Results of one cell with these labels, and 0.123456 for every statistic."""
    row = {**labels, "ok": 5, "failed": 0, **dict.fromkeys(columns, 0.123456)}
    given = systems.study()
    cell = Cell(0, labels, given.cells[0].scenario)
    results, study = Results(UPath("nowhere")), SimpleNamespace(cells=[cell], config=given.config)
    vars(results).update(cells=pd.DataFrame([row]), study=study)  # what else would be read there
    return results


@pytest.mark.parametrize("columns", [SUMMARY_COLUMNS, RECOVERY_COLUMNS | SUMMARY_COLUMNS])
@pytest.mark.parametrize("swept", [0, 1, 2, 3])
def test_the_summary_fits_a_terminal_or_says_what_it_left_out(swept, columns):
    """What is shown and what is named as left out are all there is; the mean stays."""
    labels = {f"attack.of.{key}": 1.5 for key in range(swept)}
    lines = tables.summary_text(results_of(labels, columns)).splitlines()
    assert max(map(len, lines)) <= 80
    _, _, left_out = " ".join(lines).partition("left out: ")
    shown = [name for name in columns.values() if f" {name} " in f"{lines[0]} "]
    named = left_out.removesuffix("; all are in cells.csv").split(", ") if left_out else []
    assert sorted(shown + named) == sorted(columns.values())
    assert "tail mean [m]" in shown
    legend = "mean low, mean high: 95 % interval of the mean over lanes"
    assert (legend in lines) == ("mean low" in shown)


def test_long_labels_are_cut_and_many_left_out_and_that_is_said():
    """A label of 90 letters keeps as many as fit; of eleven such the first stay, and the mean does."""
    labels = {f"topology.key{number}": "a" * 90 for number in range(11)}
    for swept in (1, 2, 11):
        given = dict(list(labels.items())[:swept])
        text = tables.summary_text(results_of(given, SUMMARY_COLUMNS | RECOVERY_COLUMNS))
        lines = text.splitlines()
        assert max(map(len, lines)) <= 80
        assert "aaaaaaaaa…" in lines[1]
        assert "0.1235" in lines[1]
        words = " ".join(lines)
        gone = [key for key in given if key.rpartition(".")[2] not in lines[0]]
        assert all(key in words for key in gone)
        assert bool(gone) == (swept == 11)
        assert "… stands where a label is cut short; all are in cells.csv" in words


def test_what_attacks_leave_of_the_papers_is_said_with_the_cells():
    """Of those that ā does not bound and those whose derivatives are none; of the paper's own nothing."""
    attacks = ["rotating", "freeze", "spoof", {"kind": "bias", "orders": [0]}, "replay"]
    study = systems.study(sweep={"attack": attacks})
    assert tables.caveat_lines(study.cells) == [
        "attack not bounded by ā: cells 1, 4",
        "attack derivatives falsified each on its own: cells 2, 3",
    ]
