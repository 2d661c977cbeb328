"""Detectors: which messages raise an alarm at a tick, and what an alarm does (theorems.md O17)."""

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from jaxtyping import Float, Int

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.losses import unheard_faults
from jaxnet.kinds.observers import Observer
from jaxnet.kinds.observers.truth import Truth
from jaxnet.kinds.registry import KindOf
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, Memory, SlotMask, SlotSources, SlotVectors


class JudgedMessages(NamedTuple):
    """The messages that arrive at a tick against their predictions, by slot.

    `residuals` are received minus predicted jets, position first, whitened by their covariance: of
    independent orders each is divided by the standard deviation of its error. It is 0 in an order
    without errors. A listener has a slot for each source.
    """

    time: LaneTimes  # of the tick [s]
    sources: SlotSources  # number of the source, 0 is the navigator
    residuals: Float[Any, "orders 2 slots m *lanes"]
    orders: Int[Any, "slots m *lanes"]  # number of orders with errors
    judged: SlotMask  # whether a message arrived that can be tested
    interval: LaneNumbers  # time from tick to tick [s]
    apart: SlotVectors  # received minus predicted position [m]


class AlarmRule(NamedTuple):
    """The test of a link: an alarm if S is over the limit.

    S is the sum of the squared residuals of the last `window` ticks. With a drift S becomes
    `max(0, S + z - drift)` at each tick, and 0 after an alarm; z is the squared residual, or if not
    `squared` the residual along a direction.
    """

    limit: float
    window: int = 1
    drift: float | None = None
    squared: bool = True


class AnyDetector(Kind):
    """Base class of all detectors; the class attributes are those of nobody who tests messages."""

    if TYPE_CHECKING:
        predicts: Any = None
        cuts: Any = None
        return_after: Any = None

    present: ClassVar[bool] = False
    whitens: ClassVar[bool] = True  # whether it needs the covariance of residuals

    @property
    def acts(self) -> bool:
        """Whether an alarm changes what is heard."""
        return self.cuts != "never"

    @property
    def cuts_links(self) -> bool:
        """Whether an alarm takes a link out of the network."""
        return self.cuts in ("link", "both_ways")

    @property
    def needs_variances(self) -> bool:
        """Whether the variance of the errors of messages has to be known."""
        return self.whitens or self.predicts.needs_variances

    def rule(self, orders: int) -> AlarmRule | None:
        """The test of a link with so many orders with errors; by default None, which is unknown."""
        return None

    def limit_words(self) -> str:
        """When a test without a `rule` raises an alarm, in words with units; "" if not known."""
        return ""

    def foretells(self) -> bool:
        """Whether messages are compared with the truth, as of nobody who tests none."""
        return not self.present or self.predicts.exact

    def breaks(self):
        return broken(uncut=self.acts)


class Detector(AnyDetector):
    """A test of messages. A subclass gives `alarms`, and `start` if it has a memory.

    On a link that an alarm cuts, a memory starts anew: its leaves of shape (…, slots, m, lanes).

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.detectors import Detector
    >>> class Far(Detector):
    ...     '''An alarm about every message that is over 5 m from where its source is.'''
    ...
    ...     whitens = False
    ...
    ...     def alarms(self, messages, memory):
    ...         return (messages.apart**2).sum(axis=0) > 25.0, memory
    >>> attack = {"kind": "rotating", "magnitude": 10.0}
    >>> keys = {"engine": "exact", "attack": attack, "metrics": ["alarms"], "detector": Far()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["alarms"].to_list()
    [1.0, 1.0]
    """

    present: ClassVar[bool] = True

    predicts: Annotated[Observer, KindOf("observer")] = setting(
        Truth(), "what messages are compared with"
    )
    cuts: Literal["never", "message", "link", "both_ways"] = setting(
        "never",
        "what an alarm does from its tick on: never, nothing; message, the message counts as lost; "
        "link, the listener ignores the source; both_ways, the source ignores the listener too",
        title="alarms cut",
    )
    return_after: Positive | None = setting(
        None, "[s], after which a cut link returns; null: it never does"
    )

    def start(self, messages: JudgedMessages) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def alarms(self, messages: JudgedMessages, memory: Any) -> tuple[SlotMask, Memory]:
        """The messages that raise an alarm at a tick.

        Parameters
        ----------
        messages
            The messages that arrive. Without attack their residuals are standard normal if the
            errors are normal.
        memory
            The memory from the last tick, or from `start`.

        Returns
        -------
            Whether a message raises an alarm, (slots, m, lanes), and the memory. Messages that are
            not judged do not count.
        """
        raise KindError(f"{self.kind}: a detector gives alarms(self, messages, memory)")

    def faults(self, scenario):
        """Faults of errors that nobody knows, of no ticks, and of alarms that cut."""
        yield from self.predicts.faults(scenario)
        channel, known = scenario.channel, self.predicts.tells_covariance
        noises = {"channel.noise": channel.noise, "sensing": scenario.sensing}
        noisy = {key: noise for key, noise in noises.items() if not noise.exact()}
        if scenario.tick == 0 and not self.acts:
            yield Fault(("detector", "tick"), "messages are tested at ticks: give a tick")
        if self.whitens and not known:
            told = f"{self.predicts.kind} tells no covariance: give kind: distance"
            yield Fault(("detector.predicts", "detector"), told)
        if self.needs_variances and not (noisy or channel.rounded):
            told = f"{self.kind} needs errors of messages: give channel: {{noise: {{position: …}}}}"
            told += ", or kind: distance" * (not self.predicts.needs_variances)
            yield Fault(("detector", "channel.noise"), told)
        for key, noise in noisy.items():
            if self.needs_variances and not noise.tells_deviations():
                told = f"{noise.kind} tells no standard deviations of its errors"
                yield Fault(("detector", key), told)
        if self.acts:
            yield from unheard_faults("detector.cuts", scenario)
