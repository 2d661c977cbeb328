"""The arrays of a study's folder, and the split of its lanes into shards, known before a run."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jaxnet.config import keys
from jaxnet.config.cells import Cell
from jaxnet.config.scenario import sources_of
from jaxnet.config.spacings import multiples

SHARD_BYTES = 2**27  # of a shard's arrays, at most: it has fewer lanes where they would take more
ROW_BYTES = 120  # of a row in a file, at most

CellLabel = str | int | float  # value of a swept key, as tables and coordinates show it


class Variable(NamedTuple):
    """An array of a store, and the engine's series that it holds."""

    dims: str  # of one lane's part, separated by blanks
    dtype: str
    unit: str
    meaning: str
    series: str


APART = "max of ‖y_i - y_j‖ over honest vehicles"
EPSILON = "mean over vehicles of ‖y_i - Σ w_ij y_j‖"
SPREAD_ARRAY = Variable("time", "float32", "m", APART, "spread")
ERRORS = {
    "tracking": Variable("time", "float32", "m", "mean over vehicles of ‖y_i - y_0‖", "tracking"),
    "disagreement": Variable("time", "float32", "m", EPSILON, "disagreement"),
}
MEAN, GREATEST = "mean of ‖y_i - y_0‖ over the tail", "greatest ‖y_i - y_0‖ over the tail"
VEHICLE_ARRAYS = {
    "tail_mean": Variable("vehicle", "float32", "m", MEAN, "vehicle_mean"),
    "tail_max": Variable("vehicle", "float32", "m", GREATEST, "vehicle_max"),
}
SIGNAL, INPUTS = "signal of each attacked vehicle", "control inputs u_i of the vehicles"
TRAJECTORIES = {
    "states": Variable("time vehicle state", "float64", "", "states of the vehicles", "state"),
    "inputs": Variable("time vehicle input", "float64", "", INPUTS, "inputs"),
    "attack": Variable("time vehicle axis", "float64", "m", SIGNAL, "attack"),
    "kept": Variable("time slot vehicle", "float32", "1", "weights in force", "kept"),
}
# One for all lanes of a cell.
NAVIGATOR = Variable("time axis", "float64", "m", "position y_0 of the navigator", "navigator")
SOURCES = Variable("slot vehicle", "int32", "1", "whom a vehicle hears in a slot", "sources")
DIMENSIONS = {  # unit and meaning of the labels along each dimension
    "cell": ("1", "number of the cell"),
    "sample": ("1", "number of the sample"),
    "lane": ("1", "number of the lane in this store"),
    "time": ("s", "time"),
    "vehicle": ("1", "number of the vehicle"),
    "slot": ("1", "number of the slot"),
    "axis": ("", "axis of the plane"),
    "state": ("", "name of the state"),
    "input": ("", "name of the input"),
}


def sizes(cells: Sequence[Cell]) -> dict[str, int]:
    """Sizes of the dimensions that have one size in all stores of a study."""
    scenario = cells[0].scenario
    return {
        "cell": len(cells),
        "time": round(scenario.horizon / scenario.output_step) + 1,
        "vehicle": scenario.vehicles,
        "axis": 2,
        "state": len(scenario.vehicle.states),
        "input": len(scenario.vehicle.inputs),
    }


def coordinates(cells: Sequence[Cell], samples: int) -> dict[str, np.ndarray]:
    scenario, known = cells[0].scenario, sizes(cells)
    slots = (len(sources_of(cell.scenario)) for cell in cells if drops_messages(cell.scenario))
    return {
        "cell": np.arange(known["cell"]),
        "sample": np.arange(samples),
        "time": np.array(multiples(scenario.output_step, range(known["time"]))),
        "vehicle": np.arange(1, known["vehicle"] + 1),
        "slot": np.arange(max(slots, default=0)),
        "axis": np.array(["x", "y"], dtype=object),
        "state": np.array(scenario.vehicle.states, dtype=object),
        "input": np.array(scenario.vehicle.inputs, dtype=object),
    }


def drops_messages(scenario: keys.Scenario) -> bool:
    """Whether links may be out of force: by a defence, by losses, or by alarms."""
    lossless = scenario.channel.loss.perfect() and not scenario.detector.acts
    return scenario.defence.decides or not lossless


