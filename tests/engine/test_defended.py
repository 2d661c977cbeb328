"""What holds and what does not: scores of the trimming under attacks that defeat some of them (O11)."""

import numpy as np
import pytest

import jaxnet
from jaxnet.config.scenario import situation_of
from tests import systems

PAIR = {
    "vehicles": 4,
    "topology": {
        "kind": "edges",
        "edges": [[1, 2, 1], [1, 3, 1], [1, 4, 1], [2, 1, 1], [2, 3, 1], [2, 4, 1], [3, 0, 1], [4, 0, 1]],
    },
    "attack": {"kind": "bias", "magnitude": 5.0, "vehicles": [4]},
    "engine": "exact",
    "horizon": 60.0,
    "tail": 1.0,
    "tick": 0.1,
}
TRUST = {"kind": "trusted_trim", "theta": {1: 1, 2: 1}, "trusted": {1: [2], 2: [1]}}
SCORES = {
    "feedback": {"score": "feedback", "filter": 1.0},
    "announced": {"score": "announced"},
}


def unrecovered(study, samples):
    """Share of lanes that end farther off than a hundredth of ā."""
    outcome = systems.simulate(systems.lanes(study, samples, ()))
    assert (outcome.status == 0).all()
    return (outcome.metrics["tail_mean"] > 0.01 * study.config.attack.magnitude).mean(), outcome


def test_two_who_trust_each_other_know_nothing():
    """About half of the lanes end exactly ā off, though Assumptions 1 and 2 hold; `safe` promises nothing."""
    study = systems.study(defence=TRUST, **PAIR)
    share, outcome = unrecovered(study, 300)
    assert abs(share - 0.5) < 4 * np.sqrt(0.25 / 300)
    ended = outcome.metrics["tail_max"]
    assert np.mean((ended < 1e-6) | (np.abs(ended - 5.0) < 1e-6)) > 0.98  # a few still change sides
    known = situation_of(study.cells[0].scenario)
    safe = study.config.defence.safe(known.weights, known.attacked, known.trusted)
    assert safe.vehicles.tolist() == [False, False, True, True]


def test_what_is_announced_saves_them():
    """All four are safe, and no lane fails; the same by contraction's own account."""
    study = systems.study(defence={**TRUST, "score": "announced"}, **PAIR)
    known = situation_of(study.cells[0].scenario)
    assert study.config.defence.safe(known.weights, known.attacked, known.trusted).vehicles.all()
    assert unrecovered(study, 300)[0] == 0


@pytest.mark.parametrize("score", ["feedback", "announced"])
def test_the_ring_by_score(score):
    """Rotating at 1.4 rad/s, where seven in ten lanes do not recover by position: none by what drives."""
    study = systems.study(
        attack={"kind": "rotating", "frequency": 1.4, "magnitude": 10.0},
        defence={"kind": "trusted_trim", **SCORES[score]},
        engine="exact",
        horizon=90.0,
        output_step=0.5,
    )
    assert unrecovered(study, 100)[0] == 0


@pytest.mark.parametrize(("score", "saves"), [("feedback", False), ("announced", True)])
def test_a_false_third_derivative_alone(score, saves):
    """Positions, velocities and accelerations do not show it; what is announced does."""
    study = systems.study(
        attack={"kind": "spoof", "orders": [3], "magnitude": 10.0, "direction": {"uniform": [0, 6.28]}},
        defence={"kind": "trusted_trim", **SCORES[score]},
        engine="exact",
        horizon=90.0,
        output_step=0.5,
    )
    share, _ = unrecovered(study, 100)
    assert share == 0 if saves else share > 0.9


def test_trusted_sources_alone_are_exact():
    """The ring, where all hear the navigator: under an attack that defeats trimming no lane is off."""
    study = jaxnet.load(
        {
            "name": "test",
            "attack": {"kind": "spoof", "magnitude": 10.0},
            "defence": "trusted_only",
            "engine": "exact",
            "horizon": 60.0,
            "tail": 1.0,
        }
    )
    known = situation_of(study.cells[0].scenario)
    assert study.config.defence.safe(known.weights, known.attacked, known.trusted).vehicles.all()
    _, outcome = unrecovered(study, 50)
    assert outcome.metrics["tail_max"].max() < 1e-9
