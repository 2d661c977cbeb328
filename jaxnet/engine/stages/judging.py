"""Judge: a vehicle decides which sources to retain, by jets with the noise of its defence."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import LaneFlags, LinkFlags, Moment, PerLink, VehicleFlags, tell
from jaxnet.engine.stages.channel import Reception, messages_now, with_sum_one
from jaxnet.engine.stages.late import OnTime
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.shapes import Decision, Memory
from jaxnet.model import control, retained, xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane


class Judged(eqx.Module):
    """Sources that vehicles retain: all."""

    def next(
        self, now: Moment, sensed: Sensed, late: OnTime, links: LinkErrors, heard: Reception
    ) -> "Judged":
        return self

    def in_force(self, lane: Lane) -> AxisWeights:
        """Weights that would be in force if every message had arrived."""
        return lane.weights[None]

    def believed(self, lane: Lane) -> AxisWeights:
        """Weights of the retained sources, not normalised."""
        return lane.weights[None]

    def seen(self, lane: Lane) -> Decision:
        """The decision as attackers see it."""
        return jnp.ones(lane.weights.shape, bool)

    def changed(self, before: "Judged", lane: Lane) -> tuple[LaneFlags, VehicleFlags]:
        """Lanes whose decision changed, and vehicles whose retained sources did."""
        nothing = jnp.zeros(lane.weights.shape[1:], bool)
        return nothing.any(axis=0), nothing

    def single(self, lane: Lane) -> Decision | None:
        """Retained sources by axis, where all weights in force follow from them; else None."""
        return None


class Decided(Judged):
    """Sources that vehicles retain by their defence's decision, ([2,] slots, m, lanes)."""

    decision: Decision
    memory: Memory  # of the defence

    def next(self, now, sensed, late, links, heard):
        lane, own = now.lane, sensed.of(now.errors)
        received = links.of(late.jets(now, now.carried(tell(own))))
        weights, arrived = lane.weights, heard.arrivals
        if arrived is not None:  # a slot without a message holds the vehicle itself
            each = zip(received, own, strict=False)
            received = tuple(jnp.where(arrived[None], jet, mine[:, None]) for jet, mine in each)
            weights = with_sum_one(jnp.where(arrived, weights, 0.0), axis=0)
        messages = messages_now(now, late, links, heard)
        around = surroundings(now, self.memory, weights, arrived, messages)
        observed = lane.defence.judges_by(received, now.time)
        decision, memory = lane.defence.decide(own, observed, self.decision, self.memory, around)
        usable = jnp.broadcast_to(lane.weights > 0, decision.shape)  # other slots never count
        if decision.dtype == bool:
            decision = decision | ~usable
        else:
            decision = jnp.where(usable, decision, 0.0)
        if arrived is not None and messages is None:
            decision = jnp.where(arrived, decision, self.decision)
        return Decided(decision, memory)

    def in_force(self, lane):
        """A vehicle that retains nobody has weights 0, or NaN if its law couples vehicles."""
        weights = retained.in_force(lane.weights, self.decision)
        if lane.law.couples():
            return weights
        return jnp.where((self.believed(lane) > 0).any(axis=1, keepdims=True), weights, 0.0)

    def believed(self, lane):
        support = retained.support(self.decision).reshape(-1, *lane.weights.shape)
        return jnp.where(support, lane.weights[None], 0.0)

    def seen(self, lane):
        return self.decision

    def changed(self, before, lane):
        assert isinstance(before, Decided)
        supports = [retained.support(one.decision) for one in (self, before)]
        # 2.7 times, W-MSR, 12 vehicles
        vehicles = xla.materialised(lambda: retained.changed(*supports))
        if self.decision.dtype == bool:
            return xla.in_any_row(vehicles), vehicles
        return xla.in_any_row(self.decision != before.decision), vehicles

    def single(self, lane):
        if self.decision.dtype != bool:
            return None
        return self.decision.reshape(-1, *lane.weights.shape)


def first_judged(now: Moment) -> Judged:
    """Decisions before the first tick: every vehicle retains every source."""
    if not now.plan.decides:
        return Judged()
    lane, defence, errors = now.lane, now.lane.defence, now.errors
    memory = defence.start(surroundings(now, None, lane.weights, None, announces=False))
    everybody = jnp.ones(lane.weights.shape, bool)
    messages = messages_now(now, OnTime(), LinkErrors(), Reception())
    around = surroundings(now, memory, lane.weights, None, messages)
    carried = now.carried(tell(errors))
    shape = jax.eval_shape(lambda: defence.decide(errors, carried, everybody, memory, around))[0]
    allowed = lane.weights.shape, (2, *lane.weights.shape)
    if shape.shape not in allowed or shape.dtype not in (jnp.bool_, jnp.float64):
        raise KindError(
            f"{defence.kind}.decide: a decision is boolean or double precision, of shape"
            f" {allowed[0]} or {allowed[1]} (got {shape.dtype} of shape {shape.shape})"
        )
    if shape.dtype == jnp.bool_:
        return Decided(jnp.ones(shape.shape, bool), memory)
    return Decided(jnp.broadcast_to(lane.weights, shape.shape), memory)


def surroundings(
    now: Moment,
    memory: Memory,
    weights: Float[Array, "slots m lanes"],
    arrived: LinkFlags | None,
    messages: PerLink | None = None,
    announces: bool = True,
) -> Neighbourhood:
    """Inputs of a defence besides the received jets; `weights` are of messages that arrived."""
    lane, hearing, attacked = now.lane, now.network.hearing, now.attacked_links()
    announced = lane.defence.announcement(memory) if announces else None
    if announced is not None:
        sent = jnp.concatenate([jnp.zeros_like(announced[:, :1]), announced], axis=1)
        carried = hearing.received(sent, control.driven(lane.gain, now.signals))
        announced = lane.announces.received(
            hearing.sent(sent), carried, attacked, hearing.signals, now.time
        )
        announced = lane.defence.overheard(announced, hearing.sources, now.time)
    return Neighbourhood(
        hearing.sources,
        weights,
        now.network.trusted,
        lane.gain,
        now.time,
        now.network.shared,
        announced,
        attacked,
        arrived,
        lane.weights > 0,
        messages,
    )
