"""The numbers of one lane, which is one simulated fleet, and the structure that all lanes share."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxnet.model.control import Gain
from jaxnet.model.hearing import Hearing
from jaxnet.model.retained import RowStrength
from jaxnet.model.shapes import Flags, Numbers
from jaxnet.model.signal import Basis, OfInputs, up_to


class Turns(NamedTuple):
    """Networks that take turns, each with its weights and strengths."""

    schedule: Any  # the graph, a kind that gives the number of the network in force
    weights: Float[Array, "networks slots m *lanes"]
    strength: RowStrength | None  # leaves (networks, m, *lanes)


class Periods(NamedTuple):
    """Times from which other vehicles are attacked; their signals and the weights from then on."""

    at: Float[Array, "periods *lanes"]  # [s], the first 0
    attacked: Bool[Array, "periods signals *lanes"]  # signals in force
    # None where all periods have those of the lane
    weights: Float[Array, "periods slots m *lanes"] | None


class Lane(NamedTuple):
    """The numbers of one simulated fleet.

    Many lanes form one tree of the same structure, with a last axis over lanes. Law, vehicle,
    navigator, defence, announcements, sensor, loss, noise, detector, formation and filter are kinds
    with their numbers drawn. The attack's signal has a method `basis`. With a formation, `initial`
    holds the states that vehicles would have without it.
    """

    initial: Float[Array, "n m *lanes"]
    weights: Float[Array, "slots m *lanes"]
    gain: Gain
    law: Any
    vehicle: Any
    navigator: Any
    defence: Any
    signal: Any
    vectors: Float[Array, "2 signals functions *lanes"]  # of the attack [m]; initial if strategic
    attack_scale: Float[Array, "*lanes"]  # [m], factor of the unit vectors of the attack
    announces: Any  # announcements of attacked links, a kind with its numbers drawn
    # Greatest norms by order: navigator's path, signal functions.
    sizes: Float[Array, "2 derivatives *lanes"]
    interval: Float[Array, "*lanes"]  # [s] from tick to tick
    sensor: Any = None  # None where vehicles sense without errors
    loss: Any = None  # None where every message arrives
    noise: Any = None  # None where messages arrive without errors
    strength: RowStrength | None = None  # of rows; None where it is 1
    turns: Turns | None = None  # None where one network is always in force
    delay: Any = None  # of messages, by `engine.stages.late`; None where they are not delayed
    periods: Periods | None = None  # None where the same vehicles are attacked all along
    gain_apart: Float[Array, "r m *lanes"] | None = None  # own gains minus `gain`; None: 0
    steps: Float[Array, "r *lanes"] | None = None  # [m, m/s, …] of rounded messages, or None
    detector: Any = None  # None where nobody tests messages
    formation: Any = None  # None where all vehicles go to one place
    filter: Any = None  # None where vehicles move as the law asks
    damping: Gain | None = None  # gains of own derivatives, compared with nobody's; None: 0

    @property
    def lossy(self) -> bool:
        """Whether a source may be unheard at a tick: lost, late, in another network, cut off."""
        channel = self.loss is not None or self.turns is not None or self.delay is not None
        return channel or self.alarms_cut

    @property
    def alarms_cut(self) -> bool:
        """Whether an alarm cuts a message or a link."""
        return self.detector is not None and self.detector.acts

    @property
    def exact_words(self) -> bool:
        return self.noise is None and self.steps is None

    @property
    def own_gain(self) -> Gain:
        """The gains of a vehicle's own jets: those of differences from others, and of damping."""
        return self.gain if self.damping is None else self.gain + self.damping

    @property
    def singular(self) -> bool:
        """Whether the law is singular where `vehicle.margin` is 0."""
        return bool(self.vehicle.singular) and self.law.singular_at_rest()

    def instead(self, time: Float[Array, "*lanes"]) -> dict[str, Any]:
        """What stands in place of fields of the lane from these times [s] on.

        Networks take turns; in other periods other vehicles are attacked.
        """
        found: dict[str, Any] = {}
        if self.turns is not None:
            number = self.turns.schedule.number(time, len(self.turns.weights))
            found["weights"] = of_number(self.turns.weights, number)
            if self.turns.strength is not None:
                strengths = (of_number(leaf, number) for leaf in self.turns.strength)
                found["strength"] = type(self.turns.strength)(*strengths)
        if self.periods is not None:
            number = (time[None] >= self.periods.at).sum(axis=0) - 1
            attacked = of_number(self.periods.attacked, number)
            xp = time.__array_namespace__()
            found["vectors"] = xp.where(attacked[None, :, None], self.vectors, 0.0)
            if self.periods.weights is not None:
                found["weights"] = of_number(self.periods.weights, number)
        return found

    def without(self, cut: Flags, given: dict[str, Any]) -> dict[str, Any]:
        """What stands in place of fields of the lane if these links are cut, (slots, m, lanes).

        `given` stands in their place otherwise. Rows are those of a network without the links.
        """
        xp, lane = cut.__array_namespace__(), self._replace(**given)
        kept = xp.where(cut, 0.0, lane.weights)
        share = xp.where(cut.any(axis=0), kept.sum(axis=0), 1.0)
        found = given | {"weights": kept / xp.where(share > 0, share, 1.0)[None]}
        if lane.strength is not None:
            found["strength"] = lane.strength.within(share)
        return found

    def basis(self, time: Numbers) -> Basis:
        """The attacks' functions at times [s] and their derivatives, at least up to the order."""
        return up_to(len(self.gain), self.signal.basis, time)

    def inputs(self, time: Numbers) -> Float[Any, "functions ..."] | None:
        """Functions at times [s] that attacked vehicles take as inputs; None where they obey."""
        return self.signal.signal.basis(time)[0] if self.misuses else None

    @property
    def misuses(self) -> bool:
        """Whether attacked vehicles put the signal in place of their inputs."""
        return isinstance(self.signal, OfInputs)

    def offsets(self, time: Numbers) -> Float[Any, "derivatives 2 m ..."]:
        """The formation's offsets at times [s] with derivatives, up to the order at least."""

        def jets(time: Numbers) -> Any:
            return self.formation.jets(time, self.weights.shape[1])

        return up_to(len(self.gain), jets, time)

    def path(self, time: Numbers) -> Float[Any, "derivatives 2 ..."]:
        """The navigator's jets at times [s], up to the vehicles' order at least."""
        return up_to(len(self.gain), self.navigator.jets, time)


def of_number(each: Numbers | Flags, number: Int[Any, "*lanes"]) -> Any:
    """The entries of these numbers, each of its own lane: lanes last."""
    places = number.reshape(*[1] * (each.ndim - number.ndim), *number.shape)
    return each.__array_namespace__().take_along_axis(each, places, axis=0)[0]


class Network(NamedTuple):
    """The structure that lanes share: hearing, trust, shared data of the defence, and solver."""

    hearing: Hearing
    trusted: Bool[Array, "slots m"]
    # The signal that outputs show of each vehicle, if its listeners receive different ones.
    display_signals: Int[Array, "m"]
    shared: Any  # data of the defence
    solver: Any  # of `solvers`
