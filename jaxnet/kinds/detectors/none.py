"""No detector."""

from typing import ClassVar

from jaxnet.kinds.detectors import Detector


class NoDetector(Detector):
    """Nobody tests words."""

    kind = "none"
    present: ClassVar[bool] = False
