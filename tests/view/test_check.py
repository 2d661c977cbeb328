"""What `check` says: facts of cells, and by which swept keys they differ."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from jaxnet.cli import main
from jaxnet.config.naming import boxes_of
from jaxnet.config.scenario import attacked_draws, safe_in, safe_in_all, situation_of
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model.wording import ranges
from jaxnet.statistics import limits
from jaxnet.theory import noise, tolerance
from jaxnet.theory.case import Case
from jaxnet.theory.integer import RobustnessBracket
from jaxnet.theory.spread import scenario_gain
from jaxnet.view.text import check
from jaxnet.view.text.facts import alone_words, facts
from tests import systems


def known(seconds=0.0, **keys):
    """Facts of a study with one cell."""
    (cell,) = systems.study(**keys).cells
    return facts(cell.scenario, seconds)


def one_line(text):
    return " ".join(text.split())


PLAIN = {"attack": "none", "defence": "none"}
COMPLETE = {"kind": "random_regular", "degree": 6}
DROPPED = PLAIN | {"vehicles": 4, "defence": {"kind": "w_msr", "F": 1, "trusted": {3: [2]}}}
DROPPED |= {"topology": {"kind": "edges", "edges": [[i + 1, i, 1.0] for i in range(4)]}}
LATTICE = {"vehicles": 8, "topology": {"kind": "lattice", "neighbours": 4}, "engine": "exact"}
ANNOUNCED = {"kind": "trusted_trim", "score": "announced"}
CUT_OFF = {"vehicles": 4, "attack": {"kind": "bias", "vehicles": [4]}, "engine": "exact"}
CUT_OFF |= {"defence": ANNOUNCED | {"theta": {2: 1, 3: 1}, "trusted": {}}}
LINKS = [(1, 0), (2, 1), (2, 3), (3, 1), (3, 2), (4, 0)]  # 2 and 3 drop 1 and believe each other
CUT_OFF |= {"topology": {"kind": "edges", "edges": [[*link, 1.0] for link in LINKS]}}
ROUNDS = {"law": "rounds", "output_step": 0.2}
WHOLE_TICKS = {"loss": {"kind": "bernoulli", "probability": 0.5, "of": "all"}}
ALONE = PLAIN | {"defence": "w_msr"}
TESTED = {
    "vehicles": 6,
    "engine": "exact",
    "defence": "none",
    "channel": {"noise": {"position": 0.1}},
    "detector": "chi_squared",
    "attack": {"kind": "bias", "magnitude": 0.2, "vehicles": [1]},
}


CUTTING = TESTED | {"detector": {"kind": "cusum", "drift": 4, "threshold": 8, "cuts": "link"}}
NOISY = {
    "channel": {"noise": {"position": 0.1}},
    "detector": {"kind": "cusum", "drift": 4, "threshold": 9},
}
ONE_WAY = {"kind": "cusum", "drift": 0.5, "threshold": 5, "direction": [1, 0]}
FILTERED = {"detector": {"kind": "chi_squared", "predicts": "kalman"}}
ALONG = TESTED | {"detector": ONE_WAY}


def losing(loss, **channel):
    return {"defence": "trusted_trim", "channel": {"loss": loss, **channel}}


def of_drawn(number, **keys):
    attack = {"kind": "rotating", "vehicles": {"random": number}}
    return LATTICE | {"attack": attack, "defence": "none"} | keys


FACTS = [
    # networks: norms are those of the paper; a path loses all behind its attacked vehicles
    ({"topology": "star"}, "‖L⁻¹‖₂", "1; ‖E‖ ≤ ‖L⁻¹‖₂ ‖d‖ under a steady"),
    ({"topology": "cyclic"}, "‖L⁻¹‖₂", "10; ‖E‖ ≤ ‖L⁻¹‖₂ ‖d‖ under a steady"),
    ({"topology": "path"}, "‖L⁻¹‖₂", "7.963; ‖E‖"),
    ({"topology": "star"}, "attack", "rotating on 2, 5, 8, 11 in what they hear of the navigator"),
    ({"topology": "cyclic"}, "attack", "in what they transmit; the attack is on 8 links"),
    ({"topology": "star"}, "Assumption 1", "no honest path from the navigator to 2, 5, 8, 11;"),
    ({"topology": "path"}, "Assumption 1", "to 3-12; 3, 6, 9, 12 hear no honest source"),
    ({"topology": "cyclic"}, "Assumption 1", "holds: an honest path"),
    ({}, "navigator", "never slower than 13.23 m/s"),
    # theorems of LeBlanc et al. on the vehicles alone
    (ALONE | {"vehicles": 7, "topology": COMPLETE}, "robustness", "r = 4, s = 4; W-MSR bears F"),
    (ALONE, "robustness", "r = 1, s = 1; W-MSR bears F attackers"),
    (
        ALONE,
        "robustness",
        "(glossary.md); with one navigator no graph is more than 1-robust",
    ),
    (ALONE | {"topology": "star"}, "robustness", "r = 0, s = 0; W-MSR"),
    (ALONE | {"vehicles": 40}, "robustness", "r = 1, s = 1; W-MSR"),
    # defences
    ({"defence": "trusted_trim"}, "guarantee", "none: known attacks pass"),
    ({"defence": ANNOUNCED}, "guarantee", "announced: by majority"),
    ({"defence": "trust"}, "guarantee", "none: whoever stays within the radius"),
    ({"defence": {"kind": "trust", "observation": "random"}}, "guarantee", "by earned trust"),
    (CUT_OFF, "cut off", "2, 3 may be cut off from the navigator, depending on values"),
    # a verdict that is sure has no line that doubts it: W-MSR, F = 1, trusts 2 at 3 alone
    (DROPPED, "cut off", "2-4 drop all sources (F too great), or hear only vehicles that do"),
    # laws: growths of an independent program
    (ROUNDS, "law", "UNSTABLE, deviations times 1.0458 at each tick of 0.05 s; 2 rounds are"),
    (ROUNDS, "law", "; stability is known only while all sources are retained"),
    (ROUNDS, "safe", "nothing is proved; since the law (rounds) is not solved at every"),
    (
        ROUNDS | {"tick": 0.2},
        "law",
        "4 rounds are the least that is stable, and every number from 6",
    ),
    (
        {"law": {"kind": "rounds", "rounds": 2}, "defence": "none"},
        "law",
        "stable, deviations times 0.9667",
    ),
    (
        {"law": "rounds", "vehicles": 1001, "defence": "none"},
        "law",
        "nothing is known of its stability: there are more than 1,000 vehicles",
    ),
    (
        {"law": "rounds", "tick": 0.75, "output_step": 0.75, "tail": 4.5},
        "law",
        "no number of rounds is stable",
    ),
    # lost and late messages: two independent programs for the ring, i τ for the path
    (
        PLAIN | {"law": "rounds", "tick": 0.02, "channel": WHOLE_TICKS},
        "channel",
        "mean square, deviations times 1.0089 at each tick; stable up to a loss of 0.4131",
    ),
    (PLAIN | {"channel": {"delay": 0.1}}, "delay", "vehicles end late by 1 s"),
    (
        PLAIN | {"channel": {"delay": 0.1}, "topology": "path"},
        "delay",
        "vehicles end late by 0.1 to 1.2 s",
    ),
    (
        PLAIN | {"tick": 0.02, "channel": {"delay": 0.04, "extrapolate": "jerk"}},
        "delay",
        "UNSTABLE: the delay must be below 0.0363729 s",
    ),
    (
        PLAIN | {"law": "rounds", "tick": 0.02, "channel": {"delay": 0.06}},
        "delay",
        "no bound on errors holds; stable, deviations times 0.988730 at each tick of 0.02 s",
    ),
    # alarms: 1 / 0.01, 1 / (1 - 0.99¹⁶), 1 / 0.203948, √9.210340 σ; s = 0.5363 / 0.3035
    (
        TESTED,
        "alarms",
        "link comes after 100 ticks = 5 s in the mean; a false alarm about any of 16 honest",
    ),
    (
        TESTED,
        "alarms",
        "after 6.732 ticks = 0.3366 s in the mean; an alarm about a steady lie of ā comes",
    ),
    (
        TESTED,
        "unseen",
        "a liar that knows the errors may be 0.3035 m off at each tick and raise no alarm; lies",
    ),
    (TESTED | {"defence": "w_msr"}, "unseen", "and raise no alarm"),
    (
        TESTED | {"detector": {"kind": "chi_squared", "window": 10}},
        "unseen",
        "m off at each tick and raise no alarm;",  # the window sees any greater one
    ),
    (CUTTING, "alarms", "a false alarm about one link comes after 245 ticks = 12.25 s in the mean"),
    (
        CUTTING,
        "unseen",
        "0.2 m off at each tick, after one tick of 0.3464 m, and raise no alarm;",
    ),
    (CUTTING, "unseen", "; such lies about positions move no vehicle by more than"),
    (
        CUTTING,
        "isolation",
        "; no vehicle is cut off from the navigator by fewer than 2 wrong cuts; 2 wrong cuts may",
    ),
    # χ²₂ at 1 %, √9.210340 σ; a start of ‖E‖ ≤ 282.8 m, ‖Ė‖ ≤ 28.7 m/s, ‖Ë‖ ≤ 8.9 m/s²
    (
        TESTED,
        "detector",
        "squared residual over 9.21 variances, a position 0.3035 m off; starts raise",
    ),
    (
        ALONG,
        "detector",
        "by a sum of the residual along the direction less 0.5 a message over 5 stand",
    ),
    (CUTTING, "guarantee", "vehicles believe every source; what alarms cut is not heard"),
    (TESTED | {"detector": "distance"}, "detector", "a position over 1 m from the expected one"),
    (
        CUTTING
        | {"navigator": "none", "vehicle": "single_integrator", "gain": [1], "law": "local"},
        "detector",
        "if cuts divide the fleet, each part agrees on a place of its own: no lane fails",
    ),
    (
        TESTED | FILTERED,
        "detector",
        "; after a start the derivative that no message carries may be ",
    ),
    (TESTED, "detector", "χ² test against the true motion of the source (an ideal observer)"),
    (TESTED | FILTERED, "detector", "only while the derivative that is not told stays within"),
    (TESTED | FILTERED, "detector", "not known: messages are compared with what kalman expects"),
    (
        CUTTING | {"topology": "path"},
        "isolation",
        "reaches 1; a lane ends as disconnected once any of 2-6 is cut off; a defence with",
    ),
    (
        ALONG,
        "alarms",
        "ticks = 46.54 s in the mean; a false alarm about any of 16 honest links comes after",
    ),
    (ALONG, "alarms", "a steady lie of ā along the direction comes after 4.009 ticks"),
    # attacked vehicles that each lane draws: a majority bears one liar, some listener hears two
    (
        of_drawn(1, defence=ANNOUNCED),
        "safe",
        "every vehicle by majority, whichever vehicles are drawn",
    ),
    (of_drawn(2, defence=ANNOUNCED), "safe", "no vehicle is proved safe in every lane"),
    (
        of_drawn(2, defence=ANNOUNCED),
        "trimming",
        "1-8 hear more than ϑ attacked sources, or trust one",
    ),
    (of_drawn(2, defence="w_msr"), "defence", "F = 1, but a vehicle may hear 2 attacked sources;"),
    (of_drawn(2, defence={"kind": "w_msr", "F": 2}), "defence", "W-MSR, F = 2; W-MSR may drop"),
    ({"defence": {"kind": "w_msr", "drop_trusted": True}}, "defence", "may drop any source, so"),
    ({"defence": "reputation"}, "defence", "reputation may drop any source, so there is no bound"),
    ({"defence": "clipping"}, "defence", "clipping drops no source but changes weights, so there"),
    ({"defence": "w_msr", "topology": "star"}, "defence", "W-MSR changes no weight in this"),
    # 0.9³ on a ring; of a channel that is bad for 1/6 of the time (5/6)³
    (losing({"kind": "bernoulli", "probability": 0.1}), "trimming", "holds; in up to 27.1 % of"),
    (losing({"kind": "gilbert_elliott", "fail": 0.1, "recover": 0.5}), "trimming", "up to 42.1 %"),
    (
        losing({"kind": "range", "radius": 9}),
        "trimming",
        "at some ticks a vehicle may lack messages and",
    ),
    (
        of_drawn(1, defence="w_msr"),
        "defence",
        "F = 1; W-MSR may drop any source that is not trusted, so there is no bound",
    ),
    (of_drawn(7, vehicles=24), "safe", "more than 1,000 sets of vehicles may be drawn"),
    (of_drawn(7, vehicles=24), "attack", "on 7 vehicles drawn for each lane"),
    (
        of_drawn(1, vehicles=4, topology="path"),
        "Assumption 1",
        "broken: no honest path from the navigator to 2-4",
    ),
    # drawn weights and gains
    ({"topology": {"navigator_weight": {"uniform": [0.05, 0.15]}}}, "weights", "their medians"),
    ({"gain": [1, 3, {"uniform": [3, 4]}]}, "gain", "stable whatever is drawn"),
]


def test_without_an_attack_every_link_is_honest():
    """With ā = 0: on a ring of twelve, 36 links, of which a liar of ā > 0 makes two dishonest."""
    told = {
        size: known(0.0, attack={"kind": "bias", "vehicles": [2], "magnitude": size}, **NOISY)
        for size in (0, 1)
    }
    assert "any of 36 honest links" in told[0]["alarms"]
    assert "any of 34 honest links" in told[1]["alarms"]
    assert ["lie of ā" in told[size]["alarms"] for size in (0, 1)] == [False, True]


@pytest.mark.parametrize(("keys", "fact", "told"), FACTS)
def test_facts(keys, fact, told):
    searched = 2.0 if fact == "robustness" else 0.0
    assert told in known(searched, **keys)[fact]


@pytest.mark.parametrize("keys", [{"of": "all"}, {"probability": 0.0}])
@pytest.mark.parametrize("missing", ["drop", "hold"])
def test_messages_that_are_lost_together_or_replaced_keep_nobody_from_trimming(keys, missing):
    loss = {"kind": "bernoulli", "probability": 0.1} | (keys if missing == "drop" else {})
    assert known(**losing(loss, missing=missing))["trimming"].endswith("Assumption 2 holds")


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"sensing": {"position": 0.1}}, "sensors err"),
        ({"channel": {"noise": {"position": 0.1}}}, "messages are not exact (noise or rounding)"),
        ({"channel": {"quantisation": 0.1}}, "messages are not exact (noise or rounding)"),
        ({"channel": {"loss": {"kind": "bernoulli", "probability": 0.1}}}, "messages are lost"),
        ({"channel": {"delay": 0.1}}, "messages are late"),
        (
            {"topology": {"kind": "switching", "networks": ["cyclic", "path"], "every": 3.0}},
            "networks take turns",
        ),
        ({"law": "rounds"}, "the law (rounds) is not solved at every instant"),
        ({"law": "linearised", "engine": "nonlinear"}, "the law (linearised) is not"),
        ({"gain": {"vehicles": [[1, 3, 3], [8, 12, 6]] * 6}}, "gains differ by vehicle"),
    ],
)
def test_a_broken_premise_of_safety_is_named(keys, why):
    """Once for each of several, and no safe vehicle nor decay beside it."""
    found = known(**keys)
    assert found["safe"].startswith("nothing is proved; since ")
    assert why in found["safe"]
    assert not {"decay", "proof ends", "theorem 3"} & {*found}


@pytest.mark.parametrize(("topology", "ends"), [("cyclic", False), ("path", True)])
def test_where_nothing_is_proved_no_proof_ends(topology, ends):
    """On a ring everybody hears the liar in the end, on a path nobody before it does."""
    attack = {"kind": "rotating", "vehicles": [5]}
    found = known(2.0, topology=topology, attack=attack, defence="none")
    assert ("proof ends" in found) is ends
    assert (found["safe"] == "no vehicle is proved safe") is not ends


TRUSTED = {"defence": "trusted_only", "recovery": {"tau": 0.01}, "name": "short"}
BY_SIZE = TRUSTED | {"sweep": {"attack.magnitude": [0.1, 1, 10, 100]}}


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        # e⁻ᵗ ((1 + t + t²/2) 282.8 m + (t + t²) 28.7 m/s) at 17.9 s; tests/theory/test_start.py
        (
            TRUSTED | {"attack.magnitude": 0.1},
            "time the effect of the start is below 0.001 m after 17.9 s; the",
        ),
        (TRUSTED, "the tail begins at 25 s"),
        (
            TRUSTED | {"defence": "trusted_trim"},
            "s; under attack the defence decides when; the tail",
        ),
        (TRUSTED | {"attack": "none"}, "the effect of the start is below 0.283 m after 11.4 s"),
        (
            BY_SIZE,
            "[100] the effect of the start is below 1 m after 9.91 s",
        ),
        (
            BY_SIZE | {"horizon": 15.0},
            "WARNING: the tail begins before the effect of the start ends (`horizon: 23` is"
            " enough): all but ā = 100 m.",
        ),
        (
            {"metrics": [{"kind": "settling_time", "below": 0.1}]},
            "the effect of the start is below 0.1 m after",
        ),
        ({"metrics": ["settling_time"]}, "the effect of the start is below 2.83 m after"),
        (
            {"channel": {"delay": 0.1}},
            "the end of the effect of the start is not known: messages are late",
        ),
        ({"gain": [1, 3, {"uniform": [3, 4]}]}, "gains are drawn or apart"),
        ({"initial": {"position": {"normal": [0, 9]}}}, "or a start has no bound"),
    ],
)
def test_it_is_told_when_a_start_has_died_away(keys, told):
    size = keys.get("attack.magnitude")
    keys = {key: each for key, each in keys.items() if key != "attack.magnitude"}
    study = systems.study(**keys | ({"attack": {"magnitude": size}} if size else {}))
    text = one_line(check.check_text(study))
    assert told in text
    assert ("WARNING" in text) is ("WARNING" in told)


@pytest.mark.parametrize(
    ("r", "total", "told"),
    [
        ((3, 6), (-1, 2), "r = 3 to 6, s = 0 to 3; W-MSR bears F"),
        ((3, 3), (1, 2), "r = 3, s = 2 to 3; "),
        ((0, 0), (-1, -1), "r = 0, s = 0; "),
    ],
)
def test_a_search_that_ends_early_tells_bounds(r, total, told):
    found = tolerance.VehiclesAlone(None, RobustnessBracket(*r), RobustnessBracket(*total))
    (cell,) = systems.study(defence="w_msr").cells
    assert alone_words(found, cell.scenario).startswith(told)


def test_programs_of_many_networks_share_their_time(monkeypatch):
    """None runs for 16 vehicles or fewer, nor for more than twenty networks."""
    asked, found = [], (RobustnessBracket(2, 3), RobustnessBracket(0, 2))
    monkeypatch.setattr(tolerance, "brackets", lambda n, heard, s: (asked.append(s), found)[1])
    for seeds in (1, 4, 21):
        topology = {"kind": "random_regular", "degree": 4}
        sweep = {"topology.seed": [*range(seeds)]}
        check.networks(systems.study(vehicles=20, topology=topology, sweep=sweep, **ALONE).cells)
    check.networks(systems.study(vehicles=16, **ALONE).cells)
    assert asked == [2.0] + [0.5] * 4


def test_a_frequency_tells_networks_apart_where_vehicles_announce():
    """Announcements lag by the signal's rate; no other fact depends on it."""
    sweep = {"attack.frequency": [0.1, 5.0]}
    for defence, groups in (("trusted_trim", 1), (ANNOUNCED, 2)):
        assert len(check.networks(systems.study(defence=defence, sweep=sweep).cells)) == groups


