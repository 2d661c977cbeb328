"""The batch of lanes of a cell and its samples with all drawn numbers, and its program's plan."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxnet.config.document import ConfigError, Problem
from jaxnet.config.keys import RANDOMISATIONS, Config, Scenario
from jaxnet.config.scenario import has_ticks, interval_of, links_of, outputs_of, sources_of
from jaxnet.engine.batch import Inputs, Job
from jaxnet.engine.plan import Clock, Plan
from jaxnet.engine.stages.late import DrawnDelay, SteadyDelay
from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.attacks import AnyAttack, order_factors, signal_scale
from jaxnet.kinds.fields import EachOrder, Uniform, is_drawn, value_range
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import as_pytree
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.ticks import TICK_ROUNDING
from jaxnet.lanes.draws import Alone, Draw, EachLink, share_up_to
from jaxnet.lanes.proofs import prove, prove_finite, prove_path, prove_presumed
from jaxnet.lanes.uniforms import MOST_DIMENSIONS, Keyed, Place, Recorded, Scrambled, Source
from jaxnet.model import hearing
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane, Network, Periods, Turns
from jaxnet.model.retained import RowStrength, WithOwnWeight
from jaxnet.model.signal import ORDERS, Apart, Falsified
from jaxnet.solvers.choice import choose_solver


def job(
    scenario: Scenario, source: Source, samples: Sequence[int], save: tuple[str, ...] = ()
) -> Job:
    """The lanes of one cell.

    `save` names the series to save, of `metrics.SERIES` and `metrics.VEHICLE_ERRORS`. The numbers
    have double precision, whatever the default of the process is.
    """
    with jax.enable_x64(True):
        return build_job(scenario, Draw(source, samples, scenario.vehicles), save)


def build_job(scenario: Scenario, draw: Draw, save: tuple[str, ...]) -> Job:
    """The lanes of one cell for the samples of a draw, in the active precision."""
    sources = sources_of(scenario)
    vehicle = scenario.vehicle.drawn(draw, "vehicle")
    prove_presumed(scenario, vehicle)
    navigator, start = (
        scenario.navigator.drawn(draw, "navigator"),
        start_of(scenario, vehicle, draw),
    )
    output = np.asarray(vehicle.output_jets(start)[0])
    signal, vectors, amplitude, sizes = attack_of(scenario, draw, navigator, output)
    attacked = first_attacked(scenario.attack).chosen(draw)
    weights = weights_of(scenario, draw, sources, scenario.topology, attacked)
    prove_finite(scenario.vehicle, "start", start)
    prove_path(navigator, scenario.horizon, len(draw.samples))
    prove_finite(scenario.topology, "lane_weights", weights)
    matrices, loss, noise = scenario.gain_matrices, scenario.channel.loss, scenario.channel.noise
    detector, own = scenario.detector, scenario.own_gains
    if own is not None:
        gain = draw.same(own[0])
    else:
        gain = draw.several(scenario.gain, "gain") if matrices is None else draw.same(matrices)
    lanes = Lane(
        initial=lanes_first(start),
        weights=weights,
        gain=gain,
        law=tree(scenario.law.drawn(draw, "law")),
        vehicle=tree(vehicle),
        navigator=tree(navigator),
        defence=tree(scenario.defence.drawn(draw, "defence")),
        signal=tree(signal, len(draw.samples)),
        vectors=lanes_first(vectors),
        attack_scale=amplitude,
        announces=tree(announcement_of(scenario, draw)),
        sizes=lanes_first(sizes),
        interval=draw.same(interval_of(scenario)),
        sensor=None if scenario.sensing.exact() else tree(scenario.sensing.drawn(draw, "sensing")),
        loss=None if loss.perfect() else tree(loss.drawn(draw, "channel.loss")),
        noise=None if noise.exact() else tree(noise.drawn(draw, "channel.noise")),
        strength=strength_of(scenario, weights, scenario.topology),
        turns=turns_of(scenario, draw, sources),
        delay=delay_of(scenario, draw, sources),
        periods=periods_of(scenario, draw, sources),
        gain_apart=None if own is None else draw.same((own - own[0]).T),
        steps=steps_of(scenario, draw),
        detector=tree(detector.drawn(draw, "detector")) if detector.present else None,
    )
    numbers = scenario.engine.numbers(draw, gain, interval_of(scenario))
    return Job(
        Inputs(lanes, numbers),
        network_of(scenario, sources),
        clock_of(scenario),
        plan_of(scenario, save),
    )


def recorded(scenario: Scenario, source: Source) -> Recorded:
    """All numbers that a lane of a scenario draws, in the order of the draws."""
    found = Recorded(source)
    job(scenario, found, [0])
    return found


def source_of(study: Config, scenario: Scenario) -> Source:
    """The source of numbers for the lanes of a study, with the scenario of one of its cells.

    Raises ConfigError if a lane draws more numbers than Sobol sequences have dimensions.
    """
    keyed = Keyed(study.seed)
    if study.draws == "random" or not isinstance(study.samples, int):
        return keyed
    places = sorted(recorded(scenario, keyed).places, key=lambda place: forgotten(scenario, place))
    if len(places) > MOST_DIMENSIONS:
        most = f"sobol takes {MOST_DIMENSIONS:,} numbers of a lane at most (got {len(places):,})"
        raise ConfigError([Problem("study", "draws", most)])
    columns = {place: column for column, place in enumerate(places)}
    return Scrambled(study.seed, study.samples // RANDOMISATIONS, columns)


def forgotten(scenario: Scenario, place: Place) -> tuple[bool, bool]:
    """The sort key that puts less important numbers last.

    Numbers of the start come last. Before them come numbers of the attack for vehicles without
    attack. Early Sobol dimensions are evenly spread in pairs even with few points; late dimensions
    are not.
    """
    spared = place.vehicle not in (0, *scenario.attack.targets())
    return place.name.startswith("initial."), place.name.startswith("attack.") and spared


def first_attacked(attack: AnyAttack) -> AnyAttack:
    """The attack on the vehicles that it attacks at t = 0."""
    periods = attack.periods()
    return attack.on(periods[0][1]) if periods else attack


def periods_of(scenario: Scenario, draw: Draw, sources: np.ndarray) -> Periods | None:
    """When other vehicles are attacked, None where the same ones are all along; samples first.

    The times are earlier by a rounding of the times of ticks.
    """
    attack = scenario.attack
    if not attack.periods():
        return None
    at = np.array([time - TICK_ROUNDING for time, _ in attack.periods()])
    sets = [attack.on(vehicles).chosen(draw) for _, vehicles in attack.periods()]
    owners = hearing.of_transmitters(sources).T.ravel() if attack.by_link() else slice(None)
    weights: Any = None
    if attack.splits():
        graph = scenario.topology
        weights = np.stack(
            [weights_of(scenario, draw, sources, graph, each) for each in sets], axis=1
        )
    attacked = np.stack([each[owners] for each in sets])
    return Periods(
        draw.same(at), lanes_first(attacked), None if weights is None else as_array(weights)
    )


def weights_of(
    scenario: Scenario, draw: Draw, sources: np.ndarray, graph: Graph, attacked: np.ndarray
) -> Any:
    """The weights of each lane by slot in a graph: (samples, slots, m).

    Each identity of a source has the weight of the source before normalisation. A split link has
    two slots. A lane hears the slot of the attack if the source is among the `attacked` vehicles
    (m, samples), and the slot of the source otherwise.
    """
    weights, attack = graph.weights_by_slot(draw, scenario.vehicles, sources), scenario.attack
    if not scenario.navigator.present:
        weights = np.where(sources == 0, 0.0, weights)
    if attack.splits():
        linked = links_of(scenario)
        links = hearing.by_slot(linked, attack.attacked_links(linked), sources)
        lies = attacked[hearing.of_transmitters(sources)]
        silent = links[..., None] & (lies != hearing.again(sources)[..., None])
        weights = np.where(np.moveaxis(silent, -1, 0), 0.0, weights)
    if attack.identities() == 1 and scenario.navigator.present:
        return weights
    return weights / np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)


def strength_of(scenario: Scenario, weights: Any, graph: Graph) -> RowStrength | None:
    """Strength of each lane's rows with these weights, None where it does not act."""
    return (
        graph.strength(weights, scenario.navigator.present) if not scenario.law.couples() else None
    )


