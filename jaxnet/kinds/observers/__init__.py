"""Observers: what a listener expects of the messages that it hears (docs/detectors.md).

At each tick an observer compares the messages that arrive with what it expected. Then it learns
from those that detectors left. Jets are absolute: nobody is subtracted from them.
"""

from typing import Any, ClassVar, NamedTuple

from jaxtyping import Float

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.shapes import (
    LaneNumbers,
    LaneTimes,
    Memory,
    SlotMask,
    SlotNumbers,
    SlotSources,
    StackedJets,
)

ByOrder = Float[Any, "orders slots m *lanes"]
LinkJets = Float[Any, "orders 2 slots m *lanes"]  # [m, m/s, …]


class HeardMessages(NamedTuple):
    """The messages of a tick, by slot. A listener has a slot for each source.

    Attributes
    ----------
    time, interval
        Time of the tick, and from tick to tick [s], (lanes,).
    sources
        Numbers of the sources, (slots, m); 0 is the navigator.
    weights
        Weights of the network in force, (slots, m, lanes); 0 on a link that an alarm has cut.
    arrived
        Whether a message arrives. `advance` is not told of those that an alarm has cut.
    received
        Jets in each message, below the vehicles' order. A delayed message has those of the tick at
        which it was sent.
    errors
        `received` minus the true jets of the source at that tick.
    variances
        Variance of the errors on an axis, by order; 0 in an order without errors, and where neither
        observer nor detector needs it.
    own
        Jets of the listeners at this tick, as they sense them, (orders, 2, m, lanes).
    """

    time: LaneTimes
    interval: LaneNumbers
    sources: SlotSources
    weights: SlotNumbers
    arrived: SlotMask
    received: LinkJets
    errors: LinkJets
    variances: ByOrder
    own: StackedJets


class Compared(NamedTuple):
    """Messages against their predictions.

    Attributes
    ----------
    residuals
        Received minus predicted jets; of each order what the orders before it do not tell.
    variances
        Variance of a residual on an axis, by order; 0 in an order that follows from those before.
        None: unknown.
    known
        Messages for which there is a prediction.
    """

    residuals: LinkJets
    variances: ByOrder | None
    known: SlotMask


class Observer(Kind):
    """A prediction of messages. A subclass gives `compared`, and `start` and `advance` for a
    memory.

    On a link that an alarm cuts, a memory starts anew: its leaves of shape (…, slots, m, lanes).

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.observers import Compared, Observer
    >>> class Near(Observer):
    ...     '''Expects a source where its listener is; nobody knows how far off that is.'''
    ...
    ...     tells_covariance = False
    ...
    ...     def compared(self, heard, memory):
    ...         return Compared(heard.received - heard.own[:, :, None], None, heard.arrived)
    >>> detector = {"kind": "distance", "threshold": 1000.0, "predicts": Near()}
    >>> keys = {"engine": "exact", "metrics": ["false_alarms"], "detector": detector}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["false_alarms"].to_list()
    [0.0, 0.0]
    """

    exact: ClassVar[bool] = False  # whether it expects the truth
    tells_covariance: ClassVar[bool] = True  # whether that of its residuals is known
    needs_variances: ClassVar[bool] = False  # whether it needs those of messages
    presumes: ClassVar[str] = ""  # of the motion of sources, where that covariance is right

    def start(self, heard: HeardMessages) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def compared(self, heard: HeardMessages, memory: Any) -> Compared:
        """The messages of a tick against what was expected, with the memory of the last tick."""
        raise KindError(f"{self.kind}: an observer gives compared(self, heard, memory)")

    def advance(self, heard: HeardMessages, memory: Any) -> Memory:
        """The memory after a tick, without the messages that an alarm has cut."""
        return memory
