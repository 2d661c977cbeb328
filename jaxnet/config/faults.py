"""What cannot be simulated, and why: faults that only several keys together show (DESIGN, section 3)."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxnet.config import keys as config
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.network import slowest_of, weights_of
from jaxnet.config.wording import shown
from jaxnet.model import graph

SLOWEST_NAVIGATOR = 0.05  # [m/s]
MULTIPLE = 1e-9  # relative
MOST_MULTIPLE = 1e8


class Objection(NamedTuple):
    """A fault: the keys that it stands on, the first the one to name, and what is wrong."""

    keys: tuple[str, ...]
    message: str


def study_objections(study: Config, cells: Sequence[Scenario]) -> Iterator[Objection]:
    """Faults of a study beyond its cells."""
    chosen = study.save.trajectories
    if isinstance(chosen, config.Samples):
        yield from chosen_objections(chosen.samples, study.samples)
    if isinstance(study.samples, config.Sequential) and study.recovery is None:
        yield Objection(
            ("samples.until", "samples"), "needs to know what has recovered: give recovery: {tau: 0.01}"
        )
    if study.recovery is not None:
        yield from recovery_objections(study, cells)


def chosen_objections(chosen: list[int], samples: Any) -> Iterator[Objection]:
    """Samples that are asked for must be simulated."""
    key = "save.trajectories.samples"
    if isinstance(samples, config.Sequential):
        yield Objection((key, "samples"), "asks for a fixed number of samples; {worst: K} does not")
        return
    beyond = [sample for sample in chosen if sample >= samples]
    if beyond:
        yield Objection((key, "samples"), f"samples are 0 to {samples - 1} (got {beyond[0]})")


def recovery_objections(study: Config, cells: Sequence[Scenario]) -> Iterator[Objection]:
    """A share of ā must be a number, and somewhere be asked about."""
    magnitudes = [cell.attack.magnitude for cell in cells if isinstance(cell.attack, config.Attacked)]
    if any(map(config.is_drawn, magnitudes)):
        yield Objection(
            ("recovery", "attack.magnitude"),
            "compares with ā, which is drawn here: give or sweep attack.magnitude",
        )
    elif cells and isinstance(study.samples, config.Sequential) and not any(magnitudes):
        yield Objection(
            ("samples.until", "samples"), "nobody lies in any cell, so there is nothing to recover from"
        )


def scenario_objections(scenario: Scenario) -> Iterator[Objection]:
    """Faults of one cell."""
    yield from time_objections(scenario)
    yield from gain_objections(scenario)
    yield from engine_objections(scenario)
    topology = list(topology_objections(scenario))
    yield from topology or graph_objections(scenario)
    yield from vehicle_objections(scenario)
    yield from navigator_objections(scenario)


def multiple(value: float, of: float) -> bool:
    """Whether one duration is a whole multiple of another."""
    if not of / 2 < value < of * MOST_MULTIPLE:
        return False
    return abs(value - round(value / of) * of) <= MULTIPLE * value


def time_objections(scenario: Scenario) -> Iterator[Objection]:
    """Ticks, output times, tail and horizon must fit into each other."""
    tick, step, horizon, tail = scenario.tick, scenario.output_step, scenario.horizon, scenario.tail
    if tick > 0 and not multiple(step, tick):
        yield Objection(
            ("output_step", "tick"), f"must be a multiple of tick = {tick:.12g} (got {step:.12g})"
        )
    if not multiple(horizon, step):
        yield Objection(
            ("horizon", "output_step"),
            f"must be a multiple of output_step = {step:.12g} (got {horizon:.12g})",
        )
    if tail > 0 and not multiple(tail, step):
        yield Objection(
            ("tail", "output_step"), f"must be a multiple of output_step = {step:.12g} (got {tail:.12g})"
        )
    if tail > horizon:
        yield Objection(("tail", "horizon"), f"must fit into horizon = {horizon:.12g} (got {tail:.12g})")


def gain_objections(scenario: Scenario) -> Iterator[Objection]:
    """The closed loop `s³ + k2 s² + k1 s + k0` must be Hurwitz, whatever is drawn."""
    k0, k1, k2 = worst = least_stable(scenario.gain)
    if not (k0 > 0 and k2 > 0 and k1 * k2 > k0):
        roots = np.sort_complex(np.roots([1.0, k2, k1, k0]))
        eigenvalues = ", ".join(f"{root.real:.3g}{root.imag:+.3g}j" for root in roots)
        drawn = f" where {shown(worst)} is drawn" if any(map(config.is_drawn, scenario.gain)) else ""
        yield Objection(("gain",), f"unstable: eigenvalues {eigenvalues}{drawn} (got {shown(scenario.gain)})")


def least_stable(gain: list[Any]) -> list[float]:
    """The draw that is unstable if any is: the least k1 and k2, and the greatest k0 if all are positive."""
    low, high = zip(*map(config.bounds, gain), strict=True)
    k0, k1, k2 = (0.0 if bound == -np.inf else bound for bound in low)
    return [high[0] if k0 > 0 else k0, k1, k2]


def engine_objections(scenario: Scenario) -> Iterator[Objection]:
    """The flat engine holds kept sets from tick to tick."""
    trims = isinstance(scenario.defence, config.TrustedTrim)
    if isinstance(scenario.engine, config.Flat) and trims and scenario.tick == 0:
        yield Objection(("engine", "tick"), "the flat engine trims at ticks only: give a tick, or chassis")


def topology_objections(scenario: Scenario) -> Iterator[Objection]:
    """The graph must be one of that many vehicles."""
    m, topology = scenario.vehicles, scenario.topology
    if isinstance(topology, config.Figure1) and m != 5:
        yield Objection(("vehicles", "topology"), f"figure1 has 5 vehicles (got {m})")
    if isinstance(topology, config.Cyclic) and m < 3:
        yield Objection(("vehicles", "topology"), f"a ring has at least 3 vehicles (got {m})")
    if isinstance(topology, config.Edges):
        yield from edge_objections(topology, m)


def vehicle_objections(scenario: Scenario) -> Iterator[Objection]:
    """Whoever is named must exist."""
    m = scenario.vehicles
    if isinstance(scenario.attack, config.Attacked):
        listed = scenario.attack.vehicles
        yield from unknown_vehicles("attack.vehicles", listed, m, first=1)
        if len(set(listed)) < len(listed):
            yield Objection(("attack.vehicles",), f"named twice (got {shown(listed)})")
    if isinstance(scenario.defence, config.TrustedTrim):
        defence = scenario.defence
        yield from unknown_vehicles("defence.trusted", list(defence.trusted), m, first=1)
        sources = [source for trusted in defence.trusted.values() for source in trusted]
        yield from unknown_vehicles("defence.trusted", sources, m, first=0)
        if isinstance(defence.theta, dict):
            yield from unknown_vehicles("defence.theta", list(defence.theta), m, first=1)


def unknown_vehicles(key: str, listed: list[int], vehicles: int, first: int) -> Iterator[Objection]:
    """Those of a list that do not exist."""
    beyond = sorted({one for one in listed if not first <= one <= vehicles})
    if beyond:
        noun = "vehicles are" if first else "sources are"
        yield Objection(
            (key, "vehicles"),
            f"{noun} {first} to {vehicles} (got {', '.join(map(str, beyond))})",
        )


def edge_objections(topology: config.Edges, vehicles: int) -> Iterator[Objection]:
    """Every edge joins two that exist and differ, once."""
    seen: set[tuple[int, int]] = set()
    for number, (listener, source, _) in enumerate(topology.edges):
        key = f"topology.edges.{number}"
        if not (1 <= listener <= vehicles and 0 <= source <= vehicles):
            yield Objection(
                (key, "topology.edges", "vehicles"),
                f"i is 1 to {vehicles} and j 0 to {vehicles} (got [{listener}, {source}])",
            )
        elif listener == source:
            yield Objection((key, "topology.edges"), f"{listener} hears itself")
        elif (listener, source) in seen:
            yield Objection((key, "topology.edges"), f"[{listener}, {source}] is given twice")
        seen.add((listener, source))


def graph_objections(scenario: Scenario) -> Iterator[Objection]:
    """The navigator must reach everybody, otherwise L is singular."""
    lost = graph.unreachable(weights_of(scenario))
    if lost:
        yield Objection(
            ("topology.edges", "topology"),
            f"the navigator does not reach {', '.join(map(str, lost))}",
        )


def navigator_objections(scenario: Scenario) -> Iterator[Objection]:
    """A navigator that stops makes every vehicle singular."""
    slowest, when = slowest_of(scenario)
    if slowest < SLOWEST_NAVIGATOR:
        yield Objection(
            ("navigator", "horizon"),
            f"slows to {slowest:.3g} m/s at t = {when:.4g} s; at least {SLOWEST_NAVIGATOR} m/s is needed,"
            " for the law is singular where a vehicle stands still",
        )
