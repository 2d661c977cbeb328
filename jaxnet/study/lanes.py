"""A cell and its samples become a batch of lanes with everything drawn, and the plan by which they run."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.engine import chassis
from jaxnet.engine.batch import Inputs, Job
from jaxnet.engine.stepper import Tolerances
from jaxnet.model import attack, defence
from jaxnet.model.lane import Lane
from jaxnet.study import config
from jaxnet.study.config import Scenario
from jaxnet.study.draws import draw
from jaxnet.study.network import Network, navigator_of, network_of


def job(scenario: Scenario, seed: int, samples: Sequence[int], save: tuple[str, ...] = ()) -> Job:
    """Lanes of one cell; `save` names the series wanted, of `chassis.SERIES`."""
    network, drawn = network_of(scenario), Drawn(scenario, seed, samples)
    navigator = navigator_of(scenario)
    lanes = Lane(
        initial=drawn.initial(),
        weights=drawn.same(network.weights),
        navigator=type(navigator)(*map(drawn.same, navigator)),
        attack=drawn.attack(network),
        defence=drawn.defence(network),
        gain=drawn.same(scenario.gain),
    )
    plan = plan_of(scenario, save)
    interval = scenario.output_step if plan.ticks == 1 else scenario.tick
    clock = chassis.Clock(drawn.same(interval), drawn.same(tail_outputs(scenario)))
    engine = scenario.engine
    tolerances = Tolerances(*map(drawn.same, (engine.rtol, engine.atol, engine.max_steps)))
    return Job(Inputs(lanes, clock, tolerances), plan)


def plan_of(scenario: Scenario, save: tuple[str, ...] = ()) -> chassis.Plan:
    """What the compiled program is shaped by. Where nobody decides, a tick is an output step."""
    decides = isinstance(scenario.defence, config.TrustedTrim)
    held = decides and scenario.tick > 0
    return chassis.Plan(
        outputs=round(scenario.horizon / scenario.output_step),
        ticks=round(scenario.output_step / scenario.tick) if held else 1,
        in_field=decides and scenario.tick == 0,
        solver=scenario.engine.solver,
        save=save,
    )


def tail_outputs(scenario: Scenario) -> int:
    """Output times that stand for t → ∞, both ends of the tail included."""
    return round(scenario.tail / scenario.output_step) + 1


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

    def initial(self) -> Any:
        """Robot states at t = 0: (samples, m, 6), ω = F = 0."""
        given = self.scenario.initial
        position = self.each(given.position, "initial.position", components=2)
        heading = self.each(given.heading, "initial.heading")
        speed = self.each(given.speed, "initial.speed")
        return np.concatenate([position, heading, speed, np.zeros_like(position)], axis=2)

    def attack(self, network: Network) -> attack.Attack:
        """The attack, zero for vehicles that are not attacked."""
        given, links = self.scenario.attack, self.same(network.attacked)
        if isinstance(given, config.NoAttack):
            return attack.NoAttack(links)
        attacked = np.isin(self.everyone, given.vehicles)

        def unit(number: Any, name: str) -> Any:
            angle = self.each(number, name)
            vector = np.concatenate([np.cos(angle), np.sin(angle)], axis=2)
            return np.where(attacked[None, :, None], vector, 0.0)

        magnitude = self.one(given.magnitude, "attack.magnitude")
        if isinstance(given, config.Bias):
            return attack.Bias(links, magnitude, unit(given.direction, "attack.direction"))
        frequency = self.one(given.frequency, "attack.frequency")
        phasor = unit(given.phase, "attack.phase")
        if isinstance(given, config.Rotating):
            return attack.Rotating(links, magnitude, frequency, phasor)
        return attack.Sinusoid(links, magnitude, frequency, phasor, unit(given.direction, "attack.direction"))

    def defence(self, network: Network) -> defence.Defence:
        """The defence."""
        given = self.scenario.defence
        if isinstance(given, config.NoDefence):
            return defence.KeepAll()
        return defence.TrustedTrim(
            self.same(network.trusted),
            self.same(network.protected),
            self.same(network.theta),
            self.same(given.tolerance),
        )
