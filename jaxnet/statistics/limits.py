"""Theory applied to a study's cells: the bounds as a table, and the lanes that violate a bound.

`‖E_i(t)‖ ≤ slope_i ā + Σ_k |expm(A_c t)_{0k}| ‖F_i^(k)‖` at every time. F_i^(k) is E_i^(k)(0) -
G_i^(k)(0) for the static bound, where G = L⁻¹ d. It is E_i^(k)(0) for the peak gain and the
harmonic bound (theorems.md O5). The other sound bounds are never below the peak gain and need no
check.
"""

import functools
from collections.abc import Callable, Iterator, Sequence

import jax
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.linalg import expm

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import (
    BOUNDS,
    broken_premise,
    for_any_signal,
    missing,
    outputs_of,
    situation_of,
    sources_of,
    too_many_sets,
)
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import attack_of, signals_of, source_of, start_of
from jaxnet.lanes.uniforms import Source
from jaxnet.model import graph, hearing, signal
from jaxnet.model.graph import Digraph
from jaxnet.model.wording import Named, cells_named, ranges
from jaxnet.statistics.groups import attacked_groups, labels_without_magnitude
from jaxnet.store.results import Results
from jaxnet.theory import bounds, solution
from jaxnet.theory.bounds import Bound
from jaxnet.theory.spread import bounded_vehicles, scenario_gain

LIMIT_ALLOWANCE = 1e-9  # relative rounding of a limit
# in memory at a time, over vehicles, times and lanes; a few arrays of this size exist
MOST_LIMITS = 2**20
VIOLATION_COLUMNS = ["cell", "sample", "bound", "tail_max", "limit", "command"]

Limits = Float[np.ndarray, "times m lanes"]
# jets (3, 2, signals, lanes) to (3, 2, m, lanes)
Response = Callable[[np.ndarray], np.ndarray | float]


def slopes_table(cells: Sequence[Cell]) -> pd.DataFrame:
    """Return the slopes per ā of every bound for each group of attacked cells.

    The harmonic bound has rows where the attack has one frequency.

    A bound has a slope for each vehicle, for the worst vehicle and for the fleet. Slopes are blank
    where lanes have bounds of their own, because weights or gains are drawn. They are also blank
    where nothing is known of the retained neighbours, and where the law holds a jerk.
    """
    rows, columns = [], [*labels_without_magnitude(cells[0]), "bound", "vehicle", "slope"]
    for group in attacked_groups(cells):
        scenario = group.cells[0].scenario
        reach, unknown = scenario_gain(scenario), Bound(np.full(scenario.vehicles, np.nan), np.nan)
        known = dict.fromkeys(bounds.BOUND_KEYS, unknown)
        if reach is not None:
            known = bounds.ultimate_bounds(reach, np.array(scenario.gain))
            if of_one_frequency(scenario):
                known["harmonic"] = bounds.harmonic(reach, np.array(scenario.gain))
        vehicles = [*map(str, range(1, scenario.vehicles + 1)), "worst", "fleet"]
        for name, bound in known.items():
            slopes = [*bound.vehicles.tolist(), bound.worst, bound.fleet]
            rows += [
                {**group.labels, "bound": name, "vehicle": vehicle, "slope": slope}
                for vehicle, slope in zip(vehicles, slopes, strict=True)
            ]
    return pd.DataFrame(rows, columns=columns)


def unchecked(cells: Sequence[Cell]) -> dict[str, list[int]]:
    """Numbers of attacked cells without a bound for every vehicle, by reason."""
    found: dict[str, list[int]] = {}
    for cell in cells:
        if cell.scenario.attack.present and (why := unbounded_words(cell.scenario)):
            found.setdefault(why, []).append(cell.number)
    return found


def unbounded_words(scenario: Scenario) -> str:
    """Why not every vehicle has a bound; "" if each has one."""
    bounded = bounded_vehicles(scenario)
    if bounded is None:
        return broken_premise(scenario, BOUNDS)
    if bounded.all():
        return ""
    who = ranges(vehicle_numbers(bounded))
    only = f"only vehicle {who} has one" if who.isdigit() else f"only vehicles {who} have one"
    return f"{only}, the others may be cut off" if who else "every vehicle may be cut off"