def test_a_detector_and_a_magnitude_tell_networks_apart():
    """Where there is a detector; no other fact depends on a magnitude."""
    sweep = {"attack.magnitude": [0.1, 0.2], "detector.false_alarms": [0.01, 0.001]}
    found = check.networks(systems.study(**TESTED, sweep=sweep).cells)
    assert len({each.facts["alarms"] for each in found}) == 4
    without = TESTED | {"detector": "none"}
    sweep = {"attack.magnitude": [0.1, 0.2]}
    assert len(check.networks(systems.study(**without, sweep=sweep).cells)) == 1


def test_every_key_that_a_fact_depends_on_tells_networks_apart():
    """A filter has its distance, a start its time, a gain its decay."""
    robots = {"vehicle": "single_integrator", "gain": [1.0], "attack": "none", "engine": "exact"}
    apart = [{"kind": "barrier", "distance": each} for each in (0.2, 0.3)]
    filtered = robots | {"engine": "sampled"}
    assert len(check.networks(systems.study(**filtered, sweep={"filter": apart}).cells)) == 2
    for key, values in {
        "initial.position": [{"uniform": [-1, 1]}, {"uniform": [-9, 9]}],
        "gain": [[1.0], [2.0]],
        "engine": ["sampled", "exact"],
    }.items():
        found = check.networks(systems.study(**robots, sweep={key: values}).cells)
        assert len(found) == len(values), key


