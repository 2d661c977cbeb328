"""A cell and its samples become a batch of lanes with everything drawn, and the plan by which they run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg import expm

from jaxnet.config import keys as config
from jaxnet.config.keys import Scenario
from jaxnet.config.network import Network, navigator_of, network_of, weights_are_drawn
from jaxnet.engine.batch import Inputs, Job
from jaxnet.engine.flat import Flow
from jaxnet.engine.plan import Clock, Plan, Tolerances
from jaxnet.lanes.draws import draw, draw_each
from jaxnet.model import attack, defence, hearing
from jaxnet.model.attack import Harmonic
from jaxnet.model.lane import Lane
from jaxnet.model.lane import Network as SharedNetwork
from jaxnet.theory import exact


def job(scenario: Scenario, seed: int, samples: Sequence[int], save: tuple[str, ...] = ()) -> Job:
    """Lanes of one cell; `save` names the series wanted, of `metrics.SERIES`."""
    network, drawn = network_of(scenario), Drawn(scenario, seed, samples)
    sources, navigator, plan = hearing.slots(network.weights), navigator_of(scenario), plan_of(scenario, save)
    lanes = Lane(
        initial=drawn.initial(),
        weights=drawn.weights(network, sources),
        navigator=type(navigator)(*map(drawn.same, navigator)),
        attack=drawn.attack(),
        tolerance=drawn.one(getattr(scenario.defence, "tolerance", 0.0), "defence.tolerance"),
        gain=drawn.gain(),
    )
    shared, clock = shared_network(scenario, network, sources), clock_of(scenario)
    numbers = engine_numbers(scenario, lanes.gain, float(clock.interval), drawn)
    return Job(Inputs(lanes, numbers), shared, clock, plan)


def shared_network(scenario: Scenario, network: Network, sources: Any) -> SharedNetwork:
    """What the lanes of a cell share, by slot."""
    attacked: Any = hearing.by_slot(network.attacked, sources)
    heard = hearing.Hearing(sources, attacked)
    if not isinstance(scenario.defence, config.TrustedTrim):
        return SharedNetwork(heard, defence.KeepAll())
    trusted = hearing.by_slot(network.trusted, sources)
    return SharedNetwork(heard, defence.trusted_trim(trusted, network.protected, network.theta))


def engine_numbers(scenario: Scenario, gain: Any, interval: float, drawn: "Drawn") -> Any:
    """What the engine needs besides the lanes, given their gains."""
    engine = scenario.engine
    if isinstance(engine, config.Flat):
        if (gain == gain[0]).all():
            return Flow(drawn.same(expm(exact.companion(gain[0]) * interval)))
        return Flow(expm(exact.companion(gain) * interval))  # pyright: ignore[reportArgumentType]
    rtol, atol = drawn.one(engine.rtol, "engine.rtol"), drawn.one(engine.atol, "engine.atol")
    return Tolerances(rtol, atol, drawn.same(engine.max_steps))


def plan_of(scenario: Scenario, save: tuple[str, ...] = ()) -> Plan:
    """What the compiled program is shaped by."""
    return Plan(
        engine=scenario.engine.kind,
        in_field=isinstance(scenario.defence, config.TrustedTrim) and scenario.tick == 0,
        solver=getattr(scenario.engine, "solver", ""),
        save=save,
        rows=outputs_of(scenario) + 1 if save else 0,
    )


def clock_of(scenario: Scenario) -> Clock:
    """When things happen. Where nobody decides, a tick is an output step."""
    held = isinstance(scenario.defence, config.TrustedTrim) and scenario.tick > 0
    numbers = (
        scenario.tick if held else scenario.output_step,
        round(scenario.output_step / scenario.tick) if held else 1,
        outputs_of(scenario),
        round(scenario.tail / scenario.output_step) + 1,  # both ends of the tail
    )
    return Clock(*map(np.asarray, numbers))  # pyright: ignore[reportArgumentType]


def outputs_of(scenario: Scenario) -> int:
    """Output times after t = 0."""
    return round(scenario.horizon / scenario.output_step)


class Drawn:
    """Makes the leaves of lanes: NumPy arrays with a leading axis over samples."""

    def __init__(self, scenario: Scenario, seed: int, samples: Sequence[int]):
        self.scenario, self.seed, self.samples = scenario, seed, samples
        self.everyone = range(1, scenario.vehicles + 1)

    def same(self, value: Any) -> Any:
        """The same value in every lane."""
        array = np.asarray(value)
        return np.broadcast_to(array, (len(self.samples), *array.shape))

    def each(self, number: Any, name: str, components: int = 1) -> Any:
        """A number of each vehicle: (samples, m, components)."""
        return draw(number, self.seed, name, self.samples, self.everyone, components)

    def one(self, number: Any, name: str) -> Any:
        """A number of the lane: (samples,)."""
        return draw(number, self.seed, name, self.samples, [0])[:, 0, 0]

    def gain(self) -> Any:
        """Gains on ε, ε̇, ε̈: (samples, 3)."""
        places = [(0, component) for component in range(3)]
        return draw_each(self.scenario.gain, self.seed, "gain", self.samples, places)

    def weights(self, network: Network, sources: Any) -> Any:
        """Weights by slot: (samples, slots, m)."""
        if not weights_are_drawn(self.scenario):
            return self.same(hearing.by_slot(network.weights, sources))
        topology: Any = self.scenario.topology
        if isinstance(topology, config.Cyclic):
            navigator = self.one(topology.navigator_weight, "topology.navigator_weight")[:, None, None]
            return np.where(sources == 0, navigator, (1.0 - navigator) / 2)
        return self.edge_weights(topology.edges, sources)

    def edge_weights(self, edges: Any, sources: Any) -> Any:
        """Weights by slot of drawn edges: the number of edge (i, j) is component j of vehicle i."""
        links, numbers = [(i, j) for i, j, _ in edges], [number for *_, number in edges]
        listeners, heard = np.array(links).T
        vehicles = listeners - 1
        slots = (sources[:, vehicles] == heard).argmax(axis=0)
        weights = np.zeros((len(self.samples), *sources.shape))
        weights[:, slots, vehicles] = draw_each(numbers, self.seed, "topology.edges", self.samples, links)
        return weights / weights.sum(axis=1, keepdims=True)

    def initial(self) -> Any:
        """Robot states at t = 0: (samples, 6, m), ω = F = 0."""
        given = self.scenario.initial
        position = self.each(given.position, "initial.position", components=2)
        heading = self.each(given.heading, "initial.heading")
        speed = self.each(given.speed, "initial.speed")
        states = np.concatenate([position, heading, speed, np.zeros_like(position)], axis=2)
        return states.swapaxes(1, 2)

    def attack(self) -> Harmonic:
        """The attack, zero for vehicles that are not attacked."""
        given = self.scenario.attack
        if isinstance(given, config.NoAttack):
            nothing = np.zeros((len(self.samples), 2, self.scenario.vehicles))
            return Harmonic(np.zeros(len(self.samples)), nothing, nothing)  # pyright: ignore[reportArgumentType]

        def angles(name: str) -> Any:
            return self.each(getattr(given, name), f"attack.{name}")[:, :, 0].T

        numbers = [self.one(given.magnitude, "attack.magnitude")]
        if not isinstance(given, config.Bias):
            numbers.append(self.one(given.frequency, "attack.frequency"))
        words = {
            config.Bias: ["direction"],
            config.Rotating: ["phase"],
            config.Sinusoid: ["phase", "direction"],
        }
        kinds = {config.Bias: attack.bias, config.Rotating: attack.rotating, config.Sinusoid: attack.sinusoid}
        signal = kinds[type(given)](*numbers, *map(angles, words[type(given)]))
        attacked = np.isin(self.everyone, given.vehicles)[None, :, None]
        vectors = (np.moveaxis(each * attacked, -1, 0) for each in (signal.cosine, signal.sine))
        return Harmonic(signal.frequency, *vectors)