class Shard(NamedTuple):
    """Consecutive samples of one cell. More samples leave the numbers of shards unchanged.

    Where the first samples of a shard are stored, `samples` may be the missing ones alone.
    """

    number: int
    cell: Cell
    samples: range


def shards_of(
    cells: Sequence[Cell], samples: Sequence[int], size: int, numbers: Iterable[int] | None = None
) -> list[Shard]:
    """Shards with these numbers, by default all of a study, without those that are empty.

    The first samples of every cell come first. `samples` are the numbers of samples of the cells.
    """
    if numbers is None:
        numbers = range(-(-max(samples) // size) * len(cells))
    found = ((number, *samples_of_shard(samples, size, number)) for number in numbers)
    return [Shard(number, cells[cell], held) for number, cell, held in found if held]


def samples_of_shard(samples: Sequence[int], size: int, number: int) -> tuple[int, range]:
    """Number of a shard's cell, and its samples; `samples` are the numbers of the cells."""
    block, cell = divmod(number, len(samples))
    return cell, range(block * size, min((block + 1) * size, samples[cell]))


def shard_size(cells: Sequence[Cell], study: keys.Config) -> int:
    """Number of lanes in a shard: about a second's work, with small saved arrays."""
    most = min(cell.scenario.engine.shard for cell in cells)
    return int(np.clip(SHARD_BYTES // max(1, lane_bytes(cells, study.save)), 1, most))


def filled_stores(cells: Sequence[Cell], save: keys.Save) -> dict[str, dict[str, Variable]]:
    stores = {"errors.zarr": error_variables(cells)} if save.errors else {}
    if save.vehicles:
        stores["vehicles.zarr"] = dict(VEHICLE_ARRAYS)
    if save.trajectories == "all":
        stores["trajectories.zarr"] = trajectory_variables(cells)
    return stores


def lane_bytes(cells: Sequence[Cell], save: keys.Save) -> int:
    """Upper bound on the bytes of arrays that a lane leaves in the folder."""
    stores = filled_stores(cells, save).values()
    return sum(variable_bytes(variables, cells) for variables in stores)


def disk_bytes(study: keys.Config, cells: Sequence[Cell], lanes: int) -> int:
    """Upper bound on the bytes on the disk of these lanes and of the chosen trajectories."""
    match study.save.trajectories:
        case keys.Samples(samples=samples):
            chosen = len(samples) * len(cells)
        case keys.WorstLanes(worst=count):
            chosen = count * len(cells)
        case _:
            chosen = 0
    if chosen:
        variables = trajectory_variables(cells)
        chosen *= variable_bytes(variables | cell_variables(variables), cells)
    return lanes * (ROW_BYTES + lane_bytes(cells, study.save)) + chosen


def error_variables(cells: Sequence[Cell]) -> dict[str, Variable]:
    """Arrays over time: the spread where a cell has no navigator, no error where none has one."""
    leaderless = [cell.scenario.leaderless for cell in cells]
    found = {"spread": SPREAD_ARRAY, **ERRORS} if any(leaderless) else dict(ERRORS)
    if all(leaderless):
        del found["tracking"]
    return found


def trajectory_variables(cells: Sequence[Cell]) -> dict[str, Variable]:
    """Arrays of a trajectory; `kept` only where messages are dropped or lost.

    States and inputs have one unit for each of their labels, separated by commas.
    """
    vehicle = cells[0].scenario.vehicle
    found = dict(TRAJECTORIES)
    for name, units in {"states": vehicle.units, "inputs": vehicle.input_units}.items():
        found[name] = found[name]._replace(unit=", ".join(units))
    if not any(drops_messages(cell.scenario) for cell in cells):
        del found["kept"]
    return found


def series_of(variables: Mapping[str, Variable]) -> tuple[str, ...]:
    return tuple(variable.series for variable in variables.values())


def cell_variables(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Arrays of a cell that stand beside those of its lanes."""
    return {"navigator": NAVIGATOR} | ({"source": SOURCES} if "kept" in variables else {})


def variable_bytes(variables: Mapping[str, Variable], cells: Sequence[Cell]) -> int:
    coords = coordinates(cells, 1)
    return sum(
        int(np.prod([len(coords[dim]) for dim in variable.dims.split()]))
        * np.dtype(variable.dtype).itemsize
        for variable in variables.values()
    )
