"""What was run, by name: each row from the config that it tells of."""

import jaxnet
from jaxnet.view.page.setting import setting_rows


def rows(**keys):
    """The setting of a study with these keys."""
    return setting_rows(jaxnet.load({"name": "setting", **keys}))


def test_a_plain_study_is_told_by_names():
    """No raw name of a kind, and no row of what is not there."""
    assert rows(engine="exact") == {
        "vehicles": "12, two-wheeled",
        "navigator": "Lissajous curve",
        "network": "cyclic",
        "attack": "rotating",
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
    assert told["defence"] == "none, W-MSR"
    assert told["attack"] == "none, rotating"
    assert told["magnitude ā"] == "0, 3 m"
    assert told["attack frequency"] == "1, 2, 3, 4, 5, 6, 7, 8, … rad/s"
    assert told["attacked vehicles"] == "1, 2"
    assert told["attacked signals"] == "none, what drawn vehicles transmit"
    assert rows(attack={"vehicles": {"random": 1}})["attacked signals"] == (
        "what 1 drawn vehicle of each lane transmits"
    )


def test_noise_and_losses_have_their_numbers():
    """A loss of probability 0 is none."""
    loss = {"loss": {"kind": "bernoulli", "probability": 0.2}}
    told = rows(
        sensing={"position": 0.1}, channel=loss, sweep={"channel.loss.probability": [0, 0.2]}
    )
    assert told["sensor errors"] == "Gaussian, position = 0.1"
    assert told["lost messages"] == "none, Bernoulli"
    assert told["loss probability"] == "0, 0.2"
    assert rows(channel=loss)["lost messages"] == "Bernoulli, probability = 0.2"


def test_without_an_attack_there_is_no_magnitude():
    """Attack and defence are told even where there are none."""
    told = rows(attack="none", defence="none")
    assert told["attack"] == told["defence"] == "none"
    assert not {"magnitude ā", "attacked signals"} & set(told)


def test_what_is_heard_of_the_navigator_is_told_apart():
    """By the links that carry the attack; one vehicle hears, two hear."""
    links = {"kind": "rotating", "links": "navigator", "vehicles": [2]}
    assert (
        rows(topology="star", attack=links)["attacked signals"]
        == "what vehicle 2 hears of the navigator"
    )


def test_a_magnitude_that_scales_nothing_is_left_out():
    """A liar's path has sizes of its own; ā stands there if recovery compares with it."""
    assert "magnitude ā" not in rows(attack={"kind": "own_path"})
    assert rows(attack={"kind": "own_path"}, recovery={"tau": 0.1})["magnitude ā"] == "5 m"
    told = rows(
        attack={"kind": "spoof", "magnitude": [3, 0.5], "vehicles": {"at": [2], "sets": [[4]]}}
    )
    assert told["magnitude ā"] == "(3 m, 0.5 m/s)"
    assert told["attacked signals"].startswith(
        "what attacked vehicles (nobody until 2 s, then 4) transmit"
    )
