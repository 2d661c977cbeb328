"""Faults that only several keys together show: scenarios that cannot be simulated."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.keys import (
    KINDS,
    RANDOMISATIONS,
    Config,
    Samples,
    Scenario,
    Sequential,
)
from jaxnet.config.scenario import greatest_strength
from jaxnet.kinds import registry
from jaxnet.kinds.fields import EachOrder, EachPosition, EachVehicle, Number, is_drawn, value_range
from jaxnet.kinds.kind import Fault, Kind, KindError
from jaxnet.kinds.metrics import COLUMNS_OF_METRIC, WITH_DETECTOR, Metric
from jaxnet.kinds.refusals import shorten_value
from jaxnet.model import axis
from jaxnet.model.wording import count
from jaxnet.outside import blame

MULTIPLE_TOLERANCE = 1e-9  # relative tolerance
MOST_MULTIPLE = 10**8
MOST_LATE = 200  # ticks by which messages may be delayed
# Of the law's fastest time constant in a tick over which a message is a power series: terms of
# degree 8 and above are left out, under 1e-6 m where the fleet is tens of metres off.
MOST_RATE = 0.2
TAKEN_COLUMNS = (  # of rows, then of cells
    *("cell", "sample", "status", "steps", "switches", "unheard", "stopped", "tail_fall"),
    *("cut_off", "cut_off_at", "cut_off_vehicles", "cut_off_share"),
    *("lanes", "ok", "failed", "unrecovered", "in_hull", "unsettled", "falling"),
)
GIVE_RECOVERY = "needs to know what has recovered: give recovery: {tau: 0.01}"
LEAST_CHOICES = 100  # choices that a search tries at least


# --- of a study -----------------------------------------------------------------------------------


def study_faults(
    study: Config, cells: Sequence[Scenario], wrong: Collection[str]
) -> Iterator[Fault]:
    """Yield faults of a study that depend on none of the wrong keys."""
    for needed, faults_of in STUDY_FAULTS:
        if not {*needed} & {*wrong}:
            yield from faults_of(study, cells)


def chosen_sample_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    if isinstance(study.save.trajectories, Samples):
        keys = ("save.trajectories.samples", "samples")
        chosen, samples = study.save.trajectories.samples, study.samples
        if isinstance(samples, Sequential):
            yield Fault(keys, "asks for a fixed number of samples; {worst: K} does not")
        elif beyond := [sample for sample in chosen if sample >= samples]:
            yield Fault(keys, f"samples are 0 to {samples - 1} (got {beyond[0]})")


def until_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    if isinstance(study.samples, Sequential) and study.recovery is None:
        yield Fault(("samples.until", "samples"), GIVE_RECOVERY)


def sobol_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    samples = study.samples
    if study.draws == "sobol":
        number, got = (0, "until: …") if isinstance(samples, Sequential) else (samples, samples)
        each, rest = divmod(number, RANDOMISATIONS)
        if each == 0 or rest or each & (each - 1):
            told = f"must be {RANDOMISATIONS} times a power of two where draws is sobol:"
            yield Fault(("samples", "draws"), f"{told} {RANDOMISATIONS}, 32, 64, … (got {got})")


def sobol_share_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    if study.draws == "sobol" and study.recovery is not None:
        told = "has an interval of independent lanes: give draws: random, or no recovery"
        yield Fault(("recovery", "draws"), told)


def size_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    save = study.save
    stores = save.errors or save.vehicles or save.trajectories != "none"
    if stores and "vehicles" not in study.swept and len({cell.vehicles for cell in cells}) > 1:
        told = "stores arrays of one size: all networks need as many vehicles"
        yield Fault(("save", "sweep.topology"), told)


def recovery_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    if study.recovery is None:
        return
    attacked = [cell for cell in cells if cell.attack.present]
    magnitudes = [cell.attack.amplitude() for cell in attacked]
    if any(map(is_drawn, magnitudes)):
        told = "compares with ā, which is drawn here: give or sweep attack.magnitude"
        yield Fault(("recovery", "attack.magnitude"), told)
    elif study.recovery.of == "amplitude":
        harmful = (cell for cell in attacked if cell.attack.amplitude() > 0)
        unknown = next((cell.attack for cell in harmful if not known_amplitude(cell) > 0), None)
        if unknown is not None:
            told = f"the amplitude in force of attack {unknown.reference()} is not one known"
            told += " number: numbers are drawn, or ā does not bound positions; give of: magnitude"
            yield Fault(("recovery.of", "attack"), told)
    elif cells and isinstance(study.samples, Sequential) and not any(magnitudes):
        told = "nobody is attacked in any cell, so there is nothing to recover from"
        yield Fault(("samples.until", "samples"), told)


def metric_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    """Yield faults of columns that share a name, of odd names, of shares that nobody counts."""
    own = [metric.name for metric in study.measured()]
    columns = {f"{name}_{end}" for name in own for end in COLUMNS_OF_METRIC}
    columns |= {f"{each.name}_unsettled" for each in study.metrics if each.base == "settling_time"}
    names = [*TAKEN_COLUMNS, *study.swept, *own, *columns]
    if doubled := sorted({name for name in own if names.count(name) > 1}):
        told = f"two columns would be called {', '.join(doubled)}: give one metric another `name`"
        yield Fault(("metrics",), told)
    if odd := [name for name in own if not name.isidentifier()]:
        told = "the name of a metric has letters, digits and _ alone, and begins with no digit"
        yield Fault(("metrics",), f"{told} (got {', '.join(odd)})")
    kinds = {*registry.kind_names("metrics")}
    if taken := [each.name for each in study.metrics if each.name in kinds - {each.base}]:
        yield Fault(("metrics",), f"another metric is called {', '.join(taken)}: give another name")
    shares = [metric.name for metric in study.metrics if metric.base in WITH_DETECTOR]
    if shares and not any(cell.detector.present for cell in cells):
        told = f"no message is judged without a detector (got {', '.join(shares)})"
        yield Fault(("metrics",), told)


def search_faults(study: Config, cells: Sequence[Scenario]) -> Iterator[Fault]:
    search = study.search
    if search is None:
        return
    for key in search.over:
        if swept := [each for each in study.swept if f"{key}.".startswith(f"{each}.")]:
            told = f"{swept[0]} is swept: search over it, or sweep it"
            yield Fault((f"search.over.{key}",), told)
    if study.draws == "sobol":
        told = "a search is compared with random lanes: give draws: random"
        yield Fault(("draws", "search"), told)
    measured = [metric.name for metric in study.measured()]
    if search.maximise == "unrecovered" and study.recovery is None:
        yield Fault(("search.maximise",), GIVE_RECOVERY)
    elif search.maximise not in ("unrecovered", *measured):
        got = f"must be unrecovered, or one of {', '.join(measured)} (got {search.maximise})"
        yield Fault(("search.maximise",), got)
    for name in search.subject_to:
        if name not in measured:
            more = "" if study.detector.present else "; a detector gives alarms and false_alarms"
            got = f"must be one of {', '.join(measured)}{more} (got {name})"
            yield Fault((f"search.subject_to.{name}", "search.subject_to"), got)
    if search.may_exceed and not search.subject_to:
        yield Fault(("search.may_exceed",), "there is no limit to exceed: give search.subject_to")
    least = LEAST_CHOICES * search.starts
    if search.budget < least:
        told = f"must be at least {least:,} lanes, {LEAST_CHOICES} choices from"
        told += f" {count(search.starts, 'start')} each (got {search.budget:,})"
        yield Fault(("search.budget", "search.starts"), told)


OF_METRICS = ("metrics", "navigator", "detector", "vehicle")  # on which columns depend
STUDY_FAULTS = (  # the keys on which faults depend, and a generator of these faults
    (("save", "samples"), chosen_sample_faults),
    (("samples", "recovery"), until_faults),
    (("samples", "draws"), sobol_faults),
    (("recovery", "draws"), sobol_share_faults),
    (("recovery", "samples", *Scenario.model_fields), recovery_faults),
    (("search", "draws", "recovery", *OF_METRICS), search_faults),
    (("save", "topology", "vehicles", "navigator"), size_faults),
    (OF_METRICS, metric_faults),
)


def replaced_faults(
    study: Config, swept: Sequence[str], cells: Sequence[Scenario]
) -> Iterator[Fault]:
    """Yield the faults of given values that a sweep replaces, where they are wrong in every cell.

    They are those of a kind alone, or of a kind and the vehicles' number. A network brings its own.
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
            found = [
                each
                for each in kind_faults(root, kind, cell.model_copy(update={root: kind}))
                if f"{each.keys[0]}.".startswith(f"{key}.")
                and {part.split(".")[0] for part in each.keys} <= {root, "vehicles"}
            ]
            if not found:
                break
        yield from found


