"""One lane: one simulated fleet, with everything about it that is a number; and what lanes can share."""

from typing import NamedTuple

from jaxtyping import Array, Float

from jaxnet.model.attack import Harmonic
from jaxnet.model.defence import Defence
from jaxnet.model.hearing import Hearing
from jaxnet.model.navigator import Lissajous


class Lane(NamedTuple):
    """What one fleet is simulated from. Many lanes are the same tree with a last axis over lanes."""

    initial: Float[Array, "6 m *lanes"]
    weights: Float[Array, "slots m *lanes"]
    navigator: Lissajous
    attack: Harmonic
    tolerance: Float[Array, "*lanes"]  # [m], of scores (see `defence`)
    gain: Float[Array, "3 *lanes"]


class Network(NamedTuple):
    """Who hears whom, who lies on which links and who defends itself how: the same in lanes side by side."""

    hearing: Hearing
    defence: Defence
