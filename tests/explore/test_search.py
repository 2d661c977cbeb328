"""The worst choice is found where it is known, is what its study of its own gives."""

import contextlib
import itertools
import math
import pickle
import re
import shutil

import jax
import numpy as np
import pytest
from scipy import optimize, stats

import jaxnet
from experiments import search as experiment
from experiments.search import BIAS, KNOWN, largest
from jaxnet.api import studies, writing
from jaxnet.api.studies import with_random_lanes
from jaxnet.config.document import ConfigError
from jaxnet.config.keys import Scenario
from jaxnet.engine.batch import Machine
from jaxnet.explore import worst
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.search import Finalist, Trials, late_time, search_box
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs import cluster
from jaxnet.store.folder import TakenError
from jaxnet.view.text.worst import search_text as text_of

MANY = Machine(devices=1, chunk=64)  # a generation at once
KEYS = {"engine": "exact", "defence": "none", "horizon": 20.0, "tail": 1.0, "output_step": 0.5}


def study(over, budget=1000, **keys):
    """A study that searches, of a constant attack."""
    search = {"over": over, "budget": budget, "starts": 2, **keys.pop("search", {})}
    return jaxnet.load({"name": "s", **KEYS, "attack": BIAS, **keys, "search": search})


def trials_of(given, starts=2, measure=largest, machine=MANY):
    """Trials in the box of a study's first cell."""
    scenario, source = given.cells[0].scenario, Keyed(given.config.seed)
    over = given.config.search.over
    drawn = [place for place in places_of(scenario, source) if place.name in over]
    return Trials(Box(scenario, source, drawn), starts, measure, machine)


LONG = pytest.mark.long
CASES = (
    "constant, ring",
    *(pytest.param(f"{each}, ring", marks=LONG) for each in ("spoof", "replaces")),
)


@pytest.mark.parametrize("case", CASES)
def test_the_worst_is_found_where_it_is_known(case):
    """To 1 %: all directions the same, of constant attacks, of spoofs."""
    topology, attack, over, exact = KNOWN[case]
    keys = {"topology": topology, "attack": attack, "defence": "none", "horizon": 20.0, "tail": 1.0}
    trials = trials_of(experiment.study_of(over, 1, 4000, 2, **keys))
    lanes = [generation.lanes for generation in search_box(trials, 4000, 1)]
    assert lanes == sorted(lanes)
    assert lanes[-1] == trials.lanes <= 4000
    assert 0.99 * exact < trials.best / 10 < 1.001 * exact


@pytest.mark.long
def test_sets_of_vehicles_are_all_tried():
    """Of six vehicles on a ring, the best pair is that of the exact solution of all pairs."""
    over, attack = {"attack.vehicles": {"choose": 2}}, experiment.IN_PHASE
    trials = trials_of(study(over, budget=200, vehicles=6, attack=attack))
    (only,) = search_box(trials, 200, 0)
    assert only.phase == "sets"
    assert only.lanes == 2 * math.comb(6, 2)
    keys = {**KEYS, "vehicles": 6}
    found = {
        pair: experiment.static_bound({**keys, "attack": {**BIAS, "vehicles": list(pair)}})
        for pair in itertools.combinations(range(1, 7), 2)
    }
    best = max(found.values())
    assert trials.best / 10 == pytest.approx(best, rel=1e-4)
    assert found[tuple(trials.box.attacked(trials.point))] == pytest.approx(best, rel=1e-12)


def test_a_point_is_the_lane_that_is_drawn_there():
    """To the last bit, if its coordinates are the numbers of a sample; all else is the sample's."""
    over = {"attack.phase": "each", "attack.frequency": [0.1, 4], "attack.vehicles": {"choose": 3}}
    given = study(over, attack={"kind": "rotating"}, search={"maximise": "tail_mean"})
    box = trials_of(given).box
    drawn = [box.source.uniforms(place.name, [5, 8], [place[1:]])[:, 0] for place in box.places]
    ours = box.lanes(np.stack(drawn, axis=1), np.array([5, 8]))
    theirs = job(given.cells[0].scenario, Keyed(0), [5, 8])
    jax.tree.map(np.testing.assert_array_equal, ours.inputs, theirs.inputs)


@pytest.mark.long
def test_choices_of_which_a_lane_fails_count_less():
    """They are counted, and what is found is the best of the others."""
    given = study({"attack.direction": "each"})
    count = itertools.count()

    def failing(outcome):
        return np.where(next(count) % 2, largest(outcome), math.nan)

    trials = trials_of(given, measure=failing)
    *_, last = search_box(trials, 2000, 0)
    assert last.failed > 500
    assert last.best > 25