# --- of one cell ----------------------------------------------------------------------------------


def scenario_faults(scenario: Scenario) -> Iterator[Fault]:
    yield from time_faults(scenario)
    yield from gain_faults(scenario)
    for key, nouns in {"position": "places", "heading": "headings", "speed": "speeds"}.items():
        each = getattr(scenario.initial, key)
        if isinstance(each, EachPosition | EachVehicle) and len(each.root) != scenario.vehicles:
            told = f"must be {scenario.vehicles} {nouns}, one for each vehicle"
            yield Fault((f"initial.{key}", "vehicles"), f"{told} (got {len(each.root)})")
    speed, vehicle = scenario.initial.speed, scenario.vehicle
    if vehicle.singular == 1 and value_range(speed)[0] == 0:
        told = f"must be greater than 0, for {vehicle.kind} is singular at rest"
        yield Fault(("initial.speed", "vehicle"), f"{told} (got {shorten_value(speed)})")
    kinds = {key: getattr(scenario, key) for key in KINDS}
    kinds |= {f"channel.{key}": getattr(scenario.channel, key) for key in ("loss", "noise")}
    for key, kind in kinds.items():
        yield from kind_faults(key, kind, scenario)
    for metric in scenario.metrics:
        yield from kind_faults("metrics", metric, scenario)
    yield from message_faults(scenario)
    if scenario.channel.late:
        yield from delay_faults(scenario)


