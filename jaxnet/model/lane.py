"""One lane: one simulated fleet, with everything about it that is a number; and what lanes can share."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxnet.model.hearing import Hearing


class Lane(NamedTuple):
    """What one fleet is simulated from. Many lanes are the same tree with a last axis over lanes.

    Vehicle, navigator, law, defence and announcements are kinds with their numbers drawn; the attack's signal
    gives its `basis`.
    """

    initial: Float[Array, "n m *lanes"]
    weights: Float[Array, "slots m *lanes"]
    gain: Float[Array, "3 *lanes"]
    law: Any
    vehicle: Any
    navigator: Any
    defence: Any
    signal: Any
    vectors: Float[Array, "2 signals functions *lanes"]  # of the attacks [m]; strategic ones' at first
    attack_scale: Float[Array, "*lanes"]  # [m] of an attack's unit vectors
    announces: Any  # what attacked links announce, a kind with its numbers drawn
    sizes: Float[Array, "2 4 *lanes"]  # greatest norms, by order: of the navigator's path, of the functions


class Network(NamedTuple):
    """What lanes share: who hears whom, where there are attacks, what the defence has made of it, and the
    order in which vehicles are eliminated.
    """

    hearing: Hearing
    trusted: Bool[Array, "slots m"]
    display_signals: Int[
        Array, "m"
    ]  # the signal that stands for what a vehicle says, where its listeners' differ
    shared: Any  # of the defence
    order: Any  # of `elimination`
