import io

import numpy as np
from upath import UPath

from jaxnet.kinds.fields import Vector, setting
from jaxnet.kinds.formations.offsets import Offsets
from jaxnet.kinds.kind import KindError
from jaxnet.networks.files import read_bytes


class File(Offsets):
    """Places from a file with a line `x, y` for each vehicle.

    The places become part of the study, so results need no file.
    """

    path: str = setting(..., "of the file, from the config's folder")
    offsets: list[Vector] = setting([], "[m], as read from the file by jaxnet")

    @classmethod
    def completed(cls, given, folder):
        path = given.get("path")
        if not isinstance(path, str) or "offsets" in given:
            return given
        return {**given, "offsets": read_places(read_bytes(UPath(folder) / path, path), path)}


def read_places(content: bytes, name: str) -> list[list[float]]:
    """The places in a file; raise KindError."""
    try:
        text = content.decode().replace(",", " ")
        places = np.loadtxt(io.StringIO(text), ndmin=2)
    except ValueError as error:
        raise KindError(f"{name}: must be lines x, y ({error})") from error
    if places.shape[1:] != (2,) or not np.isfinite(places).all():
        raise KindError(f"{name}: must be lines with two numbers x, y [m]")
    return places.tolist()
