"""The distance that filtered vehicles keep (theorems.md O18)."""

from jaxnet.theory.case import Case


def kept(case: Case) -> float | None:
    """Distance [m] that vehicles keep which start so far apart; None where nothing is proved."""
    scenario, engine = case.scenario, case.scenario.engine
    if engine.samples and not scenario.vehicle.holds_velocity:
        return None
    return scenario.filter.keeps(scenario.tick if engine.samples else 0.0)
