"""The batch of lanes of a cell and its samples with all drawn numbers, and its program's plan."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool

from jaxnet.config.document import ConfigError, Problem
from jaxnet.config.keys import RANDOMISATIONS, Config, Scenario
from jaxnet.config.scenario import has_ticks, interval_of, links_of, outputs_of, sources_of
from jaxnet.engine.batch import Inputs, Job
from jaxnet.engine.plan import Clock, Plan
from jaxnet.engine.stages import late
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
from jaxnet.model.graph import Digraph, normalised
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane, Network, Periods, Turns
from jaxnet.model.retained import RowStrength, WithOwnWeight
from jaxnet.model.signal import ORDERS, Apart, Falsified, OfInputs
from jaxnet.solvers.choice import choose_solver


def job(
    scenario: Scenario, source: Source, samples: Sequence[int], save: tuple[str, ...] = ()
) -> Job:
    """The lanes of one cell.

    `save` names the series to save, of `metrics.SERIES` and `metrics.VEHICLE_ERRORS`. The numbers
    have double precision, whatever the default of the process is.
    """
    draw, interval = Draw(source, samples, scenario.vehicles), interval_of(scenario)
    sources = sources_of(scenario)
    with jax.enable_x64(True):
        gain = gain_of(scenario, draw)
        lanes = lanes_of(scenario, draw, sources, gain)
        inputs = Inputs(lanes, scenario.engine.numbers(draw, gain, interval))
        network = network_of(scenario, sources)
    ticks = round(scenario.output_step / scenario.tick) if has_ticks(scenario) else 1
    tail = round(scenario.tail / scenario.output_step) + 1  # the tail includes both of its ends
    clock = Clock(*map(np.asarray, (interval, ticks, outputs_of(scenario), tail)))  # pyright: ignore[reportArgumentType]
    plan = Plan(
        engine=type(scenario.engine),
        options=scenario.engine.options(),
        metrics=scenario.measured(),
        decides=scenario.defence.decides,
        strategic=scenario.attack.strategic,
        consistent=scenario.attack.consistent(),
        missing=scenario.channel.missing,
        late=late_ticks(scenario),
        estimates=not scenario.detector.foretells(),
        own_delay=scenario.channel.own_delay and scenario.channel.late,
        extrapolate=scenario.channel.extrapolate if scenario.channel.late else "none",
        as_told=scenario.attack.as_told(),
        in_field=scenario.defence.decides and scenario.tick == 0,
        save=save,
        rows=outputs_of(scenario) + 1 if save else 0,
    )
    return Job(inputs, network, clock, plan)


def gain_of(scenario: Scenario, draw: Draw) -> Any:
    """The gains of each lane: (samples, r), or (samples, r, 2, 2); the first vehicle's own."""
    if scenario.own_gains is not None:
        return draw.same(scenario.own_gains[0])
    matrices = scenario.gain_matrices
    return draw.several(scenario.gain, "gain") if matrices is None else draw.same(matrices)


