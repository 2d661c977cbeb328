"""What is known of clipped inputs and of standing still, against ROBOTS' figures and simulation."""

import math

import numpy as np
import pytest

import jaxnet
from jaxnet.statistics.limits import unclipped_words
from jaxnet.theory.case import Case
from jaxnet.theory.clipping import clipping_ratio, unclipped
from jaxnet.theory.solution import companion
from jaxnet.theory.start import keeps_moving
from jaxnet.theory.theorems import values
from jaxnet.view.text.check import check_text
from tests import systems

FREE = {"attack": "none", "defence": "none", "engine": "nonlinear"}


def case(**keys):
    (cell,) = systems.study(**FREE | keys).cells
    return Case(cell.scenario)


def poles_at_one(order):
    return np.array([math.comb(order, k) for k in range(order)], float)


@pytest.mark.parametrize(("order", "ratio"), [(1, 2.0), (2, 9.0), (3, 25.130820), (4, 56.005882)])
def test_the_level_of_the_set_without_clipping(order, ratio):
    assert clipping_ratio(poles_at_one(order)) == pytest.approx(ratio, abs=5e-7)
    assert clipping_ratio(-poles_at_one(order)) is None  # unstable, so P is not positive


def test_no_start_of_the_set_is_clipped_and_its_worst_almost():
    """`max |K x|` over the set is the limit: attained by `x ~ P⁻¹ K'`, and falling from there."""
    gain, limit = poles_at_one(2), 1.0
    matrix = companion(gain)
    P = np.array([[1.5, 0.5], [0.5, 0.5]])
    np.testing.assert_allclose(matrix.T @ P + P @ matrix, -np.eye(2), atol=1e-15)
    worst = np.linalg.solve(P, gain) / clipping_ratio(gain) * limit
    assert gain @ worst == pytest.approx(limit)
    assert worst @ P @ worst == pytest.approx(limit**2 / clipping_ratio(gain))


@pytest.mark.parametrize(("share", "clipped"), [(0.999, False), (1.02, True)])
def test_rows_agree_with_the_set(share, clipped):
    """An agent that starts at the set's worst place, a little inside or outside it."""
    limit, speed = 2.0, 1.0
    worst = share * limit * np.linalg.solve([[1.5, 0.5], [0.5, 0.5]], [1.0, 2.0]) / 9.0
    keys = {
        "vehicles": 1,
        "topology": "star",
        "navigator": {"kind": "driven", "speed": [speed, speed], "turn_rate": [0.0, 0.0]},
        "vehicle": {"kind": "double_integrator", "limits": {"input": limit}},
        "initial": {
            "position": [[float(worst[0]), 0.0]],
            "heading": 0.0,
            "speed": speed + float(worst[1]),
        },
        **systems.clock(0.1, 4.0, 1.0),
    }
    found = unclipped(case(**keys))
    assert found.left == limit
    assert found.level == pytest.approx(limit**2 / 9)
    results = jaxnet.simulate(FREE | keys, samples=1, progress=False)
    assert (results.lanes["saturated"].iloc[0] > 0) == clipped
    words = "" if clipped else "no input was saturated at any tick in cell 0"
    assert unclipped_words(results) == words


def test_the_navigator_takes_its_part_of_the_limit():
    """The figure eight accelerates at up to √(4² + 8²) m/s², an upper bound for each axis."""
    limited = {"kind": "double_integrator", "limits": {"input": 10.0}}
    found = unclipped(case(vehicle=limited))
    assert found.left == pytest.approx(10 - math.hypot(4.0, 8.0))
    assert not found.every_start
    assert unclipped(case(vehicle=limited | {"limits": {"input": 8.0}})) is None
    near = {"position": 0.0, "heading": math.pi / 4, "speed": 20 * math.sqrt(2)}
    assert unclipped(case(vehicle=limited, initial=near)).every_start


@pytest.mark.parametrize(
    "keys",
    [
        {"attack": {"magnitude": 1.0}},
        {"engine": "sampled"},
        {"law": "local"},
        {"channel": {"delay": 0.2}},
        {"vehicle": {"kind": "unicycle", "limits": {"acceleration": 5.0}}},
    ],
)
def test_nothing_is_told_without_the_premises(keys):
    limited = {"vehicle": {"kind": "double_integrator", "limits": {"input": 30.0}}}
    assert "unclipped" in values(case(**limited))
    assert "unclipped" not in values(case(**limited | keys))


def test_three_integrators_are_not_tamed():
    """Only limits make it so."""
    limited = {"kind": "two_wheeled", "limits": {"force_rate": 30.0}}
    told = check_text(systems.study(**FREE, vehicle=limited))
    assert "Sussmann and Yang" in told
    assert "Sussmann" not in check_text(systems.study(**FREE))


@pytest.mark.parametrize(("vehicle", "length"), [("two_wheeled", 48.874), ("unicycle", 35.959)])
def test_who_starts_near_never_comes_to_rest(vehicle, length):
    """Figure eight, with the navigator's velocity and acceleration."""
    found = keeps_moving(case(vehicle=vehicle))
    known = {"two_wheeled": [0.270671, 1.0, 0.230579], "unicycle": [math.exp(-1), 1.0]}[vehicle]
    np.testing.assert_allclose(found.factors, known, atol=1e-6)
    assert found.slowest / found.factors[0] == pytest.approx(length, abs=1e-3)
    assert not found.every_start
    assert keeps_moving(case(vehicle="single_integrator")) is None


def test_the_condition_is_sharp_on_a_line():
    """`1 - D t e^-t` first falls to 0 at D = e, for a unicycle D ahead of a navigator at 1 m/s."""
    line = {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]}
    keys = {"vehicle": "unicycle", "navigator": line, "horizon": 5.0, "vehicles": 1}
    keys |= {"topology": "star"}

    def met(ahead):
        start = {"position": [[ahead, 0.0]], "heading": 0.0, "speed": 1.0}
        return keeps_moving(case(**keys, initial=start)).every_start

    assert met(2.6)
    assert not met(math.e)
