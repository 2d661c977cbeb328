from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.metrics.alarms import alarm_share

FALSE_ALARMS = Metric(
    "false_alarms",
    "",
    lambda seen: alarm_share(seen, 1),
    time="last",
    words="alarms about words of honest links, a share of these words",
    undefined="blank",
)
