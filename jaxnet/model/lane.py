"""One lane: one simulated fleet, with everything about it that is a number."""

from typing import NamedTuple

from jaxtyping import Array, Float

from jaxnet.model.attack import Attack
from jaxnet.model.defence import Defence
from jaxnet.model.navigator import Lissajous


class Lane(NamedTuple):
    """What one fleet is simulated from.

    The leaves are arrays, so all of them may vary without a new compilation; a batch of lanes is the same
    tree with a leading axis.
    """

    initial: Float[Array, "m 6"]
    weights: Float[Array, "m sources"]
    navigator: Lissajous
    attack: Attack
    defence: Defence
    gain: Float[Array, "3"]