@pytest.mark.parametrize(
    ("formation", "places"),
    [
        ("none", [[0, 0], [0.1, 0], [1, 1], [2, 2]]),
        ({"kind": "line", "spacing": 0.1}, [[0, 0]] * 4),
        ({"kind": "line", "spacing": 0.2}, [[0, 0]] * 4),
    ],
)
def test_lanes_that_start_nearer_than_a_filter_s_distance_are_told(formation, places):
    keys = {"vehicle": "single_integrator", "gain": [1.0], "vehicles": 4, "samples": 5}
    keys |= {"engine": "sampled", "formation": formation, "initial": {"position": places}}
    text = one_line(check.check_text(systems.study(**keys, filter="barrier", attack="none")))
    told = "; in 5 of 5 lanes two vehicles start nearer than D = 0.15 m, so no filter can"
    assert (told in text) == ("0.2" not in str(formation))


def test_a_draw_has_the_weakest_of_its_reasons():
    """Vehicle by vehicle as for each listed vehicle alone."""
    keys = {"vehicles": 5, "topology": "path", "defence": "none", "engine": "exact"}
    drawn = systems.study(attack={"kind": "rotating", "vehicles": {"random": 1}}, **keys)
    scenario = drawn.cells[0].scenario
    graph = scenario.topology.normalised_rows(5)
    draws = attacked_draws(scenario, graph)
    assert draws is not None
    found, *_ = safe_in_all(scenario, graph, draws)
    each = []
    for i in range(1, 6):
        alone = (
            systems.study(attack={"kind": "rotating", "vehicles": [i]}, **keys).cells[0].scenario
        )
        each.append(safe_in(alone, graph, situation_of(alone).attacked)[0].vehicles)
    np.testing.assert_array_equal(found.vehicles, np.all(each, axis=0))
    assert (found.why, found.vehicles.tolist()) == ("untouched", [True] + [False] * 4)


