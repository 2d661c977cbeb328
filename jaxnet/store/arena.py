"""A script with the closed loop of one lane, for the Robotarium's public simulator.

The script needs NumPy and the simulator alone (robotarium_python_simulator 2.1.0). All that the
lane has drawn stands in it as arrays. The arena reaches a start to 0.05 m and 0.2 rad only, so the
script computes commands from measured poses, by the functions of `arena_loop`.
"""

import inspect
import pprint
import textwrap
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.naming import labels_title
from jaxnet.engine.batch import Job
from jaxnet.kinds.fields import differs
from jaxnet.kinds.losses import Messages
from jaxnet.kinds.refusals import shorten_value
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import draw_of_attack, job, source_of
from jaxnet.model import signal
from jaxnet.model.lane import Lane
from jaxnet.model.retained import WeightsAsTheyAre, WithOwnWeight
from jaxnet.store import arena_loop
from jaxnet.store.folder import Folder, FolderError

# Of the script, by key and kind; the loop calls the first one.
FUNCTIONS: dict[str, dict[str, list[Callable[..., Any]]]] = {
    "defence": {
        "none": [arena_loop.believe_all],
        "trusted_only": [arena_loop.believe_trusted],
        "trusted_trim": [arena_loop.trim_by_trust],
        "w_msr": [arena_loop.w_msr],
    },
    "filter": {
        "none": [arena_loop.unfiltered],
        "barrier": [arena_loop.keep_apart, arena_loop.nearest_within],
    },
}
ARENA_KINDS = {
    "vehicle": ["robotarium"],
    "engine": ["sampled"],
    "law": ["local"],
    "navigator": ["none", "lissajous"],
    "attack": ["none", "bias", "rotating", "sinusoid", "own_path"],
    "defence": [*FUNCTIONS["defence"]],
    "filter": [*FUNCTIONS["filter"]],
    "formation": ["none", "circle", "file", "grid", "line", "offsets"],
    "channel.loss": ["none", "bernoulli", "gilbert_elliott", "jamming"],
    "detector": ["none"],
}
STEP = 0.033  # [s]
ARENA_VALUES = {  # of keys, where a cell has them
    "tick": STEP,
    "engine.move": "euler",
    "vehicle.wheel_radius": 0.016,
    "vehicle.base": 0.11,
    "vehicle.limits": {"wheel_rate": 12.5},
    "channel.missing": "drop",
    "channel.delay": 0.0,
    "attack.moves": "by_law",
    "filter.form": "halves",
    "defence.noise": 0.0,
    "defence.score": "position",
    "defence.filter": None,
}
MOST_ROBOTS = 50
HALF_SIZE = np.array([1.6, 1.0])  # [m], of the arena
MEANINGS = {
    "steps": "number of steps, and a step [s]",
    "ahead": "[m], from the axle to the point that the law steers",
    "gain": "[1/s], of the law: velocity = gain · (mean of messages - own place)",
    "start": "x [m], y [m], heading [rad]: a column for each robot",
    "places": "in the formation [m]: centre, cosine, sine, rate [rad/s], see `waves`",
    "navigator": "its path [m]: centre, cosine, sine, rate [rad/s]",
    "lies": "[m]: centre, cosine, sine, rate [rad/s]; column 0 is no lie",
    "listener": "links: who listens (robots count from 1)",
    "source": "links: whom it hears (0 is the navigator)",
    "carried": "links: whose place a message has; one above the last robot: nobody's",
    "lie": "links: the column of `lies` that a message adds",
    "weight": "links: weights, which sum to 1 for each listener",
    "normalised": "1: the sum of believed weights and `own_weight` is a divisor; 0: `own_weight`",
    "lost": "messages that the channel loses: a row for each step, a column for each link",
    "trusted": "links: whether the listener trusts the source",
    "trusts_nobody": "links: whether the listener trusts no source",
    "spared": "links: whether the defence never drops it",
    "theta": "links: how many messages the listener drops",
    "tolerance": "[m], added to the score of a message that was dropped before",
    "F": "how many messages a robot drops on each side",
    "told": "[m], what robots tell of their places beside the truth: centre, cosine, sine, rate",
    "distance": "of the filter: [m], gain [s⁻¹ m^(2 - 2 power)], power, speed [m/s]",
}


