"""What was run, by name: each row from the config that it tells of."""

import pytest

import jaxnet
from jaxnet.config.keys import Config, Scenario
from jaxnet.view.page import setting
from jaxnet.view.page.setting import setting_rows


def rows(**keys):
    """The setting of a study with these keys."""
    return setting_rows(jaxnet.load({"name": "setting", **keys}))


def test_a_plain_study_is_told_by_names():
    """No raw name of a kind, and no row of what is not there."""
    assert rows(engine="exact") == {
        "vehicles": "12, two-wheeled",
        "topology": "cyclic",
        "navigator": "Lissajous curve, frequency = 0.2, 0.4 rad/s, phase = 0, 0 rad",
        "initial position": "uniform -200 to 200 m",
        "gain": "1, 3, 3",
        "attack": "rotating, frequency = 0.7 rad/s, phase = uniform 0 to 6.283 rad",
        "attacked signals": "what vehicles 2, 5, 8, 11 transmit",
        "magnitude ā": "5 m",
        "defence": "trusted trimming, ϑ = 1",
        "time": "30 s; the tail is the last 5 s",
        "engine": "exact, ticks of 0.05 s",
    }


def test_each_swept_key_has_its_values_and_unit():
    """Once, in the row of its kind or in its own; of many values the first eight."""
    sweep = {
        "defence": ["none", {"kind": "w_msr", "F": 1}],
        "attack.magnitude": [0, 3],
        "attack.frequency": {"linspace": [1, 9, 9]},
        "attack.vehicles.random": [1, 2],
    }
    told = rows(attack={"vehicles": {"random": 1}}, sweep=sweep)
    assert told["defence"] == "none; W-MSR, F = 1"
    assert told["attack"] == "rotating, phase = uniform 0 to 6.283 rad"
    assert told["magnitude ā"] == "0, 3 m"
    assert told["attack frequency"] == "1, 2, 3, 4, 5, 6, 7, 8, … rad/s"
    assert told["attacked vehicles"] == "1, 2"
    assert told["attacked signals"] == "what drawn vehicles transmit"
    assert rows(attack={"vehicles": {"random": 1}})["attacked signals"] == (
        "what 1 vehicle, drawn for each lane, transmits"
    )


LOSS = {"loss": {"kind": "bernoulli", "probability": 0.2}}
SWEPT_LOSS = {"channel.loss.probability": [0, 0.2]}
LINKS = {"kind": "rotating", "links": "navigator", "vehicles": [2]}
CHANGING = {"kind": "spoof", "magnitude": [3, 0.5], "vehicles": {"at": [2], "sets": [[4]]}}
TOLD = [
    ({"sensing": {"position": 0.1}}, "sensor errors", "Gaussian, position = 0.1 m"),
    ({"channel": LOSS}, "lost messages", "Bernoulli, probability = 0.2"),
    ({"channel": LOSS, "sweep": SWEPT_LOSS}, "lost messages", "Bernoulli"),
    ({"channel": LOSS, "sweep": SWEPT_LOSS}, "loss probability", "0, 0.2"),
    ({"attack": "bias"}, "attack", "bias, direction = 0 rad"),
    ({"formation": {"kind": "line", "spacing": 2.0}}, "initial position",
     "uniform -200 to 200 m, and the place in the formation added"),
    ({"topology": {"kind": "lattice", "neighbours": 6, "label": "six neighbours"}}, "topology",
     "six neighbours (lattice, neighbours = 6)"),
    ({"topology": "lattice"}, "topology", "lattice, neighbours = 4"),  # defaults of sizes
    ({"topology": "erdos_renyi"}, "topology", "Erdős–Rényi, probability = 0.3"),
    ({"topology": {"kind": "small_world", "label": "few rewired"}}, "topology",
     "few rewired (small world, neighbours = 4, rewired = 0.1)"),
    ({"defence": {"kind": "w_msr", "F": 1, "label": "W-MSR F=1"}}, "defence", "W-MSR F=1"),
    ({"topology": {"kind": "lattice", "navigator": [1, 4], "label": "lattice, 2 leaders"}},
     "topology", "lattice, 2 leaders (navigator = 1, 4, neighbours = 4)"),
    ({"detector": "chi_squared", "sensing": {"position": 0.1}, "metrics": ["alarms"]}, "metrics",
     "share of attacked messages that raise an alarm,"
     " share of honest messages that raise an alarm"),
    ({"attack": "none"}, "attack", "none"),  # told even where there is none
    ({"defence": "none"}, "defence", "none"),
    ({"attack": "none"}, "magnitude ā", None),
    ({"attack": "none"}, "attacked signals", None),
    ({"topology": "star", "attack": LINKS}, "attacked signals",
     "what vehicle 2 hears of the navigator"),
    ({"attack": {"kind": "own_path"}}, "magnitude ā", None),  # a path has sizes of its own
    ({"attack": {"kind": "own_path"}, "recovery": {"tau": 0.1}}, "magnitude ā", "5 m"),
    ({"vehicles": 2, "topology": "path", "initial": {"position": [[0, 1], [2.5, -1]]}},
     "initial position", "(0, 1), (2.5, -1) m"),
    ({"attack": CHANGING}, "magnitude ā", "(3 m, 0.5 m/s)"),
    ({"attack": CHANGING}, "attacked signals", "what attacked vehicles (nobody until 2 s, then 4)"
     " transmit (derivatives falsified each on its own)"),
]  # fmt: skip


