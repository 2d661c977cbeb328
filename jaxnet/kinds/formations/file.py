import math

from upath import UPath

from jaxnet.kinds.fields import Vector, setting
from jaxnet.kinds.formations.offsets import PlacedFormation
from jaxnet.kinds.kind import KindError
from jaxnet.networks.files import read_bytes


class FileFormation(PlacedFormation):
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
        lines = [line.partition("#")[0] for line in content.decode().splitlines()]
        places = [list(map(float, line.replace(",", " ").split())) for line in lines]
    except ValueError as error:
        raise KindError(f"{name}: must be lines x, y ({error})") from error
    places = [place for place in places if place]
    if not places or any(len(place) != 2 or not all(map(math.isfinite, place)) for place in places):
        raise KindError(f"{name}: must be lines with two numbers x, y [m]")
    return places
