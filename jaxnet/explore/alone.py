"""A study of one choice, which `jaxnet run` simulates with the same numbers as the search."""

from collections.abc import Sequence
from typing import Any, BinaryIO

import yaml
from upath import UPath

from jaxnet.config.cells import Cell, to_plain
from jaxnet.config.document import Yaml12Dumper
from jaxnet.config.keys import Config
from jaxnet.config.study import Study, load
from jaxnet.engine.batch import Machine
from jaxnet.explore.box import VEHICLES, Box
from jaxnet.explore.search import BoxPoint
from jaxnet.runs.run import Run
from jaxnet.store.folder import Folder, digest


def choice_study(study: Config, cell: Cell, box: Box, point: BoxPoint) -> Study:
    """Return the study of one point of a cell's box.

    Its config contains the point's numbers. Its samples are the starts of the search.
    """
    assert study.search is not None
    attacked = box.attacked(point)
    keys: dict[str, Any] = to_plain(cell.scenario)
    keys |= {
        "name": f"{study.name}-worst-{cell.number}",
        "seed": study.seed,
        "samples": study.search.starts,
    }
    keys |= {"recovery": to_plain(study)["recovery"]}
    overrides: dict[str, Any] = {VEHICLES: attacked} if box.lots else {}
    for name in study.search.over:
        if name != VEHICLES:
            overrides[name] = key_value(box, point, name, attacked)
    with study.scope():
        return load(keys, overrides)


def key_value(
    box: Box, point: BoxPoint, name: str, attacked: Sequence[int]
) -> float | list[float] | list[float | list[float]]:
    """Return the value of a key at a point: a number, or a list of numbers by vehicle or component."""
    numbers: dict[int, list[float]] = {}
    for place, column in box.columns.items():
        if place.name == name:
            numbers.setdefault(place.vehicle, []).append(box.number(place, point[column]))
    if 0 in numbers:
        components = numbers[0]
        return components if name == "gain" else components[0]
    by_vehicle = [numbers[vehicle] for vehicle in attacked]
    return [each[0] if len(each) == 1 else each for each in by_vehicle]


def simulate_choice(study: Study, folder: Folder, machine: Machine) -> UPath:
    """Simulate a choice's study into its own folder and return the folder.

    The folder has the trajectory of the first lane. Results of another choice in the folder are removed.
    """
    saved = load(study, {"save.trajectories": {"samples": [0]}})
    with folder.writing():
        if folder.manifest.get("hash") != digest(saved.config):
            folder.clear()
        Run(saved.config, saved.cells, folder, lambda tally: None, machine).whole()
    return folder.path


def write_config(study: Study, name: str, file: BinaryIO) -> None:
    """Write a study as a YAML file with this name; its first line is the command that runs it."""
    body = yaml.dump(
        to_plain(study.config),
        Dumper=Yaml12Dumper,
        sort_keys=False,
        default_flow_style=None,
        width=100,
    )
    file.write(f"# jaxnet run {name}\n{body}".encode())
