"""The table of bounds, and whether a lane that breaks one is found, and no other."""

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.kinds.attacks.rotating import Rotating
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.signal import Harmonic
from jaxnet.statistics import limits as bounds
from jaxnet.statistics.limits import limits_of, slopes_table, violations_table
from jaxnet.theory.case import Case
from jaxnet.view.text.facts import attack_line
from tests import reference, systems

GAIN = [2.0, 4.0, 2.5]
EDGES = [[1, 0, 1], [2, 0, 1], [2, 1, 3], [3, 2, 1], [3, 4, 2], [4, 3, 1], [4, 1, 2]]


def test_the_table_has_a_block_for_each_group():
    """Cells that differ in ā alone share one; the star's static slopes are its attacked."""
    study = jaxnet.load({"sweep": {"topology": ["star", "cyclic"], "attack.magnitude": [1, 2]}})
    slopes = slopes_table(study.cells)
    assert slopes.columns.tolist() == ["topology", "bound", "vehicle", "slope"]
    assert len(slopes) == 2 * 7 * 14
    star = slopes[(slopes["topology"] == "star") & (slopes["bound"] == "static")]
    assert star["vehicle"].tolist() == [*map(str, range(1, 13)), "worst", "fleet"]
    assert star["slope"].tolist() == [0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 2]
    ring = slopes[slopes["topology"] == "cyclic"].set_index(["bound", "vehicle"])["slope"]
    assert ring["peak_gain", "worst"] == pytest.approx(19.8)
    assert ring["harmonic", "worst"] == pytest.approx(7.0, abs=1e-3)  # one frequency, as by default
    assert ring["static"].isna().all()
    several = jaxnet.load({"attack": "multisine"})
    assert "harmonic" not in set(slopes_table(several.cells)["bound"])
    assert slopes_table(jaxnet.load({"attack": "none"}).cells).empty


@pytest.mark.parametrize("threat", ["adds", "replaces"])
@pytest.mark.parametrize("defence", ["none", "trusted_trim"])
@pytest.mark.parametrize("topology", ["cyclic", {"kind": "lattice", "navigator": [1, 4]}])
def test_drawn_attackers_have_the_greatest_bound_of_all_their_sets(topology, defence, threat):
    """Each slope is the greatest of the studies of one pair, and no lane exceeds it.

    A message that is replaced only in some lanes has no static bound.
    """
    keys = {"vehicles": 6, "topology": topology, "defence": defence, "engine": "exact"}

    def study(vehicles):
        attack = {"kind": "bias", "vehicles": vehicles, "threat": threat}
        return systems.study(attack=attack, horizon=90.0, tail=5.0, **keys)

    pairs = [slopes_table(study([*each]).cells) for each in combinations(range(1, 7), 2)]
    given = study({"random": 2})
    found = slopes_table(given.cells).set_index(["bound", "vehicle"])["slope"]
    most = pd.concat(pairs).groupby(["bound", "vehicle"])["slope"].max()[found.index]
    if threat == "replaces":
        jumping = ["static", "lyapunov_printed"]
        assert found[jumping].isna().all()
        gains = ["peak_gain", "harmonic"]
        np.testing.assert_allclose(found[gains], most[gains], rtol=1e-9)
    else:
        np.testing.assert_allclose(found, most, rtol=1e-9)
    results = jaxnet.simulate(given, samples=30, progress=False)
    worst = results.lanes["tail_max"].max() / 5.0
    bound = found["peak_gain" if found["static"].isna().all() else "static", "worst"]
    assert worst <= bound * (1 + 1e-6)
    assert (worst > bound / 1.3) == found["static"].notna().all()
    assert violations_table(results).empty
    assert bounds.at_once_words(given.cells) == ""