def kind_faults(key: str, kind: Kind | Metric, scenario: Scenario) -> list[Fault]:
    """Return the faults that a kind reports, or the error that a kind from outside raised."""
    try:
        with blame.blaming():
            return list(kind.faults(scenario))
    except KindError as error:
        return [Fault((key,), str(error))]


def is_multiple(value: float, of: float) -> bool:
    """Whether a duration is a whole multiple of another, up to rounding."""
    return of / 2 < value and abs(value - round(value / of) * of) <= MULTIPLE_TOLERANCE * value


def uneven(key: str, value: float, of: str, unit: float, most: int = MOST_MULTIPLE) -> list[Fault]:
    """Return a fault unless a duration is 1 to `most` times another."""
    told = ""
    if value / unit > most + 0.5:
        told = f"must be at most {most:,} times {of} = {unit:.12g} (got {value:.12g})"
    elif not is_multiple(value, unit):
        told = f"must be a multiple of {of} = {unit:.12g} (got {value:.12g})"
    return [Fault((key, of), told)] if told else []


def time_faults(s: Scenario) -> Iterator[Fault]:
    if s.tick > 0:
        yield from uneven("output_step", s.output_step, "tick", s.tick)
    yield from uneven("horizon", s.horizon, "output_step", s.output_step)
    if s.tail > 0:
        yield from uneven("tail", s.tail, "output_step", s.output_step)
    if s.tail > s.horizon:
        told = f"must fit into horizon = {s.horizon:.12g} (got {s.tail:.12g})"
        yield Fault(("tail", "horizon"), told)


