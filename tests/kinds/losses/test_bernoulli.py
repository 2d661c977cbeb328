"""Lost messages: counts against the binomial distribution, and lanes with a known motion."""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from jaxnet.config.document import ConfigError
from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.engine.status import Status
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.losses import Loss
from tests import reference, systems
from tests.reference import navigator_at

QUIET = {"attack": "none", "defence": "none", "engine": "exact"}


def loss(probability):
    """The key `channel`."""
    return {"loss": {"kind": "bernoulli", "probability": probability}}


def test_a_vehicle_with_one_source_keeps_its_drive_as_often_as_messages_are_lost():
    """On the star; inside the 99.9 % interval of a binomial number."""
    study = systems.study(topology="star", channel=loss(0.3), horizon=10.0, tail=1.0, **QUIET)
    outcome = systems.simulate(systems.lanes(study, 50, ()))
    number = 50 * 12 * 201
    low, high = stats.binom.ppf([0.0005, 0.9995], number, 0.3)
    assert low <= outcome.unheard.sum() <= high


@pytest.mark.parametrize(("probability", "known"), [(0.1, 0.484321), (0.3, 0.628338)])
def test_dropped_words_leave_more_of_the_noise(probability, known):
    """The mean of `Σ_j w_ij²` over vehicles that hear somebody, 0.415 without loss: 99 % interval."""
    keys = QUIET | {
        "law": "local",
        "topology": {"kind": "cyclic", "navigator_weight": 0.1},
        "horizon": 10.0,
    }
    study = systems.study(**keys, channel=loss(probability), tail=1.0)
    squares = (systems.simulate(systems.lanes(study, 20, ("kept",))).series["kept"] ** 2).sum(
        axis=-1
    )
    heard = squares[squares > 0]
    assert len(heard) > 15_000
    assert abs(heard.mean() - known) <= 2.576 * heard.std() / np.sqrt(len(heard))


def test_where_everybody_hears_somebody_the_error_is_nominal():
    """Each of 12 vehicles hears all others: weights do not matter without attack and noise."""
    keys = QUIET | {"topology": "complete", "horizon": 10.0, "tail": 1.0}
    one = systems.lanes(systems.study(**keys, channel=loss(0.3)), 4)
    outcome, times = systems.simulate(one), np.arange(101) * 0.1
    assert outcome.unheard.tolist() == [0, 0, 0, 0]
    for number, states in enumerate(outcome.series["state"][..., :2]):
        lane, path = systems.lane(one, number), navigator_at(one, number)
        known = reference.nominal(path, lane.gain, reference.flat_jets(lane.initial.T), times)
        assert np.abs(states - known).max() <= 1e-9


def test_who_never_hears_anything_goes_on_as_it_began():
    """Its drive stays P(y) of the start, where the jerk was 0: y‴ + P(y - y*) = 0 with `k0 y* = P(y)`."""
    keys = QUIET | {"engine": "exact", "channel": loss(1.0), "horizon": 10.0, "tail": 1.0}
    lanes = systems.lanes(systems.study(**keys), 2)
    outcome = systems.simulate(lanes)
    assert outcome.status.tolist() == [0, 0]
    assert outcome.unheard.tolist() == [12 * 201] * 2
    x, y, heading, speed = np.moveaxis(lanes.inputs.lane.initial[:, :4], 1, 0)
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=-1)
    flow = expm(10.0 * np.array([[0, 1, 0], [0, 0, 1], [-1, -3, -3]]))
    start = np.stack([x, y], axis=-1)
    end = start + 3 * velocity + flow[0, 0] * -3 * velocity + flow[0, 1] * velocity
    assert np.abs(outcome.series["state"][:, -1, :, :2] - end).max() <= 1e-9


def test_a_channel_that_happens_to_lose_nothing_changes_nothing():
    """Lanes whose defence cuts a vehicle off fail, the others have the same errors."""
    edges = [
        [1, 0, 1],
        [2, 1, 1],
        [2, 3, 1],
        [2, 4, 1],
        [3, 2, 1],
        [3, 1, 1],
        [3, 4, 1],
        [4, 2, 1],
        [4, 3, 1],
    ]
    defence = {"kind": "trusted_trim", "theta": {2: 1, 3: 1}, "trusted": {2: [3], 3: [2]}}
    keys = {
        "topology": {"kind": "edges", "edges": edges},
        "vehicles": 4,
        "defence": defence,
        "attack": "none",
    }
    plain, lossless = (
        systems.simulate(
            systems.lanes(systems.study(horizon=10.0, tail=1.0, engine="exact", **keys, **more), 16)
        )
        for more in ({}, {"channel": loss(1e-300)})
    )
    assert Status.disconnected in plain.status
    assert plain.status.tolist() == lossless.status.tolist()
    assert plain.switches.tolist() == lossless.switches.tolist()
    for name, values in plain.metrics.items():
        np.testing.assert_allclose(lossless.metrics[name], values, rtol=0, atol=1e-9)


def test_no_bound_and_no_certificate_is_told_where_messages_are_lost():
    """The theory presupposes every message."""
    for keys in ({"channel": loss(0.1)}, {"sensing": {"velocity": 0.1}}):
        scenario = systems.study(**keys).cells[0].scenario
        known = situation_of(scenario)
        assert known.retained is None
        assert safe_in(scenario, known.graph, known.attacked) == []


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"tick": 0}, "channel.loss: messages are lost at ticks: give a tick"),
        ({"defence": {"kind": "trusted_trim", "score": "announced"}}, "needs every message"),
    ],
)
def test_a_loss_that_cannot_be_simulated_is_refused(keys, message):
    """With the key that the user may change."""
    with pytest.raises(ConfigError, match=message):
        systems.study(channel=loss(0.1), **keys)


def test_probability_and_kind_of_loss_are_swept():
    """Labels are numbers, or names with what tells them apart."""
    by_number = systems.study(channel=loss(0.1), sweep={"channel.loss.probability": [0.0, 0.5]})
    assert [cell.scenario.channel.loss.probability for cell in by_number.cells] == [0.0, 0.5]
    kinds = [
        "none",
        {"kind": "bernoulli", "probability": 0.1},
        {"kind": "bernoulli", "probability": 0.2},
    ]
    by_kind = systems.study(sweep={"channel.loss": kinds})
    labels = [cell.labels["channel.loss"] for cell in by_kind.cells]
    assert labels == ["none", "bernoulli(probability=0.1)", "bernoulli(probability=0.2)"]


def test_a_loss_that_draws_without_saying_so_is_told_what_is_missing():
    """The key of the random numbers is drawn only for kinds whose `draws` returns True."""

    class Silent(Loss):
        kind = "silent"

        def lost(self, messages, memory):
            drawn = self.random(messages.time, "loss", "uniform", messages.present.shape[:-1])
            return drawn < 0.5, memory

    study = systems.study(channel={"loss": Silent()}, horizon=1.0, tail=0.5, **QUIET)
    with pytest.raises(KindError, match=r"gives draws\(self\)"):
        systems.simulate(systems.lanes(study, 1))
