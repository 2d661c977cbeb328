"""What `check` says of the paper's scenarios."""

import numpy as np
import pytest

from jaxnet.config.scenario import attacked_draws, safe_in, safe_in_all, situation_of
from jaxnet.theory.integer import RobustnessBracket
from jaxnet.view.text import check
from tests import systems


def section(text: str, title: str) -> str:
    """The certificate of one topology."""
    return next(part for part in text.split("\n\n") if part.startswith(title))


def test_the_papers_topologies():
    """Nobody in star and path is protected, and both break the paper's own Assumption 1."""
    text = check.check_text(
        systems.study(sweep={"topology": ["star", "cyclic", "path"]}, samples=7)
    )
    assert "3 cells × 7 samples = 21 lanes" in text
    star, cyclic, path = (section(text, name) for name in ("star", "cyclic", "path"))
    assert "nobody is protected" in star
    assert "nobody is protected" in path
    assert "holds for every vehicle" in cyclic
    assert "no honest path from the navigator to 2, 5, 8, 11" in star
    assert "no honest path from the navigator to 3-12" in path
    assert "Assumption 1  holds" in cyclic
    assert "in what they hear of the navigator" in star
    assert "in what they transmit, 8 links" in cyclic
    norms = [
        section(text, name).split("‖L⁻¹‖₂")[1].split()[0] for name in ("star", "cyclic", "path")
    ]
    assert norms == ["1", "10", "7.963"]
    for part in (star, cyclic, path):
        assert "exactly 1-robust" in part
        assert "13.23 m/s" in part


@pytest.mark.parametrize(("horizon", "told"), [(15.0, True), (30.0, False)])
def test_a_start_that_has_not_died_away_is_told(horizon, told):
    """(s + 1)³ = 0: `η(t) = e⁻ᵗ (1 + N t + N² t²/2) η(0)` with the nilpotent N = A + 1."""
    text = " ".join(check.check_text(systems.study(horizon=horizon)).split())
    nilpotent = np.array([[1, 1, 0], [0, 1, 1], [-1, -3, -2]])
    t = horizon - 5
    known = np.exp(-t) * (np.eye(3) + nilpotent * t + nilpotent @ nilpotent * t**2 / 2)
    words = f"up to {np.linalg.norm(known, 2):.2g} ‖η(0)‖ when the tail begins, at {t:g} s"
    assert (words in text) is ("not died away" in text) is told


def robustness_of(**keys):
    """The line of robustness, without its beginning."""
    rows = section(
        check.certificates(systems.study(**keys).cells)[0], keys["topology"]["kind"]
    ).splitlines()
    (line,) = [row.strip() for row in rows if row.startswith("  robustness")]
    start = "robustness    exactly 1-robust with the navigator, as every graph that it reaches, while W-MSR with"
    start += " F = 1 asks for 3-robustness against F-local attackers, (2, 2)-robustness against F-total attackers"
    assert line.startswith(start)
    return line.removeprefix(start)


COMPLETE = {"kind": "random_regular", "degree": 6}


@pytest.mark.parametrize(
    ("vehicles", "topology", "told"),
    [
        (
            7,
            COMPLETE,
            "(1, 7), (2, 7), (3, 7), (4, 7)-robust, {}F-local attackers up to F = 1, F-total up to F = 3",
        ),
        (12, {"kind": "cyclic"}, "(1, 4)-robust, enough for W-MSR only without attackers"),
        (12, {"kind": "star"}, "not 1-robust, so not enough for W-MSR"),
        (30, {"kind": "star"}, "not 1-robust, so not enough for W-MSR"),
        (40, {"kind": "cyclic"}, "1-robust, enough for W-MSR only without attackers"),
        (200, {"kind": "star"}, "not 1-robust, so not enough for W-MSR"),
        (201, {"kind": "cyclic"}, "not examined: they are more than 200"),
    ],
)
def test_the_robustness_of_the_vehicles_alone(vehicles, topology, told):
    """All pairs (r, s), and the attackers that W-MSR tolerates by the theorems of LeBlanc et al."""
    line = robustness_of(vehicles=vehicles, topology=topology, attack="none", defence="none")
    assert line == "; the vehicles alone " + told.format("enough for W-MSR with ")


