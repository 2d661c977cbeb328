from jaxnet.kinds.observers import Compared, Observer


class Truth(Observer):
    """The true jets of the source when it sent the message: the best that a listener could know."""

    words = "the true motion (an ideal observer)"
    exact = True

    def compared(self, heard, memory):
        return Compared(heard.errors, heard.variances, heard.arrived)
