"""The paper's law, solved exactly."""

from typing import ClassVar

from jaxnet.kinds.laws import Law


class ExactLaw(Law):
    """Solve the law for all vehicles together at every instant, as if each knew the jerk of all
    others.
    """

    kind = "exact"
    holds: ClassVar[bool] = False
