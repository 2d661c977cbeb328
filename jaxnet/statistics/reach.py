"""Attack gain of a scenario's network.

The module imports no JAX, so that a config is checked at once.
"""

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import BOUNDS, broken_premise, situation_of
from jaxnet.kinds.attacks import heard_orders, magnitude_shares
from jaxnet.theory import spread
from jaxnet.theory.spread import AttackGain


def scenario_gain(scenario: Scenario) -> AttackGain | None:
    """Return the gains γ of a scenario's network, by which bounds multiply ā.

    None without the premises of BOUNDS. If the attacked vehicles are drawn, the gains are those of
    an attack on all vehicles.
    """
    if broken_premise(scenario, BOUNDS):
        return None
    known = situation_of(scenario)
    assert known.retained is not None
    carried = ~(known.attacked & scenario.attack.replaces())
    attack = scenario.attack
    order = scenario.vehicle.order
    orders, shares = tuple(heard_orders(attack, order)), magnitude_shares(attack, order)
    smooth = (
        attack.consistent()
        and not attack.strategic
        and not attack.splits()
        and not attack.periods()
    )
    return spread.attack_gain(known.retained, known.attacked, carried, smooth, orders, shares)
