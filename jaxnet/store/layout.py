"""The arrays of a study's folder, and the split of its lanes into shards, known before a run."""

from collections.abc import Mapping, Sequence
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

    dims: tuple[str, ...]
    dtype: str
    unit: str
    meaning: str
    series: str


def error_array(meaning: str, series: str, along: str = "time") -> Variable:
    return Variable(("cell", "sample", along), "float32", "m", meaning, series)


def path_array(dims: str, dtype: str, unit: str, meaning: str, series: str) -> Variable:
    return Variable(("cell", "sample", "time", *dims.split()), dtype, unit, meaning, series)


SPREAD_ARRAY = error_array("max of ‖y_i - y_j‖ over vehicles that are not attacked", "spread")
ERRORS = {
    "tracking": error_array("mean over vehicles of ‖y_i - y_0‖", "tracking"),
    "disagreement": error_array("mean over vehicles of ‖y_i - Σ w_ij y_j‖", "disagreement"),
}
VEHICLE_ARRAYS = {
    "tail_mean": error_array("mean of ‖y_i - y_0‖ over the tail", "vehicle_mean", "vehicle"),
    "tail_max": error_array("greatest ‖y_i - y_0‖ over the tail", "vehicle_max", "vehicle"),
}
TRAJECTORIES = {
    "states": path_array("vehicle state", "float64", "", "states of the vehicles", "state"),
    "inputs": path_array(
        "vehicle input", "float64", "", "control inputs u_i of the vehicles", "inputs"
    ),
    "attack": path_array(
        "vehicle axis", "float64", "m", "signal of each attacked vehicle", "attack"
    ),
    "kept": path_array("slot vehicle", "float32", "1", "weights in force", "kept"),
}
NAVIGATOR = Variable(
    ("cell", "time", "axis"), "float64", "m", "position y_0 of the navigator", "navigator"
)
HEARD_SOURCES = Variable(
    ("cell", "slot", "vehicle"), "int32", "1", "whom a vehicle hears in a slot", "sources"
)
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
    return {
        "cell": np.arange(known["cell"]),
        "sample": np.arange(samples),
        "time": np.array(multiples(scenario.output_step, range(known["time"]))),
        "vehicle": np.arange(1, known["vehicle"] + 1),
        "slot": np.arange(slots_of(cells)),
        "axis": np.array(["x", "y"], dtype=object),
        "state": np.array(scenario.vehicle.states, dtype=object),
        "input": np.array(scenario.vehicle.inputs, dtype=object),
    }


def slots_of(cells: Sequence[Cell]) -> int:
    """Largest number of slots of a cell whose defence decides; 0 without such a cell."""
    alike = {}
    for scenario in (cell.scenario for cell in cells if cell.scenario.defence.decides):
        # an attacked source may have several slots
        several = scenario.attack.identities() + scenario.attack.splits() > 1
        alike[id(scenario.topology), several and id(scenario.attack)] = scenario
    return max((len(sources_of(each)) for each in alike.values()), default=0)


class Shard(NamedTuple):
    """Consecutive samples of one cell. More samples leave the numbers of shards unchanged.

    Where the first samples of a shard are stored, `samples` may be the missing ones alone.
    """

    number: int
    cell: Cell
    samples: range


def shards_of(cells: Sequence[Cell], samples: Sequence[int], size: int) -> list[Shard]:
    """All shards of a study: the first samples of every cell, then the next samples of every cell.

    `samples` are the numbers of samples of the cells.
    """
    numbers = range(-(-max(samples) // size) * len(cells))
    shards = (shard_of(cells, samples, size, number) for number in numbers)
    return [shard for shard in shards if shard.samples]


def shard_of(cells: Sequence[Cell], samples: Sequence[int], size: int, number: int) -> Shard:
    cell, held = samples_of_shard(samples, size, number)
    return Shard(number, cells[cell], held)


def samples_of_shard(samples: Sequence[int], size: int, number: int) -> tuple[int, range]:
    """Number of a shard's cell, and its samples; `samples` are the numbers of the cells."""
    block, cell = divmod(number, len(samples))
    return cell, range(block * size, min((block + 1) * size, samples[cell]))


def shard_size(cells: Sequence[Cell], study: keys.Config) -> int:
    """Number of lanes in a shard: about a second's work, with small saved arrays."""
    most = min(cell.scenario.engine.shard for cell in cells)
    return int(np.clip(SHARD_BYTES // max(1, lane_bytes(cells, study.save)), 1, most))


def filled_stores(cells: Sequence[Cell], save: keys.Save) -> dict[str, dict[str, Variable]]:
    """Variables of the stores that are filled shard by shard, by store."""
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
    chosen_bytes = variable_bytes(along_lanes(trajectory_variables(cells)), cells) if chosen else 0
    return lanes * (ROW_BYTES + lane_bytes(cells, study.save)) + chosen * chosen_bytes


def error_variables(cells: Sequence[Cell]) -> dict[str, Variable]:
    """Arrays over time: the spread where a cell has no navigator, no error where none has one."""
    leaderless = [cell.scenario.leaderless for cell in cells]
    found = {"spread": SPREAD_ARRAY, **ERRORS} if any(leaderless) else dict(ERRORS)
    if all(leaderless):
        del found["tracking"]
    return found


def trajectory_variables(cells: Sequence[Cell]) -> dict[str, Variable]:
    """Arrays of a trajectory; `kept` only where a defence decides.

    States and inputs have one unit for each of their labels, separated by commas.
    """
    vehicle = cells[0].scenario.vehicle
    units = {"states": ", ".join(vehicle.units), "inputs": ", ".join(vehicle.input_units)}
    found = {
        name: variable._replace(unit=units.get(name, variable.unit))
        for name, variable in TRAJECTORIES.items()
    }
    if not any(cell.scenario.defence.decides for cell in cells):
        del found["kept"]
    return found


def series_of(variables: Mapping[str, Variable]) -> tuple[str, ...]:
    return tuple(variable.series for variable in variables.values())


def along_lanes(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    every = {**variables, **cell_variables(variables)}
    return {
        name: variable._replace(dims=("lane", *own_dims(variable)))
        for name, variable in every.items()
    }


def cell_variables(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    return {"navigator": NAVIGATOR} | ({"source": HEARD_SOURCES} if "kept" in variables else {})


def own_dims(variable: Variable) -> tuple[str, ...]:
    return tuple(dim for dim in variable.dims if dim not in ("cell", "sample", "lane"))


def variable_bytes(variables: Mapping[str, Variable], cells: Sequence[Cell]) -> int:
    coords = coordinates(cells, 1)
    return sum(
        int(np.prod([len(coords[dim]) for dim in own_dims(variable)]))
        * np.dtype(variable.dtype).itemsize
        for variable in variables.values()
    )
