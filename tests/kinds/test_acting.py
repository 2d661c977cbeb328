"""The liars of configs/acting_knows.yaml, which know the error of each message."""

from pathlib import Path

import numpy as np
import pytest

import jaxnet

CONFIG = Path(__file__).parents[2] / "configs" / "acting_knows.yaml"


@pytest.mark.parametrize("factor", [1.0, 1.02])
def test_they_raise_no_alarm_and_a_little_more_does(factor):
    """O19: a residual of σ√v at each tick is the greatest that none sees for ever. v is the
    threshold of χ² over one or ten messages, per message, and the drift of the CUSUM, whose sum
    grows by 0.16 a tick where the lie is greater by 2 %.
    """
    swept = jaxnet.load(CONFIG).config.sweep
    networks, lies, cuts = swept.values()
    more = [[detector, factor * size] for detector, size in lies]
    asked = dict(zip(swept, (networks[:1], more, cuts[:1]), strict=True))
    study = jaxnet.load(CONFIG, {"horizon": 20.0, "tail": 1.0, "samples": 2, "sweep": asked})
    rows = jaxnet.simulate(study, progress=False).lanes
    assert (np.isinf(rows["first_alarm"]) == (factor == 1.0)).all()
    assert np.isfinite(rows["first_honest"]).any()
    assert ((rows["alarms"] > 0) == (factor > 1.0)).all()
