"""Cells chosen by the values of their swept keys."""

import pytest

from jaxnet.statistics.choice import select_cells
from jaxnet.store.folder import FolderError
from tests import systems

PLAIN = {"topology": ["star", "path"], "attack.magnitude": [1, 2.0, 0.123456789]}
NAMED = {  # values that tables show in other words than the config
    "attack.vehicles": [{"random": 1}, {"random": 4}],
    "defence": [
        "none",
        {"kind": "trusted_trim", "label": "trimming"},
        "w_msr",
        {"kind": "w_msr", "F": 2},
    ],
}


def chosen(sweep, where):
    """Numbers of the cells."""
    study = systems.study(attack={"kind": "rotating"}, sweep=sweep, vehicles=12)
    return [cell.number for cell in select_cells(study.cells, where)]


@pytest.mark.parametrize(
    ("where", "numbers"),
    [
        ({}, [0, 1, 2, 3, 4, 5]),
        ({"topology": ["path", "star"], "attack.magnitude": "1.0"}, [0, 3]),
        ({"attack.magnitude": [1, 2]}, [0, 1, 3, 4]),
        ({"attack.magnitude": "0.1235", "topology": "star"}, [2]),
        ({"attack.magnitude": 0.123456789}, [2, 5]),
        ({"attack magnitude": "2 m"}, [1, 4]),
        ({"attack magnitude ā": "ā = 2 m"}, [1, 4]),
        ({"attack magnitude ā [m]": 2, "topology": "star"}, [1]),
    ],
)
def test_cells_of_some_values(where, numbers):
    """One value or several, as text or number, with the digits that tables show."""
    assert chosen(PLAIN, where) == numbers


@pytest.mark.parametrize(
    ("where", "numbers"),
    [
        ({"attack.vehicles": "4 drawn"}, [4, 5, 6, 7]),
        ({"attack.vehicles": "4 attacked, drawn"}, [4, 5, 6, 7]),
        ({"attack.vehicles": "{random: 4}"}, [4, 5, 6, 7]),
        ({"attack.vehicles": '{"random": 4}'}, [4, 5, 6, 7]),
        ({"attack.vehicles": {"random": 4}}, [4, 5, 6, 7]),
        ({"defence": "no\N{NO-BREAK SPACE}defence"}, [0, 4]),
        ({"defence": "none"}, [0, 4]),
        ({"defence": "{kind: trusted_trim, label: trimming}"}, [1, 5]),
        ({"defence": ["W-MSR (F 2)"]}, [3, 7]),
        ({"defence": "{kind: w_msr}"}, [2, 6]),
        ({"defence": "w_msr(F=2)", "attack.vehicles": "1 drawn"}, [3]),
    ],
)
def test_a_value_may_be_written_as_a_table_or_the_config_has_it(where, numbers):
    """What a user copies from a table or from the study finds the cells."""
    assert chosen(NAMED, where) == numbers


@pytest.mark.parametrize(
    ("sweep", "where", "words", "listed"),
    [
        (PLAIN, {"topolgy": "star"}, "topolgy is not swept", "topology; attack.magnitude"),
        (PLAIN, {"topolgy": "star"}, "topolgy is not swept", "did you mean 'topology'?"),
        (PLAIN, {"magnitud": 1}, "magnitud is not swept", "did you mean 'attack.magnitude'?"),
        (NAMED, {"defence": "wmsr"}, "defence has no value wmsr", "it has 'none' (no defence), "),
        ({"defence": ["none", "w_msr"]}, {"defence": "wmsr"}, "wmsr", "did you mean 'w_msr'?"),
        (PLAIN, {"topology": "cyclic"}, "topology has no value cyclic", "it has star, path"),
        (PLAIN, {"attack.magnitude": ["1", "0.124"]}, "has no value 0.124", "it has 1, 2, 0.1235"),
        *(
            (NAMED, {"attack.vehicles": wrong}, "has no value", "'{\"random\": 1}' (1 drawn), ")
            for wrong in ("4", "[4]", "{random: 2}", "{", "{kind: star}")
        ),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(sweep, where, words, listed):
    """Each listed value is accepted as it stands there."""
    with pytest.raises(FolderError, match=words) as refused:
        chosen(sweep, where)
    assert listed in str(refused.value)
