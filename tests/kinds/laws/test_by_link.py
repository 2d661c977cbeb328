"""Laws by link: a linear one is the local law. Others: test_known_protocols.py."""

import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.laws import LinkLaw
from jaxnet.view.text.check import check_text


class Linear(LinkLaw):
    """`q_i = P(Σ_j w_ij (y_j + a_ij - y_i))`: the local law without the navigator's derivative."""

    def demand(self, apart, links):
        each = zip(links.gain, apart, strict=True)
        return sum(gain[None, None] * (links.weights * jet).sum(axis=1) for gain, jet in each)


def rows(law, **keys):
    fixed = {"law": law, "engine": "exact", "navigator": "none", "horizon": 4.0, "tail": 1.0}
    fixed |= {"vehicle": "single_integrator", "gain": [1.5], "tick": 0.1}
    results = jaxnet.simulate({**fixed, **keys}, samples=6, progress=False)
    assert set(results.lanes["status"]) == {"ok"}
    return results.lanes


ORDER_2 = {"vehicle": "double_integrator", "gain": [1.0, 2.0]}
EDGES = [[i, i % 12 + 1, 0.3 * i] for i in range(1, 13)] + [[1, 5, 1.0], [6, 2, 0.4]]
UNNORMALISED = {"kind": "edges", "edges": EDGES, "normalised": False}
EULER = {
    "engine": {"kind": "sampled", "move": "euler"},
    "vehicle": {"kind": "look_ahead", "ahead": 30.0},
}


@pytest.mark.parametrize(
    "keys",
    [
        pytest.param(
            {"defence": {"kind": "w_msr", "F": 1}, **ORDER_2}, id="w_msr", marks=pytest.mark.long
        ),
        pytest.param(
            {"channel": {"loss": {"kind": "bernoulli", "probability": 0.3}}},
            id="loss",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"channel": {"noise": {"position": 0.5}}, "sensing": {"position": 0.2}},
            id="noise",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"topology": UNNORMALISED, "defence": "none"}, id="strength", marks=pytest.mark.long
        ),
        pytest.param(EULER, id="sampled"),
        pytest.param({"engine": "nonlinear", **ORDER_2}, id="nonlinear", marks=pytest.mark.long),
    ],
)
def test_a_linear_law_by_link_is_the_local_law(keys):
    """Under attack, with what links and defences do to messages."""
    keys = {"attack": {"kind": "rotating", "magnitude": 5.0, "vehicles": [2, 5]}, **keys}
    ours, theirs = rows(Linear(), **keys), rows("local", **keys)
    for name in ("tail_mean", "peak_error", "spread", "tail_disagreement", "switches"):
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-10)


def test_nothing_is_proved_of_a_law_by_link():
    keys = {"law": Linear(), "vehicle": "single_integrator", "gain": [1.0], "engine": "exact"}
    said = check_text(jaxnet.load({**keys, "defence": "none"}))
    assert "nothing is proved" in said
    assert "nothing is proved" not in check_text(
        jaxnet.load({**keys, "law": "exact", "defence": "none"})
    )


@pytest.mark.parametrize(
    "channel",
    [{"delay": 0.1}, {"loss": {"kind": "bernoulli", "probability": 0.1}, "missing": "hold"}],
)
def test_messages_of_before_are_refused(channel):
    keys = {"law": Linear(), "vehicle": "single_integrator", "gain": [1.0], "channel": channel}
    with pytest.raises(jaxnet.ConfigError, match="hears messages of now alone"):
        jaxnet.load(keys)
