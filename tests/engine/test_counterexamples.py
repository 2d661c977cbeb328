"""The counterexamples of docs/guarantees.md, simulated: with all assumptions no lane is lost."""

import numpy as np
import pytest

from experiments import counterexamples
from jaxnet.engine.status import Status
from tests import systems


def ended(study):
    """Four lanes: their statuses, and the greatest error of any vehicle over ā."""
    outcome = systems.simulate(systems.lanes(study, 4, ()))
    return outcome.status, outcome.metrics["tail_max"] / counterexamples.MAGNITUDE


BUT_B1 = [each for each in counterexamples.ASSUMPTIONS if not each[0].startswith("B1")]


@pytest.mark.long
@pytest.mark.parametrize(("name", "keys"), BUT_B1, ids=lambda given: str(given)[:2])
def test_each_assumption_is_needed(name, keys):
    """Half of ā off or more, or cut off. B1: tests/kinds/attacks/test_announces.py."""
    status, worst = ended(counterexamples.pair(**keys))
    if name.startswith("A3"):
        assert (status == Status.disconnected).all()
    elif name == "none":
        assert worst.max() < 1e-12
    else:
        assert worst.min() > 0.499


@pytest.mark.long
def test_between_ticks_the_error_is_of_the_order_of_the_tick():
    """Half the tick and half the attack, as R(a) that changes no faster allows: half the error."""
    sizes = counterexamples.MAGNITUDE / np.array([1, 2])
    studies = [
        counterexamples.pair(attack=counterexamples.between_ticks(tick, size), tick=tick)
        for tick, size in zip((0.1, 0.05), sizes, strict=True)
    ]
    whole, half = (ended(study)[1] for study in studies)
    np.testing.assert_allclose(whole, 0.5, rtol=1e-4)
    np.testing.assert_allclose(half, 0.25, rtol=1e-4)


@pytest.mark.parametrize(
    ("score", "lost"),
    [({"score": "feedback"}, True), ({"score": "feedback", "filter": 1.0}, False)],
)
def test_what_passes_through_zero_is_retained_unless_filtered(score, lost):
    """A circle of P(a) through the origin at 16 rad/s, on the ring."""
    status, worst = ended(counterexamples.ring(counterexamples.orbit(16.0), score, 0.05))
    assert (status == Status.ok).all()
    assert worst.min() > 0.1 if lost else worst.max() < 1e-9
