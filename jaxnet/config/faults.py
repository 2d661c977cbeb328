"""Faults that only several keys together show: scenarios that cannot be simulated (docs/config.md)."""

from collections.abc import Iterator, Sequence

import numpy as np

from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.keys import (
    KINDS,
    RANDOMISATIONS,
    Config,
    Samples,
    Scenario,
    SearchSettings,
    Sequential,
)
from jaxnet.config.scenario import scenario_graph
from jaxnet.config.wording import shorten_value
from jaxnet.kinds.fields import EachOrder, EachPosition, Number, is_drawn, value_range
from jaxnet.kinds.kind import Fault, Kind, KindError
from jaxnet.kinds.metrics import DETECTION
from jaxnet.outside import blame
from jaxnet.theory import exact

MULTIPLE_TOLERANCE = 1e-9  # relative tolerance
MOST_MULTIPLE = 10**8
MOST_LATE = 200  # ticks by which words may be late
MOST_RATE = (
    0.5  # of a time constant in a tick over which a motion is a power series: errs by under 1e-7
)
LEAST_CHOICES = 100  # choices that a search tries at least


def study_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    """Yield the faults of a study beyond those of its cells."""
    chosen = study.save.trajectories
    if isinstance(chosen, Samples):
        yield from chosen_faults(chosen.samples, study.samples)
    if isinstance(study.samples, Sequential) and study.recovery is None:
        yield Fault(
            ("samples.until", "samples"),
            "needs to know what has recovered: give recovery: {tau: 0.01}",
        )
    if study.draws == "sobol":
        yield from sobol_faults(study)
    if study.recovery is not None:
        yield from recovery_faults(study, cells)
    if study.search is not None:
        yield from search_faults(study, study.search)
    stores = study.save.errors or study.save.vehicles or study.save.trajectories != "none"
    if stores and "vehicles" not in study.sweep and len({cell.vehicles for cell in cells}) > 1:
        yield Fault(
            ("save", "sweep.topology"),
            "stores arrays of one size: all networks need as many vehicles",
        )
    yield from metric_faults(study, cells)


def replaced_faults(
    study: Config, swept: Sequence[str], cells: Sequence[Scenario]
) -> Iterator[Fault]:
    """Yield the faults of given values that a sweep replaces, where they are wrong in every cell.

    They are those of a kind alone, or of a kind and the number of vehicles. A network brings its own number.
    """
    for key in swept:
        root, *inside = key.split(".")
        if root not in KINDS or root == "topology" or len(inside) > 1:
            continue
        base, found = getattr(study, root), list[Fault]()
        for cell in cells:
            kind = getattr(cell, root) if inside else base
            if inside and type(kind) is type(base):
                kind = kind.model_copy(update={inside[0]: getattr(base, inside[0])})
            wrong = kind_faults(root, kind, cell.model_copy(update={root: kind}))
            found = [each for each in wrong if f"{each.keys[0]}.".startswith(f"{key}.")]
            found = [
                each
                for each in found
                if {part.split(".")[0] for part in each.keys} <= {root, "vehicles"}
            ]
            if not found:
                break
        yield from found


def metric_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    """Yield a fault if columns share a name, a name is no identifier, or nothing gives a share of alarms."""
    own = [metric.name for metric in study.measured()]
    isolation = ["cut_off", "cut_off_at", "cut_off_vehicles", "cut_off_share", "stopped"]
    counts = ["steps", "switches", "unheard", *isolation]
    names = ["cell", "sample", "status", *counts, *study.sweep, *own]
    twice = sorted({name for name in own if names.count(name) > 1})
    odd = [name for name in own if not name.isidentifier()]
    if twice or odd:
        yield Fault(
            ("metrics",), f"a metric's name must be a column's own (got {', '.join(twice + odd)})"
        )
    if shares := [
        name for name in own if name in DETECTION and not any(c.detector.present for c in cells)
    ]:
        yield Fault(("metrics",), f"no word is judged without a detector (got {', '.join(shares)})")


def chosen_faults(chosen: list[int], samples: int | Sequential) -> Iterator[Fault]:
    """Yield a fault for samples whose trajectories are stored but which are not simulated."""
    key = "save.trajectories.samples"
    if isinstance(samples, Sequential):
        yield Fault((key, "samples"), "asks for a fixed number of samples; {worst: K} does not")
        return
    beyond = [sample for sample in chosen if sample >= samples]
    if beyond:
        yield Fault((key, "samples"), f"samples are 0 to {samples - 1} (got {beyond[0]})")


