"""What theory says of a study's cells: the bounds as a table, and the lanes that break one.

`‖E_i(t)‖ ≤ slope_i ā + Σ_k |expm(A_c t)_{0k}| ‖·‖` at every time, where · is E_i^(k)(0) - G_i^(k)(0) for the
static bound, G = L⁻¹ d, and E_i^(k)(0) for the peak gain and the harmonic bound (SCIENCE, O5). The other
sound bounds are never below the peak gain and need no check of their own.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.linalg import expm

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.scenario import outputs_of, situation_of, sources_of
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import attack_of, signals_of, source_of, start_of
from jaxnet.lanes.uniforms import Source
from jaxnet.model import graph, hearing, signal
from jaxnet.model.graph import Digraph
from jaxnet.statistics.groups import attacked_groups, labels_without_magnitude
from jaxnet.statistics.reach import scenario_gain
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.theory import bounds, exact
from jaxnet.theory.bounds import Bound

LIMIT_ALLOWANCE = 1e-9  # relative
MOST_LIMITS = 2**24  # limits held at a time, of vehicles, times and lanes
UNCHECKED = (
    "their weights or gains are drawn, ā does not bound the attack, nothing is known of whom the defence"
    " retains, or the law is not solved at every instant"
)
VIOLATION_COLUMNS = ("cell", "sample", "bound", "tail_max", "limit", "command")

Limits = Float[np.ndarray, "times m lanes"]
Response = Callable[[np.ndarray], Any]  # (3, 2, signals, lanes) to (3, 2, m, lanes), of jets


def slopes_table(cells: Sequence[Cell]) -> pd.DataFrame:
    """Slopes per ā of every bound, vehicle by vehicle, worst and fleet, for each group of attacked cells.

    All are blank where weights or gains are drawn, for then each lane has bounds of its own, where nothing is
    known of whom the defence retains, and where the law has a jerk held.
    """
    blocks = []
    for group in attacked_groups(cells):
        for name, bound in bounds_of(group.cells[0].scenario).items():
            numbered = {str(number): slope for number, slope in enumerate(bound.vehicles.tolist(), 1)}
            slopes = numbered | {"worst": bound.worst, "fleet": bound.fleet}
            blocks += [
                {**group.labels, "bound": name, "vehicle": who, "slope": s} for who, s in slopes.items()
            ]
    return pd.DataFrame(blocks, columns=[*labels_without_magnitude(cells[0]), "bound", "vehicle", "slope"])


def bounds_of(scenario: Scenario) -> dict[str, Bound]:
    """Bounds of a scenario by name, blank where nothing is known of whom is retained, or lanes differ."""
    reach = scenario_gain(scenario)
    return (
        bounds.unknown_bounds(scenario.vehicles)
        if reach is None
        else bounds.ultimate_bounds(reach, np.array(scenario.gain))
    )


def unchecked_cells(cells: Sequence[Cell]) -> list[int]:
    """Numbers of the attacked cells that `violations` leaves out."""
    attacked = [cell for cell in cells if cell.scenario.attack.present]
    return [cell.number for cell in attacked if scenario_gain(cell.scenario) is None]


def violations_table(results: Results) -> pd.DataFrame:
    """The ok lanes whose tail_max is over a bound that holds for them, each with the command that replays it.

    The limit is the greatest over vehicles and the tail's output times, with 1e-9 of it and the engine's
    `accuracy` on top (coarser tolerances than the defaults may exceed that by themselves). Static is asked
    where retained neighbours cannot change, the peak gain where it is finite, the harmonic bound of attacks
    that have one frequency. Cells whose weights or gains
    are drawn, or of whose defence nothing is known, are left out, and a failed lane has no tail_max that
    could exceed anything.
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
            found += excesses(results, cell, source, rows[first : first + at_once])
    return pd.DataFrame(found, columns=list(VIOLATION_COLUMNS))


def suspect_lanes(scenario: Scenario, source: Source, rows: Any) -> Bool[np.ndarray, " lanes"]:
    """Lanes over what a bound allows without a transient: no others can break it, so no others are drawn."""
    magnitude = magnitudes(scenario, Draw(source, rows["sample"].tolist(), scenario.vehicles))
    errors = rows["tail_max"].to_numpy()
    least = [
        error_limit(scenario, bound, magnitude).max(axis=0) for bound, _ in valid_bounds(scenario).values()
    ]
    return np.any([errors > limit for limit in least], axis=0)


def excesses(results: Results, cell: Cell, source: Source, rows: Any) -> Iterator[tuple[Any, ...]]:
    """Rows of the table of violations, of some lanes of one cell."""
    scenario, samples, errors = cell.scenario, rows["sample"].tolist(), rows["tail_max"].to_numpy()
    for bound, limits in limits_of(scenario, source, samples, tail_of(scenario)).items():
        limit = limits.max(axis=(0, 1))
        for n in np.flatnonzero(errors > limit):
            command = results.replay_command(cell.number, samples[n])
            yield cell.number, samples[n], bound, errors[n], limit[n], command


def tail_of(scenario: Scenario) -> Float[np.ndarray, " times"]:
    """Output times [s] that stand for t → ∞, both ends of the tail included."""
    last, tail = outputs_of(scenario), round(scenario.tail / scenario.output_step)
    return np.arange(last - tail, last + 1) * scenario.output_step