def gain_faults(s: Scenario) -> Iterator[Fault]:
    """Yield faults of gains: how many, `s^r + … + k1 s + k0` that is not Hurwitz, an engine."""
    order, given, matrices = s.vehicle.order, s.order_of_gain, s.gain_matrices
    if given != order:
        names = ", ".join(f"k{each}" for each in range(order))
        told = f"{s.vehicle.kind} needs {count(order, 'gain')}, {names} (got {given})"
        yield Fault(("gain", "vehicle"), told)
        return
    if matrices is None:
        worst = least_stable(s.gain)
        if not (min(worst) > 0 and is_hurwitz(worst)):
            drawn = f" where {shorten_value(worst)} is drawn" * any(map(is_drawn, s.gain))
            yield unstable(s, np.roots([1.0, *worst[::-1]]), drawn)
        return
    eigenvalues = np.linalg.eigvals(axis.companion(matrices))
    if not eigenvalues.real.max() < 0:
        eigenvalues = eigenvalues.reshape(-1, eigenvalues.shape[-1])
        yield unstable(s, eigenvalues[eigenvalues.real.max(axis=1).argmax()])
    lossless = s.channel.loss.perfect() and not s.detector.acts
    coasts = s.defence.coasts() or s.vehicle.standstill == "stop"
    several = len(s.topology.turns()) > 1
    if s.own_gains is not None:
        yield from own_gain_faults(s, coasts or several or not lossless)
    elif s.law.solves() and s.engine.by_functions:
        unsteady = coasts or several or not (lossless and s.sensing.exact())
        if unsteady or not s.attack.consistent():
            told = f"the {s.engine.kind} engine takes gains by axis only in one network, without"
            told += " errors of sensors, losses, isolated: coast, standstill: stop, and attacks of"
            told += " some orders alone"
            yield Fault(("gain", "engine"), told)


def own_gain_faults(s: Scenario, unsteady: bool) -> Iterator[Fault]:
    if len(s.gain.vehicles) != s.vehicles:
        told = f"must be {s.vehicles}, one for each vehicle (got {len(s.gain.vehicles)})"
        yield Fault(("gain.vehicles", "vehicles"), told)
    if not s.law.solves():
        yield Fault(("gain", "law"), "gains of each vehicle need law: exact")
    if s.engine.by_functions:
        told = f"the {s.engine.kind} engine moves all vehicles by one flow, that of one gain:"
        yield Fault(("gain", "engine"), f"{told} give engine: nonlinear")
    if unsteady:
        told = "gains of each vehicle need messages that all arrive, one network, isolated: fail"
        told += " and standstill: fail"
        yield Fault(("gain", "channel"), told)
    if s.defence.announcing():
        yield Fault(("gain", "defence.score"), "sources announce R of one gain: give another score")


def unstable(s: Scenario, eigenvalues: np.ndarray, drawn: str = "") -> Fault:
    words = ", ".join(f"{z.real:.3g}{z.imag:+.3g}j" for z in np.sort_complex(eigenvalues))
    return Fault(("gain",), f"unstable: eigenvalues {words}{drawn} (got {shorten_value(s.gain)})")


def is_hurwitz(gain: list[float]) -> bool:
    """Whether `s^r + … + k1 s + k0` is Hurwitz for positive gains, r at most 4."""
    if len(gain) < 3:
        return True
    k0, k1, k2, *highest = gain
    return k1 * k2 > k0 if not highest else k1 * k2 * highest[0] > k1**2 + k0 * highest[0] ** 2


def least_stable(gain: list[Number]) -> list[float]:
    """Return the unstable draw of the gains, if there is one.

    It has the least k1 and k2, and the greatest k0 if all k0 are positive. For an order below 3,
    any positive gains are stable. For order 4, Kharitonov's four polynomials decide (Differential
    Equations 14, 1979).
    """
    low, high = zip(*map(value_range, gain), strict=True)
    if len(gain) == 4 and min(low) > 0:
        ends = ((high, low, low, high), (high, high, low, low))
        ends += ((low, low, high, high), (low, high, high, low))
        corners = [[end[k] for k, end in enumerate(each)] for each in ends]
        return next((each for each in corners if not is_hurwitz(each)), corners[0])
    k0, *others = (0.0 if bound == -np.inf else bound for bound in low)
    return [high[0] if k0 > 0 else k0, *others]


