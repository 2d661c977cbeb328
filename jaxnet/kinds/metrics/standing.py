from jaxnet.kinds.metrics import Metric, of_fleet

STANDING = Metric(
    "standing",
    "",
    lambda seen: of_fleet(seen, 0.0 if seen.standing is None else seen.standing[0]),
    time="last",
    words="share of vehicle-time in which a vehicle stood that had stopped",
)
