"""Lanes in which a vehicle was cut off, or came to rest: how many of each cell."""

import pytest
from upath import UPath

import jaxnet
from jaxnet.model.wording import cells_named
from jaxnet.statistics import isolation
from jaxnet.store.results import Results
from jaxnet.view.text.tables import summary_text
from tests import systems


def test_lanes_whose_vehicles_coast_are_counted_by_cell():
    """On a path W-MSR cuts off all vehicles but the first, in each lane."""
    keys = {"vehicles": 3, "topology": "path", "engine": "exact", "horizon": 1.0, "gain": [1.0]}
    keys |= {"attack": {"kind": "bias", "vehicles": [2]}, "vehicle": "single_integrator"}
    sweep = {"defence": ["none", {"kind": "w_msr", "isolated": "coast"}]}
    results = jaxnet.simulate(systems.study(**keys, tail=0.5, sweep=sweep), 2, progress=False)
    words = isolation.ISOLATED["cut_off_vehicles"]
    assert isolation.isolated_lanes(results) == {words: {0: (0, 2), 1: (2, 2)}}
    told = f"A{words[1:]}: in 2 of 2 lanes of cell 1 (W-MSR)"
    assert told in " ".join(summary_text(results).split())
    assert "cut off" not in summary_text(results, where={"defence": "none"})


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        ([10, 10, 7, 7], "in 10 of 20 lanes of each of cells 0, 1; in 7 of 20 lanes of each of"),
        ([0, 0, 0, 7], "in 7 of 20 lanes of cell 3"),
        ([1, 2, 3, 4], "in 10 of 80 lanes of cells 0-3"),
    ],
)
def test_cells_with_as_many_lanes_are_told_together(counts, told, monkeypatch):
    """Of many numbers the sum."""
    cells = systems.study(sweep={"attack.magnitude": [1, 2, 3, 4]}).cells
    lanes = {"it happened": {cell: (many, 20) for cell, many in enumerate(counts)}}
    monkeypatch.setattr(isolation, "isolated_lanes", lambda results: lanes)
    (line,) = isolation.isolated_lines(Results(UPath("nowhere")), cells, cells_named)
    assert line.startswith(f"It happened: {told}")