def sobol_faults(study: Config) -> Iterator[Fault]:
    """Yield faults of a Sobol study: an unsuitable number of samples, or a recovery, whose interval is not
    known.
    """
    each, rest = (
        (0, 1) if isinstance(study.samples, Sequential) else divmod(study.samples, RANDOMISATIONS)
    )
    if rest or each & (each - 1):
        got = "until: …" if isinstance(study.samples, Sequential) else shorten_value(study.samples)
        yield Fault(
            ("samples", "draws"),
            f"must be {RANDOMISATIONS} times a power of two where draws is sobol: {RANDOMISATIONS}, 32, 64, …"
            f" (got {got})",
        )
    if study.recovery is not None:
        yield Fault(
            ("recovery", "draws"),
            "has an interval of independent lanes: give draws: random, or no recovery",
        )


def search_faults(study: Config, search: SearchSettings) -> Iterator[Fault]:
    """Yield faults of a search: swept keys, Sobol draws, an unknown metric, or too small a budget."""
    for key in search.over:
        if swept := [each for each in study.sweep if f"{key}.".startswith(f"{each}.")]:
            yield Fault(
                (f"search.over.{key}",), f"{swept[0]} is swept: search over it, or sweep it"
            )
    if study.draws == "sobol":
        yield Fault(
            ("draws", "search"), "a search is held against random lanes: give draws: random"
        )
    measured = [metric.name for metric in study.measured()]
    if search.maximise == "unrecovered":
        if study.recovery is None:
            yield Fault(
                ("search.maximise",), "needs to know what has recovered: give recovery: {tau: 0.01}"
            )
    elif search.maximise not in measured:
        got = f"must be unrecovered, or one of {', '.join(measured)} (got {search.maximise})"
        yield Fault(("search.maximise",), got)
    for name in search.subject_to:
        if name not in measured:
            more = "" if study.detector.present else "; a detector gives alarms and false_alarms"
            got = f"must be one of {', '.join(measured)}{more} (got {name})"
            yield Fault((f"search.subject_to.{name}", "search.subject_to"), got)
    if search.budget < LEAST_CHOICES * search.starts:
        least = LEAST_CHOICES * search.starts
        yield Fault(
            ("search.budget", "search.starts"),
            f"must be at least {least:,} lanes, {LEAST_CHOICES} choices from {search.starts} starts each"
            f" (got {search.budget:,})",
        )


def amplitude_faults(cells: Sequence[Scenario]) -> Iterator[Fault]:
    """Yield a fault if the amplitude in force of an attack is not known, or no position is shifted."""
    for cell in cells:
        attack = cell.attack
        if attack.present and attack.amplitude() > 0 and not known_amplitude(cell) > 0:
            yield Fault(
                ("recovery.of", "attack"),
                f"the amplitude in force of attack {attack.reference()} is not one known number: numbers are"
                " drawn, or ā does not bound positions; give of: magnitude",
            )
            return


def recovery_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    """Yield a fault if ā is drawn, or if samples depend on recovery and no cell is attacked."""
    magnitudes = [cell.attack.amplitude() for cell in cells if cell.attack.present]
    if any(map(is_drawn, magnitudes)):
        yield Fault(
            ("recovery", "attack.magnitude"),
            "compares with ā, which is drawn here: give or sweep attack.magnitude",
        )
    elif study.recovery is not None and study.recovery.of == "amplitude":
        yield from amplitude_faults(cells)
    elif cells and isinstance(study.samples, Sequential) and not any(magnitudes):
        yield Fault(
            ("samples.until", "samples"),
            "nobody is attacked in any cell, so there is nothing to recover from",
        )