@pytest.mark.parametrize(
    ("known", "total", "told"),
    [
        ((3, 3), (1, 2), "3-robust, {}F-local attackers up to F = 1, F-total up to at least F = 1"),
        (
            (3, 6),
            (1, 5),
            "{between}3 and 6, {}F-local attackers up to at least F = 1, F-total up to at least F = 1",
        ),
        ((5, 6), (4, 4), "{between}5 and 6, {}F-local attackers up to F = 2, F-total up to F = 4"),
        (
            (1, 4),
            (0, 3),
            "{between}1 and 4, enough for W-MSR without attackers; with attackers it is not known",
        ),
        ((0, 4), (-1, 3), "{between}0 and 4, so nothing is proved of W-MSR"),
        ((1, 1), (0, 0), "1-robust, enough for W-MSR only without attackers"),
        ((0, 0), (-1, -1), "not 1-robust, so not enough for W-MSR"),
    ],
)
def test_a_search_that_ends_early_tells_bounds(known, total, told):
    between = "r-robust, with the greatest r between "
    found = check.bracket_text(RobustnessBracket(*known), RobustnessBracket(*total))
    assert found == told.format("enough for W-MSR with ", between=between)


def test_programs_of_many_networks_share_their_time(monkeypatch):
    """None runs for 16 vehicles or fewer, nor for more than twenty networks."""
    asked = []
    monkeypatch.setattr(
        check, "brackets", lambda n, heard, seconds: (asked.append(seconds), BOUNDS)[1]
    )
    keys = {"vehicles": 20, "attack": "none", "defence": "none"}
    for seeds in (1, 4, 21):
        topology = {
            "topology": {"kind": "random_regular", "degree": 4},
            "sweep": {"topology.seed": [*range(seeds)]},
        }
        check.certificates(systems.study(**keys, **topology).cells)
    check.certificates(systems.study(vehicles=16).cells)
    assert asked == [2.0] + [0.5] * 4


BOUNDS = RobustnessBracket(2, 3), RobustnessBracket(0, 2)


def test_some_are_protected_and_some_outnumbered():
    """Fig. 1 with ϑ for some; a ring in which 3 hears two liars."""
    given = systems.study(attack={"vehicles": [2, 4]}, defence={"theta": {3: 1, 7: 1, 9: 2}})
    text = " ".join(check.check_text(given).split())
    assert "holds for 3, 7 only; 1, 2, 4-6, 8-12 unprotected" in text
    assert "more than ϑ attacked sources, or a trusted one, at 3" in text


def test_ranges():
    """Runs of three or more are drawn together."""
    assert check.ranges([1, 2, 3, 5, 7, 8, 10]) == "1-3, 5, 7, 8, 10"


def test_what_is_drawn_lane_by_lane_is_said():
    """The certificate is of the weights' medians, 0.1 and 0.1 and 0.2, and says in which cells."""
    weights = [{"uniform": [0.05, 0.15]}, 0.1, {"choice": [0.2, 0.1, 0.3]}]
    gains = [[1, 3, 3], [1, 3, {"uniform": [3, 4]}]]
    text = check.check_text(
        systems.study(sweep={"topology.navigator_weight": weights, "gain": gains})
    )
    tenth, fifth = (section(text, f"cyclic, cells {cells}") for cells in ("0-3", "4, 5"))
    assert [part.split("‖L⁻¹‖₂")[1].split()[0] for part in (tenth, fifth)] == ["10", "5"]
    assert "weights       drawn in cells 0, 1; what is said is of their medians" in tenth
    assert "gain          drawn in cells 1, 3; stable whatever is drawn" in tenth
    assert "weights       drawn in cells 4, 5" in fifth
    assert "drawn" not in check.check_text(systems.study(gain=[2, 3, 3]))