def unchecked_words(cells: Sequence[Cell], named: Named = cells_named) -> str:
    """The unchecked cells with their reasons; "" if there are none."""
    found = unchecked(cells)
    return "; ".join(f"{named(numbers)}: {why}" for why, numbers in found.items())


def at_once_words(cells: Sequence[Cell]) -> str:
    """Cells whose bounds are those of an attack on all vehicles; "" if there are none."""
    many = [cell for cell in cells if too_many_sets(cell.scenario)]
    numbers = [cell.number for cell in many if not missing(cell.scenario, BOUNDS)]
    told = "bounds take all vehicles as attacked at once, as too many sets may be drawn, in"
    return f"{told} {cells_named(numbers)}" if numbers else ""


def unclipped_words(results: Results) -> str:
    """Cells with limits in which no lane's inputs were saturated at any tick; "" if there are none.

    Between ticks the nonlinear engine may have clipped them all the same.
    """
    limited = [cell.number for cell in results.study.cells if cell.scenario.vehicle.limits]
    each = results.by_cell("saturated", cells=limited) if limited else ()
    numbers = [number for number, rows in each if not rows["saturated"].to_numpy().any()]
    return f"no input was saturated at any tick in {cells_named(numbers)}" if numbers else ""


def violations_table(results: Results) -> pd.DataFrame:
    """Ok lanes whose tail_max exceeds a valid bound, each with the command that replays the lane.

    The limit is the greatest over vehicles and the tail's output times. It includes 1e-9 of itself
    and the engine's `accuracy`; tolerances coarser than the defaults may exceed that. The static
    bound is checked where retained neighbours cannot change, the peak gain where it is finite. The
    harmonic bound is checked for attacks of one frequency. Cells with drawn weights or gains, and
    cells with unknown retained neighbours, are left out. A failed lane has no tail_max.
    """
    found = []
    attacked = {
        cell.number: cell
        for cell in results.study.cells
        if cell.scenario.attack.present and scenario_gain(cell.scenario) is not None
    }
    for number, rows in results.by_cell("sample", "tail_max", cells=attacked):
        cell = attacked[number]
        source = source_of(results.study.config, cell.scenario)
        rows = rows[suspect_lanes(cell.scenario, source, rows)]
        at_once = max(1, MOST_LIMITS // (len(tail_of(cell.scenario)) * cell.scenario.vehicles))
        for first in range(0, len(rows), at_once):
            found += excesses(results, cell, source, rows.iloc[first : first + at_once])
    return pd.DataFrame(found, columns=VIOLATION_COLUMNS)


def suspect_lanes(
    scenario: Scenario, source: Source, rows: pd.DataFrame
) -> Bool[np.ndarray, " lanes"]:
    """Lanes that exceed a bound without its transient; no other lane can violate the bound."""
    draw = Draw(source, rows["sample"].tolist(), scenario.vehicles)
    errors, magnitude = rows["tail_max"].to_numpy(), magnitudes(scenario, draw)
    least = [
        error_limit(scenario, bound, magnitude).max(axis=0)
        for bound, _ in valid_bounds(scenario).values()
    ]
    return np.any([errors > limit for limit in least], axis=0)


def excesses(
    results: Results, cell: Cell, source: Source, rows: pd.DataFrame
) -> Iterator[tuple[object, ...]]:
    scenario, samples, errors = cell.scenario, rows["sample"].tolist(), rows["tail_max"].to_numpy()
    for bound, limits in limits_of(scenario, source, samples, tail_of(scenario)).items():
        limit = limits.max(axis=(0, 1))
        for n in np.flatnonzero(errors > limit):
            command = results.replay_command(cell.number, samples[n])
            yield cell.number, samples[n], bound, errors[n], limit[n], command


def tail_of(scenario: Scenario) -> Float[np.ndarray, " times"]:
    """Output times [s] of the tail, both ends included."""
    last, tail = outputs_of(scenario), round(scenario.tail / scenario.output_step)
    return np.arange(last - tail, last + 1) * scenario.output_step


def limits_of(
    scenario: Scenario, source: Source, samples: Sequence[int], times: Float[np.ndarray, " times"]
) -> dict[str, Limits]:
    """Each valid bound's limit of ‖y_i - y_0‖ [m], with its transient and allowances."""
    draw = Draw(source, samples, scenario.vehicles)
    error, attack = initial_errors(scenario, draw)
    flow = transient_factors(tuple(scenario.gain), tuple(times.tolist()))
    found = {}
    for name, (bound, response) in valid_bounds(scenario).items():
        free = error - response(attack)
        with np.errstate(over="ignore"):  # no error exceeds an infinite limit
            transient = np.einsum("tk,kin->tin", flow, np.linalg.norm(free, axis=1))
        found[name] = error_limit(scenario, bound, magnitudes(scenario, draw), transient)
    return found


def magnitudes(scenario: Scenario, draw: Draw) -> Float[np.ndarray, " lanes"]:
    return draw.one(scenario.attack.amplitude(), "attack.magnitude")


@for_any_signal
def valid_bounds(scenario: Scenario) -> dict[str, tuple[Bound, Response]]:
    """Return valid bounds with the G at which transients start: 0 where kept sets may switch."""
    reach, known = scenario_gain(scenario), situation_of(scenario)
    assert reach is not None
    gain = np.array(scenario.gain)
    found: dict[str, tuple[Bound, Response]] = {
        "peak_gain": (bounds.peak_gain(reach, gain), lambda attack: 0.0)
    }
    if of_one_frequency(scenario):
        found["harmonic"] = bounds.harmonic(reach, gain), lambda attack: 0.0
    if reach.fixed is not None and not np.isinf(reach.norms):
        word = reach.fixed.only(~(known.attacked & scenario.attack.replaces()))
        found["static"] = (
            bounds.static(reach),
            forced_response(scenario, word, reach.fixed.only(known.attacked)),
        )
    return found


def of_one_frequency(scenario: Scenario) -> bool:
    return scenario.attack.harmonic() and scenario.attack.consistent()


def forced_response(scenario: Scenario, word: Digraph, added: Digraph) -> Response:
    """Return the function `G = L⁻¹ d`.

    `word` is the graph of the links that transmit their source's signal. `added` is the graph of
    attacked links.
    """
    solve, sources = graph.solver(word), sources_of(scenario)
    signals, weights = signals_of(scenario, sources), hearing.by_slot(added, added.weights, sources)

    def response(attack: np.ndarray) -> np.ndarray:
        shares = zip(weights, signals, strict=True)
        sums = np.sum([share[:, None] * attack[:, :, each] for share, each in shares], axis=0)
        found = solve(np.moveaxis(sums, 2, 0).reshape(scenario.vehicles, -1))
        return np.moveaxis(found.reshape(-1, *sums.shape[:2], sums.shape[-1]), 0, 2)

    return response


def error_limit(
    scenario: Scenario,
    bound: Bound,
    magnitude: Float[np.ndarray, " lanes"],
    transient: Limits | float = 0.0,
) -> Float[np.ndarray, "*times m lanes"]:
    """Return `slope ā` + transient [m] with the allowances, by (time,) vehicle and lane."""
    with np.errstate(invalid="ignore"):  # infinity times 0 is not-a-number
        limit = bound.vehicles[:, None] * magnitude + transient
    return limit * (1 + LIMIT_ALLOWANCE) + scenario.engine.accuracy


@functools.lru_cache
def transient_factors(
    gain: tuple[float, ...], times: tuple[float, ...]
) -> Float[np.ndarray, "times r"]:
    """Return `|expm(A_c t)_{0k}|` from a cache; most cells share their gain and tail."""
    return np.abs(expm(solution.companion(np.array(gain)) * np.array(times)[:, None, None])[:, 0])


def initial_errors(scenario: Scenario, draw: Draw) -> tuple[np.ndarray, np.ndarray]:
    """E and the attackers' signals at t = 0, derivatives below the order r: (r, 2, m, lanes)."""
    with jax.enable_x64(True):  # kinds may use JAX
        vehicle = scenario.vehicle.drawn(draw, "vehicle")
        start, navigator = (
            start_of(scenario, vehicle, draw),
            scenario.navigator.drawn(draw, "navigator"),
        )
        own, zero = np.stack(vehicle.output_jets(start)), np.zeros(len(draw.samples))
        function, vectors, *_ = attack_of(scenario, draw, navigator, own[0])
        path = np.stack(navigator.jets(zero))
        attack = np.stack(signal.jets(vectors, function.basis(zero))[: len(own)])
    return own - path[: len(own), :, None], attack
