"""Laws: how vehicles find the jerk q = y‴ that solves `L q = b` (theorems.md O2b, O12)."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.shapes import (
    AxisSlotNumbers,
    LaneGains,
    LaneTimes,
    SlotJets,
    SlotLinks,
    SlotSources,
    VehicleVectors,
)

Way = Literal["solved", "held", "local", "linearised"]


class Law(Kind):
    """A way to solve `L q = b`, which couples all vehicles.

    A subclass holds q from tick to tick; it gives `exchange`.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.laws import Law
    >>> class Halfway(Law):
    ...     '''Halfway from what a vehicle held to what a round makes of it.'''
    ...
    ...     def exchange(self, last, demand, heard):
    ...         return (last + heard(last) + demand) / 2
    >>> keys = {"engine": "exact", "tick": 0.02, "attack": "none", "law": Halfway()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    claims: ClassVar[frozenset[str]] = frozenset({"left", "iterates", "gives_demand"})
    holds: ClassVar[bool] = True  # whether vehicles hold q from tick to tick
    local: ClassVar[bool] = False  # whether neighbours transmit no highest derivative, as q = y‴
    by_link: ClassVar[bool] = False  # whether `demand` gives q, from the difference on each link

    def exchange(
        self,
        last: VehicleVectors,
        demand: VehicleVectors,
        heard: Callable[[VehicleVectors], VehicleVectors],
    ) -> VehicleVectors:
        """The jerk that vehicles hold from this tick until the next.

        Parameters
        ----------
        last
            The jerk that vehicles held until now [m/s³], (2, m, lanes); 0 at first.
        demand
            The right-hand side b of each vehicle [m/s³], (2, m, lanes).
        heard
            Function from q to A q, which each vehicle computes from the q that its neighbours send.

        Returns
        -------
            The jerk [m/s³], (2, m, lanes).
        """
        raise KindError(f"{self.kind}: a law gives exchange(self, last, demand, heard)")

    def left(self, eigenvalues: np.ndarray) -> np.ndarray | None:
        """The factor by which an exchange multiplies q - L⁻¹b along eigenvectors of A.

        None, the default, means that it is not known; `jaxnet check` then says nothing of
        stability.
        """
        return None

    def exchanges(self) -> int:
        """How often neighbours send each other q at a tick."""
        return 1

    def way(self) -> Way:
        """How vehicles follow the law between ticks.

        `solved`: for all vehicles together at every instant, as the theory asks. `held`: by the q
        of the last tick. `local`: at every instant, each vehicle alone. `linearised`: by inputs
        that are linear in the error of the state.
        """
        return "held" if self.holds else "local" if self.local else "solved"

    def needs_ticks(self) -> bool:
        return self.way() == "held"

    def solves(self) -> bool:
        """Whether the law is solved for all vehicles at every instant, as the theory asks."""
        return self.way() == "solved"

    def couples(self) -> bool:
        """Whether a vehicle's q depends on those that its neighbours send.

        Such a law needs a navigator and has no solution for vehicles that are cut off, which may
        keep their drive. It does not depend on the strength of a row of weights.
        """
        return not self.local

    def heeds_highest(self, sources: SlotSources) -> SlotLinks:
        """The slots whose source tells a highest derivative that a local law heeds."""
        return sources == 0

    def parts(self, gain: Any) -> tuple[Any, Any]:
        """The gains of differences from neighbours, and those of own derivatives, or None."""
        return gain, None

    def takes_any_message(self) -> bool:
        """Whether messages may be lost, delayed or err."""
        return self.way() != "linearised"

    def tells_motion(self, extrapolated: bool) -> bool:
        """Whether delayed messages are power series of the vehicles' motion over a tick."""
        return not self.holds and (self.local or extrapolated)

    def iterates(self) -> bool:
        """Whether it is Jacobi's iteration, of which a sufficient number of rounds is known."""
        return False

    def gives_demand(self) -> bool:
        """Whether q is the demand itself, of which stability is known."""
        return False

    def own_gain(self, gain: Any) -> Any:
        """The gains by which a vehicle's own jets move it between ticks: 0 where it holds q."""
        return 0.0 * gain if self.needs_ticks() else gain

    def singular_at_rest(self) -> bool:
        """Whether the inputs are those of `ψ⁻¹`, undefined where ψ is singular."""
        return self.way() != "linearised"

    def breaks(self):
        return broken(solved=not self.solves())

    def faults(self, scenario):
        if self.needs_ticks() and scenario.tick == 0:
            message = f"{self.kind} holds the jerk from tick to tick: give a tick"
            yield Fault(("law", "tick"), message)


class LinksInForce(NamedTuple):
    """What a law by link knows besides the differences."""

    sources: SlotSources  # numbers, 0 is the navigator; a slot without a source holds the listener
    weights: AxisSlotNumbers  # in force: 0 where there is no link, or no message that is believed
    gain: LaneGains  # k0, k1, …
    time: LaneTimes  # [s]


class LinkLaw(Law):
    """A local law that need not be linear in what each link tells, held from tick to tick.

    A subclass gives `demand`.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.laws import LinkLaw
    >>> class Sign(LinkLaw):
    ...     '''Agreement in finite time: `q_i = k0 Σ_j w_ij sign(y_j - y_i)`.'''
    ...
    ...     def demand(self, apart, links):
    ...         return links.gain[0][None, None] * (links.weights * jnp.sign(apart[0])).sum(axis=1)
    >>> keys = {"navigator": "none", "vehicle": "single_integrator", "law": Sign()}
    >>> results = jaxnet.simulate({**keys, "engine": "exact"}, samples=2, progress=False)
    >>> results.lanes["status"].to_list()
    ['ok', 'ok']
    """

    local = True
    by_link = True

    def demand(self, apart: SlotJets, links: LinksInForce) -> VehicleVectors:
        """The derivative of the order r that each vehicle asks for [m/s^r], (2, m, lanes).

        `apart` are the received jets less those that the vehicle senses of itself, below the order,
        each (2, slots, m, lanes): `y_j + a_ij - y_i` first, with the errors of the channel.
        """
        raise KindError(f"{self.kind}: a law by link gives demand(self, apart, links)")

    def exchange(self, last, demand, heard):
        return demand

    def faults(self, scenario):
        yield from super().faults(scenario)
        if scenario.channel.late or scenario.channel.missing != "drop":
            told = f"{self.kind} hears messages of now alone: no delay, and missing: drop"
            yield Fault(("law", "channel"), told)
