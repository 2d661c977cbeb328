"""Times of alarms, links cut wrongly and run lengths, where a detector from outside alarms."""

import numpy as np
import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.kinds.detectors import Detector
from tests import systems

EDGES = [[i, i - 1, 1.0] for i in range(1, 5)] + [[i, i + 1, 1.0] for i in range(1, 4)]


class Planned(Detector):
    """Alarms about given links from given times [s] on: [listener, source, time]."""

    whitens = False
    plan: list[list[float]]

    def alarms(self, messages, memory):
        listeners = np.arange(1, 1 + messages.sources.shape[1])[None]
        found = messages.judged & False
        for listener, source, time in self.plan:
            there = (listeners == int(listener)) & (messages.sources == int(source))
            late = messages.time > time - 1e-9
            found = found | (there[..., None] & late[None, None])
        return found, memory


def alarmed(metrics, **keys):
    """Four vehicles on a line, with planned alarms."""
    study = {
        "engine": "exact",
        "vehicles": 4,
        "topology": {"kind": "edges", "edges": EDGES},
        "law": "local",
        "vehicle": "single_integrator",
        "defence": "none",
        "attack": {"kind": "bias", "magnitude": 1.0, "vehicles": [2]},
        "detector": Planned(plan=[[1, 2, 0.4], [3, 2, 1.15], [2, 1, 0.75]], cuts="link"),
        "tick": 0.05,
        "output_step": 0.5,
        "horizon": 2.0,
        "tail": 1.0,
        "metrics": metrics,
    }
    return systems.study(**{**study, **keys})


def measured(metric, **keys):
    outcome = systems.simulate(systems.lanes(alarmed([metric], **keys), 2, save=()))
    name = metric if isinstance(metric, str) else metric["kind"]
    assert (outcome.status == 0).all()
    assert (outcome.metrics[name] == outcome.metrics[name][0]).all()
    return outcome.metrics[name][0]


def first(**keys):
    return {"kind": "first_alarm", **keys}


@pytest.mark.parametrize(
    ("metric", "known"),
    [
        (first(), 0.4),
        (first(which="last"), 1.15),
        (first(of="honest"), 0.75),
        (first(of="honest", which="last"), np.inf),
        (first(listener=3, source=2), 1.15),
        (first(listener=2, source=1), 0.75),  # an honest link
        (first(of="attacked", listener=2, source=1), np.inf),
        (first(of="honest", listener=4, source=3), np.inf),
        ("isolation_time", 1.15),
        # of 5 honest links; the tail begins at 1 s
        ("wrongly_cut", 1 / 5),
        # Until the alarm 15 messages on one link, itself among them 16; 41 on four links
        ({"kind": "run_length"}, 16 + 4 * 41),
        ({"kind": "run_length", "of": "attacked"}, (9 + 24) / 2),
    ],
)
def test_what_is_measured_is_what_was_planned(metric, known):
    """Vehicle 2 lies to 1 and 3. A link that is cut is not tested any more."""
    assert measured(metric) == pytest.approx(known)


def test_a_link_that_returns_raises_alarms_again():
    """It is cut at 0.4, 0.9, 1.4 and 1.9 s for half a second: all along."""
    cut = Planned(plan=[[1, 2, 0.4]], cuts="link", return_after=0.5)
    assert measured({"kind": "run_length", "of": "attacked"}, detector=cut) == (8 + 4 + 41) / 4
    both = Planned(plan=[[2, 1, 0.4]], cuts="both_ways")
    assert measured("wrongly_cut", detector=both) == 1 / 5  # and an attacked one
    assert measured("isolation_time", detector=both) == np.inf


def test_a_liar_that_sends_0_stays_attacked():
    """Its links are cut while it lies for a tick. Then they carry the truth, but are not honest.

    A detector of what is more than 0.5 m off sees it once, from 0.4 s on.
    """
    lie = {"kind": "sleeper", "magnitude": 1.0, "vehicles": [2], "start": 0.4, "burst": 0.05}
    keys = {"attack": {**lie, "share": 0.0}, "detector": {"kind": "distance", "threshold": 0.5}}
    keys["detector"] |= {"cuts": "link"}
    assert measured("isolation_time", **keys) == pytest.approx(0.4)
    assert measured("wrongly_cut", **keys) == 0.0
    assert measured({"kind": "run_length", "of": "attacked"}, **keys) == 9


@pytest.mark.long
def test_a_study_without_detector_has_no_alarms_to_time():
    with pytest.raises(ConfigError, match="no message is judged without a detector"):
        systems.study(metrics=["first_alarm"])
    with pytest.raises(ConfigError, match="give listener and source"):
        systems.study(metrics=[first(listener=1)])
    keys = {"vehicles": 4, "detector": {"kind": "distance"}}
    with pytest.raises(ConfigError, match="there are 4 vehicles"):
        systems.study(metrics=[first(listener=5, source=1)], **keys)
    sweep = {"engine": "exact", "sweep": {"detector": ["none", "distance"]}}
    rows = jaxnet.simulate(
        {**sweep, "horizon": 1.0, "tail": 0.5, "metrics": ["first_alarm", "wrongly_cut"]}, 1
    ).lanes
    assert np.isinf(rows["first_alarm"][0])
    assert rows["first_alarm"][1] == 0.0
    assert rows["status"].tolist() == ["ok", "ok"]


RATE, TICKS = 0.005, 41


def falsely_alarmed(topology, samples):
    """Rows of honest vehicles with errors of links, at the last of so many ticks."""
    study = {
        "engine": "exact",
        "vehicles": 6,
        "topology": topology,
        "vehicle": "single_integrator",
        "gain": [1.0],
        **systems.QUIET,
        "channel": {"noise": {"position": 0.1}},
        "detector": {"kind": "chi_squared", "false_alarms": RATE, "cuts": "link"},
        "tick": 0.05,
        "output_step": 0.5,
        "horizon": 2.0,
        "tail": 0.0,
        "metrics": ["wrongly_cut"],
    }
    return jaxnet.simulate(study, samples).lanes


def test_links_are_cut_wrongly_at_the_rate_of_false_alarms():
    """Tests of a link are independent: after n ticks it is cut with probability 1 - (1 - α)^n."""
    rows, share = falsely_alarmed("complete", 100), 1 - (1 - RATE) ** TICKS
    assert (rows["status"] == "ok").all()
    error = np.sqrt(share * (1 - share) / (100 * 36))
    assert abs(rows["wrongly_cut"].mean() - share) < 4 * error


def test_a_fleet_falls_apart_at_the_rate_of_false_alarms():
    """On a star each vehicle has one source, so the first alarm of any ends the lane."""
    rows, share = falsely_alarmed("star", 200), 1 - (1 - RATE) ** (6 * TICKS)
    apart = (rows["status"] == "disconnected").mean()
    assert abs(apart - share) < 4 * np.sqrt(share * (1 - share) / 200)
    assert ((rows["status"] == "ok") | (rows["status"] == "disconnected")).all()
