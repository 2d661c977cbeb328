"""What theory says of a study's cells: the bounds as a table, and the lanes that break one.

`‖E_i(t)‖ ≤ slope_i ā + Σ_k |expm(A_c t)_{0k}| ‖·‖` at every time, where · is E_i^(k)(0) - G_i^(k)(0) for the
static bound, G = L⁻¹ d, and E_i^(k)(0) for the peak gain (SCIENCE, O5). The other sound bounds are never
below the peak gain and need no check of their own.
"""

import functools
from collections.abc import Iterator, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.linalg import expm

from jaxnet.config import keys as config
from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario
from jaxnet.config.network import navigator_of, network_of, weights_are_drawn
from jaxnet.lanes.jobs import Drawn, clock_of
from jaxnet.model import graph, robot
from jaxnet.statistics.groups import attacked_groups, shared
from jaxnet.store.results import Results
from jaxnet.theory import bounds, exact
from jaxnet.theory.bounds import Bound

ROUNDING = 1e-9  # relative
ACCURACY = {"chassis": 1e-5, "flat": 1e-8}  # [m], what an engine may be off at its default tolerances
NUMBERS = 2**24  # limits held at a time, of vehicles, times and lanes
COLUMNS = ("cell", "sample", "bound", "tail_max", "limit", "command")

Limits = Float[np.ndarray, "times m lanes"]


def table(cells: Sequence[Cell]) -> pd.DataFrame:
    """Slopes per ā of every bound, vehicle by vehicle, worst and fleet, for each group of attacked cells.

    All are blank where weights or gains are drawn: then each lane has bounds of its own.
    """
    blocks = []
    for group in attacked_groups(cells):
        for name, bound in bounds_of(group.cells[0].scenario).items():
            numbered = {str(number): slope for number, slope in enumerate(bound.vehicles.tolist(), 1)}
            slopes = numbered | {"worst": bound.worst, "fleet": bound.fleet}
            blocks += [
                {**group.labels, "bound": name, "vehicle": who, "slope": s} for who, s in slopes.items()
            ]
    return pd.DataFrame(blocks, columns=[*shared(cells[0]), "bound", "vehicle", "slope"])


def bounds_of(scenario: Scenario) -> dict[str, Bound]:
    """Bounds of a scenario by name, blank where they differ from lane to lane."""
    if not shared_by_lanes(scenario):
        return dict.fromkeys(bounds.NAMES, Bound(np.full(scenario.vehicles, np.nan), np.nan))
    network = network_of(scenario)
    links = network.weights, network.attacked, network.trusted, network.theta
    return bounds.bounds(*links, np.array(scenario.gain))


def shared_by_lanes(scenario: Scenario) -> bool:
    """Whether all lanes have the same bounds."""
    return not weights_are_drawn(scenario) and not any(map(config.is_drawn, scenario.gain))


def unchecked(cells: Sequence[Cell]) -> list[int]:
    """Numbers of the attacked cells that `violations` leaves out."""
    attacked = [cell for cell in cells if isinstance(cell.scenario.attack, config.Attacked)]
    return [cell.number for cell in attacked if not shared_by_lanes(cell.scenario)]