def scenario_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield the faults of one cell."""
    yield from time_faults(scenario)
    yield from gain_faults(scenario)
    yield from position_faults(scenario)
    for key in KINDS:
        yield from kind_faults(key, getattr(scenario, key), scenario)
    yield from kind_faults("channel.loss", scenario.channel.loss, scenario)
    yield from kind_faults("channel.noise", scenario.channel.noise, scenario)
    if scenario.channel.missing != "drop" or scenario.channel.late:
        yield from old_word_faults(scenario)
    yield from world_faults(scenario)
    if scenario.channel.late:
        yield from delay_faults(scenario)
    if scenario.detector.present:
        yield from detector_faults(scenario)


def world_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield a fault where a law or gain does not know what words become on their way."""
    channel, networks = scenario.channel, len(scenario.topology.turns())
    exact = channel.noise.exact() and not channel.rounded
    if not scenario.law.takes_any_message() and not (exact and networks == 1):
        yield Fault(("law", "channel"), "linearised knows no noise of words, and one network")
    if not scenario.law.couples() and channel.noise.errs_in_highest():
        told = f"vehicles do not tell their highest derivative under law: {scenario.law.kind}"
        yield Fault(("channel.noise.jerk", "law"), told)
    plain = exact and not channel.late and channel.missing == "drop"
    if scenario.gain_matrices is not None and not plain:
        told = "noise, rounding, delay and stand-ins of words need a number for each order"
        yield Fault(("gain", "channel"), told)
    steps, order = channel.quantisation, scenario.vehicle.order
    if channel.rounded and scenario.tick == 0:
        yield Fault(("channel.quantisation", "tick"), "words are rounded at ticks: give a tick")
    if isinstance(steps, EachOrder) and len(steps.root) > order:
        told = f"has at most {order} steps, one for each jet of {scenario.vehicle.kind}"
        yield Fault(("channel.quantisation", "vehicle"), f"{told} (got {len(steps.root)})")


def old_word_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield a fault where a law cannot use words that are late or heard before."""
    channel, law = scenario.channel, scenario.law
    keys = tuple(
        key
        for key, given in {"missing": channel.missing != "drop", "delay": channel.late}.items()
        if given
    )
    keys = tuple(f"channel.{key}" for key in keys)
    if not law.takes_any_message():
        yield Fault((*keys, "law"), f"{law.kind} knows live words alone: give another law")
    elif law.exchanges() > 1:
        told = "a law by exchanges makes one at a tick where words are late or stand in: give law.rounds: 1"
        yield Fault((*keys, "law.rounds"), f"{told} (got {law.exchanges()})")
    if not law.couples() and channel.late and channel.extrapolate == "jerk":
        told = "neighbours tell no highest derivative under a local law: give none or jets"
        yield Fault(("channel.extrapolate", "law"), told)


def delay_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield faults of a delay of words."""
    delay, tick = scenario.channel.delay, scenario.tick
    if tick == 0:
        yield Fault(("channel.delay", "tick"), "words are late by whole ticks: give a tick")
    elif is_drawn(delay):
        low, high = value_range(delay)
        if not tick / 2 <= low <= high <= MOST_LATE * tick:
            told = f"a drawn delay is at least half a tick, {tick / 2:.12g} s, and at most {MOST_LATE} ticks"
            yield Fault(("channel.delay", "tick"), f"{told} (got {shorten_value(delay)})")
    elif told := multiple_fault(delay, "tick", tick, MOST_LATE):
        yield Fault(("channel.delay", "tick"), told)
    elif tells_motion(scenario) and tick * fastest_motion(scenario) > MOST_RATE:
        told = (
            f"late motions need ticks of at most {MOST_RATE:g} of the law's fastest time constant"
        )
        yield Fault(("channel.extrapolate", "tick", "law"), told)
    if scenario.channel.missing == "extrapolate":
        told = "a lost word is dropped or held where words are late: give drop or hold"
        yield Fault(("channel.missing", "channel.delay"), told)
    if scenario.defence.announcing():
        told = "a defence by announcements needs every message at once: give another defence"
        yield Fault(("channel.delay", "defence"), told)


def fastest_motion(scenario: Scenario) -> float:
    """Return the rate of a vehicle's own motion [1/s]: that of the law, times the strongest row above 1."""
    factors = [1.0]
    for each in scenario.topology.turns() if not scenario.law.couples() else ():
        rows = scenario_graph(scenario.model_copy(update={"topology": each})).weights.T[None]
        strength = each.strength(rows, scenario.navigator.present)
        factors += (
            [] if strength is None else [float(strength.of(np.ones((1, *rows.shape[::2]))).max())]
        )
    return max(factors) * fastest_rate(scenario)


