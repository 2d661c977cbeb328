"""Names of keys and values: words, units and few digits; a config's own names come first."""

import copy
import pickle

import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.config.naming import (
    Key,
    label_notes,
    labels_title,
    quantity,
    value_alone,
    value_name,
)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("attack.frequency", "attack frequency [rad/s]"),
        ("attack.magnitude", "attack magnitude ā [m]"),
        ("attack.vehicles.random", "attacked vehicles"),
        ("channel.loss.probability", "loss probability"),
        ("channel", "channel"),
        ("gain.0", "gain k0"),
        ("tick", "tick [s]"),
        ("initial.speed", "initial speed [m/s]"),
        (Key("tick", "period"), "period [s]"),
        (Key("attack.magnitude", "strength"), "strength [m]"),
    ],
)
def test_keys_have_words_and_units(key, words):
    """From their fields; a name of the config's keeps the unit."""
    assert quantity(key) == words


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("attack.frequency", 0.3981071705534972, "attack frequency = 0.3981 rad/s"),
        ("defence", "w_msr", "W-MSR"),
        ("defence", "w_msr(F=2)", "W-MSR (F 2)"),
        ("defence", "none", "no defence"),
        ("topology", "my own graph", "my own graph"),
        ("topology", "random_regular(degree=4)", "random regular (degree 4)"),
        ("attack.vehicles", "[2, 5]", "attacked vehicles = 2, 5"),
        ("attack.vehicles", '{"random": 1}', "1 attacked, drawn"),
        ("attack.vehicles", '{"random": 4}', "4 attacked, drawn"),
        ("attack.vehicles.random", 2, "2 attacked, drawn"),
        (Key("attack.vehicles", "liars"), '{"random": 2}', "liars = 2 drawn"),
        ("initial.speed", '{"uniform": [0.2, 0.4]}', "initial speed = uniform 0.2 to 0.4 m/s"),
    ],
)
def test_values_have_no_json_and_few_digits(key, value, words):
    """Non-breaking spaces hold a number and its unit together."""
    assert value_name(key, value).replace("\N{NO-BREAK SPACE}", " ") == words


def test_a_number_of_vehicles_does_not_read_as_a_vehicle():
    """Cells of tables and entries of legends are short."""
    assert value_alone("attack.vehicles", '{"random": 1}') == "1 drawn"
    assert value_alone("attack.vehicles", "[1]") == "1"


@pytest.mark.parametrize(
    ("label", "kind", "told"),
    [
        ("geo. median", {"kind": "geometric_median"}, False),
        ("W-MSR F=2", {"kind": "w_msr", "F": 2}, False),
        ("W-MSR", {"kind": "w_msr", "F": 2}, True),
        ("W-MSR F=1", {"kind": "w_msr", "F": 12}, True),
        ("nearest 2", {"kind": "ms_norm", "F": 2}, True),
    ],
)
def test_a_label_that_says_all_has_no_note(label, kind, told):
    """Short forms of the kind's words are no news; a number is."""
    notes = label_notes({"defence": [kind | {"label": label}]}, [{"defence": label}])
    assert bool(notes) == told


def test_a_config_names_its_keys_and_changes_no_row():
    """Swept keys carry the name; the hash of the study stays; a key that is none is refused."""
    keys = {
        "sweep": {"attack.frequency": [0.5, 1.0]},
        "labels": {"attack.frequency": "carrier frequency"},
    }
    study = jaxnet.load(keys)
    assert labels_title(study.cells[0].labels).startswith("carrier frequency")
    (key,) = pickle.loads(pickle.dumps(copy.deepcopy(study.cells[1].labels)))
    assert key == "attack.frequency"
    assert key.name == "carrier frequency"
    with pytest.raises(ConfigError, match=r"labels.attack.frequncy: unknown key"):
        jaxnet.load(keys, {"labels": {"attack.frequncy": "x"}})
