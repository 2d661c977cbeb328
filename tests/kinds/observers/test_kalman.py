"""The filter of a link: its gain at rest, its residuals, and what it does not know."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jaxnet.config.document import ConfigError
from jaxnet.kinds.observers import Compared, HeardMessages, Observer
from jaxnet.kinds.observers.kalman import Kalman, LinkEstimate, learnt
from jaxnet.model.whitening import whitened
from tests import systems

H, UNKNOWN = 0.1, 2.0
SIZES = np.array([0.3, 0.2, 0.0])


def heard(order, received):
    """One link of one lane on which a message arrives."""
    shape = (1, 1, 1)
    jets = np.asarray(received, float).reshape(order, 2, *shape)
    variances = np.broadcast_to(SIZES[:order, None, None, None] ** 2, (order, *shape))
    flags = np.ones(shape, bool)
    own = np.zeros((order, 2, 1, 1))
    times = np.zeros(1), np.full(1, H)
    return HeardMessages(
        *times, np.zeros((1, 1), int), 1.0 * flags, flags, jets, jets, variances, own
    )


def run(order, messages):
    """Residuals of messages, their variances, and whether they are known."""
    rule = Kalman.filled({"unknown": np.full(1, UNKNOWN)})
    memory, found = rule.start(heard(order, messages[0])), []
    step = jax.jit(lambda here, last: (rule.compared(here, last), rule.advance(here, last)))
    for message in messages:
        compared, memory = step(heard(order, message), memory)
        found.append((compared.residuals, compared.variances, bool(compared.known.all())))
    return found


@pytest.mark.parametrize("order", [1, 2])
def test_variances_come_to_rest_where_riccati_s_equation_says(order):
    found = run(order, np.zeros((200, order, 2)))
    moved = np.array([[1.0, H], [0.0, 1.0]])[:order, :order]
    push = (
        UNKNOWN * np.array([[H**2 / 2], [H]])[-order:] if order == 2 else np.array([[UNKNOWN * H]])
    )
    noise = np.diag(SIZES[:order] ** 2)
    before = solve_discrete_are(moved.T, np.eye(order), push @ push.T, noise)
    roots = np.linalg.cholesky(before + noise)
    np.testing.assert_allclose(np.ravel(found[-1][1]), np.diag(roots) ** 2, rtol=1e-9)
    assert [known for *_, known in found[:2]] == [False, True]


def test_residuals_of_such_a_source_are_white():
    """A source that moves as the filter thinks, 2 axes of 3 orders, of which one has no errors."""
    draw, order = np.random.default_rng(5), 3
    jets, told = np.zeros((order, 2)), []
    step = np.array([[1, H, H**2 / 2], [0, 1, H], [0, 0, 1]])
    push = np.array([[H**3 / 6], [H**2 / 2], [H]])
    for _ in range(400):
        told.append(jets + SIZES[:, None] * draw.normal(size=(order, 2)))
        jets = step @ jets + push * UNKNOWN * draw.normal(size=(1, 2))
    found = run(order, told)
    each = [jax.jit(whitened)(residual, variances) for residual, variances, _ in found[1:]]
    white = np.stack([np.asarray(one)[..., 0, 0, 0] for one, _ in each])
    assert all(int(orders[0, 0, 0]) == order for _, orders in each)
    assert white.var() == pytest.approx(1.0, abs=2.576 * np.sqrt(2 / white.size))
    lagged = (white[1:] * white[:-1]).mean()
    assert abs(lagged) <= 2.576 / np.sqrt(white[1:].size)


def white(covariance, residual):
    """A residual that has a covariance, whitened, and its number of orders."""
    here = heard(3, residual)._replace(variances=np.zeros((3, 1, 1, 1)))
    spread = {(i, j): covariance[i, j].reshape(1, 1, 1) for i in range(3) for j in range(i, 3)}
    nothing = LinkEstimate((jnp.zeros((2, 1, 1, 1)),) * 3, spread, here.arrived)
    found = learnt(here, nothing)
    residuals, orders = whitened(jnp.stack(found.residuals), jnp.stack(found.variances))
    return residuals[..., 0, 0, 0], int(orders[0, 0, 0])


def test_whitening_divides_by_a_root_and_leaves_out_what_follows():
    """Against NumPy; an order that is twice another one has no number of its own."""
    draw = np.random.default_rng(2)
    root = draw.normal(size=(3, 3))
    covariance, residual = root @ root.T, draw.normal(size=(3, 2))
    expected = np.linalg.solve(np.linalg.cholesky(covariance), residual)
    np.testing.assert_allclose(white(covariance, residual)[0], expected, rtol=1e-9)
    twice = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 9.0]])
    found, orders = white(twice, np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]))
    np.testing.assert_allclose(found[:, 0], [1.0, 0.0, 1.0])
    assert orders == 2


KEYS = {
    "engine": "exact",
    "vehicles": 6,
    "defence": "none",
    "horizon": 10.0,
    "tail": 1.0,
    "channel": {"noise": {"position": 0.1}},
    "detector": {"kind": "distance", "threshold": 2.0, "predicts": "kalman"},
}


@pytest.mark.long
def test_a_slow_lie_drags_the_filter_along():
    """A sudden bias is seen at once, one that grows slowly never: the truth would show it."""

    def share(**keys):
        study = systems.study(**{**KEYS, **keys})
        return systems.simulate(systems.lanes(study, 2, save=())).metrics["alarms"].mean()

    slow = {"attack": {"kind": "sinusoid", "magnitude": 6.0, "frequency": 0.05, "vehicles": [2]}}
    true = {"detector": KEYS["detector"] | {"predicts": "truth"}}
    assert share(**slow) == 0.0
    assert share(**slow, **true) > 0.1
    sudden = {"kind": "bias", "magnitude": 60.0, "vehicles": {"at": [5.0], "sets": [[2]]}}
    assert share(attack=sudden) > 0.0


class Still(Observer):
    """A source is where it was at its last message; nobody knows by how much it errs."""

    tells_covariance = False

    def start(self, heard):
        return heard.received, jnp.zeros_like(heard.arrived)

    def compared(self, heard, memory):
        last, known = memory
        return Compared(heard.received - last, None, heard.arrived & known)

    def advance(self, heard, memory):
        kept = [
            jnp.where(heard.arrived[None], new, old)
            for new, old in zip(heard.received, memory[0], strict=True)
        ]
        return jnp.stack(kept), heard.arrived | memory[1]


def test_an_observer_from_outside_is_one_class():
    """All sources move; the first message of a link is not tested, nor the first after a cut."""
    cuts = {"cuts": "link", "return_after": 0.15}
    still = {"kind": "distance", "threshold": 1e-9, "predicts": Still(), **cuts}
    keys = {"channel": {}, "attack": "none", "law": "local", "metrics": ["run_length"]}
    study = systems.study(**KEYS | keys | {"detector": still, "horizon": 0.4, "tail": 0.1})
    found = systems.simulate(systems.lanes(study, 2, save=())).metrics
    assert found["false_alarms"].tolist() == [1.0, 1.0]
    with pytest.raises(ConfigError, match="Still tells no covariance"):
        systems.study(**KEYS | {"detector": {"kind": "chi_squared", "predicts": Still()}})
