from jaxnet.kinds.detectors import Detector


class NoDetector(Detector):
    """Nobody tests messages."""

    present = False
