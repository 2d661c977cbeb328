"""A tick as all stages see it: lanes, the fleets' errors, the attacks' functions and the time.

Jets are relative to the navigator: E = y - y_0 and its derivatives, (2, m, lanes), lanes last.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine.plan import Plan
from jaxnet.model import plane, signal
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis, Vectors

Instants = Float[Array, " lanes"]
LaneFlags = Bool[Array, " lanes"]
VehicleFlags = Bool[Array, "m lanes"]
LinkFlags = Bool[Array, "slots m lanes"]
PerAxis = Float[Array, "2 m lanes"]
PerLink = Float[Array, "2 slots m lanes"]
Sent = tuple[Float[Array, "2 sources lanes"], ...]
Received = tuple[PerLink, ...]


class Moment(NamedTuple):
    """A tick, before anything is decided. The lane has the weights and vectors in force."""

    lane: Lane
    network: Network
    plan: Plan
    errors: Jets
    basis: Basis
    time: Instants
    last: PerAxis  # drive of each vehicle until now, where it may be kept or heard; else 0
    told: PerAxis | None = None  # R of what each vehicle tells, where a defence hears it

    @property
    def order(self) -> int:
        return len(self.lane.gain)

    @property
    def navigator(self) -> Float[Array, "derivatives 2 lanes"]:
        return self.lane.path(self.time)

    @property
    def own(self) -> Jets:
        """Jets of the vehicles, relative to nobody."""
        return plane.plus(self.errors, self.navigator[: len(self.errors), :, None])

    @property
    def signals(self) -> Jets:
        return signal.jets(self.lane.vectors, self.basis)

    def attacked_links(self) -> LinkFlags:
        return attacked_links(self.network.hearing, self.lane.vectors)

    def carried(self, sent: Sent) -> Received:
        """Jets on each link, with the attacks' jets on attacked links."""
        received = self.network.hearing.received
        return tuple(received(*both) for both in zip(sent, self.signals, strict=False))


def tell(errors: Jets) -> Sent:
    """Jets that the navigator and the vehicles send. The navigator's come first and are 0."""
    return tuple(jnp.concatenate([jnp.zeros_like(jet[:, :1]), jet], axis=1) for jet in errors)


def attacked_links(hearing: Hearing, vectors: Vectors) -> LinkFlags:
    """Links that carry a signal with these vectors."""
    along, across = hearing.added(jnp.abs(vectors).sum(axis=2)) != 0
    return along | across


def misusing(vectors: Vectors) -> VehicleFlags:
    """Vehicles with a signal, where attacked vehicles misuse their inputs."""
    return (vectors != 0).any(axis=(0, 2))