def turns_of(scenario: Scenario, draw: Draw, sources: np.ndarray) -> Turns | None:
    """The networks that take turns, None where there is one."""
    networks = scenario.topology.turns()
    if len(networks) == 1:
        return None
    attacked = first_attacked(scenario.attack).chosen(draw)
    each = [weights_of(scenario, draw, sources, graph, attacked) for graph in networks]
    strengths = [strength_of(scenario, *both) for both in zip(each, networks, strict=True)]
    strength = None
    if any(one is not None for one in strengths):
        plain = WithOwnWeight(np.zeros_like(each[0][:, 0]))
        strengths = [plain if one is None else one for one in strengths]
        strength = jax.tree.map(lambda *leaves: np.stack(leaves, axis=1), *strengths)
    weights = as_array(np.stack(each, axis=1))
    return Turns(tree(scenario.topology.drawn(draw, "topology")), weights, strength)


def network_of(scenario: Scenario, sources: Any) -> Network:
    """The network that the lanes of a cell share, by slot."""
    linked = links_of(scenario)
    attacked = hearing.by_slot(linked, scenario.attack.attacked_links(linked), sources)
    if scenario.attack.splits():
        attacked = attacked & hearing.again(sources)
    trusted = scenario.defence.trusts(linked)
    carried_sources = np.where(attacked & scenario.attack.replaces(), 0, sources)
    shared = scenario.defence.shared(linked, trusted, sources)
    signals = signals_of(scenario, sources)
    shown = np.arange(scenario.vehicles)
    if scenario.attack.by_link():
        first = np.nonzero(attacked.T)[::-1]  # slots and listeners, sorted by listener
        shown[hearing.of_transmitters(sources)[first][::-1]] = signals[first][::-1]
    heard = Hearing(*map(as_array, hearing.of_slots(sources, carried_sources, attacked, signals)))
    trusted = as_array(hearing.by_slot(linked, trusted, sources))
    return Network(heard, trusted, as_array(shown), shared, choose_solver(sources).solver)


