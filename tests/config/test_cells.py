"""Cells of a sweep: what they share is validated once, and time grows with their number."""

import itertools
import sys

import pytest

import jaxnet
from jaxnet.config import naming
from jaxnet.config.cells import to_plain
from jaxnet.config.faults import scenario_faults
from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import SIGNAL_NUMBERS, but_signal
from jaxnet.kinds.registry import kind_names
from jaxnet.statistics.limits import valid_bounds
from jaxnet.theory.spread import scenario_gain
from jaxnet.view.text import check
from jaxnet.view.text.facts import facts

STUDY = {"vehicles": 4, "horizon": 2.0, "tail": 1.0, "engine": "exact", "attack": {"vehicles": [2]}}


def load(**sweep):
    """A study that sweeps dotted keys, given with _ for the dot."""
    return jaxnet.load(
        STUDY | {"sweep": {key.replace("_", ".", 1): each for key, each in sweep.items()}}
    )


def test_entries_of_lists_are_swept():
    """Of the gain, of a navigator's path and of attacked vehicles; the other entries stay."""
    cells = load(
        gain_0=[0.5, 1], **{"navigator_amplitude.1": [60, 70]}, **{"attack_vehicles.0": [1, 3]}
    ).cells
    assert [cell.scenario.gain for cell in cells[::4]] == [[0.5, 3.0, 3.0], [1.0, 3.0, 3.0]]
    assert [cell.scenario.navigator.amplitude for cell in cells[:4:2]] == [
        [100.0, 60.0],
        [100.0, 70.0],
    ]
    assert [cell.scenario.attack.vehicles for cell in cells[:2]] == [[1], [3]]
    assert naming.value_name("gain.0", 0.5).split() == ["gain", "k0", "=", "0.5"]
    assert naming.quantity("gain.0") == "gain k0"
    assert naming.quantity("navigator.amplitude.1") == "navigator amplitude 1 [m]"


def test_cells_are_the_studies_that_their_keys_make():
    """Each one loaded alone, without a sweep."""
    topologies, magnitudes = ["star", {"kind": "path"}, {"navigator_weight": 0.3}], [1, 2.5]
    study = load(
        topology=topologies, attack_magnitude=magnitudes, attack_phase=[0.5, {"uniform": [0, 1]}]
    )
    for cell in study.cells:
        topology, rest = divmod(cell.number, 4)
        attack = {"vehicles": [2], "magnitude": magnitudes[rest // 2]}
        attack["phase"] = [0.5, {"uniform": [0, 1]}][rest % 2]
        alone = jaxnet.load(STUDY | {"topology": topologies[topology], "attack": attack}).cells[0]
        assert to_plain(cell.scenario) == to_plain(alone.scenario)
        assert cell.scenario == alone.scenario


def test_a_swept_number_is_judged_as_one_that_is_given():
    """In the first cell and in a later one; a fault names its key, its value and its cell."""

    def told(**keys):
        with pytest.raises(jaxnet.ConfigError) as error:
            jaxnet.load(STUDY | keys)
        return [problem.message for problem in error.value.problems]

    (alone,) = told(attack={"vehicles": [2], "magnitude": -1})
    for listed in ([-1, 2], [2, -1]):
        where = f", in cell {listed.index(-1)} (attack.magnitude=-1)"
        assert told(sweep={"attack.magnitude": listed}) == [alone + where]
    given = {"vehicles": [2], "sybils": -1}
    wrong = told(attack=given, sweep={"attack.magnitude": [1, 2]})
    assert wrong == told(attack=given)


@pytest.mark.parametrize("kind", sorted({*kind_names("attack")} - {"none", "envelope", "freeform"}))
def test_no_number_of_a_signal_changes_what_is_found_once_for_all(kind):
    """Faults, gains, bounds and facts are those of each cell alone, where two cells share a key."""

    def found(scenario):
        gain = scenario_gain.__wrapped__(scenario)
        slopes = valid_bounds.__wrapped__(scenario) if gain else {}
        bounds = {name: bound.vehicles.tolist() for name, (bound, _) in slopes.items()}
        return [*scenario_faults(scenario)], repr(gain), bounds, facts(scenario, 0.0)

    for more in ({}, {"vehicles": [9]}, {"orders": [1]}):
        made = Scenario.model_validate(STUDY | {"attack": {"kind": kind} | more})
        named = [name for name in SIGNAL_NUMBERS if type(getattr(made.attack, name, 0)) is float]
        assert "magnitude" in named
        for name in named:
            other = made.with_values(attack=made.attack.with_values(**{name: 0.3}))
            assert but_signal(other) == but_signal(made)
            assert found(other) == found(made)


def test_whole_numbers_beyond_64_bits_are_told_as_decimals():
    """A column of a table holds no greater ones."""
    study = load(attack_magnitude=[1, 9223372036854775808])
    assert [cell.labels["attack.magnitude"] for cell in study.cells] == [1.0, 9223372036854775808.0]
    assert {type(cell.labels["attack.magnitude"]) for cell in study.cells} == {float}


def test_a_long_sweep_takes_calls_like_its_length():
    """Twenty cells more take twice the calls of ten more, to load and to be told."""

    def calls(count):
        seen = itertools.count()
        sys.setprofile(lambda *_: next(seen))
        try:
            told = check.check_text(load(attack_frequency={"linspace": [0.1, 1.1, count]}))
        finally:
            sys.setprofile(None)
        assert f"{count} cells" in told
        return next(seen)

    calls(10)
    few, some, many = map(calls, (10, 20, 40))
    assert many - some == pytest.approx(2 * (some - few), rel=0.05)