def violations(results: Results) -> pd.DataFrame:
    """The ok lanes whose tail_max is over a bound that holds for them, each with the command that replays it.

    The limit is the greatest over vehicles and the tail's output times, with 1e-9 of it and the engine's
    `ACCURACY` on top (a chassis engine with coarser tolerances than the defaults may exceed that by itself).
    Static is asked where kept sets cannot switch, the peak gain where it is finite. Cells whose weights or
    gains are drawn are left out, and a failed lane has no tail_max that could exceed anything.
    """
    seed, found = results.study.config.seed, []
    attacked = {
        cell.number: cell
        for cell in results.study.cells
        if isinstance(cell.scenario.attack, config.Attacked) and shared_by_lanes(cell.scenario)
    }
    for number, rows in results.by_cell("sample", "tail_max", cells=attacked):
        cell = attacked[number]
        rows = rows[suspects(cell.scenario, seed, rows)]
        at_once = max(1, NUMBERS // (len(tail_of(cell.scenario)) * cell.scenario.vehicles))
        for first in range(0, len(rows), at_once):
            found += excesses(results, cell, rows[first : first + at_once])
    return pd.DataFrame(found, columns=list(COLUMNS))


def suspects(scenario: Scenario, seed: int, rows: Any) -> Bool[np.ndarray, " lanes"]:
    """Lanes over what a bound allows without a transient: no others can break it, so no others are drawn."""
    magnitude = magnitudes(Drawn(scenario, seed, rows["sample"].tolist()))
    errors = rows["tail_max"].to_numpy()
    least = [allowed(scenario, bound, magnitude).max(axis=0) for bound, _ in holding(scenario).values()]
    return np.any([errors > limit for limit in least], axis=0)


def excesses(results: Results, cell: Cell, rows: Any) -> Iterator[tuple[Any, ...]]:
    """Rows of the table of violations, of some lanes of one cell."""
    scenario, samples, errors = cell.scenario, rows["sample"].tolist(), rows["tail_max"].to_numpy()
    for bound, limits in limits_of(scenario, results.study.config.seed, samples, tail_of(scenario)).items():
        limit = limits.max(axis=(0, 1))
        for n in np.flatnonzero(errors > limit):
            command = results.replay_command(cell.number, samples[n])
            yield cell.number, samples[n], bound, errors[n], limit[n], command


def tail_of(scenario: Scenario) -> Float[np.ndarray, " times"]:
    """Output times [s] that stand for t → ∞."""
    clock = clock_of(scenario)
    last = int(clock.outputs)
    return np.arange(last + 1 - int(clock.tail_outputs), last + 1) * scenario.output_step


def limits_of(
    scenario: Scenario, seed: int, samples: Sequence[int], times: Float[np.ndarray, " times"]
) -> dict[str, Limits]:
    """What ‖y_i - y_0‖ [m] is at most by each bound that holds, its transient and the allowances included."""
    drawn = Drawn(scenario, seed, samples)
    path = np.stack(navigator_of(scenario).jets(np.zeros(1))[:3])
    with jax.enable_x64(True):
        own, signal = map(np.asarray, start(drawn.initial(), drawn.attack()))
    error = own - path[:, :, None]
    flow = influence(tuple(scenario.gain), tuple(times.tolist()))
    found = {}
    for name, (bound, mixing) in holding(scenario).items():
        free = error - np.einsum("ij,kxjn->kxin", mixing, signal)
        transient = np.einsum("tk,kin->tin", flow, np.linalg.norm(free, axis=1))
        found[name] = allowed(scenario, bound, magnitudes(drawn), transient)
    return found


def magnitudes(drawn: Drawn) -> Float[np.ndarray, " lanes"]:
    """ā [m] of attacked lanes."""
    return drawn.one(cast(config.Attacked, drawn.scenario.attack).magnitude, "attack.magnitude")


def holding(scenario: Scenario) -> dict[str, tuple[Bound, Float[np.ndarray, "m m"]]]:
    """Bounds that hold, each with the K of the G = K a its transient starts from: 0 for the peak gain."""
    network = network_of(scenario)
    lies = bounds.spread_of(network.weights, network.attacked, network.trusted, network.theta)
    nothing = np.zeros((scenario.vehicles, scenario.vehicles))
    found = {"peak_gain": (bounds.peak_gain(lies, np.array(scenario.gain)), nothing)}
    if lies.kept is not None and np.isfinite(lies.norms):
        told = np.where(network.attacked, lies.kept, 0.0)
        mixing = np.linalg.solve(graph.laplacian(lies.kept), told[:, 1:] + np.diag(told[:, 0]))
        found["static"] = bounds.static(lies), mixing
    return found


def allowed(scenario: Scenario, bound: Bound, magnitude: Any, transient: Any = 0.0) -> Any:
    """`slope ā` + transient [m] with the allowances, by (time,) vehicle and lane."""
    with np.errstate(invalid="ignore"):  # of nothing an infinite multiple says nothing
        limit = bound.vehicles[:, None] * magnitude + transient
    return limit * (1 + ROUNDING) + ACCURACY[scenario.engine.kind]


@functools.lru_cache
def influence(gain: tuple[float, ...], times: tuple[float, ...]) -> Float[np.ndarray, "times 3"]:
    """`|expm(A_c t)_{0k}|`, remembered, for cells mostly share their gain and tail."""
    return np.abs(expm(exact.companion(np.array(gain)) * np.array(times)[:, None, None])[:, 0])


@jax.jit
def start(initial: Any, attack: Any) -> Any:
    """Outputs and attackers' signals at t = 0, each with two derivatives: (3, 2, m, lanes)."""
    initial, attack = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), (initial, attack))
    signal = attack.jets(jnp.zeros(initial.shape[-1]))[:3]
    return jnp.stack(robot.output_jets(initial)), jnp.stack(signal)