def test_one_cell_is_told_in_full():
    """The first of three topologies by its number, as if it stood alone."""
    study = systems.study(sweep={"topology": ["star", "cyclic", "path"]}, samples=7)
    text = check.check_text(study, 0)
    assert "3 cells × 7 samples = 21 lanes" in text
    (_, title, *lines) = text.partition("star, cell 0\n")
    told = one_line("".join(lines))
    for name, line in known(2 / 3, topology="star", samples=7).items():
        assert f"{name} {line}" in told
    ((first, told_each),) = check.certificates(check.networks(study.cells[:1]))
    certified = "".join(lines).partition("\n  time ")[0]
    assert one_line(check.facts_text(first, told_each)) == one_line(title + certified)


def test_what_differs_is_told_by_the_keys_that_decide_it():
    """Trimming by ϑ alone, the norm by the weight; shared facts stand once, no other key does."""
    theta = {"defence.theta": [1, 2], "topology.navigator_weight": [0.1, 0.5]}
    text = check.check_text(systems.study(sweep=theta))
    same, *others = re.split(r"\n(?=by )", text.split("\n\n")[2])
    assert same.startswith("in all cells\n")
    assert "Assumption 1  holds" in same
    assert [each.splitlines()[0] for each in others] == ["by navigator_weight", "by theta"]
    assert "‖L⁻¹‖₂  [0.1] 10  [0.5] 2\n" in others[0] + "\n"


