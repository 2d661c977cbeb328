"""The numbers of one lane, which is one simulated fleet, and the structure that all lanes share."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxnet.model.control import Gain
from jaxnet.model.hearing import Hearing
from jaxnet.model.shapes import Numbers
from jaxnet.model.signal import Basis, up_to
from jaxnet.model.strength import RowStrength


class Lane(NamedTuple):
    """The numbers of one simulated fleet.

    Many lanes form one tree of the same structure, with a last axis over lanes. Law, vehicle, navigator,
    defence, announcements, sensor and loss are kinds with their numbers drawn. The signal of the attack has a
    method `basis`.
    """

    initial: Float[Array, "n m *lanes"]
    weights: Float[Array, "slots m *lanes"]
    gain: Gain
    law: Any
    vehicle: Any
    navigator: Any
    defence: Any
    signal: Any
    vectors: Float[Array, "2 signals functions *lanes"]  # of the attack [m]; initial if strategic
    attack_scale: Float[Array, "*lanes"]  # [m], factor of the unit vectors of the attack
    announces: Any  # announcements of attacked links, a kind with its numbers drawn
    sizes: Float[Array, "2 derivatives *lanes"]  # greatest norms by order: navigator's path, signal functions
    sensor: Any = None  # None where vehicles sense without errors
    loss: Any = None  # None where every message arrives
    strength: RowStrength | None = None  # of rows; None where it is 1

    @property
    def singular(self) -> bool:
        """Return whether the law is singular where `vehicle.margin` is 0."""
        return bool(self.vehicle.singular) and not self.law.linearised

    def basis(self, time: Numbers) -> Basis:
        """Return the attacks' functions at times [s], with derivatives up to the vehicles' order at least."""
        return up_to(len(self.gain), self.signal.basis, time)

    def path(self, time: Numbers) -> Float[Array, "derivatives 2 ..."]:
        """Return the navigator's jets at times [s], up to the vehicles' order at least."""
        return up_to(len(self.gain), self.navigator.jets, time)


class Network(NamedTuple):
    """The structure that lanes share: hearing, trust, shared data of the defence, and solver."""

    hearing: Hearing
    trusted: Bool[Array, "slots m"]
    display_signals: Int[
        Array, "m"
    ]  # the signal that outputs show for each vehicle, if its listeners receive different signals
    shared: Any  # data of the defence
    solver: Any  # of `solvers`
