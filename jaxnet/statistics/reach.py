"""Attack gain of a scenario's network.

The module imports no JAX, so that a config is checked at once.
"""

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import differs_by_lane, situation_of
from jaxnet.theory import spread
from jaxnet.theory.spread import AttackGain


def scenario_gain(scenario: Scenario) -> AttackGain | None:
    """Return the gains γ of a scenario's network, by which bounds multiply ā.

    None if they are unknown: the retained neighbours are unknown, or differ between lanes; ā does not bound
    the attack; sources have several identities; or the law holds a jerk. If the attacked vehicles are drawn,
    the gains are those of an attack on all vehicles.
    """
    known = situation_of(scenario)
    if known.retained is None or differs_by_lane(scenario):
        return None
    carried = ~(known.attacked & scenario.attack.replaces())
    attack = scenario.attack
    if not attack.bounded or attack.identities() > 1 or scenario.law.holds:
        return None
    smooth = attack.consistent() and not attack.strategic and not attack.splits()
    return spread.attack_gain(known.retained, known.attacked, carried, smooth, attack.falsified())