def test_each_clause_is_told_by_the_keys_that_decide_it():
    """A false alarm by its rate, one about a lie by its size too; the greatest lie is seen at once.

    Mean runs of a lie are tested in tests/theory/test_alarms.py.
    """
    sweep = {"attack.magnitude": [0.1, 0.2, 9], "detector.false_alarms": [0.01, 0.001]}
    text = check.check_text(systems.study(**TESTED, sweep=sweep))
    by_rate, by_both = re.findall(r"^  alarms (?:.*\n)(?:   .*\n)+", text + "\n", re.M)
    assert one_line(by_rate).startswith("alarms [0.01] a false alarm about one link comes after")
    assert one_line(by_both).count("an alarm about a steady lie of ā comes after") == 5
    told = "[9; any] an alarm about a steady lie of ā comes after 1 tick = 0.05 s in the mean"
    assert one_line(by_both).endswith(told)
    assert text.count("false alarm about one link") == 2


@pytest.mark.parametrize(
    ("errors", "known"),
    [  # of O13 and O15; for a mean error of 0.1 m as much as they are
        ({"channel": {"noise": {"position": 0.1}}}, noise.of_messages),
        ({"sensing": {"position": 0.1}}, noise.of_sensors),
    ],
)
def test_a_threshold_below_what_errors_leave_is_told(errors, known):
    """Normal errors of both axes have the mean length σ √(π / 2)."""
    study = systems.study(**PLAIN | {"attack": {"kind": "bias"}}, **errors)
    left = known(Case(study.cells[0].scenario)).mean() * np.sqrt(np.pi / 2)
    sweep = {"attack.magnitude": [9 * left, 11 * left, left]}
    keys = PLAIN | {"attack": {"kind": "bias"}, "recovery": {"tau": 0.1}, "sweep": sweep}
    text = one_line(check.check_text(systems.study(**keys, **errors)))
    told = f"leave an expected mean error of {left:.3g} m, which recovery does not allow, in"
    assert f"WARNING: errors of sensors and messages alone {told} cells 0, 2 (" in text
    detector = {"kind": "chi_squared", "false_alarms": 1e-3, "cuts": "message"}
    sweep |= {"detector": ["none", detector]}
    text = one_line(check.check_text(systems.study(**keys | {"sweep": sweep}, **errors)))
    if "channel" in errors:  # which a detector needs
        assert f"{told} cells 0, 4 (" in text