def test_too_many_sets_count_as_one_of_all_vehicles():
    """2 of 46 are 1,035 pairs: the slopes are those of an attack on all, and this is told."""
    keys = {"vehicles": 46, "topology": "cyclic", "defence": "none"}
    drawn, every = (
        systems.study(attack={"kind": "bias", "vehicles": vehicles}, **keys).cells
        for vehicles in ({"random": 2}, [*range(1, 47)])
    )
    pd.testing.assert_frame_equal(slopes_table(drawn), slopes_table(every))
    assert bounds.at_once_words(drawn) == (
        "bounds take all vehicles as attacked at once, as too many sets may be drawn, in cell 0"
    )
    assert "bounds take all vehicles as attacked at once" in attack_line(Case(drawn[0].scenario))
    assert bounds.at_once_words(every) == ""


JUDGES = ("w_msr", "clipping", "coordinate_median", "centerpoint", "geometric_median")


@pytest.mark.parametrize("defence", JUDGES)
def test_a_defence_that_can_change_no_weight_has_the_bounds_of_none(defence):
    """On a star, where the navigator alone is heard; not on a ring, nor where it may be dropped."""
    keys = {"engine": "exact", "topology": "star", "horizon": 20.0, "tail": 2.0}
    keys["attack"] = {"kind": "sinusoid", "vehicles": {"random": 2}}
    keys["sweep"] = {"defence": ["none", defence], "attack.magnitude": [1, 50]}
    results = jaxnet.simulate(systems.study(**keys), samples=4, progress=False)
    cells = results.study.cells
    table = slopes_table(cells).set_index(["defence", "bound", "vehicle"])["slope"]
    pd.testing.assert_series_equal(table[defence], table["none"])
    assert table["none"].xs("peak_gain").notna().all()
    assert bounds.unchecked_words(cells) == ""
    assert violations_table(results).empty
    errors = results.cells["tail_max_max"].to_numpy().reshape(2, 2)
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-9)
    for more in ({"topology": "cyclic"}, {"defence": {"kind": defence, "trusted": "none"}}):
        if defence != "geometric_median" or "topology" in more:
            ring = systems.study(**keys | {"sweep": {}, "defence": defence} | more)
            assert "the defence may" in bounds.unchecked_words(ring.cells)


@pytest.mark.parametrize(
    "drawn",
    [
        {"gain": [1, 3, {"uniform": [3, 4]}]},
        {"topology": {"kind": "cyclic", "navigator_weight": {"uniform": [0.1, 0.2]}}},
        {"law": "rounds"},
        {"defence": "w_msr", "engine": "exact"},
    ],
)
def test_where_each_lane_has_its_own_bounds_none_is_claimed(drawn):
    """All slopes are blank, and no lane is held against one; nor where jerks are held or any source
    may be dropped.
    """
    study = jaxnet.load(drawn)
    slopes = slopes_table(study.cells)
    assert len(slopes) == 6 * 14
    assert slopes["slope"].isna().all()
    assert violations_table(results_of(study, tail_max=[1e9])).empty


def results_of(study, **columns):
    """Results of a study whose rows have these columns."""
    rows = pd.DataFrame({"cell": 0, "status": "ok", **columns})
    rows["sample"] = rows.groupby("cell").cumcount()
    return systems.results_of(study, rows)


@pytest.mark.parametrize("engine", ["nonlinear", "exact"])
def test_a_lane_over_its_bound_is_found(engine):
    """In the star, after 60 s, a constant attack of 3 m has taken its listeners 3 m off, not more.

    Over that static is violated, over 2 √2 · 3 = 8.5 m the bound of one frequency, over 24 m the
    peak gain; a failed lane violates nothing.
    """
    keys = {
        "topology": "star",
        "attack": {"kind": "bias", "magnitude": 3},
        "horizon": 60,
        "samples": 5,
    }
    study = systems.study(engine=engine, **keys)
    accuracy = {"exact": 1e-8, "nonlinear": 1e-5}[engine]
    errors = [3.0, 3.0 + 2 * accuracy, 23.9, 24.1, np.nan]
    status = ["ok", "ok", "ok", "ok", "singular"]
    found = violations_table(results_of(study, tail_max=errors, status=status))
    assert found.columns.tolist() == ["cell", "sample", "bound", "tail_max", "limit", "command"]
    assert [tuple(row) for row in found[["sample", "bound"]].to_numpy()] == [
        (3, "peak_gain"),
        (2, "harmonic"),
        (3, "harmonic"),
        (1, "static"),
        (2, "static"),
        (3, "static"),
    ]
    assert found["tail_max"].tolist() == [24.1, 23.9, 24.1, errors[1], 23.9, 24.1]
    np.testing.assert_allclose(found["limit"], [24, 8.48528, 8.48528, 3, 3, 3], rtol=1e-5)
    assert found["command"][0] == "jaxnet replay nowhere --cell 0 --sample 3"