def signals_of(scenario: Scenario, sources: np.ndarray) -> np.ndarray:
    return (
        hearing.link_signals(sources)
        if scenario.attack.by_link()
        else hearing.of_transmitters(sources)
    )


def plan_of(scenario: Scenario, save: tuple[str, ...] = ()) -> Plan:
    return Plan(
        engine=type(scenario.engine),
        options=scenario.engine.options(),
        metrics=scenario.measured(),
        decides=scenario.defence.decides,
        strategic=scenario.attack.strategic,
        consistent=scenario.attack.consistent(),
        missing=scenario.channel.missing,
        late=late_ticks(scenario),
        extrapolate=scenario.channel.extrapolate if scenario.channel.late else "none",
        as_told=scenario.attack.as_told(),
        in_field=scenario.defence.decides and scenario.tick == 0,
        save=save,
        rows=outputs_of(scenario) + 1 if save else 0,
    )


def late_ticks(scenario: Scenario) -> int:
    """The greatest number of ticks by which words are late."""
    if not (scenario.channel.late and has_ticks(scenario)):
        return 0
    return max(1, round(value_range(scenario.channel.delay)[1] / scenario.tick))


def steps_of(scenario: Scenario, draw: Draw) -> Any:
    """The steps to which the jets of words are rounded, (samples, r), None where they are not."""
    given, order = scenario.channel.quantisation, scenario.vehicle.order
    if not scenario.channel.rounded:
        return None
    if isinstance(given, EachOrder):
        return draw.same(np.array([*given.root, *[0.0] * (order - len(given.root))]))
    return np.repeat(draw.one(given, "channel.quantisation")[:, None], order, axis=1)


