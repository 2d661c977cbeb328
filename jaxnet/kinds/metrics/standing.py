from jaxnet.kinds.metrics import Metric, tallied

STANDING = Metric(
    "standing",
    "",
    lambda seen: tallied(seen, "standing", 0),
    time="last",
    words="share of vehicle-time in which a vehicle stood that had stopped",
)
