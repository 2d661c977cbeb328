"""Attack gain of a scenario's network.

The module imports no JAX, so that a config is checked at once.
"""

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import Situation, differs_by_lane, is_ideal, situation_of
from jaxnet.kinds.attacks import heard_orders, magnitude_shares
from jaxnet.theory import spread
from jaxnet.theory.spread import AttackGain


def scenario_gain(scenario: Scenario) -> AttackGain | None:
    """Return the gains γ of a scenario's network, by which bounds multiply ā.

    None if they are unknown (`gap_of_theory` says why). If the attacked vehicles are drawn, the gains are
    those of an attack on all vehicles.
    """
    known = situation_of(scenario)
    if gap_of_theory(scenario, known) or known.retained is None:
        return None
    carried = ~(known.attacked & scenario.attack.replaces())
    attack = scenario.attack
    order = scenario.vehicle.order
    orders, shares = tuple(heard_orders(attack, order)), magnitude_shares(attack, order)
    smooth = attack.consistent() and not attack.strategic and not attack.splits() and not attack.periods()
    return spread.attack_gain(known.retained, known.attacked, carried, smooth, orders, shares)


def gap_of_theory(scenario: Scenario, known: Situation) -> str:
    """Return why no bound is known for a scenario; "" if a bound is known."""
    if not scenario.navigator.present:
        return "there is no navigator"
    if not is_ideal(scenario):
        return "vehicles sense with errors or messages are lost"
    if differs_by_lane(scenario):
        return "networks, weights or gains are drawn for each lane"
    if scenario.gain_matrices is not None:
        return "gains differ by axis or vehicle, or couple the axes"
    if not scenario.attack.bounded:
        return "ā does not bound the attack"
    if scenario.attack.identities() > 1:
        return "attacked vehicles have several identities"
    if not scenario.law.solved:
        return (
            "the law holds the jerk between ticks"
            if scenario.law.holds
            else f"the law is {scenario.law.kind}"
        )
    return "" if known.retained is not None else "the defence may retain any neighbour"
