"""What the law asks of a vehicle from the messages of an instant, alike for all engines."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import Instants, PerAxis, misusing
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.tick import DecisionState, Drive
from jaxnet.kinds.laws import LinksInForce
from jaxnet.model import control, signal
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors


class Signals(NamedTuple):
    """Navigator and attack functions at one instant, with R(y_0) and R(β) of the law.

    R is computed here once, because a stage would compute R once for each vehicle.
    """

    time: Instants  # [s]
    navigator: Float[Array, "derivatives 2 lanes"]
    basis: Basis
    path: Float[Array, "2 lanes"]  # R(y_0)
    drive: Float[Array, "functions lanes"]  # R(β), see `control.drive_functions`
    inputs: Float[Array, "functions lanes"] | None  # of vehicles that misuse theirs; None: nobody


def signals(lane: Lane, time: Instants) -> Signals:
    navigator, basis = lane.path(time), lane.basis(time)
    path, drive = control.driven(lane.gain, navigator), control.drive_functions(lane.gain, basis)
    return Signals(time, navigator, basis, path, drive, lane.inputs(time))


def obeyed(demand: PerAxis, vectors: Vectors, now: Signals) -> PerAxis:
    """A demand, or the attack's signal where an attacked vehicle misuses its input."""
    if now.inputs is None:
        return demand
    return jnp.where(misusing(vectors), signal.combined(vectors, now.inputs), demand)


def coupled_demand(lane: Lane, network: Network, drive: Drive, own: Jets, now: Signals) -> PerAxis:
    """Right-hand side b of `L q = b`; `own` are the jets that vehicles sense of themselves."""
    attack = signal.combined(control.drive_vectors(lane.gain, drive.vectors), now.drive)
    demand = control.demand(own, now.path, attack, network.hearing, drive.weights, lane.gain)
    return drive.known.plus(demand, now.time)


def local_jerk(lane: Lane, network: Network, drive: Drive, own: Jets, now: Signals) -> PerAxis:
    """The r-th derivative that the local law asks for; `own` are the jets that vehicles sense."""
    attack, hearing = signal.jets(drive.vectors, now.basis), network.hearing
    silent = drive.known.silent((drive.weights == 0).all(axis=1))
    heeded = lane.law.heeds_highest(hearing.sources)
    given = own, now.navigator, attack, hearing, drive.weights, lane.gain, heeded
    demand = drive.known.plus(jnp.where(silent, 0.0, control.local_demand(*given)), now.time)
    demand = control.damped(drive.strength.times(demand), lane.damping, own)
    return obeyed(demand, drive.vectors, now)


def demand_by_link(
    lane: Lane, network: Network, drive: Drive, errors: LinkErrors, own: Jets, now: Signals
) -> PerAxis:
    """The r-th derivative that a law by link asks for; `errors` are those of the messages."""
    hearing, attack = network.hearing, signal.jets(drive.vectors, now.basis)
    told = (
        hearing.received(jnp.concatenate([led[:, None], mine], axis=1), lie)
        for led, mine, lie in zip(now.navigator, own, attack, strict=False)
    )
    received = errors.of(tuple(told))
    apart = tuple(jet - mine[:, None] for jet, mine in zip(received, own, strict=True))
    weights = drive.strength.rows(drive.weights)[:, None] * drive.weights
    return lane.law.demand(apart, LinksInForce(hearing.sources, weights, lane.gain, now.time))


def exchange(
    lane: Lane, network: Network, decided: DecisionState, own: Jets, now: Signals, last: PerAxis
) -> PerAxis:
    """The r-th derivative that vehicles hold until the next tick, under a law that holds one.

    `own` are a vehicle's own jets of y, and `last` is the derivative held until now, which a
    vehicle that hears nobody still holds.
    """
    drive = decided.drive(lane)
    own, weights = drive.sensed.of(own), drive.weights
    if lane.law.by_link:
        demand = demand_by_link(lane, network, drive, decided.links, own, now)
    else:
        asked = coupled_demand if lane.law.couples() else local_jerk
        demand = asked(lane, network, drive, own, now)
    demand = drive.coasting.held(demand, last)

    def heard(jerk: PerAxis) -> PerAxis:
        sources = jnp.concatenate([jnp.zeros_like(jerk[:, :1]), jerk], axis=1)
        return network.hearing.mean(weights, sources, jnp.zeros_like(drive.vectors[:, :, 0]))

    return obeyed(lane.law.exchange(last, demand, heard), drive.vectors, now)