def delay_of(
    scenario: Scenario, draw: Draw, sources: np.ndarray
) -> SteadyDelay | DrawnDelay | None:
    """The delay of words, None where they are not late. What is drawn is rounded to whole ticks."""
    delay, tick = scenario.channel.delay, scenario.tick
    if not scenario.channel.late:
        return None
    if not is_drawn(delay):
        return SteadyDelay(draw.same(delay))
    if scenario.channel.delay_of == "message":
        upper = (np.arange(late_ticks(scenario)) + 1.5) * tick
        key = draw.one(Uniform(uniform=[0.0, 1.0]), "channel.delay.key")
        return DrawnDelay(key, draw.same(share_up_to(delay, upper)))
    each = EachLink(draw, len(sources)).each(delay, "channel.delay")
    ticks = np.maximum(1, np.round(each / tick)).reshape(len(each), -1, len(sources))
    return SteadyDelay(as_array(ticks.swapaxes(1, 2) * tick))


def clock_of(scenario: Scenario) -> Clock:
    """The clock: tick interval [s], ticks for each output, outputs, and outputs in the tail."""
    numbers = (
        interval_of(scenario),
        round(scenario.output_step / scenario.tick) if has_ticks(scenario) else 1,
        outputs_of(scenario),
        round(scenario.tail / scenario.output_step) + 1,  # the tail includes both of its ends
    )
    return Clock(*map(np.asarray, numbers))  # pyright: ignore[reportArgumentType]


def start_of(scenario: Scenario, vehicle: Any, draw: Draw) -> np.ndarray:
    """The states at t = 0: (n, m, samples)."""
    given = scenario.initial
    position = draw.positions(given.position, "initial.position")
    heading, speed = (
        draw.each(getattr(given, name), f"initial.{name}")[..., 0] for name in ("heading", "speed")
    )
    return np.asarray(vehicle.start(position.transpose(2, 1, 0), heading.T, speed.T))


def attack_of(
    scenario: Scenario, draw: Draw, navigator: Any, start: np.ndarray
) -> tuple[Any, np.ndarray, Any, np.ndarray]:
    """The signal of the attack, its vectors, its scale, and greatest norms.

    - The vectors have the shape (2, m, B, samples), and are 0 for vehicles without attack. If each
      listener receives a different signal, the vectors belong to links (`hearing.link_signals`).
    - The scale is ā over the size of the signal.
    - The greatest norms have the shape (2, 4, samples): first the navigator's path, then the
      signal's functions, by order.

    `navigator` has its numbers drawn; `start` holds the vehicles' outputs y(0), (2, m, samples).
    """
    attack = scenario.attack
    first = np.asarray(navigator.jets(np.zeros(len(draw.samples))))[0]
    chosen, draw = (
        attack.chosen(draw),
        Draw(draw.source, draw.samples, scenario.vehicles, attack.targets()),
    )
    if attack.by_link():
        sources = sources_of(scenario)
        owners = hearing.of_transmitters(sources).T.ravel()
        chosen, draw = chosen[owners], EachLink(draw, len(sources))
        start = np.concatenate([first[:, None], start], axis=1)[:, sources.T.ravel()]
    else:
        start = np.where(heard_by(scenario)[None, :, None], first[:, None], start)
    if attack.apart():
        signal, vectors, scale, sizes = basis_by_vehicle(scenario, draw, chosen, start)
    else:
        signal, vectors, scale, sizes = shared_basis(scenario, draw, navigator, start)
        vectors = vectors * chosen[None, :, None]
    path = sizes_up_to(scenario.vehicle.order, scenario.navigator, 0.0, scenario.horizon)[:, None]
    return signal, vectors, scale, np.stack([np.broadcast_to(path, sizes.shape), sizes])


def heard_by(scenario: Scenario) -> np.ndarray:
    linked = links_of(scenario)
    return (scenario.attack.attacked_links(linked) & (linked.sources == 0)).any(axis=1)


