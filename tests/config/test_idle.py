"""Keys without effect are told once, and only where they act in no cell."""

import pytest

import jaxnet
from jaxnet.config.idle import idle_keys
from jaxnet.view.text.check import check_text

TURNS = {"kind": "switching", "networks": ["complete", "cyclic"]}
PULSES = {"kind": "jamming", "period": 0.33, "length": 0.1}
OVER = {"over": {"attack.phase": [0, 1]}}
LEADERLESS = {"navigator": "none", "law": "local", "defence": "none"}


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"channel": {"extrapolate": "jets"}}, {"channel.extrapolate": "no word is late"}),
        ({"channel": {"extrapolate": "jets", "delay": 0.1}}, {}),
        ({"channel": {"extrapolate": "jets"}, "sweep": {"channel.delay": [0, 0.1]}}, {}),
        (
            {"sweep": {"channel.extrapolate": ["none", "jets"]}},
            {"channel.extrapolate": "no word is late"},
        ),
        (
            {"channel": {"delay": 0.1, "delay_of": "message"}},
            {"channel.delay_of": "no delay is drawn"},
        ),
        ({"channel": {"missing": "hold"}}, {"channel.missing": "no message is lost"}),
        (
            {"channel": {"noise": {"outliers": 0.1}}},
            {"channel.noise.outliers": "there are no errors"},
        ),
        ({"sensing": {"outliers": 0.1, "position": 1}}, {}),
        (
            {"sensing": {"correlation": 1, "dropout": 0.1}},
            {"sensing.correlation": "there are no errors"},
        ),
        (
            {"attack": {"announces": "zero"}},
            {"attack.announces": "the defence has nobody announce"},
        ),
        ({"attack": {"announces": "zero"}, "defence": {"score": "announced"}}, {}),
        (
            {"defence": {"trusted": {1: [5, 2], 3: [4]}}},
            {"defence.trusted.1": "1 does not hear 5"},
        ),
        (
            {"search": OVER | {"until": 5}},
            {"search.until": "choices are run to the horizon of 30 s"},
        ),
        ({"search": OVER | {"until": 30}}, {}),
        ({"topology": TURNS | {"every": 0.07}}, {"topology.every": "it is no multiple of tick"}),
        ({"topology": TURNS | {"at": [0.1, 0.17]}}, {"topology.at": "it is no multiple of tick"}),
        ({"channel": {"loss": PULSES}}, {"channel.loss.period": "it is no multiple of tick"}),
        (
            {"attack": {"vehicles": [3], "magnitude": 7}, "sweep": {"attack": ["bias", "none"]}},
            {
                "attack.vehicles": "sweep.attack replaces the whole attack",
                "attack.magnitude": "sweep.attack replaces the whole attack",
            },
        ),
        ({"vehicles": 4, "sweep": {"attack": ["bias", "none"]}}, {}),
        (
            {"defence": {"theta": 2}, "sweep": {"defence.theta": [0, 1]}},
            {"defence.theta": "replaces it"},
        ),
        (
            LEADERLESS | {"topology": {"kind": "complete", "navigator_weight": 0.2}},
            {"topology.navigator_weight": "there is no navigator"},
        ),
        ({}, {}),
    ],
)
def test_what_changes_nothing_is_told(keys, told):
    """By the key, in one list at the end of what `check` says."""
    study = jaxnet.load(keys)
    found = idle_keys(study)
    assert found.keys() == told.keys()
    for key, why in told.items():
        assert why in found[key]
    text = check_text(study)
    assert text.count("keys without effect") == bool(told)
    assert all(text.count(f"\n  {key} ") == 1 for key in told)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        (
            {"attack": {"vehicles": [99]}, "sweep": {"attack": ["bias"]}},
            "vehicles are 1 to 12 (got 99)",
        ),
        ({"attack": {"vehicles": [99]}, "sweep": {"attack.vehicles": [[1]]}}, "1 to 12 (got 99)"),
        ({"defence": {"trusted": {77: [1]}}, "sweep": {"defence": ["none"]}}, "1 to 12 (got 77)"),
        ({"vehicles": 3, "attack": {"vehicles": [2, 5, 8, 11]}}, "1 to 3 (got 5, 8, 11)"),
    ],
)
def test_nonsense_in_what_is_replaced_is_refused(keys, says):
    """As where nothing replaces it; and what a user wrote is never adapted."""
    with pytest.raises(jaxnet.ConfigError) as refused:
        jaxnet.load(keys)
    assert says in str(refused.value)


def test_a_small_fleet_has_attacked_vehicles_of_its_own():
    """Of 2, 5, 8, 11 those that exist, or 1."""

    def attacked(study):
        return [cell.scenario.attack.targets() for cell in study.cells]

    study = jaxnet.load({"sweep": {"vehicles": [3, 12, 6]}})
    assert (
        attacked(study)
        == attacked(jaxnet.load(study, {"samples": 2}))
        == [[2], [2, 5, 8, 11], [2, 5]]
    )
    assert attacked(jaxnet.load({"vehicles": 1, "topology": "star"})) == [[1]]
    assert jaxnet.load({"vehicles": 3}).config.attack.targets() == [2]
