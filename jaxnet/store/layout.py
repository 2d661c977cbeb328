"""The arrays of a study's folder, and the split of its lanes into shards, all known before a run starts."""

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
    """An array of a store: its dimensions, type, unit and meaning, and the engine's series that it holds."""

    dims: tuple[str, ...]
    dtype: str
    unit: str
    meaning: str
    series: str


LANE_TIME = ("cell", "sample", "time")
ERRORS = {
    "tracking": Variable(
        LANE_TIME, "float32", "m", "mean over vehicles of ‖y_i - y_0‖", "tracking"
    ),
    "disagreement": Variable(
        LANE_TIME, "float32", "m", "mean over vehicles of ‖y_i - Σ w_ij y_j‖", "disagreement"
    ),
}
SPREAD_OVER_TIME = Variable(
    LANE_TIME, "float32", "m", "max of ‖y_i - y_j‖ over vehicles that are not attacked", "spread"
)
VEHICLE_ARRAYS = {
    "tail_mean": Variable(
        ("cell", "sample", "vehicle"),
        "float32",
        "m",
        "mean of ‖y_i - y_0‖ over the tail",
        "vehicle_mean",
    ),
    "tail_max": Variable(
        ("cell", "sample", "vehicle"),
        "float32",
        "m",
        "greatest ‖y_i - y_0‖ over the tail",
        "vehicle_max",
    ),
}
TRAJECTORIES = {
    "states": Variable(
        (*LANE_TIME, "vehicle", "state"), "float64", "", "states of the vehicles", "state"
    ),
    "inputs": Variable(
        (*LANE_TIME, "vehicle", "input"),
        "float64",
        "",
        "control inputs u_i of the vehicles",
        "inputs",
    ),
    "attack": Variable(
        (*LANE_TIME, "vehicle", "axis"), "float64", "m", "signal of each attacked vehicle", "attack"
    ),
    "kept": Variable((*LANE_TIME, "slot", "vehicle"), "float32", "1", "weights in force", "kept"),
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
    """Return the sizes of the dimensions that have one size in all stores of a study."""
    scenario = cells[0].scenario
    outputs = round(scenario.horizon / scenario.output_step)
    states, inputs = len(scenario.vehicle.states), len(scenario.vehicle.inputs)
    found = {"cell": len(cells), "time": outputs + 1, "vehicle": scenario.vehicles, "axis": 2}
    return found | {"state": states, "input": inputs}


def coordinates(cells: Sequence[Cell], samples: int) -> dict[str, np.ndarray]:
    """Return the labels along each dimension."""
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
    """Return the largest number of slots of a cell whose defence decides; 0 without such a cell."""
    alike = {}
    for scenario in (cell.scenario for cell in cells if cell.scenario.defence.decides):
        several = (
            scenario.attack.identities() + scenario.attack.splits() > 1
        )  # slots of an attacked source
        alike[id(scenario.topology), several and id(scenario.attack)] = scenario
    return max((len(sources_of(each)) for each in alike.values()), default=0)


class Shard(NamedTuple):
    """Consecutive samples of one cell. More samples in a study leave the numbers of its shards unchanged.

    Where the first samples of a shard are stored, `samples` may be the missing ones alone.
    """

    number: int
    cell: Cell
    samples: range


def shards_of(cells: Sequence[Cell], samples: Sequence[int], size: int) -> list[Shard]:
    """Return all shards of a study: the first samples of every cell, then the next samples of every cell.

    `samples` are the numbers of samples of the cells.
    """
    numbers = range(-(-max(samples) // size) * len(cells))
    shards = (shard_of(cells, samples, size, number) for number in numbers)
    return [shard for shard in shards if shard.samples]


def shard_of(cells: Sequence[Cell], samples: Sequence[int], size: int, number: int) -> Shard:
    """Return the shard of a number; a shard beyond the samples of its cell has none."""
    cell, held = samples_of_shard(samples, size, number)
    return Shard(number, cells[cell], held)


def samples_of_shard(samples: Sequence[int], size: int, number: int) -> tuple[int, range]:
    """Return the number of a shard's cell, and its samples; `samples` are the numbers of the cells."""
    block, cell = divmod(number, len(samples))
    return cell, range(block * size, min((block + 1) * size, samples[cell]))


def shard_size(cells: Sequence[Cell], study: keys.Config) -> int:
    """Return the number of lanes in a shard: about a second's work, with small saved arrays."""
    most = min(cell.scenario.engine.shard for cell in cells)
    return int(np.clip(SHARD_BYTES // max(1, lane_bytes(cells, study.save)), 1, most))


def filled_stores(cells: Sequence[Cell], save: keys.Save) -> dict[str, dict[str, Variable]]:
    """Return the variables of the stores that are filled shard by shard, by store."""
    stores = {"errors.zarr": error_variables(cells)} if save.errors else {}
    if save.vehicles:
        stores["vehicles.zarr"] = dict(VEHICLE_ARRAYS)
    if save.trajectories == "all":
        stores["trajectories.zarr"] = trajectory_variables(cells)
    return stores


def lane_bytes(cells: Sequence[Cell], save: keys.Save) -> int:
    """Return an upper bound on the bytes of arrays that a lane leaves in the folder."""
    return sum(
        variable_bytes(variables, cells) for variables in filled_stores(cells, save).values()
    )


def disk_bytes(study: keys.Config, cells: Sequence[Cell], lanes: int) -> int:
    """Return an upper bound on the bytes on the disk of these lanes and of the chosen trajectories."""
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
    """Return the arrays over time: with the spread where a cell has no navigator, without the error where
    none has.
    """
    leaderless = [cell.scenario.leaderless for cell in cells]
    spread = {"spread": SPREAD_OVER_TIME} if any(leaderless) else {}
    return spread | {
        name: each for name, each in ERRORS.items() if name != "tracking" or not all(leaderless)
    }


def trajectory_variables(cells: Sequence[Cell]) -> dict[str, Variable]:
    """Return the arrays of a trajectory; `kept` only where a defence decides.

    States and inputs have one unit for each of their labels, separated by commas.
    """
    decides, vehicle = (
        any(cell.scenario.defence.decides for cell in cells),
        cells[0].scenario.vehicle,
    )
    units = {"states": ", ".join(vehicle.units), "inputs": ", ".join(vehicle.input_units)}
    return {
        name: variable._replace(unit=units.get(name, variable.unit))
        for name, variable in TRAJECTORIES.items()
        if decides or name != "kept"
    }


def series_of(variables: Mapping[str, Variable]) -> tuple[str, ...]:
    """Return the names of the engine's series that fill these arrays."""
    return tuple(variable.series for variable in variables.values())


def along_lanes(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the arrays of a store of chosen lanes, with `lane` as the first dimension."""
    every = {**variables, **cell_variables(variables)}
    return {
        name: variable._replace(dims=("lane", *own_dims(variable)))
        for name, variable in every.items()
    }


def cell_variables(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the arrays of a trajectory that all lanes of a cell share."""
    return {"navigator": NAVIGATOR} | ({"source": HEARD_SOURCES} if "kept" in variables else {})


def own_dims(variable: Variable) -> tuple[str, ...]:
    """Return the dimensions of an array without those that number the lane."""
    return tuple(dim for dim in variable.dims if dim not in ("cell", "sample", "lane"))


def variable_bytes(variables: Mapping[str, Variable], cells: Sequence[Cell]) -> int:
    """Return the bytes of one lane's part of these arrays."""
    coords = coordinates(cells, 1)
    return sum(
        int(np.prod([len(coords[dim]) for dim in own_dims(variable)]))
        * np.dtype(variable.dtype).itemsize
        for variable in variables.values()
    )
