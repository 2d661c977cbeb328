"""The paper's law."""

from typing import ClassVar

from jaxnet.kinds.laws import Law


class ExactLaw(Law):
    """Solved for all vehicles together, at every instant, as if each knew what all others are about to do."""

    kind = "exact"
    holds: ClassVar[bool] = False
