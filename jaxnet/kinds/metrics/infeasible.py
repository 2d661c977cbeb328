from jaxnet.kinds.metrics import Metric, of_fleet

WITHOUT_VELOCITY = Metric(
    "infeasible",
    "",
    lambda seen: of_fleet(seen, 0.0 if seen.halted is None else seen.halted[0]),
    time="last",
    words="share of vehicle-steps in which the filter had no velocity, and the vehicle stood still",
)
