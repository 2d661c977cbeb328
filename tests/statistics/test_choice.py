"""Cells chosen by the values of their swept keys."""

import pytest

from jaxnet.statistics.choice import select_cells
from jaxnet.store.folder import FolderError
from tests import systems


@pytest.fixture
def cells():
    """Two topologies by three ā, one of which has more digits than a table shows."""
    return systems.study(
        sweep={"topology": ["star", "path"], "attack.magnitude": [1, 2.0, 0.123456789]}
    ).cells


@pytest.mark.parametrize(
    ("where", "numbers"),
    [
        ({}, [0, 1, 2, 3, 4, 5]),
        ({"topology": "path"}, [3, 4, 5]),
        ({"topology": ["path", "star"], "attack.magnitude": "1.0"}, [0, 3]),
        ({"attack.magnitude": [1, 2]}, [0, 1, 3, 4]),
        ({"attack.magnitude": "0.1235", "topology": "star"}, [2]),
        ({"attack.magnitude": 0.123456789}, [2, 5]),
    ],
)
def test_cells_of_some_values(cells, where, numbers):
    """One value or several, as text or number, with the digits that tables show."""
    assert [cell.number for cell in select_cells(cells, where)] == numbers


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ({"topolgy": "star"}, "topolgy is not swept"),
        ({"topology": "cyclic"}, "topology has no value cyclic"),
        ({"attack.magnitude": ["1", "0.124"]}, "attack.magnitude has no value 0.124"),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(cells, where, words):
    """Keys and values."""
    with pytest.raises(FolderError, match=words) as refused:
        select_cells(cells, where)
    assert "(swept are topology: star, path; attack.magnitude: 1, 2.0, 0.123456789)" in str(refused.value)
