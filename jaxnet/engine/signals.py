"""What engines need of an instant besides the fleet: the navigator and the attacks' functions."""

from typing import NamedTuple

from jaxtyping import Array, Float

from jaxnet.engine.tick import Instants
from jaxnet.model import control
from jaxnet.model.lane import Lane
from jaxnet.model.signal import Basis


class Signals(NamedTuple):
    """What depends on the time alone, and what the law makes of it, which a stage would compute once for each
    vehicle.
    """

    time: Instants  # itself
    navigator: Float[Array, "4 2 lanes"]
    basis: Basis
    path: Float[Array, "2 lanes"]  # R(y_0)
    drive: Float[Array, "functions lanes"]  # R(β)


def signals(lane: Lane, time: Instants) -> Signals:
    """The navigator and the attacks' functions at these times."""
    navigator, basis = lane.navigator.jets(time), lane.signal.basis(time)
    path, drive = (control.driven(lane.gain, jets) for jets in (navigator, basis))
    return Signals(time, navigator, basis, path, drive)