def test_false_alarms_that_cut_most_honest_links_are_told():
    """After 41 tests 1 - (1 - α)^41 of the links are cut: half at α = 0.0168; or they return."""
    rates = [0.0165, 0.0171]
    assert [round(1 - (1 - rate) ** 41, 2) for rate in rates] == [0.49, 0.51]
    sweep = {"detector.cuts": ["never", "message", "link", "both_ways"]}
    keys = TESTED | {"tick": 0.05, "horizon": 2.0, "tail": 0.0}
    keys["sweep"] = sweep | {"detector.false_alarms": rates}
    words = "false alarms will cut most honest links before the run ends, in cells 5, 7 ("
    assert f"WARNING: {words}" in one_line(check.check_text(systems.study(**keys)))
    for spared in ({"return_after": 1.0}, {"predicts": "kalman"}, {"kind": "distance"}):
        detector = {"kind": "chi_squared", "cuts": "link"} | spared
        detector |= {"threshold": 0.1} if "kind" in spared else {"false_alarms": 0.5}
        study = systems.study(**TESTED | {"detector": detector})
        assert "false alarms will cut" not in check.check_text(study)


def test_swept_gains_are_named_in_full():
    """A number alone names no key."""
    sweep = {"gain.0": [1.0, 2.0], "defence": ["none", "w_msr"]}
    text = check.check_text(systems.study(sweep=sweep))
    titles = [line for line in text.splitlines() if line.startswith("by ")]
    assert "by gain.0" in titles
    assert "by 0" not in titles