def announcement_of(scenario: Scenario, draw: Draw) -> Announcement:
    """The announcements of attacked links.

    The numbers belong to vehicles, or to links if each listener receives a different signal
    (`hearing.link_signals`).
    """
    attack = scenario.attack
    theirs = Draw(draw.source, draw.samples, scenario.vehicles, attack.targets())
    if attack.by_link():
        theirs = EachLink(theirs, len(sources_of(scenario)))
    return attack.announcement().drawn(theirs, "attack.announces")


def basis_by_vehicle(
    scenario: Scenario, draw: Draw, chosen: np.ndarray, start: np.ndarray
) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray]:
    """Signal, vectors, scale and greatest norms if each attacked vehicle has functions of its own.

    The function builds the signal of each attacked vehicle in a separate lane, and then joins these
    lanes. The joint norm is the root of the sum of squares.
    """
    (m, count), n = chosen.shape, max(1, int(chosen[:, 0].sum()))
    attacked = np.argsort(~chosen, axis=0, kind="stable")[:n]
    alone = Alone(draw, attacked)
    theirs = np.take_along_axis(start, attacked[None], axis=1).reshape(2, 1, -1)
    signal, given, scale, sizes = shared_basis(
        scenario, alone, scenario.navigator.drawn(alone, "navigator"), theirs
    )
    vectors = np.zeros((2, m, given.shape[2], n, count))
    number, lane = np.indices(attacked.shape)
    vectors[:, attacked, :, number, lane] = given.reshape(2, -1, n, count).transpose(2, 3, 0, 1)
    side_by_side = jax.tree.map(
        lambda leaf: leaf.reshape(*leaf.shape[:-1], n, count), as_pytree(signal)
    )
    vectors = vectors.reshape(2, m, -1, count) * chosen[None, :, None]
    together = np.linalg.norm(sizes.reshape(len(sizes), n, count), axis=1)
    return Apart(side_by_side), vectors, scale.reshape(n, count).max(axis=0), together


def shared_basis(
    scenario: Scenario, draw: Draw, navigator: Any, start: np.ndarray
) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray]:
    """Signal, vectors, scale and greatest norms if all attacked vehicles share the functions.

    The vectors treat every vehicle as attacked. The scale is ā over the size of the signal, or 1
    for a signal without bound.
    """
    count, order = len(draw.samples), scenario.vehicle.order
    drawn: AnyAttack = scenario.attack.drawn(draw, "attack").of_order(order)
    signal, given = drawn.told(navigator, start)
    scale = np.ones(count)
    rows = max(len(ORDERS), order + 1)
    reach = np.asarray(drawn.reach(scenario.navigator, signal, scenario.horizon))[:rows]
    if drawn.bounded:
        sizes = drawn.sizes(scenario.horizon)
        prove(drawn, getattr(signal, "basis", None), given, sizes, scenario.horizon, count)
        scale = np.broadcast_to(signal_scale(drawn, sizes, order), count)
    unit = first_vectors(signal, count) if given is None else given
    if drawn.falsified() != ORDERS or drawn.by_order() is not None:
        factors = order_factors(drawn, reach, order)
        signal = Falsified(signal, np.broadcast_to(factors, (len(factors), count)))
        reach = factors * reach
    return signal, unit * scale, scale, np.broadcast_to(reach, (len(reach), count))


def first_vectors(signal: Any, count: int) -> np.ndarray:
    """Placeholders of a strategic attack's vectors, one a function, until the first tick."""
    functions = np.asarray(signal.basis(np.zeros(count))).shape[1]
    return np.ones((2, 1, functions, 1))


def tree(drawn: Any, count: int = 1) -> Any:
    """A tree of arrays with the lane axis moved from last to first.

    `drawn` is a kind with its numbers drawn, or another tree of arrays. A single number is repeated
    for `count` lanes.
    """
    leaves = jax.tree.map(
        lambda leaf: leaf if np.ndim(leaf) else np.full(count, leaf), as_pytree(drawn)
    )
    return jax.tree.map(lanes_first, leaves)


def lanes_first(leaf: Any) -> Any:
    return np.moveaxis(np.asarray(leaf), -1, 0)


def as_array(leaf: np.ndarray) -> Any:
    """A NumPy array, typed as a JAX array; compiled programs accept both."""
    return leaf