def lanes_of(scenario: Scenario, draw: Draw, sources: np.ndarray, gain: Any) -> Lane:
    topology, attack, own = scenario.topology, scenario.attack, scenario.own_gains
    loss, noise, detector = scenario.channel.loss, scenario.channel.noise, scenario.detector
    vehicle = scenario.vehicle.drawn(draw, "vehicle")
    gain, damping = scenario.law.parts(gain)
    formation, safety = scenario.formation, scenario.filter
    prove_presumed(scenario, vehicle)
    navigator = scenario.navigator.drawn(draw, "navigator")
    start = start_of(scenario, vehicle, draw)
    output = np.asarray(vehicle.output_jets(start)[0])
    signal, vectors, amplitude, sizes = attack_of(scenario, draw, navigator, output)
    announcing = draw_of_attack(scenario, draw)
    attacked = first_attacked(attack).chosen(draw)
    weights = weights_of(scenario, draw, sources, topology, attacked)
    prove_finite(scenario.vehicle, "start", start)
    prove_path(navigator, scenario.horizon, len(draw.samples))
    prove_finite(topology, "lane_weights", weights)
    return Lane(
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
        announces=tree(attack.announcement().drawn(announcing, "attack.announces")),
        sizes=lanes_first(sizes),
        interval=draw.same(interval_of(scenario)),
        sensor=None if scenario.sensing.exact() else tree(scenario.sensing.drawn(draw, "sensing")),
        loss=None if loss.perfect() else tree(loss.drawn(draw, "channel.loss")),
        noise=None if noise.exact() else tree(noise.drawn(draw, "channel.noise")),
        strength=strength_of(scenario, weights, topology),
        turns=turns_of(scenario, draw, sources),
        delay=delay_of(scenario, draw, sources),
        periods=periods_of(scenario, draw, sources),
        gain_apart=None if own is None else draw.same((own - own[0]).T),
        steps=steps_of(scenario, draw),
        detector=tree(detector.drawn(draw, "detector")) if detector.present else None,
        formation=tree(formation.drawn(draw, "formation")) if formation.present else None,
        damping=damping,
        filter=tree(safety.drawn(draw, "filter")) if safety.present else None,
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
    attacked = (0, *scenario.attack.targets())

    def importance(place: Place) -> tuple[bool, bool]:
        """Numbers of the start come last, before them those of attacks on spared vehicles.

        Early Sobol dimensions are evenly spread in pairs even with few points; late ones are not.
        """
        spared = place.name.startswith("attack.") and place.vehicle not in attacked
        return place.name.startswith("initial."), spared

    places = sorted(recorded(scenario, keyed).places, key=importance)
    if len(places) > MOST_DIMENSIONS:
        most = f"sobol takes {MOST_DIMENSIONS:,} numbers of a lane at most (got {len(places):,})"
        raise ConfigError([Problem("study", "draws", most)])
    columns = {place: column for column, place in enumerate(places)}
    return Scrambled(study.seed, study.samples // RANDOMISATIONS, columns)


def first_attacked_vehicles(
    study: Config, scenario: Scenario, samples: Sequence[int]
) -> Bool[np.ndarray, "m lanes"]:
    """The vehicles that are attacked at t = 0 in lanes of a study."""
    draw = Draw(source_of(study, scenario), samples, scenario.vehicles)
    return first_attacked(scenario.attack).chosen(draw)


def lane_graphs(study: Config, scenario: Scenario, samples: Sequence[int]) -> list[Digraph]:
    """The graphs of lanes of a study, each of which has links of its own; rows sum to 1."""
    draw, linked = Draw(source_of(study, scenario), samples, scenario.vehicles), links_of(scenario)
    sources = hearing.slots(linked, np.ones_like(linked.sources))
    weights = scenario.topology.weights_by_slot(draw, scenario.vehicles, sources)
    if not scenario.navigator.present:
        weights = np.where(sources == 0, 0.0, weights)
    return [normalised(hearing.graph_of(sources, each)) for each in weights]


def first_attacked(attack: AnyAttack) -> AnyAttack:
    """The attack on the vehicles that it attacks at t = 0."""
    periods = attack.periods()
    return attack.on(periods[0][1]) if periods else attack


def periods_of(scenario: Scenario, draw: Draw, sources: np.ndarray) -> Periods | None:
    """When other vehicles are attacked, None where the same ones are all along; samples first.

    The times are earlier by a rounding of the times of ticks.
    """
    attack, weights = scenario.attack, None
    if not attack.periods():
        return None
    at = np.array([time - TICK_ROUNDING for time, _ in attack.periods()])
    sets = [attack.on(vehicles).chosen(draw) for _, vehicles in attack.periods()]
    if attack.splits():
        each = [weights_of(scenario, draw, sources, scenario.topology, one) for one in sets]
        weights = as_array(np.stack(each, axis=1))
    owners = hearing.of_transmitters(sources).T.ravel() if attack.by_link() else slice(None)
    attacked = lanes_first(np.stack([each[owners] for each in sets]))
    return Periods(draw.same(at), attacked, weights)


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
    couples = scenario.law.couples()
    return None if couples else graph.strength(weights, scenario.navigator.present)


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
    heard = Hearing(*map(as_array, (sources, carried_sources, attacked, signals)))
    trusted = as_array(hearing.by_slot(linked, trusted, sources))
    return Network(heard, trusted, as_array(shown), shared, choose_solver(sources).solver)


def signals_of(scenario: Scenario, sources: np.ndarray) -> np.ndarray:
    by_link = scenario.attack.by_link()
    return hearing.link_signals(sources) if by_link else hearing.of_transmitters(sources)


def late_ticks(scenario: Scenario) -> int:
    """The greatest number of ticks by which messages are late."""
    if not (scenario.channel.late and has_ticks(scenario)):
        return 0
    return max(1, round(value_range(scenario.channel.delay)[1] / scenario.tick))


def steps_of(scenario: Scenario, draw: Draw) -> Any:
    """The steps to which jets of messages are rounded, (samples, r), None where they are not."""
    given, order = scenario.channel.quantisation, scenario.vehicle.order
    if not scenario.channel.rounded:
        return None
    if isinstance(given, EachOrder):
        return draw.same(np.array([*given.root, *[0.0] * (order - len(given.root))]))
    return np.repeat(draw.one(given, "channel.quantisation")[:, None], order, axis=1)


def delay_of(
    scenario: Scenario, draw: Draw, sources: np.ndarray
) -> late.SteadyDelay | late.DrawnDelay | None:
    """The delay of messages, None if there is none. What is drawn is rounded to whole ticks."""
    delay, tick = scenario.channel.delay, scenario.tick
    if not scenario.channel.late:
        return None
    if not is_drawn(delay):
        return late.SteadyDelay(draw.same(delay))
    if scenario.channel.delay_of == "message":
        upper = (np.arange(late_ticks(scenario)) + 1.5) * tick
        key = draw.one(Uniform(uniform=[0.0, 1.0]), "channel.delay.key")
        return late.DrawnDelay(key, draw.same(share_up_to(delay, upper)))
    each = EachLink(draw, len(sources)).each(delay, "channel.delay")
    ticks = np.maximum(1, np.round(each / tick)).reshape(len(each), -1, len(sources))
    return late.SteadyDelay(as_array(ticks.swapaxes(1, 2) * tick))


def start_of(scenario: Scenario, vehicle: Any, draw: Draw) -> np.ndarray:
    """The states at t = 0: (n, m, samples)."""
    given = scenario.initial
    position = draw.each(given.position, "initial.position", components=2)
    heading = draw.each(given.heading, "initial.heading")[..., 0]
    speed = draw.each(given.speed, "initial.speed")[..., 0]
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
    chosen, draw = attack.chosen(draw), draw_of_attack(scenario, draw)
    if attack.by_link():
        sources = sources_of(scenario)
        chosen = chosen[hearing.of_transmitters(sources).T.ravel()]
        start = np.concatenate([first[:, None], start], axis=1)[:, sources.T.ravel()]
    else:
        linked = links_of(scenario)
        informed = (attack.attacked_links(linked) & (linked.sources == 0)).any(axis=1)
        start = np.where(informed[None, :, None], first[:, None], start)
    if attack.apart():
        signal, vectors, scale, sizes = basis_by_vehicle(scenario, draw, chosen, start)
    else:
        signal, vectors, scale, sizes = shared_basis(scenario, draw, navigator, start)
        vectors = vectors * chosen[None, :, None]
    if attack.misuses():
        signal = OfInputs(signal)
    path = sizes_up_to(scenario.vehicle.order, scenario.navigator, 0.0, scenario.horizon)[:, None]
    return signal, vectors, scale, np.stack([np.broadcast_to(path, sizes.shape), sizes])


def draw_of_attack(scenario: Scenario, draw: Draw) -> Draw:
    """Draws for vehicles, in the order of the attack's lists; for links if listeners differ."""
    theirs = Draw(draw.source, draw.samples, scenario.vehicles, scenario.attack.targets())
    return EachLink(theirs, len(sources_of(scenario))) if scenario.attack.by_link() else theirs


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
    if given is None:  # placeholders of a strategic attack, until the first tick
        functions = np.asarray(signal.basis(np.zeros(count))).shape[1]
        given = np.ones((2, 1, functions, 1))
    if drawn.falsified() != ORDERS or drawn.by_order() is not None:
        factors = order_factors(drawn, reach, order)
        signal = Falsified(signal, np.broadcast_to(factors, (len(factors), count)))
        reach = factors * reach
    return signal, given * scale, scale, np.broadcast_to(reach, (len(reach), count))


def tree(drawn: Any, count: int = 1) -> Any:
    """A tree of arrays with the lane axis moved from last to first.

    `drawn` is a kind with its numbers drawn, or another tree of arrays. A single number is repeated
    for `count` lanes.
    """

    def first(leaf: Any) -> Any:
        return lanes_first(leaf if np.ndim(leaf) else np.full(count, leaf))

    return jax.tree.map(first, as_pytree(drawn))


def lanes_first(leaf: Any) -> Any:
    return np.moveaxis(np.asarray(leaf), -1, 0)


def as_array(leaf: np.ndarray) -> Any:
    """A NumPy array, typed as a JAX array; compiled programs accept both."""
    return leaf
