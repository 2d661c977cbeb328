"""An observer of a vehicle, its neighbours and theirs, from what neighbours pass on."""

from typing import Any, NamedTuple

from jaxnet.kinds.fields import NotNegative, Positive, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.observers import Compared, HeardMessages, Observer
from jaxnet.kinds.shapes import AnyMask, AnyNumbers, SlotMask, SlotVectors
from jaxnet.lazy import jnp

MOST_OBSERVED = 100  # each holds a copy of the fleet's links


class ExpectedAround(NamedTuple):
    """What vehicles expect. The observed vehicles of all listeners are one axis, m · m."""

    around: AnyMask  # whether a listener observes a vehicle, (m · m, lanes)
    state: AnyNumbers  # positions [m] and velocities [m/s], (2, 2, m · m, lanes)
    residuals: SlotVectors  # of the last messages, by the positions expected after them [m]
    known: SlotMask


class NeighbourhoodObserver(Observer):
    """A vehicle simulates itself, its neighbours and theirs, and is drawn towards what they tell.

    All are assumed to obey `ẍ_k = -gain Σ_l (x_k - x_l) - damping ẋ_k` on the links that the
    vehicle knows: its own, and those that its neighbours tell. The simulation starts anew if the
    observed vehicles change. A message is compared with the position expected after it, so its
    alarm comes a tick later.

    Source: Bahrami and Jafarnejadsani, arXiv 2410.04547.
    """

    tells_covariance = False

    gain: Positive = setting(1.0, "[s⁻²], of each link")
    damping: NotNegative = setting(3.0, "[1/s], of each vehicle")

    def start(self, heard):
        slots, m, lanes = heard.weights.shape
        nobody, nothing = jnp.zeros((m * m, lanes), bool), jnp.zeros((2, 2, m * m, lanes))
        return ExpectedAround(
            nobody, nothing, jnp.zeros((2, slots, m, lanes)), heard.arrived & False
        )

    def compared(self, heard, memory: ExpectedAround):
        residuals = jnp.zeros_like(heard.received).at[0].set(memory.residuals)
        return Compared(residuals, None, memory.known)

    def advance(self, heard, memory: ExpectedAround):
        m, lanes = heard.weights.shape[1:]
        known = heard.arrived & (heard.weights > 0)
        near, told = by_pair(heard, known)
        own = jnp.eye(m)[..., None]
        relays = jnp.einsum("ijn,jkn->ikn", near, near)
        far = ((relays > 0) & (near + own == 0)).astype(float)
        passed_on = jnp.einsum("ijn,ajkn->aikn", near, told) / jnp.maximum(relays, 1.0)[None]
        position, speed = (own[None] * jet[:, :, None] for jet in heard.own)
        place, around = near[None] * told + position + far[None] * passed_on, near + own + far
        last, (x, v) = memory.around.reshape(m, m, lanes), memory.state.reshape(2, 2, m, m, lanes)
        same = (last == (around > 0)).all(axis=1)[None, :, None]
        x, v = jnp.where(same, x, place), jnp.where(same, v, speed)
        within = around[:, :, None] * around[:, None] * (1.0 - far[:, :, None] * far[:, None])
        links = within * near[None]
        degree = links.sum(axis=2)
        pull = (degree.max(axis=1, keepdims=True) + 2.0) * around - degree
        towards = jnp.einsum("ikln,ailn->aikn", links, x) - degree[None] * x
        towards = self.gain[None, None, None] * (towards + pull[None] * (place - x))
        rate = towards - self.damping[None, None, None] * v + 2.0 * own[None] * (speed - v)
        step = heard.interval[None, None, None]
        state = jnp.stack([x + step * v, v + step * rate]) * around[None, None]
        expected = state[0][:, jnp.arange(m)[None], heard.sources - 1]
        flat = around.reshape(m * m, lanes) > 0, state.reshape(2, 2, m * m, lanes)
        return ExpectedAround(*flat, heard.received[0] - expected, known)

    def faults(self, scenario):
        yield from super().faults(scenario)
        if scenario.navigator.present or scenario.vehicle.order != 2:
            told = "needs vehicles of order 2 without a navigator"
            yield Fault(("detector.predicts", "vehicle", "navigator"), f"{self.kind} {told}")
        if scenario.channel.late or scenario.vehicles > MOST_OBSERVED:
            told = f"needs messages on time, and at most {MOST_OBSERVED} vehicles"
            yield Fault(("detector.predicts", "channel.delay", "vehicles"), f"{self.kind} {told}")


def by_pair(heard: HeardMessages, known: SlotMask) -> tuple[AnyNumbers, Any]:
    """Whom a listener hears, (m, m, lanes), and the positions told it, (2, m, m, lanes)."""
    m, lanes = known.shape[1:]
    listeners, sources = jnp.arange(m)[None], heard.sources - 1
    places = jnp.where(known[None], heard.received[0], 0.0)
    near = jnp.zeros((m, m, lanes)).at[listeners, sources].add(known.astype(float))
    return near, jnp.zeros((2, m, m, lanes)).at[:, listeners, sources].add(places)
