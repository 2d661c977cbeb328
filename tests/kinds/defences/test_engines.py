"""Every rule in both engines, and what no rule may promise."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.kinds import registry
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.defences.centerpoint import Centerpoint
from jaxnet.kinds.defences.clipping import Clipping
from jaxnet.kinds.defences.coordinate_median import CoordinateMedian
from jaxnet.kinds.defences.geometric_median import GeometricMedian
from jaxnet.kinds.defences.ms_norm import MSNorm
from jaxnet.kinds.defences.trusted_only import TrustedOnly
from jaxnet.kinds.defences.w_msr import WMSR
from tests import systems

NAMES = [name for name in registry.kind_names("defence") if name != "none"]
LOSSY = {"channel": {"loss": {"kind": "bernoulli", "probability": 0.3}}}
LOSSY |= {"sensing": {"position": 0.1}}
GRAPH = {"vehicles": 6, "topology": {"kind": "random_regular", "degree": 4}, "tick": 0.1}


class EachItsOwn(Defence):
    """Vehicle i follows rule i of a list, the last one from there on."""

    def decide(self, own, received, last, memory, around):
        vehicle, found = jnp.arange(around.weights.shape[1])[None, None, :, None], None
        for number, rule in enumerate(RULES):
            decision, _ = rule.decide(own, received, last, rule.start(around), around)
            if decision.dtype == bool:
                decision = jnp.where(decision, around.weights, 0.0)
            weights = jnp.broadcast_to(decision, received[0].shape)
            found = weights if found is None else jnp.where(vehicle >= number, weights, found)
        return found, memory


RULES = [
    Centerpoint.filled({"drop_trusted": False}),
    Clipping.filled({"radius": jnp.full(1, 20.0), "drop_trusted": False}),
    CoordinateMedian.filled({"drop_trusted": False}),
    GeometricMedian.filled({"smoothing": jnp.full(1, 1.0), "rounds": 8}),
    MSNorm.filled({"F": 1, "drop_trusted": False}),
    WMSR.filled({"F": 1, "drop_trusted": False}),
    TrustedOnly.filled({"trusted": {}}),
]
# The latter two in both engines: tests/engine/test_reference.py
REMEMBERING = {"reputation", "trust", "trusted_trim", "vote"}


@pytest.mark.long
@pytest.mark.parametrize("defence", [EachItsOwn(), "trust"], ids=["each its own", "trust"])
def test_both_engines_agree_on_every_rule(defence):
    """Positions to 1e-6 m, weights in force to 1e-8; each hears five, one of seven lies.

    In one fleet each vehicle has another rule, in the other all remember. Messages are lost.
    """
    assert {rule.kind for rule in RULES} | REMEMBERING == set(NAMES)
    graph = {"vehicles": 7, "topology": {"kind": "circulant", "offsets": [1, 2, 3, 4]}, "tick": 0.1}
    keys = {**graph, "attack": {"kind": "rotating", "vehicles": [2]}, "defence": defence, **LOSSY}
    keys |= {"horizon": 2.0, "tail": 1.0, "output_step": 0.1}
    exact, nonlinear = (
        systems.outcome(2, engine=engine, **keys)
        for engine in ("exact", {"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-12})
    )
    assert exact.status.tolist() == nonlinear.status.tolist() == [0, 0]
    assert exact.unheard.tolist() == nonlinear.unheard.tolist()
    assert exact.switches.tolist() == nonlinear.switches.tolist()
    positions = (outcome.series["state"][..., :2] for outcome in (exact, nonlinear))
    assert np.abs(np.subtract(*positions)).max() <= 1e-6
    np.testing.assert_allclose(exact.series["kept"], nonlinear.series["kept"], rtol=0, atol=1e-8)
    assert (np.ptp(exact.series["kept"], axis=(0, 1)).max(axis=-1) > 0.01).all()  # each rule acts


def lying(defence):
    """One lies about how he moves, not where he is: rules that judge positions let him pass."""
    attack = {"kind": "spoof", "vehicles": [2], "orders": [1, 2, 3], "magnitude": 10.0}
    keys = GRAPH | {"engine": "exact", "horizon": 60.0, "tail": 1.0}
    return systems.study(attack=attack, defence=defence, **keys)


def safe(study):
    known = situation_of(study.cells[0].scenario)
    reasons = safe_in(study.cells[0].scenario, known.graph, known.attacked)
    return np.any([each.vehicles for each in reasons], axis=0).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_rules_that_believe_a_trusted_navigator_alone_promise_anything(name):
    assert safe(lying(name)) == [name in ("trusted_only", "vote")] * 6


@pytest.mark.long
@pytest.mark.parametrize(
    ("defence", "holds"),
    [
        ({"kind": "trusted_trim", "score": "announced"}, True),
        ({"kind": "trust", "observation": "random"}, True),
        ({"kind": "ms_norm", "F": 4}, True),
        ("trusted_only", True),
        ("trusted_trim", False),
        ("clipping", False),
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
