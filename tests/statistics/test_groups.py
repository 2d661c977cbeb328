"""Cells that differ in ā alone belong together."""

import jaxnet
from jaxnet.statistics import groups


def test_cells_are_grouped_by_everything_but_the_magnitude():
    """In the sweep's order, ā ascending; cells without attack belong to none."""
    sweep = {"attack": ["none", "bias"], "topology": ["star", "path"]}
    study = jaxnet.load({"sweep": sweep})
    assert [group.labels for group in groups.attacked_groups(study.cells)] == [
        {"attack": "bias", "topology": "star"},
        {"attack": "bias", "topology": "path"},
    ]
    swept = jaxnet.load({"sweep": {"attack.magnitude": [5, 0, 1], "topology": ["star", "path"]}})
    star, path = groups.attacked_groups(swept.cells)
    assert [cell.number for cell in star.cells] == [2, 4, 0]
    assert path.attacked == {5: 1.0, 1: 5.0}
    assert (str(star), star.labels) == ("topology=star", {"topology": "star"})


def test_a_drawn_magnitude_has_no_group():
    """There is no ā that such a cell's errors could stand against."""
    study = jaxnet.load({"sweep": {"attack.magnitude": [1, {"uniform": [1, 2]}]}})
    (group,) = groups.attacked_groups(study.cells)
    assert [cell.number for cell in group.cells] == [0]
