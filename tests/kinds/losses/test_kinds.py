"""Losses by tick without a fleet, and in fleets with a known motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from jaxnet.kinds.losses import Messages
from tests import systems
from tests.reference import Powers

TICK = 0.1


def lost_words(loss, ticks, lanes=4, **keys):
    """Words that are lost, (ticks, listeners, sources, lanes); all hear all, far apart."""
    keys = {"topology": "complete", "vehicles": 5, "engine": "exact", "tick": TICK} | keys
    keys["attack"] = "none"
    one = systems.lanes(systems.study(channel={"loss": loss}, **keys), lanes)
    lane = jax.tree.map(lambda leaf: jnp.moveaxis(jnp.asarray(leaf), 0, -1), one.inputs.lane)
    sources = jnp.asarray(one.network.hearing.sources)
    present, far = lane.weights > 0, jnp.ones_like(lane.weights)

    def messages(number):
        time = jnp.full(lanes, number.astype(float) * TICK)
        return Messages(time, sources, present, far, lane.interval)

    def at_tick(memory, number):
        lost, memory = lane.loss.lost(messages(number), memory)
        return memory, lost

    memory = jax.jit(lambda: lane.loss.start(messages(jnp.asarray(0))))()
    lost = np.asarray(jax.lax.scan(at_tick, memory, jnp.arange(ticks))[1])
    found = np.zeros((ticks, sources.shape[1], sources.shape[1] + 1, lanes), bool)
    for slot, listener in np.ndindex(*sources.shape):
        found[:, listener, int(sources[slot, listener])] = lost[:, slot, listener]
    return found


def links(lost):
    apart = ~np.eye(lost.shape[1], lost.shape[2], k=1, dtype=bool)
    return lost[:, apart].reshape(len(lost), -1)


def runs(lost):
    """Lengths of the runs of losses that begin and end within the sequences."""
    found = []
    for one in lost.T:
        steps = np.diff(one.astype(int))
        begins, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        ends = ends[ends > begins[0]] if len(begins) else ends[:0]
        found += (ends - begins[: len(ends)]).tolist()
    return np.array(found)


@pytest.mark.parametrize(("fail", "recover"), [(0.05, 0.25), (0.6, 0.9), (0.02, 1.0)])
def test_bursts_are_as_long_and_as_frequent_as_the_chain_says(fail, recover):
    """Share g/(g + b) at each tick from the first on, and mean burst 1/b, inside 99 % intervals."""
    loss = {"kind": "gilbert_elliott", "fail": fail, "recover": recover}
    lost = links(lost_words(loss, 600, lanes=20))
    share, memory = fail / (fail + recover), 1 - fail - recover
    width = 2.576 * np.sqrt(share * (1 - share) / lost.shape[1])
    assert abs(lost[0].mean() - share) <= width
    assert abs(lost.mean() - share) <= width * np.sqrt((1 + memory) / (1 - memory) / len(lost))
    bursts = runs(lost)
    deviation = np.sqrt(1 - recover) / recover / np.sqrt(len(bursts))
    assert abs(bursts.mean() - 1 / recover) <= 2.576 * deviation


@pytest.mark.parametrize("kind", ["bernoulli", "gilbert_elliott", "jamming"])
def test_words_are_lost_together(kind):
    """Those of a transmitter, of both directions of a link, or all; others are independent."""
    keys = {
        "bernoulli": {"probability": 0.4},
        "gilbert_elliott": {"fail": 0.3, "recover": 0.5},
        "jamming": {"starts": 3.0, "spacing": 0.2, "seconds": 2.0, "ratio": 1.5},
    }[kind]
    every = ("link", "pair", "transmitter", "all")
    lost = {of: lost_words({"kind": kind, "of": of, **keys}, 300) for of in every}
    one, other = lost["all"][:, :1, :1], lost["all"][:, 2:3, 4:5]
    assert (one == other).all()
    assert one.any()
    assert (lost["transmitter"][:, 0, 2] == lost["transmitter"][:, 3, 2]).all()
    there = np.moveaxis(lost["pair"][:, :, 1:], 2, 1)  # by source and listener
    assert (there == lost["pair"][:, :, 1:])[:, ~np.eye(5, dtype=bool)].all()
    for first, second in [
        (lost["pair"][:, 0, 2], lost["pair"][:, 0, 3]),
        (lost["pair"][:, 2, 0], lost["pair"][:, 2, 1]),
        (lost["link"][:, 0, 2], lost["link"][:, 1, 1]),
        (lost["transmitter"][:, 0, 2], lost["transmitter"][:, 0, 3]),
        (lost["link"][:, 0, 2], lost["link"][:, 3, 2]),
        (lost["all"][:, 0, 2, 0], lost["all"][:, 0, 2, 1]),
    ]:
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.25


def test_drawn_intervals_keep_their_limits_in_every_window():
    """Number and length, for each pair of ticks; the jammer uses what it has."""
    starts, spacing, seconds, ratio = 2.0, 1.3, 0.7, 3.0
    loss = {"kind": "jamming", "starts": starts, "spacing": spacing}
    loss |= {"seconds": seconds, "ratio": ratio}
    lost = lost_words(loss, 400, lanes=8)[:, 0, 2].astype(float)
    begun = np.diff(lost, axis=0, prepend=0.0) > 0
    after = np.arange(401) * TICK
    for values, least, rate in [(begun, starts, 1 / spacing), (TICK * lost, seconds, 1 / ratio)]:
        total = np.concatenate([np.zeros((1, 8)), values.cumsum(axis=0)])
        most = least + (after[None] - after[:, None]) * rate
        slack = (total[None] - total[:, None]) - most[..., None]
        later = np.triu(np.ones((401, 401), bool))
        assert slack[later].max() <= 1e-9
    assert lost.mean() > 0.1


def test_listed_and_periodic_intervals_begin_and_end_at_their_times():
    """An interval holds its begin, not its end."""
    loss = {"kind": "jamming", "intervals": [[0.3, 0.6], [2.05, 2.15]]}
    loss |= {"period": 1.0, "length": 0.2, "first": 4.0}
    lost = lost_words(loss, 70)
    ticks = [3, 4, 5, 21, 40, 41, 50, 51, 60, 61]
    np.testing.assert_array_equal(np.flatnonzero(lost[:, 1, 3, 2]), ticks)
    every = links(lost)
    assert (every == every[:, :1]).all()


def test_a_vehicle_joins_at_the_tick_at_which_it_is_near():
    """A chain closes up as 200 m e^(-t)(1 + t + t²/2); its end hears the navigator from 10 m on."""
    m = 25
    edges = [[i, i - 1, 1] for i in range(1, m + 1)] + [[m, 0, 1]]
    places = [[8.0 * i, 0.0] for i in range(1, m + 1)]
    keys = {"initial": {"position": places, "heading": 0.0, "speed": 99.0}}
    keys |= {"navigator": Powers(x=[0.0, 99.0], y=[0.0]), "vehicles": m}
    keys |= {"topology": {"kind": "edges", "edges": edges}, "attack": "none", "defence": "none"}
    keys |= {"engine": "exact", "tick": 0.05, "output_step": 0.05, "horizon": 8.0, "tail": 1.0}
    loss = {"kind": "range", "radius": 10.0}
    outcome = systems.outcome(1, channel={"loss": loss}, **keys)
    heard = outcome.series["kept"][0, :, m - 1, 0] > 0
    np.testing.assert_array_equal(np.flatnonzero(heard), np.arange(126, 161))
    assert outcome.unheard.tolist() == [0]


QUIET = {"attack": "none", "defence": "none", "engine": "exact"}


def loss(probability):
    return {"loss": {"kind": "bernoulli", "probability": probability}}


def test_a_vehicle_with_one_source_keeps_its_drive_as_often_as_messages_are_lost():
    """On the star; inside the 99.9 % interval of a binomial number."""
    study = systems.study(topology="star", channel=loss(0.3), horizon=10.0, tail=1.0, **QUIET)
    outcome = systems.simulate(systems.lanes(study, 50, ()))
    number = 50 * 12 * 201
    low, high = stats.binom.ppf([0.0005, 0.9995], number, 0.3)
    assert low <= outcome.unheard.sum() <= high


def test_who_never_hears_anything_goes_on_as_it_began():
    """Its drive stays P(y) of the start with jerk 0: y‴ + P(y - y*) = 0, `k0 y* = P(y)`."""
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
