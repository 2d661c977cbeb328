"""The attacks that searches found, as docs/search.md tells of them."""

from pathlib import Path

import pytest

import jaxnet

CONFIGS = Path(__file__).parents[2] / "configs"
HORIZON = {"samples": 1, "horizon": 100.0}


@pytest.mark.long
@pytest.mark.parametrize(("name", "left"), [("lasting", 1.04), ("lasting_greatest", 2.81)])
def test_feedback_with_a_filter_ends_as_far_off_as_the_page_says(name, left):
    """From the start of the search, at 100 s."""
    study = jaxnet.load(CONFIGS / f"{name}.yaml", HORIZON)
    (found,) = jaxnet.simulate(study, progress=False).lanes["tail_max"]
    assert found == pytest.approx(left, rel=5e-3)


@pytest.mark.long
def test_what_is_announced_bears_the_same_attack():
    """The announcements stay 0, and with them what drives the fleet but for drift in a tick."""
    announced = {"defence": {"kind": "trusted_trim", "score": "announced"}}
    study = jaxnet.load(CONFIGS / "lasting.yaml", HORIZON | announced)
    (found,) = jaxnet.simulate(study, progress=False).lanes["tail_max"]
    assert found < 1e-9