OTHER = {  # another value of every key that has a row of its own
    "topology": "star",
    "navigator": {"kind": "lissajous", "label": "eight"},
    "initial.position": {"uniform": [-5.0, 5.0]},
    "initial.heading": 0.0,
    "initial.speed": 1.0,
    "gain": [6, 11, 6],
    "law": "linearised",
    "formation": {"kind": "line", "spacing": 2.0},
    "filter": {"kind": "barrier", "distance": 0.2},
    "attack": "bias",
    "defence": "w_msr",
    "sensing": {"velocity": 0.1},
    "channel.loss": {"kind": "bernoulli", "probability": 0.2},
    "channel.missing": "hold",
    "channel.noise": {"position": 0.1},
    "channel.quantisation": 0.01,
    "channel.delay": 0.1,
    "channel.delay_of": "message",
    "channel.own_delay": True,
    "channel.extrapolate": "jets",
    "detector": {"kind": "chi_squared"},
    "output_step": 0.2,
    "metrics": ["min_separation"],
    "draws": "sobol",
    "recovery": {"tau": 0.1},
    "search": {"over": {"attack.frequency": [0.1, 1.0]}},
    "save": {"errors": True},
}
NEEDED = {  # beside these keys
    "detector": {"sensing": {"position": 0.1}},
    "filter": {"vehicle": "robotarium", "engine": "sampled", "law": "local", "gain": [1]},
}
SAID = {
    "filter": ("filter", "barrier, form = joint, distance = 0.2 m"),
    "initial.position": ("initial position", "uniform -5 to 5 m"),
    "gain": ("gain", "6, 11, 6"),
    "channel.missing": ("in place of lost messages", "hold"),
    "channel.quantisation": ("rounding of messages", "0.01 m"),
    "channel.delay": ("delay of messages", "0.1 s"),
    "output_step": ("output step", "0.2 s"),
    "save": ("save", "errors"),
    "search": ("search", "over = attack.frequency 0.1, 1"),
}


def test_every_key_of_the_schema_is_told_where_it_is_not_at_its_default():
    """A key that somebody adds to the models has a row, or stands among those of other rows."""
    known = {
        *dict(setting.keys_of_cells()),
        *(set(Config.model_fields) - set(Scenario.model_fields)),
    }
    assert known - {*setting.OWN_ROWS} == set(OTHER)
    plain = rows(samples=16)
    for key, value in OTHER.items():
        root, _, inside = key.partition(".")
        given = {root: {inside: value} if inside else value}
        given |= NEEDED.get(key, {})
        told = rows(samples=16, **given)
        changed = {name: words for name, words in told.items() if plain.get(name) != words}
        assert changed, key
        name, words = SAID.get(key, next(iter(changed.items())))
        assert changed[name] == words, key


@pytest.mark.parametrize(("keys", "name", "words"), TOLD)
def test_a_row_is_told_where_there_is_something(keys, name, words):
    """None: there is no such row."""
    assert rows(**keys).get(name) == words