def tells_motion(scenario: Scenario) -> bool:
    """Return whether late words are power series of the vehicles' motion over a tick."""
    return scenario.law.tells_motion(scenario.channel.extrapolate != "none")


def detector_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield faults of a detector: no word has errors, their sizes are unknown, or words are late or
    rounded.
    """
    noises = {"channel.noise": scenario.channel.noise, "sensing": scenario.sensing}
    noisy = {key: noise for key, noise in noises.items() if not noise.exact()}
    if not noisy:
        told = (
            "no word has errors, so every other word is false: give channel: {noise: {position: …}}"
        )
        yield Fault(("detector", "channel.noise"), told)
    for key, noise in noisy.items():
        if not noise.tells_deviations():
            yield Fault(
                ("detector", key), f"{noise.kind} tells no standard deviations of its errors"
            )
    if scenario.channel.late:
        yield Fault(("detector", "channel.delay"), "late words are not tested: give delay: 0")
    if scenario.channel.rounded:
        yield Fault(
            ("detector", "channel.quantisation"), "rounded words are not tested: leave it out"
        )


def kind_faults(key: str, kind: Kind, scenario: Scenario) -> list[Fault]:
    """Return the faults that a kind reports, or the error that a kind from outside raised."""
    try:
        return list(kind.faults(scenario))
    except KindError as error:
        return [Fault((key,), str(error))]
    except (Exception, SystemExit) as error:
        blamed = blame.blame(error)
        if blamed is None:
            raise
        return [Fault((key,), str(blamed))]


def is_multiple(value: float, of: float) -> bool:
    """Return whether one duration is a whole multiple of another, up to rounding."""
    return of / 2 < value and abs(value - round(value / of) * of) <= MULTIPLE_TOLERANCE * value


def multiple_fault(value: float, name: str, of: float, most: int = MOST_MULTIPLE) -> str:
    """Return what is wrong with a duration that is to be 1 to `most` times another, "" if nothing is."""
    if value / of > most + 0.5:
        return f"must be at most {most:,} times {name} = {of:.12g} (got {value:.12g})"
    return (
        ""
        if is_multiple(value, of)
        else f"must be a multiple of {name} = {of:.12g} (got {value:.12g})"
    )


def time_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield faults of ticks, output times, tail and horizon that do not fit into each other."""
    tick, step, horizon, tail = scenario.tick, scenario.output_step, scenario.horizon, scenario.tail
    if tick > 0 and (told := multiple_fault(step, "tick", tick)):
        yield Fault(("output_step", "tick"), told)
    if told := multiple_fault(horizon, "output_step", step):
        yield Fault(("horizon", "output_step"), told)
    if tail > 0 and (told := multiple_fault(tail, "output_step", step)):
        yield Fault(("tail", "output_step"), told)
    if tail > horizon:
        yield Fault(
            ("tail", "horizon"), f"must fit into horizon = {horizon:.12g} (got {tail:.12g})"
        )