def refuse_unable(cell: Cell, out: str | Path | UPath) -> None:
    """Raise FolderError if the cell has what the script cannot do, or the file is no script."""
    if UPath(out).suffix != ".py":
        raise FolderError(f"robotarium: a script ends in .py (got {out})")
    if refused := [*refusals(cell.scenario)]:
        told = "\n  ".join(refused)
        raise FolderError(
            f"cell {cell.number} cannot be exported to the arena, for which:\n  {told}"
        )


def write_script(
    config: Config, cell: Cell, sample: int, lane: xr.Dataset, out: str | Path | UPath
) -> list[UPath]:
    """Write the script and, beside it, the poses of the lane, (times, 3, robots).

    Raises FolderError if a robot starts outside the arena.
    """
    poses = np.moveaxis(lane["states"].values, -1, 1).copy()
    poses[:, 2] = np.arctan2(np.sin(poses[:, 2]), np.cos(poses[:, 2]))
    outside = (np.abs(poses[0, :2]) > HALF_SIZE[:, None]).any(axis=0)
    if outside.any():
        x, y = poses[0, :2, outside.argmax()]
        told = f"robot {outside.argmax() + 1} starts at ({x:.3g}, {y:.3g}) m, outside the arena"
        raise FolderError(f"cell {cell.number}, sample {sample}: {told} of ±1.6 m by ±1 m")
    place = UPath(out)
    numbers = {"start": poses[0], **lane_numbers(cell.scenario, sample, config)}
    title = " ".join(labels_title(cell.labels).split())
    heading = f"study {config.name}, cell {cell.number}{title and f' ({title})'}, sample {sample}"
    text, folder = script_text(heading, place.stem, numbers, cell.scenario), Folder(place.parent)
    script = folder.put(place.name, text.encode())
    return [script, folder.put(f"{place.stem}_poses.npy", lambda file: np.save(file, poses))]


def refusals(scenario: Scenario) -> Iterator[str]:
    """Yield what the script cannot do: key, what is given, what is allowed."""
    for key, allowed in ARENA_KINDS.items():
        name = name_of(scenario, key)
        if name not in allowed:
            yield f"{key}: {' or '.join(allowed)} (got {name})"
    for key, needed in ARENA_VALUES.items():
        family, _, name = key.rpartition(".")
        given = getattr(getattr(scenario, family) if family else scenario, name, None)
        if given not in (None, needed):
            yield f"{key}: {shorten_value(needed)} (got {shorten_value(given)})"
    for key, other, told in (
        ("gain", scenario.gain_matrices is not None, "one number"),
        ("sensing", not scenario.sensing.exact(), "no errors"),
        ("channel.noise", not scenario.channel.noise.exact(), "none"),
        ("channel.quantisation", scenario.channel.rounded, "0"),
        ("attack.vehicles", bool(scenario.attack.periods()), "the same ones at all times"),
        ("topology", len(scenario.topology.turns()) > 1, "one network"),
        ("vehicles", scenario.vehicles > MOST_ROBOTS, f"at most {MOST_ROBOTS}"),
    ):
        if other:
            yield f"{key}: {told} (got {shorten_value(attrgetter(key)(scenario))})"


def name_of(scenario: Scenario, key: str) -> str:
    return attrgetter(key)(scenario).reference()