OVER = {"attack.phase": "each", "attack.frequency": [0.2, 2.0]}
TRIMMED = {"kind": "rotating", "magnitude": 10.0}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A search that nobody disturbed, of two cells."""
    over = {"sweep": {"gain": [[1, 3, 3], [1.2, 3, 3]]}, "search": {"until": 20.0}, "horizon": 10.0}
    given = study(OVER, budget=200, attack=TRIMMED, defence="trusted_trim", tick=0.1, **over)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worst, "FRESH", 48)
        yield jaxnet.search(given, tmp_path_factory.mktemp("whole") / "s", progress=False), given


def test_the_worst_is_a_study_of_its_own(whole):
    """Whose lanes come to what was found, to the last bit, and by the nonlinear engine to 1 %."""
    results, given = whole
    for cell, row in results.worst.iterrows():
        alone = jaxnet.simulate(results.path / "worst" / f"{cell}.yaml", progress=False)
        assert alone.lanes["tail_max"].mean() == row["found"]
        assert alone.study.cells[0].scenario.gain == given.cells[cell].scenario.gain
        longer = jaxnet.load(results.path / "worst" / f"{cell}.yaml", {"horizon": 20.0})
        again = jaxnet.simulate(longer, progress=False)
        assert again.lanes["tail_max"].mean() == row["late"]
        assert row["nonlinear"] == pytest.approx(row["found"], rel=0.01)
        assert row["lanes"] <= 200
        random = results.lanes.query(f"cell == {cell}")["tail_max"]
        assert row["random"] == random.max()
        assert row["bound_name"] == "harmonic"
        assert row["fresh_low"] <= row["fresh"] <= row["fresh_high"]
    assert (
        results.searched.groupby("cell")["best"].last().tolist()
        == results.worst["greatest"].tolist()
    )


@pytest.fixture
def counts(monkeypatch):
    """Numbers of choices that are simulated, generation by generation."""
    found, simulate = [], Trials.simulate

    def counting(trials, points, *box):
        found.extend([] if box else [len(points)])
        return simulate(trials, points, *box)

    monkeypatch.setattr(Trials, "simulate", counting)
    monkeypatch.setattr(worst, "FRESH", 48)
    return found


def assert_as(whole, place):
    """A search found what one did that nobody disturbed."""
    again = jaxnet.open(place)
    assert again.worst.equals(whole.worst)
    assert again.searched.equals(whole.searched)


def test_a_search_that_is_broken_off_goes_on(whole, tmp_path, monkeypatch, counts):
    """It ends as one that nobody disturbed, and does nothing twice."""
    results, given = whole
    random = studies.run(with_random_lanes(given), tmp_path / "s", progress=False)

    def stop(what, lanes, total):
        if lanes > 100:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(writing.write_search(random, stop))
    assert len(counts) > 1
    told = []
    list(writing.write_search(random, lambda *step: told.append(step)))
    assert_as(results, tmp_path / "s")
    assert [step[1:] for step in told if "starts" in step[0]] == 2 * [(0, 3), (1, 3), (2, 3)]
    assert len(counts) == len(results.searched)
    monkeypatch.setattr(worst.CellSearch, "verify", lambda *_: pytest.fail("again"))
    list(writing.write_search(random))  # what has ended is kept


def test_the_greatest_stands_first_and_the_words_name_what_else_is_drawn(whole):
    text = " ".join(text_of(whole[0]).split())
    assert text.index("greatest tried") < text.index("found by the search")
    assert "the worst choice over attack phase, attack frequency, from " in text
    assert re.search(r" of all else \(in cell 0: .*initial heading, .*\); found", text)
    assert "of the best choices the worst at 20 s; later: the same choice then" in text
    assert "transients have died" not in text


def contents(folder):
    """All files in a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("when", ["from other starts", "tail_max"])
def test_a_search_whose_folder_is_taken_over_writes_no_more(whole, tmp_path, when):
    """Neither what it has tried nor what it has found."""
    shutil.copytree(
        whole[0].path, tmp_path / "s", ignore=shutil.ignore_patterns("search*", "worst*")
    )
    before = []

    def take(what, *_):
        if when in what and not before:
            (tmp_path / "s" / ".lock").write_bytes(b'{"owner": "process 1 on Mars"}')
            before.append(contents(tmp_path / "s"))

    with pytest.raises(TakenError, match="was taken over by process 1 on Mars"):
        list(writing.write_search(jaxnet.open(tmp_path / "s"), take))
    assert before == [contents(tmp_path / "s")]


class Here(cluster.Cluster):
    """A crew that is this process, which is sent a task as others are."""

    def __init__(self):
        """Nobody is called together."""

    def deal(self, task, config, items):
        """What the task finds of each item."""
        task, _ = pickle.loads(pickle.dumps((task, config.scope)))
        return [task(item) for item in items.values()]