def test_hundreds_of_cells_are_told_in_few_lines():
    """What is swept, one network in full, and what is different in those whose report differs; 80 columns."""
    defences = [
        "none",
        {"kind": "trusted_trim", "label": "trimming by trusted redundancy"},
        "w_msr",
    ]
    seeds = {"topology.seed": list(range(100)), "defence": defences}
    given = systems.study(topology={"kind": "random_regular", "degree": 4}, sweep=seeds)
    text = check.check_text(given)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) < 110
    assert "topology.seed  0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, … 99 (100 values)" in text
    assert text.count("Assumption 1  holds") == 1
    whole = check.certificates(given.cells)
    told = {line for part in whole for line in part.splitlines()[1:] if "trimming" in line}
    assert text.count("as the first, but") + 1 == check.MOST_NETWORKS
    assert f"… {len(told) + 2 - check.MOST_NETWORKS} more networks" in lines


def test_what_differs_is_what_is_told_of_further_networks():
    """Five rings with other ϑ: the second to fifth differ in the line of trimming alone."""
    text = check.check_text(systems.study(sweep={"defence.theta": [1, 2, 3, 4, 5]}))
    parts = text.split("\n\n")[2:-1]
    assert len(parts) == 5
    for number, part in enumerate(parts[1:], 2):
        first, *rest = part.splitlines()
        assert first == f"cyclic, cell {number - 1}: as the first, but"
        assert rest[0].startswith(f"  trimming  ϑ = {number},")
        assert all(line.startswith(" " * 12) for line in rest[1:])


def test_the_law_by_exchanges():
    """Whether it is stable, how many rounds are, and that no guarantee is of it; each tick by itself."""
    sweep = {"tick": [0.05, 0.2], "law": ["exact", "rounds"]}
    text = " ".join(check.check_text(systems.study(output_step=0.2, sweep=sweep)).split())
    first, short, long = (text.index(f"cyclic, cell{named}") for named in ("s 0, 2", " 1", " 3"))
    assert "law" not in text[first:short].replace("law=", "")
    assert (
        "law UNSTABLE, deviations times 1.0458 at each tick of 0.05 s; 2 rounds are the least"
        in text[short:long]
    )
    assert "4 rounds are the least that is stable, and every number from 6 on" in text[long:]
    assert "that is while everybody is retained" in text[long:]
    assert (
        text.count("safe nothing is proved; the theorems are of the law solved at every instant")
        == 2
    )
    assert "law rounds nothing is proved" in text
    untrimmed = check.check_text(systems.study(law={"kind": "rounds", "rounds": 2}, defence="none"))
    assert "stable, deviations times 0.9667" in untrimmed
    assert "retained" not in untrimmed
    large = check.check_text(systems.study(law="rounds", vehicles=1001, defence="none"))
    assert "stability is told of 1,000 vehicles at most" in large
    never = check.check_text(systems.study(law="rounds", tick=0.75, output_step=0.75, tail=4.5))
    assert "no number of rounds is stable" in " ".join(never.split())


RULES = {
    "none: attacks are known": {"kind": "trusted_trim"},
    "announced: by majority": {"kind": "trusted_trim", "score": "announced"},
    "none: whoever stays within the radius": {"kind": "trust"},
    "random: by earned trust": {"kind": "trust", "observation": "random"},
}


