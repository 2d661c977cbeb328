"""Networks that take turns (their motion: test_reference.py), and what is refused or told."""

import numpy as np
import pytest

from jaxnet.config.document import ConfigError
from jaxnet.view.text.check import check_text
from tests import systems

RING = [[i, 1 + (i + k) % 6, 1.0 + k] for i in range(1, 7) for k in (0, 4)]
LINE = {"vehicles": 6, "vehicle": "single_integrator", "navigator": "none", "law": "local"}
LINE |= {"gain": [1]}
LINE |= {"tick": 1.0, "output_step": 1.0, "tail": 0.0, "engine": "exact"}
CHAIN = [[1, 0, 1], [2, 1, 1]]


def test_trust_counts_in_the_network_in_force():
    """Vehicle 2 hears 0 and 1, or 1 alone: it retains 0, or else 1, and is never unheard."""
    networks = [
        {"kind": "edges", "edges": edges} for edges in ([[1, 0, 1], [2, 0, 1], [2, 1, 1]], CHAIN)
    ]
    attack = {"kind": "bias", "magnitude": 10, "vehicles": [1], "links": "neighbour"}
    attack["direction"] = 0.0
    keys = {"vehicles": 2, "vehicle": "double_integrator", "tick": 0.1, "horizon": 4.0, "tail": 0.0}
    keys |= {
        "topology": {"kind": "switching", "networks": networks, "every": 1.0},
        "attack": attack,
    }
    one = systems.lanes(systems.study(**keys, engine="exact", defence="trusted_only"), 1)
    kept = systems.simulate(one).series["kept"][0, :-1, 1]
    second = np.arange(40) // 10 % 2 == 1
    np.testing.assert_array_equal(kept, np.where(second[:, None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]))


def test_a_random_order_is_drawn_at_each_change():
    """Each network stays for its time, all about equally often; a drawn period is a lane's own."""
    networks = [
        {"kind": "edges", "edges": [[i, 1 + (i + k) % 6, 1] for i in range(1, 7)]} for k in range(3)
    ]
    keys = LINE | {"horizon": 300.0, "defence": "none", "attack": "none"}
    keys["topology"] = {"kind": "switching", "networks": networks, "every": 3.0, "order": "random"}

    def numbers(every):
        one = systems.lanes(
            systems.study(**keys | {"topology": keys["topology"] | {"every": every}}), 4
        )
        kept = systems.simulate(one).series["kept"][:, :-1]
        number = np.stack([kept[:, :, 0, 1 + (k + 1) % 6] > 0 for k in range(3)]).argmax(axis=0)
        return np.asarray(one.inputs.lane.turns.schedule.every), number

    for period, lane in zip(*numbers({"uniform": [2, 9]}), strict=True):
        turn = np.arange(300) // period
        assert 2 < period < 9
        assert (np.diff(turn)[np.diff(lane) != 0] == 1).all()
        assert (np.diff(lane) != 0).sum() > 10
    _, number = numbers(3.0)
    turns = number.reshape(4, 100, 3)
    assert (turns == turns[:, :, :1]).all()
    assert np.abs(np.bincount(turns[:, :, 0].ravel(), minlength=3) / 400 - 1 / 3).max() < 0.08
    assert (turns[0] != turns[1]).any()


def test_nothing_is_claimed_of_the_union_of_networks():
    """No stability in mean square; ticks of late motions follow the strongest network's rows."""
    loss = {"loss": {"kind": "bernoulli", "probability": 0.2, "of": "all"}}
    turns = {"kind": "switching", "networks": ["cyclic", "path"], "every": 3.0}
    for topology, told in (("cyclic", True), (turns, False)):
        study = systems.study(
            defence="none", law="rounds", attack="none", channel=loss, topology=topology
        )
        assert ("in mean square" in " ".join(check_text(study).split())) == told
    strong = {"kind": "edges", "edges": [[i, j, 9 * w] for i, j, w in RING], "normalised": False}
    weak = {"kind": "edges", "edges": RING, "normalised": False}
    keys = LINE | {"defence": "none", "attack": "none"}
    keys |= {"law": {"kind": "local", "hold": False}, "tick": 0.02, "output_step": 0.1, "tail": 0.0}
    keys |= {"channel": {"delay": 0.02}}
    systems.study(**keys, topology={**turns, "networks": [weak, weak]})
    with pytest.raises(ConfigError, match="delayed motions need ticks"):
        systems.study(**keys, topology={**turns, "networks": [weak, strong]})
