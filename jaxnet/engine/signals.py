"""Signals that depend on time alone: the navigator's jets and the attacks' functions."""

from typing import NamedTuple

from jaxtyping import Array, Float

from jaxnet.engine.tick import Instants
from jaxnet.model import control
from jaxnet.model.lane import Lane
from jaxnet.model.signal import Basis


class Signals(NamedTuple):
    """Navigator and attack functions at one instant, with R(y_0) and R(β) of the law.

    R is computed here once, because a stage would compute R once for each vehicle.
    """

    time: Instants  # [s]
    navigator: Float[Array, "derivatives 2 lanes"]
    basis: Basis
    path: Float[Array, "2 lanes"]  # R(y_0)
    drive: Float[Array, "functions lanes"]  # R(β), see `control.drive_functions`


def signals(lane: Lane, time: Instants) -> Signals:
    """Return the navigator's jets and the attacks' functions at these times, with R of each."""
    navigator, basis = lane.path(time), lane.basis(time)
    path, drive = control.driven(lane.gain, navigator), control.drive_functions(lane.gain, basis)
    return Signals(time, navigator, basis, path, drive)