def limits_of(
    scenario: Scenario, source: Source, samples: Sequence[int], times: Float[np.ndarray, " times"]
) -> dict[str, Limits]:
    """What ‖y_i - y_0‖ [m] is at most by each bound that holds, its transient and the allowances included."""
    draw = Draw(source, samples, scenario.vehicles)
    error, attack = initial_errors(scenario, draw)
    flow = transient_factors(tuple(scenario.gain), tuple(times.tolist()))
    found = {}
    for name, (bound, response) in valid_bounds(scenario).items():
        free = error - response(attack)
        with np.errstate(over="ignore"):  # an infinite limit is over every error
            transient = np.einsum("tk,kin->tin", flow, np.linalg.norm(free, axis=1))
        found[name] = error_limit(scenario, bound, magnitudes(scenario, draw), transient)
    return found


def ceilings(config: Config, cell: Cell, samples: Sequence[int]) -> dict[str, float]:
    """Greatest tail_mean and tail_max [m] that theory allows in any of these lanes of a cell.

    The least of the bounds that hold, transient included; infinite or not-a-number where theory says nothing,
    or where the code of a kind is missing.
    """
    unknown = {"tail_mean": np.inf, "tail_max": np.inf}
    return known_or(unknown, lambda: known_ceilings(config, cell, samples))


def known_ceilings(config: Config, cell: Cell, samples: Sequence[int]) -> dict[str, float]:
    """`ceilings` of a cell whose kinds are at hand; raises MissingKindError else."""
    scenario = cell.scenario
    if scenario_gain(scenario) is None:
        return {"tail_mean": np.inf, "tail_max": np.inf}
    source, times = source_of(config, scenario), tail_of(scenario)
    at_once = max(1, MOST_LIMITS // (len(times) * scenario.vehicles))
    found = {"tail_mean": 0.0, "tail_max": 0.0}
    for first in range(0, len(samples), at_once):
        limits = limits_of(scenario, source, samples[first : first + at_once], times)
        least = functools.reduce(np.fmin, limits.values())
        lanes = {"tail_mean": least.mean(axis=(0, 1)), "tail_max": least.max(axis=(0, 1))}
        found = {metric: float(np.maximum(most, lanes[metric].max())) for metric, most in found.items()}
    return found


def magnitudes(scenario: Scenario, draw: Draw) -> Float[np.ndarray, " lanes"]:
    """ā [m] of attacked lanes."""
    return draw.one(scenario.attack.amplitude(), "attack.magnitude")


def valid_bounds(scenario: Scenario) -> dict[str, tuple[Bound, Response]]:
    """Bounds that hold, each with the G of the attack that its transient starts from: 0 where sets may
    switch.
    """
    reach, known = scenario_gain(scenario), situation_of(scenario)
    assert reach is not None
    gain = np.array(scenario.gain)
    found: dict[str, tuple[Bound, Response]] = {"peak_gain": (bounds.peak_gain(reach, gain), zero_response)}
    if scenario.attack.harmonic() and scenario.attack.consistent():
        found["harmonic"] = bounds.harmonic(reach, gain), zero_response
    if reach.fixed is not None and not np.isinf(reach.norms):
        word = reach.fixed.only(~(known.attacked & scenario.attack.replaces()))
        found["static"] = (
            bounds.static(reach),
            forced_response(scenario, word, reach.fixed.only(known.attacked)),
        )
    return found


def zero_response(attack: np.ndarray) -> float:
    """What no attack does."""
    return 0.0


def forced_response(scenario: Scenario, word: Digraph, added: Digraph) -> Response:
    """`G = L⁻¹ d`, by the graph whose links carry what vehicles say, and the one of attacked links."""
    solve, sources = graph.solver(word), sources_of(scenario)
    signals, weights = signals_of(scenario, sources), hearing.by_slot(added, added.weights, sources)

    def response(attack: np.ndarray) -> np.ndarray:
        shares = zip(weights, signals, strict=True)
        sums = np.sum([share[:, None] * attack[:, :, each] for share, each in shares], axis=0)
        found = solve(np.moveaxis(sums, 2, 0).reshape(scenario.vehicles, -1))
        return np.moveaxis(found.reshape(-1, *sums.shape[:2], sums.shape[-1]), 0, 2)

    return response


def error_limit(scenario: Scenario, bound: Bound, magnitude: Any, transient: Any = 0.0) -> Any:
    """`slope ā` + transient [m] with the allowances, by (time,) vehicle and lane."""
    with np.errstate(invalid="ignore"):  # of nothing an infinite multiple says nothing
        limit = bound.vehicles[:, None] * magnitude + transient
    return limit * (1 + LIMIT_ALLOWANCE) + scenario.engine.accuracy


@functools.lru_cache
def transient_factors(gain: tuple[float, ...], times: tuple[float, ...]) -> Float[np.ndarray, "times 3"]:
    """`|expm(A_c t)_{0k}|`, remembered, for cells mostly share their gain and tail."""
    return np.abs(expm(exact.companion(np.array(gain)) * np.array(times)[:, None, None])[:, 0])


def initial_errors(scenario: Scenario, draw: Draw) -> tuple[np.ndarray, np.ndarray]:
    """E and the attackers' signals at t = 0, each with two derivatives: (3, 2, m, lanes)."""
    with jax.enable_x64(True):  # kinds may reckon by JAX
        vehicle = scenario.vehicle.drawn(draw, "vehicle")
        start, navigator = start_of(scenario, vehicle, draw), scenario.navigator.drawn(draw, "navigator")
        own, zero = np.stack(vehicle.output_jets(start)), np.zeros(len(draw.samples))
        function, vectors, *_ = attack_of(scenario, draw, navigator, start)
        path = np.stack(navigator.jets(zero))
        attack = np.stack(signal.jets(vectors, function.basis(zero))[:3])
    return own - path[:3, :, None], attack
