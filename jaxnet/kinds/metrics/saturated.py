from jaxnet.kinds.metrics import Metric, tallied

SATURATED = Metric(
    "saturated",
    "",
    lambda seen: tallied(seen, "saturated", 0),
    time="last",
    words="share of vehicle-steps in which the vehicle's inputs were saturated",
)
