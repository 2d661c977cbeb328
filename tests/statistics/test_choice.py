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
    assert "(swept are topology: star, path; attack.magnitude: 1, 2, 0.1235)" in str(refused.value)


@pytest.fixture
def named_cells():
    """Cells whose values tables show in other words than the config."""
    defences = [
        "none",
        {"kind": "trusted_trim", "label": "trimming"},
        "w_msr",
        {"kind": "w_msr", "F": 2},
    ]
    drawn = [{"random": 1}, {"random": 4}]
    sweep = {"attack.vehicles": drawn, "defence": defences}
    return systems.study(attack={"kind": "rotating"}, sweep=sweep, vehicles=12).cells


@pytest.mark.parametrize(
    ("where", "numbers"),
    [
        ({"attack.vehicles": "4 drawn"}, [4, 5, 6, 7]),
        ({"attack.vehicles": "4 attacked vehicles drawn at random"}, [4, 5, 6, 7]),
        ({"attack.vehicles": "{random: 4}"}, [4, 5, 6, 7]),
        ({"attack.vehicles": '{"random": 4}'}, [4, 5, 6, 7]),
        ({"attack.vehicles": {"random": 4}}, [4, 5, 6, 7]),
        ({"defence": "no defence"}, [0, 4]),
        ({"defence": "no\N{NO-BREAK SPACE}defence"}, [0, 4]),
        ({"defence": "none"}, [0, 4]),
        ({"defence": "trimming"}, [1, 5]),
        ({"defence": "{kind: trusted_trim, label: trimming}"}, [1, 5]),
        ({"defence": ["W-MSR (F 2)"]}, [3, 7]),
        ({"defence": "{kind: w_msr, F: 2}"}, [3, 7]),
        ({"defence": "{kind: w_msr}"}, [2, 6]),
        ({"defence": "w_msr(F=2)", "attack.vehicles": "1 drawn"}, [3]),
    ],
)
def test_a_value_may_be_written_as_a_table_or_the_config_has_it(named_cells, where, numbers):
    """What a user copies from a table or from the study finds the cells."""
    assert [cell.number for cell in select_cells(named_cells, where)] == numbers


@pytest.mark.parametrize("wrong", ["4", "[4]", "{random: 2}", "{", "{kind: star}"])
def test_the_values_of_a_refusal_are_those_of_tables(named_cells, wrong):
    """Each listed value is accepted as it stands there."""
    with pytest.raises(FolderError, match="has no value") as refused:
        select_cells(named_cells, {"attack.vehicles": wrong})
    assert (
        "(swept are attack.vehicles: 1 drawn, 4 drawn; defence: no defence, trimming, W-MSR"
        in str(refused.value)
    )