def test_workers_search_whole_cells(whole, tmp_path, monkeypatch, counts):
    """They find what one process finds, and leave it nothing to simulate of the choices."""
    results, given = whole
    random = studies.run(with_random_lanes(given), tmp_path / "s", progress=False)
    monkeypatch.setattr(writing, "executor", lambda *_: contextlib.nullcontext(Here()))
    told = []
    list(writing.write_search(random, lambda what, *_: told.append((what, len(counts))), workers=2))
    assert told[1] == ("cells searched", len(results.searched))
    assert len(counts) == len(results.searched)
    assert_as(results, tmp_path / "s")


@pytest.mark.long
def test_a_cell_in_which_all_lanes_fail_is_told(tmp_path, monkeypatch):
    """With no number, and ā drawn for each lane has none either."""
    monkeypatch.setattr(worst, "FRESH", 8)
    keys = {"defence": "w_msr", "topology": "path", "tick": 0.1}
    attack = {"kind": "rotating", "magnitude": {"uniform": [1.0, 2.0]}}
    given = study({"attack.phase": "each"}, budget=200, attack=attack, **keys)
    (row,) = jaxnet.search(given, tmp_path / "s", progress=False).worst.to_dict("records")
    for name in ("found", "random", "bound", "fresh", "nonlinear", "magnitude"):
        assert math.isnan(row[name])
    assert row["failed"] >= row["lanes"]


@pytest.mark.long
def test_the_worst_attack_that_is_not_seen(tmp_path, monkeypatch):
    """A bias as great as 2 % of alarms allow, 0.6213 deviations by χ²; honest words raise one."""
    monkeypatch.setattr(worst, "FRESH", 48)
    attack = {"kind": "bias", "vehicles": [1, 3], "magnitude": 1.0}
    keys = {"vehicles": 4, "topology": "complete", "output_step": 2.0, "tail": 4.0}
    keys |= {"channel": {"noise": {"position": 1.0}}, "detector": {"kind": "chi_squared"}}
    keys |= {"sweep": {"detector.false_alarms": [0.01, 0.5]}, "horizon": 20.0, "attack": attack}
    asked = {"subject_to": {"alarms": 0.02}, "starts": 1, "until": 1.0, "maximise": "tail_mean"}
    given = study({"attack.magnitude": [0.0, 3.0]}, budget=200, search=asked, **keys)
    results = jaxnet.search(given, tmp_path / "s", progress=False)
    found = jaxnet.simulate(results.path / "worst" / "0.yaml", progress=False).lanes.iloc[0]
    row, nothing = results.worst.to_dict("records")
    assert found["tail_mean"] == row["found"]
    # The share rises with the bias in steps of a message.
    messages, share = 2 * 3 * 401, found["alarms"]
    assert 0.02 - 3 / messages < share <= 0.02
    width = 2.576 * np.sqrt(0.02 * 0.98 / messages)
    limits = [bias_seen(0.02 + side * width) for side in (-1, 1)]
    assert limits[0] < row["magnitude"] < limits[1]
    assert 0.1 < row["fresh_allowed"] < 0.9
    allowed = results.lanes.query("cell == 0 and alarms <= 0.02")["tail_mean"]
    assert row["random"] == allowed.max()
    assert math.isnan(nothing["found"])
    assert "subject to alarms ≤ 0.02" in text_of(results)
    assert "no choice that was tried in cell 1 fulfils it" in " ".join(text_of(results).split())
    with pytest.raises(ConfigError, match="a detector gives alarms"):
        study({"attack.magnitude": [0.0, 3.0]}, search=asked)


@pytest.mark.long
def test_some_starts_may_exceed_a_limit(tmp_path, monkeypatch):
    """What is found is the mean over the starts that do not, and the text tells their share."""
    monkeypatch.setattr(worst, "FRESH", 48)
    keys = {"vehicles": 4, "topology": "complete", "attack": BIAS | {"vehicles": [1, 3]}}
    keys |= {"channel": {"noise": {"position": 1.0}}, "detector": {"kind": "chi_squared"}}
    asked = {"subject_to": {"alarms": 0.02}, "starts": 5, "may_exceed": 0.4, "until": 1.0}
    given = study({"attack.magnitude": [0.0, 3.0]}, budget=500, search=asked, **keys)
    results = jaxnet.search(given, tmp_path / "s", progress=False)
    lanes = jaxnet.simulate(results.path / "worst.yaml", progress=False).lanes
    allowed = lanes.query("alarms <= 0.02")["tail_max"]
    assert len(allowed) == 3
    (row,) = results.worst.to_dict("records")
    assert row["found"] == pytest.approx(allowed.mean(), rel=1e-14)
    assert "from at least 0.6 of the draws" in text_of(results)


