"""What the liars add: one smooth signal per attacked vehicle, and the links on which it is heard.

`‖a^(k)(t)‖ ≤ ā` for k = 0..3 is certified by construction: a signal of angular frequency ω has amplitude
`ā / max(1, |ω|³)`. A kind of attack is a type with `jets(t)`. Angles are held as unit vectors, one per
vehicle and zero where a vehicle is not attacked, so that no trigonometry of theirs is left in the loop.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Time = Float[Array, ""]
Signal = Float[Array, "4 m 2"]
Vectors = Float[Array, "m 2"]
Links = Bool[Array, "m sources"]


class NoAttack(NamedTuple):
    """Nobody lies."""

    links: Links

    def jets(self, t: Time) -> Signal:
        """Signal and its first three derivatives [m, m/s, m/s², m/s³] of each vehicle."""
        return jnp.zeros((4, len(self.links), 2))


class Bias(NamedTuple):
    """A constant offset of length `magnitude` [m] along each attacked vehicle's direction."""

    links: Links
    magnitude: Float[Array, ""]
    direction: Vectors

    def jets(self, t: Time) -> Signal:
        """See `NoAttack.jets`."""
        return jnp.zeros((4, *self.direction.shape)).at[0].set(self.magnitude * self.direction)


class Rotating(NamedTuple):
    """`a_j = amplitude · [cos(ωt + φ_j), sin(ωt + φ_j)]` with `phasor` = [cos φ_j, sin φ_j]."""

    links: Links
    magnitude: Float[Array, ""]
    frequency: Float[Array, ""]
    phasor: Vectors

    def jets(self, t: Time) -> Signal:
        """See `NoAttack.jets`."""
        w = self.frequency
        amplitude = self.magnitude / jnp.maximum(1.0, jnp.abs(w) ** 3)
        cosine, sine = amplitude * jnp.cos(w * t), amplitude * jnp.sin(w * t)
        ahead = jnp.stack([-self.phasor[:, 1], self.phasor[:, 0]], axis=1)
        now, next_quarter = cosine * self.phasor + sine * ahead, cosine * ahead - sine * self.phasor
        return jnp.stack([now, w * next_quarter, -(w**2) * now, -(w**3) * next_quarter])


class Sinusoid(NamedTuple):
    """`a_j = amplitude · sin(ωt + φ_j)` along each attacked vehicle's direction."""

    links: Links
    magnitude: Float[Array, ""]
    frequency: Float[Array, ""]
    phasor: Vectors
    direction: Vectors

    def jets(self, t: Time) -> Signal:
        """See `NoAttack.jets`."""
        circle = Rotating(self.links, self.magnitude, self.frequency, self.phasor)
        return circle.jets(t)[:, :, 1:] * self.direction[None]


Attack = NoAttack | Bias | Sinusoid | Rotating


def on_links(offset: Vectors, links: Links) -> Float[Array, "m sources 2"]:
    """`a_ij`: a listener's own signal on the navigator's channel, else the transmitter's."""
    vehicles = len(links)
    transmitted = jnp.broadcast_to(offset[None], (vehicles, vehicles, 2))
    by_source = jnp.concatenate([offset[:, None], transmitted], axis=1)
    return jnp.where(links[:, :, None], by_source, 0.0)


def corruption(signal: Signal, links: Links, weights: Float[Array, "m sources"]) -> Signal:
    """Jets of `d_i = Σ_j w_ij a_ij`, what the lies add to the desired signal of vehicle i."""
    attacked = jnp.where(links, weights, 0.0)
    from_navigator = attacked[None, :, :1] * signal
    return from_navigator + jnp.einsum("ij,kjx->kix", attacked[:, 1:], signal)
