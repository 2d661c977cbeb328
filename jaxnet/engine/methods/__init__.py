"""Engines advance lanes from tick to tick, one engine a file. A config chooses one by `engine`."""

from collections.abc import Hashable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float, Int

from jaxnet.kinds.kind import Fault, Kind
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.outside.families import add_family

if TYPE_CHECKING:
    from jaxnet.engine.plan import Clock, Inputs, Outcome, Plan
    from jaxnet.model.lane import Network
else:
    Clock = Inputs = Network = Outcome = Plan = Any

LaneGainRows = Float[np.ndarray, "lanes r 2 2"] | Float[np.ndarray, "lanes r"]
LaneCount = Int[Any, ""] | int
Presumed = Literal["nothing", "state", "motion"]


class Engine(Kind):
    """A way to advance lanes. A subclass defines `numbers` and `simulate`.

    Examples
    --------
    >>> import jaxnet
    >>> engine = jaxnet.load({"engine": "exact"}).config.engine
    >>> engine.in_field, engine.holds
    (False, True)
    """

    # Lanes side by side in fleets of twelve vehicles; fewer in larger fleets.
    chunk: ClassVar[int] = 64
    cached: ClassVar[int] = 40_000  # most vehicles side by side that a core's cache can hold
    queue: ClassVar[int] = 1  # chunks in a load
    shard: ClassVar[int] = 512  # lanes whose rows make one file: about a second of work
    accuracy: ClassVar[float] = 1e-5  # [m] bound on the error at default tolerances
    in_field: ClassVar[bool] = False  # whether vehicles can decide in the vector field (`tick: 0`)
    by_functions: ClassVar[bool] = False  # whether all drives are functions of time, on both axes
    linearises: ClassVar[bool] = False  # whether vehicles can follow a linearised law
    holds: ClassVar[bool] = False  # whether vehicles can hold a jerk from tick to tick
    samples: ClassVar[bool] = False  # whether every law is evaluated at ticks alone
    limits: ClassVar[bool] = False  # whether inputs of vehicles can be limited
    stops: ClassVar[bool] = True  # whether vehicles can stop where they come to rest

    def presumes(self, scenario: ScenarioView) -> Presumed:
        """Return what the engine takes for granted of the vehicle.

        `state`: the output's jets tell the state. `motion`: moreover, `motion` makes the outputs
        obey the law, for the engine never calls it.
        """
        return "nothing"

    def options(self) -> tuple[Hashable, ...]:
        """Return the options that shape the compiled program: hashable."""
        return ()

    def numbers(self, draw: LaneDraw, gain: LaneGainRows, interval: float) -> object:
        """Return the engine's own inputs, a pytree of arrays with lanes first.

        `interval` [s] is the time from tick to tick.
        """
        return None

    @staticmethod
    def simulate(
        queue: Inputs, count: LaneCount, network: Network, clock: Clock, plan: Plan
    ) -> Outcome:
        """Return the outcome of the first `count` lanes of a queue, traced by JAX; lanes last."""
        raise NotImplementedError

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault of a law, vehicle or tick that the engine cannot simulate."""
        law, engine = scenario.law, f"the {self.kind} engine"
        if law.needs_ticks() and not self.holds:
            message = f"{engine} cannot hold a jerk from tick to tick, as {law.kind} does"
            yield Fault(("engine", "law"), message)
        if law.way() == "linearised" and not self.linearises:
            message = f"{engine} moves vehicles by the law's exact linearisation, which {law.kind}"
            yield Fault(("engine", "law"), f"{message} lacks: give engine: nonlinear")
        if scenario.vehicle.limits and not self.limits:
            message = f"{engine} knows no limits, which {scenario.vehicle.kind} has"
            yield Fault(
                ("vehicle.limits", "engine"), f"{message}: give engine: sampled or nonlinear"
            )
        if scenario.defence.decides and scenario.tick == 0 and not self.in_field:
            yield Fault(("engine", "tick"), f"{engine} decides at ticks only: give a tick")


add_family("engine", Engine, "jaxnet.engines")