def gain_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield a fault unless `s^r + … + k1 s + k0` is Hurwitz for every draw of the gains."""
    order, given, matrices = scenario.vehicle.order, scenario.order_of_gain, scenario.gain_matrices
    if given != order:
        message = f"must be {order}, one for each order of {scenario.vehicle.kind} (got {given})"
        yield Fault(("gain", "vehicle"), message)
        return
    if matrices is not None:
        yield from matrix_faults(scenario, matrices)
        return
    worst = least_stable(scenario.gain)
    if not (min(worst) > 0 and is_hurwitz(worst)):
        eigenvalues = eigenvalue_text(np.roots([1.0, *worst[::-1]]))
        drawn = (
            f" where {shorten_value(worst)} is drawn" if any(map(is_drawn, scenario.gain)) else ""
        )
        yield Fault(
            ("gain",),
            f"unstable: eigenvalues {eigenvalues}{drawn} (got {shorten_value(scenario.gain)})",
        )


def matrix_faults(scenario: Scenario, matrices: np.ndarray) -> Iterator[Fault]:
    """Yield faults of gains that are matrices: an unstable closed loop, or an engine that lacks them."""
    eigenvalues = np.linalg.eigvals(exact.companion(matrices))
    if not eigenvalues.real.max() < 0:
        eigenvalues, got = (
            eigenvalues.reshape(-1, eigenvalues.shape[-1]),
            shorten_value(scenario.gain),
        )
        eigenvalues = eigenvalues[eigenvalues.real.max(axis=1).argmax()]
        yield Fault(("gain",), f"unstable: eigenvalues {eigenvalue_text(eigenvalues)} (got {got})")
    if scenario.own_gains is not None:
        yield from own_gain_faults(scenario, len(scenario.own_gains))
        return
    coasts = scenario.defence.coasts() or not scenario.channel.loss.perfect()
    alone = coasts or not scenario.sensing.exact() or not scenario.attack.consistent()
    alone = alone or len(scenario.topology.turns()) > 1
    if scenario.law.solves() and scenario.engine.by_functions and alone:
        message = f"the {scenario.engine.kind} engine takes gains by axis only in one network, without errors"
        more = "of sensors, losses, isolated: coast, and attacks of some orders alone"
        yield Fault(("gain", "engine"), f"{message} {more}")


def own_gain_faults(scenario: Scenario, given: int) -> Iterator[Fault]:
    """Yield faults of gains of each vehicle: their number, or what cannot follow them."""
    if given != scenario.vehicles:
        message = f"must be {scenario.vehicles}, one for each vehicle (got {given})"
        yield Fault(("gain.vehicles", "vehicles"), message)
    if not scenario.law.solves():
        yield Fault(("gain", "law"), "gains of each vehicle need law: exact")
    if scenario.engine.by_functions:
        message = (
            f"the {scenario.engine.kind} engine moves all vehicles by one flow, that of one gain:"
        )
        yield Fault(("gain", "engine"), f"{message} give engine: nonlinear")
    networks = len(scenario.topology.turns())
    if scenario.defence.coasts() or networks > 1 or not scenario.channel.loss.perfect():
        message = "gains of each vehicle need words that all arrive, one network and isolated: fail"
        yield Fault(("gain", "channel"), message)
    if scenario.defence.announcing():
        yield Fault(("gain", "defence.score"), "sources announce R of one gain: give another score")


def eigenvalue_text(eigenvalues: np.ndarray) -> str:
    """Return eigenvalues in words, in ascending order."""
    return ", ".join(f"{each.real:.3g}{each.imag:+.3g}j" for each in np.sort_complex(eigenvalues))


def position_faults(scenario: Scenario) -> Iterator[Fault]:
    """Yield a fault unless a list of positions has one for each vehicle."""
    position = scenario.initial.position
    if isinstance(position, EachPosition) and len(position.root) != scenario.vehicles:
        message = (
            f"must be {scenario.vehicles} places, one for each vehicle (got {len(position.root)})"
        )
        yield Fault(("initial.position", "vehicles"), message)


def fastest_rate(scenario: Scenario) -> float:
    """Return the greatest absolute value of an eigenvalue of the law [1/s], at the greatest gains drawn.

    It is 0 for gains that are refused here.
    """
    if scenario.gain_matrices is not None:
        return 0.0
    greatest = [value_range(each)[1] for each in scenario.gain]
    return float(np.abs(np.roots([1.0, *greatest[::-1]])).max())


def is_hurwitz(gain: list[float]) -> bool:
    """Return whether `s^r + … + k1 s + k0` is Hurwitz for positive gains, r at most 4."""
    if len(gain) < 3:
        return True
    k0, k1, k2, *highest = gain
    return k1 * k2 > k0 if not highest else k1 * k2 * highest[0] > k1**2 + k0 * highest[0] ** 2


def least_stable(gain: list[Number]) -> list[float]:
    """Return the unstable draw of the gains, if there is one: least k1 and k2, greatest k0 if all k0 are
    positive. For an order below 3, any positive gains are stable. For order 4, Kharitonov's four
    polynomials decide (Differential Equations 14, 1979).
    """
    low, high = zip(*map(value_range, gain), strict=True)
    if len(gain) == 4 and min(low) > 0:
        ends = [
            (high, low, low, high),
            (high, high, low, low),
            (low, low, high, high),
            (low, high, high, low),
        ]
        corners = [[end[k] for k, end in enumerate(each)] for each in ends]
        return next((each for each in corners if not is_hurwitz(each)), corners[0])
    k0, *others = (0.0 if bound == -np.inf else bound for bound in low)
    return [high[0] if k0 > 0 else k0, *others]
