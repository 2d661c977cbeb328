from jaxnet.kinds.metrics import Metric, tallied

WITHOUT_VELOCITY = Metric(
    "infeasible",
    "",
    lambda seen: tallied(seen, "infeasible", 0),
    time="last",
    words="share of vehicle-steps in which the filter had no velocity, and the vehicle stood still",
)
