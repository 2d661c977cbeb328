"""Attacks written out from their words for one vehicle, differentiated by JAX."""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from tests import reference, systems
from tests.reference import navigator_at


def along(angle):
    """The unit vector of a direction."""
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def risen(x):
    """The chance that of seven trials, each lucky with probability x, at least four are."""
    x = jnp.clip(x, 0.0, 1.0)
    return sum(math.comb(7, j) * x**j * (1 - x) ** (7 - j) for j in range(4, 8))


def signal(kind, numbers, t):
    """The unit signal of one vehicle at a time: (2,)."""
    match kind:
        case "bias":
            return along(numbers["direction"]) + 0 * t
        case "sinusoid":
            return jnp.sin(numbers["frequency"] * t + numbers["phase"]) * along(
                numbers["direction"]
            )
        case "rotating":
            return along(numbers["frequency"] * t + numbers["phase"])
        case "chirp":
            return along(numbers["frequency"] * t + numbers["rate"] * t * t / 2 + numbers["phase"])
    height = risen((t - numbers["start"]) / numbers["rise"])
    if numbers["stop"] is not None:
        height = height - risen((t - numbers["stop"]) / numbers["rise"])
    return height * signal(kind[1], numbers["of"], t)


@functools.partial(jax.jit, static_argnums=0)
def differentiated(kind, numbers, times):
    """The unit signal and its first three derivatives: (4, times, 2)."""
    orders = [functools.partial(signal, kind, numbers)]
    for _ in range(3):
        orders.append(jax.jacfwd(orders[-1]))
    return jnp.stack([jax.vmap(order)(times) for order in orders])


def numbers_of(drawn, lane, vehicle):
    """The kind's name, one with another in it as a pair, and its numbers in one lane for one vehicle."""
    inner = getattr(drawn, "of", None)
    values: dict[str, Any] = {"stop": None}
    for key, each in vars(drawn).items():
        if isinstance(each, np.ndarray):
            values[key] = each[vehicle - 1, lane] if each.ndim == 2 else each[lane]
    if inner is None:
        return drawn.kind, values
    kind, values["of"] = numbers_of(inner, lane, vehicle)
    return (drawn.kind, kind), values


def attack_of(given, samples):
    """A study's attack with its numbers drawn."""
    scenario = given.cells[0].scenario
    return scenario.attack.drawn(
        Draw(Keyed(given.config.seed), range(samples), scenario.vehicles), "attack"
    )


def unit_jets(drawn, lane, vehicle, times):
    """The unit signal of a vehicle in a lane, with three derivatives: (4, times, 2)."""
    return np.asarray(differentiated(*numbers_of(drawn, lane, vehicle), jnp.asarray(times)))


def sizes(drawn, lane, times):
    """Norms of the unit signal and its derivatives: (4, times)."""
    return np.linalg.norm(unit_jets(drawn, lane, 1, times), axis=-1)


def positions(given, one, lane, scale, ticks, interval):
    """Where the vehicles of an untrimmed lane are at every tick, attacked vehicles' signals times a scale."""
    drawn, alone = attack_of(given, one.size), systems.lane(one, lane)
    m, times = len(alone.weights), np.arange(ticks + 1) * interval
    jets = {j: scale * unit_jets(drawn, lane, j, times) for j in drawn.targets()}

    def attack(t):
        received = np.zeros((4, m, m + 1, 2))
        for i, j in np.argwhere(alone.links):
            received[:, i, j] = jets[j or i + 1][:, round(t / interval)]
        return received

    return reference.propagate(
        alone.weights,
        navigator_at(one, lane),
        attack,
        alone.gain,
        reference.flat_jets(alone.initial.T),
        interval,
        ticks,
    )["positions"]
