from jaxnet.kinds.detectors import Detector
from jaxnet.kinds.fields import Positive, setting, value_range
from jaxnet.model.plane import length


class Distance(Detector):
    """A message raises an alarm if its position is farther than a length from the predicted one.

    The errors of messages need not be known.
    """

    words = "distance test"
    whitens = False

    threshold: Positive = setting(1.0, "[m], the greatest distance without an alarm")

    def limit_words(self):
        ends = " to ".join(f"{end:g}" for end in dict.fromkeys(value_range(self.threshold)))
        return f"an alarm is raised by a position over {ends} m from the expected one"

    def alarms(self, messages, memory):
        return length(messages.apart) > self.threshold[None, None], memory
