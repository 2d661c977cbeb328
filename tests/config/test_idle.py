"""Keys without effect are told once, and only where they act in no cell."""

import pytest
import yaml

import jaxnet
from jaxnet.config.idle import idle_keys
from jaxnet.view.text.check import check_text

TURNS = "topology: {kind: switching, networks: [complete, cyclic]"
REPLACED = "attack: {vehicles: [3], magnitude: 7}\nsweep: {attack: [bias, none]}"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", ""),
        ("channel: {extrapolate: jets}", "channel.extrapolate: no message is delayed"),
        ("channel: {extrapolate: jets, delay: 0.1}", ""),
        ("channel: {extrapolate: jets}\nsweep: {channel.delay: [0, 0.1]}", ""),
        (
            "sweep: {channel.extrapolate: [none, jets]}",
            "channel.extrapolate: no message is delayed",
        ),
        ("channel: {delay: 0.1, delay_of: message}", "channel.delay_of: no delay is drawn"),
        ("channel: {missing: hold}", "channel.missing: no message is lost"),
        ("channel: {noise: {outliers: 0.1}}", "channel.noise.outliers: there are no errors"),
        ("sensing: {outliers: 0.1, position: 1}", ""),
        ("sensing: {correlation: 1, dropout: 0.1}", "sensing.correlation: there are no errors"),
        ("attack: {announces: zero}", "attack.announces: no vehicle announces under this defence"),
        ("attack: {announces: zero}\ndefence: {score: announced}", ""),
        ("defence: {trusted: {1: [5, 2], 3: [4]}}", "defence.trusted.1: 1 does not hear 5"),
        ("search: {over: {attack.phase: [0, 1]}, until: 5}", "search.until: choices are run to"),
        ("search: {over: {attack.phase: [0, 1]}, until: 30}", ""),
        (f"{TURNS}, every: 0.07}}", "topology.every: it is no multiple of tick"),
        (f"{TURNS}, at: [0.1, 0.17]}}", "topology.at: it is no multiple of tick"),
        (
            "channel: {loss: {kind: jamming, period: 0.33, length: 0.1}}",
            "channel.loss.period: it is no multiple of tick",
        ),
        (
            REPLACED,
            "attack.vehicles: sweep.attack replaces the whole attack\n"
            "attack.magnitude: sweep.attack replaces the whole attack",
        ),
        ("vehicles: 4\nsweep: {attack: [bias, none]}", ""),
        ("defence: {theta: 2}\nsweep: {defence.theta: [0, 1]}", "defence.theta: replaces it"),
        (
            "navigator: none\nlaw: local\ndefence: none\n"
            "topology: {kind: complete, navigator_weight: 0.2}",
            "topology.navigator_weight: there is no navigator",
        ),
    ],
)
def test_what_changes_nothing_is_told(text, told):
    """By the key, in one list at the end of what `check` says."""
    study = jaxnet.load(yaml.safe_load(text) or {})
    wanted = dict(line.split(": ") for line in told.splitlines())
    found, said = idle_keys(study), check_text(study)
    assert found.keys() == wanted.keys()
    assert all(why in found[key] for key, why in wanted.items())
    assert said.count("keys without effect") == bool(wanted)
    assert all(said.count(f"\n  {key} ") == 1 for key in wanted)


def test_a_small_fleet_has_attacked_vehicles_of_its_own():
    """Of 2, 5, 8, 11 those that exist, or 1."""

    def attacked(study):
        return [cell.scenario.attack.targets() for cell in study.cells]

    study = jaxnet.load({"sweep": {"vehicles": [3, 12, 6]}})
    again = jaxnet.load(study, {"samples": 2})
    assert attacked(study) == attacked(again) == [[2], [2, 5, 8, 11], [2, 5]]
    assert attacked(jaxnet.load({"vehicles": 1, "topology": "star"})) == [[1]]
    assert jaxnet.load({"vehicles": 3}).config.attack.targets() == [2]
