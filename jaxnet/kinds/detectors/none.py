from jaxnet.kinds.detectors import Detector


class NoDetector(Detector):
    """Nobody tests words."""

    kind = "none"
    present = False
