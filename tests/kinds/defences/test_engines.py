"""Every rule in both engines, and what no rule may promise."""

import numpy as np
import pytest

from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.kinds import registry
from tests import systems

NAMES = [name for name in registry.kind_names("defence") if name != "none"]
LOSSY = {"channel": {"loss": {"kind": "bernoulli", "probability": 0.3}}, "sensing": {"position": 0.1}}
GRAPH = {"vehicles": 6, "topology": {"kind": "random_regular", "degree": 4}, "tick": 0.1}


@pytest.mark.parametrize("name", NAMES)
def test_both_engines_agree_on_every_rule(name):
    """Positions to 1e-6 m and weights in force to 1e-8; each hears five and one of six transmits falsely.

    Rules that weigh, that drop by axis and that remember judge what arrived, for messages are lost.
    """
    keys = {**GRAPH, "attack": {"kind": "rotating", "vehicles": [2]}, "defence": name}
    keys |= {"horizon": 2.0, "tail": 1.0, "output_step": 0.1}
    keys |= LOSSY if name in ("geometric_median", "w_msr", "trust") else {}
    exact, nonlinear = (
        systems.simulate(systems.lanes(systems.study(engine=engine, **keys), 2))
        for engine in ("exact", {"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-12})
    )
    assert exact.status.tolist() == nonlinear.status.tolist() == [0, 0]
    assert exact.unheard.tolist() == nonlinear.unheard.tolist()
    assert exact.switches.tolist() == nonlinear.switches.tolist()
    positions = (outcome.series["state"][..., :2] for outcome in (exact, nonlinear))
    assert np.abs(np.subtract(*positions)).max() <= 1e-6
    np.testing.assert_allclose(exact.series["kept"], nonlinear.series["kept"], rtol=0, atol=1e-8)


def lying(defence):
    """One tells where he is and lies about how he moves, which rules that judge positions let pass."""
    attack = {"kind": "spoof", "vehicles": [2], "orders": [1, 2, 3], "magnitude": 10.0}
    return systems.study(**GRAPH, attack=attack, defence=defence, engine="exact", horizon=60.0, tail=1.0)


def safe(study):
    """Whether each vehicle is safe for one reason or another."""
    known = situation_of(study.cells[0].scenario)
    reasons = safe_in(study.cells[0].scenario, known.graph, known.attacked)
    return np.any([each.vehicles for each in reasons], axis=0).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_one_rule_alone_promises_anything(name):
    assert safe(lying(name)) == [name == "trusted_only"] * 6


@pytest.mark.parametrize(
    ("defence", "holds"),
    [
        ("trusted_only", True),
        ({"kind": "trusted_trim", "score": "announced"}, True),
        ({"kind": "trust", "observation": "random"}, True),
        ({"kind": "ms_norm", "F": 4}, True),
        ("trusted_trim", False),
        ("clipping", False),
        ("w_msr", False),
        ({"kind": "ms_norm", "noise": 5.0}, False),
    ],
    ids=str,
)
def test_a_guarantee_holds_and_where_none_is_told_the_rule_is_broken(defence, holds):
    study = lying(defence)
    assert safe(study) == [holds] * 6
    outcome = systems.simulate(systems.lanes(study, 4, ()))
    assert (outcome.status == 0).all()
    worst = outcome.metrics["tail_max"].max()
    assert worst < 1e-6 if holds else worst > 10.0