def test_hundreds_of_cells_fit_a_screen():
    """Of 80 columns; numbers that differ from network to network are told as a range."""
    defences = ["none", {"kind": "trusted_trim", "label": "trimming by redundancy"}, "w_msr"]
    sweep = {
        "topology.seed": list(range(14)),
        "defence": defences,
        "attack.magnitude": [*range(1, 7)],
    }
    given = systems.study(topology={"kind": "random_regular", "degree": 4}, sweep=sweep)
    text = check.check_text(given)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) < 70
    assert "topology.seed: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, … 13 (14 values)" in text
    assert text.count("holds: an honest path") == 1
    assert "attacked sources, or trust" in one_line(text)  # the end of a line of 160 letters
    numbers = [cell.number for each in check.networks(given.cells) for cell in each.cells]
    assert sorted(numbers) == [*range(252)]


def test_unstable_cells_are_told_at_the_top():
    """A held law multiplies errors by 1 - k h of a single integrator: unstable from k h = 2 on."""
    keys = PLAIN | {"vehicle": "single_integrator", "law": "local", "topology": "star"}
    study = systems.study(tick=0.1, sweep={"gain": [[5.0], [19.9], [20.1], [50.0]]}, **keys)
    head = one_line(check.check_text(study).split("\n\n")[0])
    where = "(line `law`): gain = 20.1 and 50."
    assert f"on disk. WARNING: unstable, deviations grow {where}" in head
    assert "WARNING" not in check.check_text(study, 1)
    assert "WARNING: unstable, deviations grow (line `law`)." in check.check_text(study, 3)


LED = {"kind": "lattice", "neighbours": 4, "navigator": [1, 4, 7], "label": "3 leaders"}
CONVOY = {
    "vehicles": 9,
    "horizon": 80.0,
    "engine": "exact",
    "attack": {"kind": "sinusoid", "vehicles": {"random": 2}, "frequency": 0.5},
    "recovery": {"tau": 0.02},
    "sweep": {
        "topology": ["cyclic", LED, "complete"],
        "defence": ["none", "trusted_trim", {"kind": "w_msr", "F": 2}, "geometric_median"],
        "attack.magnitude": [0.5, 5, 50],
    },
}


def verdict(**keys):
    """The sentences between the size of a study and its sweep."""
    block, *_ = check.check_text(systems.study(**keys)).split("\n\n")
    return block.splitlines()[1:]


def test_a_verdict_stands_first():
    """By swept values, in at most eight lines."""
    told = [line.replace("\N{NO-BREAK SPACE}", " ") for line in verdict(**CONVOY)]
    assert len(told) <= 8
    assert told[1:4] == [
        "No vehicle is proved safe from the attack.",
        "Errors have a proved bound (`jaxnet fit`): no defence and trusted trimming.",
        "A vehicle may hear more attackers than its defence bears: trusted trimming.",
    ]
    assert "A vehicle may be cut off, and its lane fails: 3 leaders, W-MSR." in told
    assert told[-2] == "Without attack starts die away before the tail begins."


PARTED = {"kind": "small_world", "navigator": {"share": 0.4}, "navigator_weight": 0.2}


def test_a_bound_is_told_of_cells_with_a_bound_for_every_vehicle():
    """Also of a fleet that is safe; not where a vote may cut vehicles off, whatever the others."""
    keys = {"vehicles": 10, "attack": {"vehicles": [3, 7]}, "name": "thirty"}
    keys |= {"vehicle": "double_integrator", "gain": [1.0, 2.0]}
    sweep = {"topology": ["cyclic", PARTED], "defence": ["none", "vote"]}
    study = systems.study(**keys, sweep=sweep)
    gains = [scenario_gain(cell.scenario) for cell in study.cells]
    finite = [each is not None and bool(np.isfinite(each.gains).all()) for each in gains]
    told = one_line("\n".join(verdict(**keys, sweep=sweep)))
    assert finite == [True, True, True, False]
    assert "Errors have a proved bound (`jaxnet fit`): all but small world, vote." in told
    assert gains[3] is not None
    whom = ranges(vehicle_numbers(np.isfinite(gains[3].gains)))
    assert limits.unchecked_words(study.cells) == (
        f"cell 3: only vehicles {whom} have one, the others may be cut off"
    )


def test_a_verdict_without_anything_to_warn_of_is_short():
    quiet = {"vehicles": 6, "attack": "none", "defence": "none", "vehicle": "single_integrator"}
    told = verdict(**quiet, gain=[1.0])
    assert len(told) == 2
    assert told[1] == "Without attack starts die away before the tail begins."


def test_a_verdict_of_many_combinations_stays_short():
    """A seed, a gain and a defence decide; where words are too many cells have numbers."""
    sweep = {
        "topology.seed": [*range(9)],
        "defence": ["none", "trusted_trim", "w_msr", "clipping"],
        "attack.vehicles": [[1], [2, 3], {"random": 2}],
    }
    told = verdict(topology={"kind": "random_regular", "degree": 3}, sweep=sweep, horizon=9.0)
    assert len(told) <= 8
    assert any("WARNING: the tail begins before" in line for line in told)
    assert max(map(len, told)) <= 80