def message_faults(s: Scenario) -> Iterator[Fault]:
    """Yield faults of a law or gain that does not know what messages become on their way."""
    channel, law, order, tick = s.channel, s.law, s.vehicle.order, s.tick
    exact_messages = channel.noise.exact() and not channel.rounded
    if not law.takes_any_message() and not (exact_messages and len(s.topology.turns()) == 1):
        yield Fault(("law", "channel"), "linearised knows no noise of messages, and one network")
    if not law.couples() and channel.noise.errs_in_highest():
        told = f"vehicles do not tell their highest derivative under law: {law.kind}"
        yield Fault(("channel.noise.jerk", "law"), told)
    old = {"channel.missing": channel.missing != "drop", "channel.delay": channel.late}
    keys = tuple(key for key, given in old.items() if given)
    if s.gain_matrices is not None and (keys or not exact_messages):
        told = "noise, rounding, delay and substitutes of messages need a number for each order"
        yield Fault(("gain", "channel"), told)
    if channel.rounded and tick == 0:
        yield Fault(("channel.quantisation", "tick"), "messages are rounded at ticks: give a tick")
    steps = channel.quantisation.root if isinstance(channel.quantisation, EachOrder) else ()
    if len(steps) > order:
        told = f"has at most {order} steps, one for each jet of {s.vehicle.kind} (got {len(steps)})"
        yield Fault(("channel.quantisation", "vehicle"), told)
    if keys and not law.takes_any_message():
        yield Fault((*keys, "law"), f"{law.kind} knows live messages alone: give another law")
    elif keys and law.exchanges() > 1:
        told = "a law by exchanges makes one at a tick where messages are delayed or substituted:"
        told += f" give law.rounds: 1 (got {law.exchanges()})"
        yield Fault((*keys, "law.rounds"), told)
    if not law.couples() and channel.late and channel.extrapolate == "jerk":
        told = "neighbours tell no highest derivative under a local law: give none or jets"
        yield Fault(("channel.extrapolate", "law"), told)


def delay_faults(s: Scenario) -> Iterator[Fault]:
    delay, tick, channel = s.channel.delay, s.tick, s.channel
    told_motion = s.law.tells_motion(channel.extrapolate != "none") and not s.engine.samples
    if tick == 0:
        yield Fault(("channel.delay", "tick"), "messages are delayed by whole ticks: give a tick")
    elif is_drawn(delay):
        low, high = value_range(delay)
        if not tick / 2 <= low <= high <= MOST_LATE * tick:
            told = f"a drawn delay is at least half a tick, {tick / 2:.12g} s, and at most"
            told += f" {MOST_LATE} ticks (got {shorten_value(delay)})"
            yield Fault(("channel.delay", "tick"), told)
    elif wrong := uneven("channel.delay", delay, "tick", tick, MOST_LATE):
        yield from wrong
    elif told_motion and tick * fastest_motion(s) > MOST_RATE:
        told = f"delayed motions need ticks of at most {MOST_RATE:g} of the law's fastest time"
        told += " constant"
        yield Fault(("channel.extrapolate", "tick", "law"), told)
    if channel.own_delay and (s.law.couples() or s.defence.anchors()):
        told = "own_delay needs law: local, and no anchor"
        yield Fault(("channel.own_delay", "law", "defence"), told)
    if channel.missing == "extrapolate":
        told = "a lost message is dropped or held where messages are delayed: give drop or hold"
        yield Fault(("channel.missing", "channel.delay"), told)
    if s.attack.replaces() and s.attack.periods():
        told = "a late message would be true or false by the vehicles attacked when it arrives:"
        yield Fault(("channel.delay", "attack.vehicles"), f"{told} give threat: adds, or one set")
    if s.defence.announcing():
        told = "a defence by announcements needs every message at once: give another defence"
        yield Fault(("channel.delay", "defence"), told)


def fastest_motion(s: Scenario) -> float:
    """Return the rate of a vehicle's own motion [1/s]: the law's, times the strongest row above 1.

    The law's rate is the greatest absolute eigenvalue at the greatest gains, 0 for matrices, which
    delayed messages refuse.
    """
    turns = s.topology.turns() if not s.law.couples() else ()
    factors = [greatest_strength(s.model_copy(update={"topology": each})) for each in turns]
    greatest = [] if s.gain_matrices is not None else [value_range(each)[1] for each in s.gain]
    return max([1.0, *factors]) * float(np.abs(np.roots([1.0, *greatest[::-1]])).max(initial=0.0))
