from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.metrics.saturated import saturation

SATURATED_STEPS = Metric(
    "saturated_steps",
    "",
    lambda seen: saturation(seen, 1),
    time="last",
    words="steps in which the inputs of any vehicle were limited",
)