@pytest.mark.parametrize("words", RULES)
def test_the_guarantee_is_of_the_rule_in_use(words):
    """And of no other rule of the same kind; a sweep of both tells both."""
    told = one_line(check.guarantees(systems.study(defence=RULES[words]).cells))
    assert [each for each in RULES if each in told] == [words]
    scores = {"defence.score": ["position", "announced"]}
    told = one_line(check.guarantees(systems.study(defence="trusted_trim", sweep=scores).cells))
    assert [each for each in RULES if each in told] == list(RULES)[:2]


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (
            {
                "law": "rounds",
                "channel": {"loss": {"kind": "bernoulli", "probability": 0.5, "of": "all"}},
            },
            "UNSTABLE in mean square, deviations times 1.0089 at each tick; stable up to a loss of 0.4131",
        ),
        ({"channel": {"delay": 0.1}}, "vehicles end late by 1 s"),
        ({"channel": {"delay": 0.1}, "topology": "path"}, "vehicles end late by 0.1 to 1.2 s"),
        (
            {"channel": {"delay": 0.04, "extrapolate": "jerk"}},
            "unstable: the delay must be below 0.0363729 s",
        ),
    ],
)
def test_what_is_known_of_lost_and_late_words_is_told(keys, told):
    """Figures of two independent programs for the ring, and i τ for the path."""
    cells = systems.study(**{"topology": "cyclic", "defence": "none", "tick": 0.02, **keys}).cells
    lines = check.world_lines(cells[0].scenario)
    assert told in lines["delay" if "delay" in keys["channel"] else "channel"]


def one_line(text):
    """A text without breaks of lines."""
    return " ".join(text.split())


LATTICE = {"vehicles": 8, "topology": {"kind": "lattice", "neighbours": 4}, "engine": "exact"}


def drawn_text(number, **keys):
    """What check says where each lane draws its attacked vehicles."""
    given = systems.study(
        attack={"kind": "rotating", "vehicles": {"random": number}}, **LATTICE | keys
    )
    return " ".join(check.check_text(given).split())


def test_drawn_vehicles_are_judged_draw_by_draw():
    """One of eight is withstood by a majority whichever it is; of two, some listener hears both."""
    announced = {"kind": "trusted_trim", "score": "announced"}
    one, two = (drawn_text(number, defence=announced) for number in (1, 2))
    assert "safe every vehicle by majority, whichever vehicles are drawn" in one
    assert "more than ϑ attacked sources" not in one
    assert "safe not known in every lane of 1-8" in two
    assert "more than ϑ attacked sources, or a trusted one, at 1-8" in two


def test_a_draw_has_the_weakest_of_its_reasons():
    """Vehicle by vehicle as for each listed vehicle alone."""
    keys = {"vehicles": 5, "topology": "path", "defence": "none", "engine": "exact"}
    drawn = systems.study(attack={"kind": "rotating", "vehicles": {"random": 1}}, **keys)
    scenario = drawn.cells[0].scenario
    graph = scenario.topology.normalised_rows(5)
    found, *_ = safe_in_all(scenario, graph, attacked_draws(scenario, graph))
    alone = [
        systems.study(attack={"kind": "rotating", "vehicles": [i]}, **keys) for i in range(1, 6)
    ]
    each = [
        safe_in(one.cells[0].scenario, graph, situation_of(one.cells[0].scenario).attacked)
        for one in alone
    ]
    expected = np.all([reasons[0].vehicles for reasons in each], axis=0)
    np.testing.assert_array_equal(found.vehicles, expected)
    assert found.why == "untouched"
    assert expected.tolist() == [True, False, False, False, False]


def test_assumption_1_of_drawn_vehicles_is_of_every_draw():
    """On a path each vehicle but the first has no honest path in some lane."""
    text = drawn_text(1, vehicles=4, topology="path", defence="none")
    assert "broken: no honest path from the navigator to 2-4" in text


def test_networks_with_other_numbers_of_attackers_are_told_apart():
    """Each with its own line; too many sets are said to be too many."""
    sweep = {"attack.vehicles": [{"random": 1}, {"random": 2}, {"random": 7}]}
    given = systems.study(attack="rotating", sweep=sweep, **LATTICE | {"vehicles": 24})
    text = " ".join(check.check_text(given).split())
    assert [f"on {n} drawn for each lane" in text for n in (1, 2, 7)] == [True] * 3
    assert "more than 1,000 sets of vehicles may be drawn" in text