def lane_numbers(scenario: Scenario, sample: int, config: Config) -> dict[str, Any]:
    """The numbers of a lane as `arena_loop` takes them, by name."""
    source = source_of(config, scenario)
    draw, attack = Draw(source, [sample], scenario.vehicles), scenario.attack
    with jax.enable_x64(True):
        one = job(scenario, source, [sample])
        lane = jax.tree.map(lambda leaf: np.moveaxis(np.asarray(leaf), 0, -1), one.inputs.lane)
        listener, slot = np.nonzero(lane.weights[..., 0].T > 0)
        at, steps = (slot, listener), int(one.clock.ticks * one.clock.outputs)
        lost = np.zeros((steps, len(slot)), bool)
        if lane.loss is not None:
            lost = lost_messages(one, lane, steps)[:, *at]
    start, robots, own_path = np.zeros(1), scenario.vehicles, not attack.bounded
    path, places = lane.path(start), np.zeros((3, 2, robots))
    if lane.formation is not None:
        places = lane.offsets(start)[..., 0]
    lies = np.stack(signal.jets(lane.vectors, lane.basis(start)))[..., 0]
    hearing = [np.asarray(each)[at] for each in one.network.hearing]
    sources, carried, attacked, number = hearing
    if not attack.replaces():
        attacked = attacked & (lane.vectors != 0).any(axis=(0, 2, 3))[number]
    told, lie = np.unique(number[attacked], return_inverse=True)
    rate = np.broadcast_to(attack_rate(scenario, draw_of_attack(scenario, draw)), lies.shape[2])
    robots_lie = wave_parts(lies, rate)
    if (sources[attacked] == 0).any():  # a robot's own place is told truly
        robots_lie = 0 * robots_lie
    lies = lies[..., told] + path * own_path  # a path of its own is less the navigator's
    column = np.zeros(len(slot), int)
    column[attacked] = lie + 1
    strength, own_weight = lane.strength, np.zeros(robots)
    if isinstance(strength, WithOwnWeight):
        own_weight = strength.own[:, 0]
    elif isinstance(strength, WeightsAsTheyAre):  # divided by nothing but the sum of the row
        own_weight = 1 / np.where(strength.total > 0, strength.total, 1.0)[:, 0]
    defence, trusted = scenario.defence, np.asarray(one.network.trusted)[at]
    return {
        "steps": steps,
        "step": STEP,
        "ahead": number_of(lane.vehicle, "ahead"),
        "gain": float(lane.gain[0, 0]),
        "places": wave_parts(places, getattr(lane.formation, "turn_rate", 0.0)),
        "navigator": wave_parts(path, getattr(lane.navigator, "frequency", 0.0)),
        "lies": np.pad(wave_parts(lies, rate[told]), ((0, 0), (0, 0), (1, 0))),
        "listener": listener + 1,
        "source": sources,
        "carried": np.where(attacked & own_path, robots + 1, carried),
        "lie": column,
        "weight": lane.weights[*at, 0],
        "normalised": 0 if isinstance(strength, WeightsAsTheyAre) else 1,
        "own_weight": own_weight,
        "lost": lost,
        "trusted": trusted,
        "trusts_nobody": ~np.isin(listener, listener[trusted]),
        "spared": trusted & (not getattr(defence, "drop_trusted", False)),
        "theta": getattr(one.network.shared, "theta", np.zeros(robots, int))[listener],
        "tolerance": number_of(lane.defence, "tolerance"),
        "F": getattr(defence, "F", 0),
        "told": robots_lie,
        "distance": number_of(lane.filter, "distance"),
        "barrier_gain": number_of(lane.filter, "gain"),
        "power": getattr(lane.filter, "power", 0),
        "speed": number_of(lane.filter, "speed") or 1e9,  # none
    }


def number_of(kind: Any, name: str) -> float:
    """A drawn number of a kind, 0 where it has none."""
    return float(np.ravel(getattr(kind, name, None) or 0.0)[0])


def attack_rate(scenario: Scenario, draw: Draw) -> np.ndarray:
    """The angular frequency of each signal, or of all [rad/s]."""
    number, name = getattr(scenario.attack, "frequency", 0.0), "attack.frequency"
    return draw.each(number, name)[0, :, 0] if differs(number) else draw.one(number, name)[:1]


