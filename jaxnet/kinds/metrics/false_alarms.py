from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.metrics.alarms import alarm_share

FALSE_ALARMS = Metric(
    "false_alarms",
    "",
    lambda seen: alarm_share(seen, 1),
    time="last",
    words="share of honest messages that raise an alarm",
    undefined="blank",
)