def test_the_mean_over_starts_leaves_out_those_that_may_exceed():
    """Where too many exceed a limit a choice does not count, where one fails it has no value."""
    trials = trials_of(study({"attack.direction": "each"}), starts=4)
    no = -math.inf
    values = np.array([[1, 2, 3, 6], [1, no, 3, 5], [1, no, no, 2], [no, math.nan, 1, 1]])
    trials.may_exceed = 0.25
    np.testing.assert_array_equal(trials.means(values), [3, 3, no, math.nan])
    trials.may_exceed = 0.0
    np.testing.assert_array_equal(trials.means(values), [3, no, no, no])


def bias_seen(share):
    """The bias over σ that is seen in a share of its words."""
    return optimize.brentq(lambda bias: stats.ncx2.sf(9.210340, 2, bias**2) - share, 1e-3, 5.0)


def smooth(x):
    """The envelope's polynomial, 0 before 0 and 1 after 1."""
    x = min(max(x, 0.0), 1.0)
    return 35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7


@pytest.mark.long
def test_what_persists_is_told_apart_from_what_is_transient(tmp_path, monkeypatch):
    """The choice is the finalist that is greatest at 1,000 s.

    A signal in phase on the untrimmed ring comes to 90/29 of itself, at any time (theorems.md O2).
    This one begins to fall at 900 s, and falls as long as it rises.
    """
    monkeypatch.setattr(worst, "FRESH", 8)
    bias = {"kind": "bias", "direction": 0.0}
    attack = {"kind": "envelope", "of": bias, "magnitude": 10.0, "stop": 900.0}
    given = study({"attack.rise": [5.0, 800.0]}, budget=200, topology="cyclic", attack=attack)
    fading = jaxnet.search(given, tmp_path / "s", progress=False)
    (row,) = fading.worst.to_dict("records")
    rise = jaxnet.load(fading.path / "worst.yaml").cells[0].scenario.attack.rise
    gain = 10.0 * 90 / 29
    assert row["until"] == 1000.0
    assert row["greatest"] == pytest.approx(gain, rel=1e-4)
    assert row["found"] == pytest.approx(gain * smooth(20 / rise), abs=1e-4)
    assert row["late"] == pytest.approx(gain * (1 - smooth((999.0 - 900) / rise)), rel=1e-6)
    assert row["late"] > 10.0
    longer = jaxnet.load(fading.path / "worst.yaml", {"horizon": 1000.0})
    again = jaxnet.simulate(longer, progress=False)
    assert again.lanes["tail_max"].mean() == row["late"]


NAN = math.nan


@pytest.mark.parametrize(
    ("found", "after", "chosen"),
    [
        ([30.0, 20.0, 10.0], [0.0, 20.0, 10.0], 1),
        ([30.0, 20.0, 10.0], [5.0, 5.0, 9.0], 2),
        ([30.0, 20.0, 10.0], [1e-9, 1e-7, 2e-6], 0),  # rounding at a late time decides nothing
        ([30.0, 20.0, 10.0], [NAN, 1.0, 2.0], 2),  # a lane failed between
        ([30.0, 20.0, 10.0], [NAN, NAN, NAN], 0),
        ([-1.0, -2.0, -3.0], [-8.0, -7.0, -9.0], 1),
    ],
)
def test_the_choice_is_the_finalist_that_is_worst_at_the_late_time(
    found, after, chosen, monkeypatch
):
    """Of finalists that are equal then, the worst at the horizon."""
    trials = trials_of(study({"attack.direction": "each"}), 1)
    points = np.arange(3.0)[:, None] + np.zeros(len(trials.box.places))
    finalists = [Finalist(value, point) for value, point in zip(found, points, strict=True)]
    trials.best, trials.point = found[0], points[0]
    trials.finalists = finalists[1:]
    monkeypatch.setattr(Trials, "simulate", lambda *_: np.array(after)[:, None])
    choice = trials.choose_finalist(1000.0)
    assert (choice.point[0], choice.found, choice.until) == (chosen, found[chosen], 1000.0)
    np.testing.assert_equal(choice.late, after[chosen])


@pytest.mark.parametrize(
    ("horizon", "step", "until", "time"),
    [
        (40.0, 0.5, 1000.0, 1000.0),
        (40.0, 0.3, 40.1, 40.2),
        (39.0, 0.3, 39.0, 39.0),
        (60.0, 0.5, 30.0, 60.0),
        (0.3, 0.1, 0.3, 0.3),
    ],
)
def test_the_late_time_is_an_output_time(horizon, step, until, time):
    """The first one that is not before `until`, nor before the horizon."""
    scenario = Scenario(horizon=horizon, output_step=step, tail=0.0)
    assert late_time(scenario, until) == pytest.approx(time, rel=1e-12)