@pytest.mark.parametrize("magnitude", [{"uniform": [0, 3]}], ids=["drawn"])
def test_drawing_the_suspects_alone_misses_no_violation(magnitude, monkeypatch):
    """Same table as of all lanes' starts; errors below bounds, above limits, and in between."""
    attack = {"kind": "rotating", "magnitude": magnitude}
    study = systems.study(
        samples=200, engine="exact", topology="star", attack=attack, horizon=12, tail=1
    )
    errors = np.random.default_rng(0).uniform(0, np.repeat([4, 40], 100))
    some = violations_table(results_of(study, tail_max=errors))
    few = bounds.suspect_lanes
    monkeypatch.setattr(bounds, "suspect_lanes", lambda *given: np.ones(200, bool))
    every = violations_table(results_of(study, tail_max=errors))
    pd.testing.assert_frame_equal(some, every)
    suspected = few(
        study.cells[0].scenario, Keyed(0), pd.DataFrame({"sample": range(200), "tail_max": errors})
    ).sum()
    assert 0 < every["sample"].nunique() < suspected < 200


def test_nothing_said_of_a_vehicle_cut_off():
    """An infinite bound is over every error, and of no attack at all nothing is claimed."""
    links = [[i, j, 1] for i in (1, 2, 3) for j in (1, 2, 3, 4) if i != j]
    keys = {
        "vehicles": 4,
        "topology": {"kind": "edges", "edges": [*links, [4, 0, 1]]},
        "defence": {"kind": "trusted_trim", "trusted": {i: [1, 2, 3] for i in (1, 2, 3)}},
        "attack": {"kind": "bias", "vehicles": [4]},
    }
    study = jaxnet.load(keys | {"sweep": {"attack.magnitude": [0, 5]}})
    assert np.isinf(slopes_table(study.cells).set_index("vehicle").loc["worst", "slope"]).all()
    assert violations_table(results_of(study, cell=[0, 1], tail_max=[1e9, 1e9])).empty


def test_what_may_switch_is_not_held_against_the_static_bound():
    """In the ring that trims: static holds without defence only; no attack, no bound."""
    sweep = {"attack": ["none", "bias"], "defence": ["none", "trusted_trim"]}
    study = jaxnet.load({"horizon": 60, "sweep": sweep})
    found = violations_table(results_of(study, cell=[0, 1, 2, 3], tail_max=[1e3, 1e3, 16.0, 16.0]))
    assert list(zip(found["cell"], found["bound"], strict=True)) == [(2, "static")]
    found = violations_table(results_of(study, cell=[0, 1, 2, 3], tail_max=[1e3, 1e3, 99.5, 99.5]))
    known = [(2, "harmonic"), (2, "static"), (3, "harmonic"), (3, "peak_gain")]
    assert sorted(zip(found["cell"], found["bound"], strict=True)) == known


class Swelling(Rotating):
    """Made from what has one frequency, with functions of its own that have two."""

    def basis(self, time):
        return (Harmonic(self.frequency).basis(time) + Harmonic(2 * self.frequency).basis(time)) / 2


def test_what_has_one_frequency_is_held_against_less():
    """On the trimming ring 2 √2 · 2.475 ā = 35.0 m: not several frequencies nor a position."""
    attacks = [
        "rotating",
        "sinusoid",
        "bias",
        "multisine",
        {"kind": "sinusoid", "orders": [0]},
        Swelling(),
    ]
    study = systems.study(horizon=60, sweep={"attack": attacks})
    cells = list(range(len(attacks)))
    below, over = (
        violations_table(results_of(study, cell=cells, tail_max=[e] * len(cells)))
        for e in (34.9, 35.1)
    )
    assert "harmonic" not in set(below["bound"])
    found = over.query("bound == 'harmonic'")
    assert found["cell"].tolist() == [0, 1, 2]
    assert found["limit"].to_numpy() == pytest.approx(2.475 * np.sqrt(8) * 5, rel=1e-5)


