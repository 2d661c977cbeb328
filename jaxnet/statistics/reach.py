"""How far the attack of a scenario spreads through its network.

The module needs no JAX, so that a config is checked at once.
"""

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import differs_by_lane, situation_of
from jaxnet.theory import spread
from jaxnet.theory.spread import AttackGain


def scenario_gain(scenario: Scenario) -> AttackGain | None:
    """Gains γ of a scenario's network, by which bounds multiply ā.

    None where they are not known: whom vehicles retain is not known, or differs from lane to lane; ā does not
    bound the attack; sources have several identities; a jerk is held. Where attacked vehicles are drawn, the
    gains are those of an attack on all.
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
