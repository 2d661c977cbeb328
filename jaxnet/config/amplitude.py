"""The amplitude in force: how far an attack of magnitude ā shifts a position that is received.

ā bounds the signal and its derivatives. A fast signal therefore has a small amplitude: a harmonic
of frequency ω shifts positions by ā / max(1, ω^r), with r = 3 the order of a robot.
"""

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.kinds.attacks import order_factors, own_numbers, signal_scale
from jaxnet.kinds.fields import Each
from jaxnet.kinds.kind import AnyKind, Kind, holds_drawn


def known_amplitude(scenario: Scenario) -> float:
    """Return the greatest distance by which attacked links shift a position [m].

    The amplitude is not-a-number without an attack, where ā bounds nothing, and where lanes or
    vehicles differ. The attack's code has to be available.
    """
    attack = scenario.attack
    if (
        not attack.present
        or not attack.bounded
        or any(own_numbers(attack))
        or draws_functions(attack)
    ):
        return np.nan
    if 0 not in attack.falsified():
        return 0.0
    order = scenario.vehicle.order
    alone = of_one_lane(attack).of_order(order)
    sizes = np.asarray(alone.sizes(scenario.horizon))
    shifted = signal_scale(alone, sizes, order) * (order_factors(alone, sizes, order) * sizes)[0]
    return float(shifted.ravel()[0])


def draws_functions(kind: Kind) -> bool:
    """Return whether numbers on which the signal's functions depend are drawn."""
    for key, field in type(kind).model_fields.items():
        value = getattr(kind, key)
        if isinstance(value, Kind) and draws_functions(value):
            return True
        own = any(isinstance(mark, Each) for mark in field.metadata)
        if holds_drawn(value) and not own and not isinstance(value, Kind):
            return True
    return False


def of_one_lane(kind: AnyKind) -> AnyKind:
    values = {key: getattr(kind, key) for key in type(kind).model_fields}
    numbers = {key: np.array([value]) for key, value in values.items() if isinstance(value, float)}
    inner = {key: of_one_lane(value) for key, value in values.items() if isinstance(value, Kind)}
    return kind.filled(values | numbers | inner)