@pytest.mark.parametrize("channel", ["neighbour", "navigator"])
def test_the_transient_is_that_of_the_drawn_start(channel):
    """Against the reference program's jets and displacements, lane by lane; ā is the lane's own."""
    attack = {
        "kind": "rotating",
        "vehicles": [1, 2],
        "links": channel,
        "magnitude": {"uniform": [1, 9]},
    }
    keys = {
        "vehicles": 4,
        "topology": {"kind": "edges", "edges": EDGES},
        "gain": GAIN,
        "defence": "none",
    }
    (cell,) = systems.study(attack=attack, **keys).cells
    times, samples = np.array([0.0, 0.7, 3.0]), [0, 4, 2]
    found = limits_of(cell.scenario, Keyed(0), samples, times)
    lanes = job(cell.scenario, Keyed(0), samples)
    for n in range(len(samples)):
        one = systems.lane(lanes, n)
        cosine, sine = one.vectors.transpose(2, 0, 1)
        size = np.linalg.norm(cosine, axis=0).max()  # its frequency is under 1 rad/s
        w, links = one.signal.frequency, one.links
        signal = [cosine, w * sine, -(w**2) * cosine]
        added = np.zeros((3, 4, 5, 2))
        for k, jet in enumerate(signal):
            for i, j in np.argwhere(links):
                added[k, i, j] = jet[:, i if j == 0 else j - 1]
        navigator = np.array([[0, 0], [20, 20], [0, 0]])
        free = reference.flat_jets(one.initial.T) - navigator[:, None]
        shifts = np.einsum("ij,kijx->kix", one.weights, added)
        forced = np.linalg.solve(np.eye(4) - one.weights[:, 1:], shifts)
        gains = np.linalg.solve(np.eye(4) - one.weights[:, 1:], (one.weights * links).sum(axis=1))
        for bound, slopes, start in (
            ("static", gains, free - forced),
            ("peak_gain", peak_gain(GAIN) * gains, free),
        ):
            for t, limit in zip(times, found[bound][:, :, n], strict=True):
                flow = np.abs(expm(reference.companion(GAIN) * t)[0])
                expected = slopes * size + flow @ np.linalg.norm(start, axis=2)
                np.testing.assert_allclose(limit, expected, rtol=2e-9, atol=1.1e-5)


def peak_gain(gain):
    """`β ‖H‖₁`, by summing |h| over small steps."""
    flow, state, total = expm(reference.companion(gain) * 1e-3), np.array([0.0, 0.0, 1.0]), 0.0
    for _ in range(40_000):
        total += abs(state[0]) * 1e-3
        state = flow @ state
    return (1 + sum(gain)) * total


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"sensing": {"position": 0.1}}, "sensors err"),
        (
            {"gain": [{"uniform": [1, 2]}, 3, 3]},
            "networks, weights or gains are drawn for each lane",
        ),
        ({"attack": "freeze"}, "ā does not bound the attack"),
        (
            {"attack": {"kind": "rotating", "sybils": 1}},
            "attacked vehicles have several identities",
        ),
        ({"law": "rounds"}, "the law (rounds) is not solved at every instant"),
        ({"defence": "w_msr"}, "the defence may drop neighbours or change weights"),
    ],
)
def test_cells_without_a_bound_have_their_own_reason(keys, why):
    """One reason a cell, and none for the cell that has a bound or no attack."""
    key, value = next(iter(keys.items()))
    plain = {"gain": [1, 3, 3], "attack": "none", "defence": "none"}.get(key)
    assert bounds.unchecked_words(systems.study(**keys).cells) == f"cell 0: {why}"
    if plain is not None:
        cells = systems.study(sweep={key: [plain, value]}).cells
        assert bounds.unchecked_words(cells) == f"cell 1: {why}"
