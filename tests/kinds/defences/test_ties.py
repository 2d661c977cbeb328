"""Liars equally far off: whom vehicles retain does not depend on the last bit of a number."""

import numpy as np
import pytest

from tests import systems

GRAPH = {"kind": "random_regular", "degree": 5, "navigator_weight": 0.1, "redraw": True}
KEYS = {"engine": "exact", "topology": GRAPH, "horizon": 10.0, "tail": 5.0, "tick": 0.1}
DEFENCES = [{"kind": "trusted_trim", "score": score} for score in ("position", "announced")]
DEFENCES += ["ms_norm", "w_msr", "coordinate_median"]
LANES = 24


def a_bit_off(one, seed):
    """The lanes with each number of start and attack the next above or below, or the same."""
    rng, lane = np.random.default_rng(seed), one.inputs.lane

    def moved(number):
        towards = np.array([-np.inf, 0.0, np.inf])[rng.integers(3, size=number.shape)]
        return np.where((towards == 0) | (number == 0), number, np.nextafter(number, towards))

    lane = lane._replace(initial=moved(lane.initial), vectors=moved(lane.vectors))
    return one._replace(inputs=one.inputs._replace(lane=lane))


@pytest.mark.long
@pytest.mark.parametrize("defence", DEFENCES, ids=str)
def test_the_last_bit_moves_nobody(defence):
    """Four liars tell the navigator's path with offsets of one size; starts differ by rounding."""
    kind = "bias" if defence == "coordinate_median" else "rotating"
    attack = {"kind": kind, "threat": "replaces"}
    study = systems.study(defence=defence, attack=attack, **KEYS)
    one = systems.lanes(study, LANES)
    ours, theirs = systems.simulate(one), systems.simulate(a_bit_off(one, 0))
    assert (ours.status == 0).all()
    for name, metric in ours.metrics.items():
        np.testing.assert_allclose(metric, theirs.metrics[name], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(ours.switches, theirs.switches)


@pytest.mark.parametrize(
    "defence", ["trusted_trim", pytest.param("ms_norm", marks=pytest.mark.long)]
)
def test_of_equal_ones_the_lower_number_is_dropped(defence):
    """At t = 0, by whoever hears two of four liars as far from the navigator, whom it trusts."""
    attack = {"kind": "rotating", "threat": "replaces", "magnitude": 1e3}
    initial = {"position": 0.0}
    study = systems.study(defence=defence, attack=attack, initial=initial, **KEYS)
    one = systems.lanes(study, LANES)
    kept, number = systems.simulate(one).series["kept"][:, 0], 0
    for lane, weights in enumerate(kept):
        heard = systems.lane(one, lane).weights > 0
        for listener in range(12):
            liars = [j for j in (2, 5, 8, 11) if heard[listener, j]]
            if len(liars) > 1 and heard[listener, 0]:
                assert [j for j in liars if weights[listener, j] == 0] == liars[:1]
                number += 1
    assert number > 100
