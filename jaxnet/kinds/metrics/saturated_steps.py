from jaxnet.kinds.metrics import Metric, tallied

SATURATED_STEPS = Metric(
    "saturated_steps",
    "",
    lambda seen: tallied(seen, "saturated", 1),
    time="last",
    words="steps in which the inputs of any vehicle were saturated",
)