def wave_parts(jets: np.ndarray, rate: Any) -> np.ndarray:
    """Centre, cosine, sine and rate (4, 2, columns) of a harmonic with these jets at t = 0."""
    value, first, second = jets[:3]
    rate = np.broadcast_to(rate, value.shape)
    turns = np.where(rate == 0, np.inf, rate)
    cosine, sine = -second / turns**2, first / turns
    return np.stack([value - cosine, cosine, sine, rate])


def lost_messages(one: Job, lane: Lane, steps: int) -> np.ndarray:
    """The messages that the lane's channel loses at each tick, (steps, slots, m)."""
    present = lane.weights > 0

    def messages(time: Any) -> Messages:
        nowhere = jnp.zeros(present.shape)
        return Messages(time, one.network.hearing.sources, present, nowhere, lane.interval)

    def tick(memory: Any, number: Any) -> tuple[Any, Any]:
        lost, memory = lane.loss.lost(messages(one.clock.at(number)[None]), memory)
        return memory, lost[..., 0]

    first = lane.loss.start(messages(jnp.zeros(1)))
    return np.asarray(jax.lax.scan(tick, first, jnp.arange(steps))[1])


def script_text(heading: str, stem: str, numbers: dict[str, Any], scenario: Scenario) -> str:
    """The script: its head, the numbers of the lane, the functions of the loop, and the run."""
    defence, safety = (FUNCTIONS[key][name_of(scenario, key)] for key in FUNCTIONS)
    loop = arena_loop.drive_robots, arena_loop.commands, arena_loop.waves
    source = "\n\n".join(map(inspect.getsource, (*loop, *defence, *safety)))
    needed = {name: value for name, value in numbers.items() if f"lane.{name}" in source}
    fields = "".join(map(field_text, needed, needed.values()))
    return f"""\
# {heading}
#
# The closed loop of this lane of jaxnet, for the simulator of the Robotarium, version 2.1.0 or
# later (github.com/robotarium/robotarium_python_simulator). Where rps can be imported:
#
#     python {stem}.py
#
# Robots are driven near `lane.start`, then the loop runs by the poses that are measured, and saves
# them as {stem}_measured.npy. {stem}_poses.npy has the lane as jaxnet simulated it, every
# {scenario.output_step:g} s. Both are (times, 3, robots).
from types import SimpleNamespace
from typing import Any

import numpy as np
import rps.robotarium as robotarium

Array = np.ndarray
lane = SimpleNamespace(
{fields})


{source}

lane.defence, lane.filter = {defence[0].__name__}, {safety[0].__name__}
robots = robotarium.Robotarium(
    number_of_robots=lane.start.shape[1],
    show_figure=True,
    initial_conditions=lane.start,
    sim_in_real_time=True,
)
measured = drive_robots(robots, lane)
np.save({f"{stem}_measured.npy"!r}, measured)
(robots.debug if hasattr(robots, "debug") else robots.call_at_scripts_end)()
"""


def field_text(name: str, value: Any) -> str:
    told = f"    # {MEANINGS[name]}\n" if name in MEANINGS else ""
    return f"{told}    {name}={literal(value)},\n"


def literal(value: Any) -> str:
    """A number or array as Python reads it again, to the last bit."""
    if np.ndim(value) == 0:
        return repr(value)
    if not value.any():
        return f'np.zeros({value.shape}, "{value.dtype}")'
    if value.dtype == bool and value.ndim == 2:
        rows = "\n".join("".join(map(str, row)) for row in value.astype(int).tolist())
        return f'np.array([[*row] for row in """\n{rows}\n""".split()]) == "1"'
    rows = pprint.pformat(value.tolist(), width=88, compact=True)
    return f"np.array(\n{textwrap.indent(rows, ' ' * 8)}\n    )"