@pytest.mark.parametrize(
    ("defence", "surely"),
    [
        ({"kind": "w_msr", "F": 1}, True),
        ({"kind": "w_msr", "F": 0}, False),
        ({"kind": "w_msr", "F": 1, "trusted": {2: [1], 3: [2], 4: [3]}}, False),
    ],
)
def test_a_defence_that_leaves_no_source_is_told(defence, surely):
    """On a path each vehicle but the first hears one source: W-MSR with F = 1 drops it."""
    told = " ".join(verdict(vehicles=4, topology="path", defence=defence))
    assert ("A vehicle drops all sources (F too great), and its lane fails." in told) is surely


def test_vehicles_may_break_apart_without_a_navigator():
    """Where an agreement is proved they do not."""
    keys = {"navigator": "none", "vehicle": "single_integrator", "gain": [1.0], "law": "local"}
    keys |= {"vehicles": 10, "attack": {"kind": "bias", "vehicles": [3, 8]}, "engine": "exact"}
    keys["sweep"] = {
        "topology": ["cyclic", {"kind": "lattice", "neighbours": 4}, "complete"],
        "defence": ["none", {"kind": "w_msr", "F": 2}],
    }
    told = " ".join(verdict(**keys))
    agree = "Guarantee: honest vehicles agree inside the box (not the hull) of their starts"
    assert f"{agree}: complete, W-MSR." in told
    assert "Vehicles drop sources, so the fleet may break apart: lattice, W-MSR." in told
    assert (
        "A vehicle drops all sources (F too great), and stays where it starts: cyclic, W-MSR."
        in told
    )


def test_products_of_values_make_up_any_set_of_combinations():
    rng = np.random.default_rng(0)
    for _ in range(50):
        every = [(a, b, c) for a in "abc" for b in "xy" for c in "pqr"]
        some = {each for each in every if rng.random() < 0.5} or {every[0]}
        boxes = boxes_of(some)
        made = [
            (a, b, c)
            for first, second, third in boxes
            for a in first
            for b in second
            for c in third
        ]
        assert sorted(made) == sorted(some)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["grows 1.02 at 0.1 s", "grows 0.98 at 0.1 s"], ["grows 0.98 to 1.02 at 0.1 s"] * 2),
        (["of 1-12", "of 3"], ["of 1-12", "of 3"]),
        (["2 rounds", "1 round", "4 rounds"], ["2 to 4 rounds", "1 round", "2 to 4 rounds"]),
        (["L⁻¹ 1e-3", "L⁻¹ 2e-3"], ["L⁻¹ 1e-3 to 2e-3"] * 2),
    ],
)
def test_lines_that_differ_in_numbers_alone_become_a_range(lines, told):
    assert check.with_ranges(lines) == told


def test_the_command_tells_one_cell_or_that_there_is_none(tmp_path):
    config = tmp_path / "two.yaml"
    config.write_text("name: two\nattack: none\nsweep: {topology: [star, path]}\n")
    one = CliRunner().invoke(main, ["check", str(config), "--cell", "1"])
    assert "\npath, cell 1\n" in one.stdout
    none = CliRunner().invoke(main, ["check", str(config), "--cell", "2"])
    assert (none.exit_code, "there are 2 cells" in none.stderr) == (2, True)


def test_cells_that_differ_by_their_attack_alone_are_told_apart():
    """As each is told by itself."""
    attacks = ["bias", "rotating", "freeze", {"kind": "rotating", "threat": "replaces"}]
    study = systems.study(sweep={"attack": attacks, "attack.vehicles": [[1], [1, 2]]})
    alone = [facts(cell.scenario)["attack"] for cell in study.cells]
    found = {cell.number: each.facts for each in check.networks(study.cells) for cell in each.cells}
    assert [found[number]["attack"] for number in range(8)] == alone
    assert len(set(alone)) == 8
    assert "\nby attack; vehicles\n  attack" in check.check_text(study)


def test_a_study_of_27_cells_fits_a_screen():
    """What cells share is told once, what a key decides once for each of its values."""
    sweep = {"topology": ["star", "cyclic", "path"], "attack.frequency": [0.1, 0.7, 2.8]}
    sweep["attack.magnitude"] = [1, 10, 100]
    attack = {"kind": "rotating", "vehicles": [2, 7]}
    text = check.check_text(systems.study(attack=attack, sweep=sweep, engine="exact"))
    titles = [line for line in text.splitlines() if line.startswith(("in all", "by "))]
    assert titles == ["in all cells", "by topology"]
    assert len(text.splitlines()) <= 62  # of 80 columns; 68 with a table for each fact
