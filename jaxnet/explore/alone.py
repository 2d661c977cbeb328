"""One choice alone, as a study that `jaxnet run` takes and whose lanes come to the same numbers."""

from collections.abc import Sequence
from typing import Any, BinaryIO

import yaml
from upath import UPath

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.keys import Config
from jaxnet.config.study import Study, load
from jaxnet.config.yaml12 import Yaml12Dumper
from jaxnet.engine.batch import Machine
from jaxnet.explore.box import VEHICLES, Box
from jaxnet.explore.search import Point
from jaxnet.runs.run import Run
from jaxnet.store.folder import Folder, digest


def study_of(study: Config, cell: Cell, box: Box, point: Point) -> Study:
    """The study of one point of a cell's box: its numbers written out, the starts those it was tried from."""
    assert study.search is not None
    attacked = box.attacked(point)
    keys: dict[str, Any] = to_plain(cell.scenario)
    keys |= {"name": f"{study.name}-worst-{cell.number}", "seed": study.seed, "samples": study.search.starts}
    keys |= {"recovery": to_plain(study)["recovery"]}
    overrides: dict[str, Any] = {VEHICLES: attacked} if box.lots else {}
    for name in study.search.over:
        if name != VEHICLES:
            overrides[name] = written_out(box, point, name, attacked)
    with study.scope():
        return load(keys, overrides)


def written_out(box: Box, point: Point, name: str, attacked: Sequence[int]) -> Any:
    """The value of a key at a point: a number, or a list of numbers, by vehicle or component."""
    numbers: dict[int, list[float]] = {}
    for place, column in box.columns.items():
        if place.name == name:
            numbers.setdefault(place.vehicle, []).append(box.number(place, point[column]))
    if 0 in numbers:
        components = numbers[0]
        return components if name == "gain" else components[0]
    listed = [numbers[vehicle] for vehicle in attacked]
    return [each[0] if len(each) == 1 else each for each in listed]


def simulated(study: Study, folder: Folder, machine: Machine) -> UPath:
    """Run a choice's study into a folder of its own, with the trajectory of its first lane; the folder.

    What the folder holds of another choice is thrown away.
    """
    shown = load(study, {"save.trajectories": {"samples": [0]}})
    with folder.writing():
        if folder.manifest.get("hash") != digest(shown.config):
            folder.clear()
        Run(shown.config, shown.cells, folder, lambda tally: None, machine).whole()
    return folder.path


def write_config(study: Study, name: str, file: BinaryIO) -> None:
    """Write a study as a file of this name, whose first line is the command that runs it."""
    body = yaml.dump(
        to_plain(study.config), Dumper=Yaml12Dumper, sort_keys=False, default_flow_style=None, width=100
    )
    file.write(f"# jaxnet run {name}\n{body}".encode())
