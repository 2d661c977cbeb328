from pydantic import ConfigDict

from jaxnet.kinds.detectors import AnyDetector


class NoDetector(AnyDetector):
    """Nobody tests messages."""

    model_config = ConfigDict(ignored_types=(object,))  # class attributes are no keys
    predicts, cuts, return_after = None, "never", None
