"""Late and lost words under the local law and under exchanges, against plain NumPy programs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.rounds import parted
from jaxnet.engine.late import DrawnDelay
from jaxnet.engine.status import Status
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.losses import Loss
from jaxnet.view.text.check import check_text
from tests import systems
from tests.engine.test_orders import subsequence
from tests.engine.test_stand_ins import Powers
from tests.matrices import matrix_of
from tests.theory.test_rounds import late_polynomial

H = 0.1
AGENTS = {
    "vehicle": "single_integrator",
    "navigator": "none",
    "law": "local",
    "gain": [1 / H],
    "tick": H,
}
AGENTS |= {"output_step": H, "horizon": 30.0, "tail": 0.0, "engine": "exact", "vehicles": 6}
AGENTS |= {"initial": {"position": {"uniform": [-1.0, 1.0]}}}
WEIGHTS = np.array([[0.5 + (3 * i + 5 * j) % 7 / 10 for j in range(6)] for i in range(6)])
EDGES = [[i + 1, j + 1, float(WEIGHTS[i, j])] for i in range(6) for j in range(6)]
LIE = {"kind": "rotating", "magnitude": 0.7, "frequency": 0.9, "vehicles": [2]}


class Thirds(Loss):
    """Links lose words in a pattern of ticks, listeners and sources, the first ones too."""

    def lost(self, messages, memory):
        """About a third."""
        number = jnp.round(messages.time / H).astype(int)[None, None]
        return is_lost(
            number,
            jnp.arange(messages.sources.shape[1])[None, :, None],
            messages.sources[..., None],
        ), memory


def is_lost(number, listener, source):
    """Whether a word is lost at a tick, for NumPy and JAX."""
    return (3 * number + 7 * listener + 2 * source) % 10 < 4


def stepped(x, lies, late, missing, trims, lost, step=0.0):
    """`x_i ← w_ii x_i + Σ_j w_ij word_j`; words are late(n, i, j) ticks late, lost, held or dropped.

    `late` is of a message that is sent at tick n. A listener hears the newest message that has come.
    """
    path, m, least = [x], len(x), late(0, 0, 1)
    words, heard = np.zeros((m, m, 2)), np.full((m, m), missing == "hold" and least == 0)
    believed, newest = np.ones((m, m, 2), bool), np.full((m, m), -1)
    words[:] = (x + lies[0])[None]
    for n in range(len(lies) - 1):
        x, new = path[-1], np.empty_like(x)
        for i in range(m):
            others, fresh = [j for j in range(m) if j != i], []
            for j in others:
                sent = range(max(newest[i, j] + 1, n - 9), n + 1)
                came = [b for b in sent if b + late(b, i, j) == n]
                if came and not (lost and is_lost(n, i, j + 1)):
                    fresh.append(j)
                    newest[i, j] = came[-1]
                    words[i, j] = path[came[-1]][j] + lies[came[-1]][j]
                    if step:
                        words[i, j] = step * np.round(words[i, j] / step)
            heard[i] = heard[i] & (missing == "hold")
            heard[i, fresh] = True
            for axis in range(2):
                if trims and fresh:
                    kept, _ = subsequence(
                        x[i, axis], words[i, fresh, axis], np.ones(len(fresh)), set(), 1
                    )
                    believed[i, fresh, axis] = np.isin(np.arange(len(fresh)), kept)
                used = [j for j in others if heard[i, j] and believed[i, j, axis]]
                total = WEIGHTS[i, i] * x[i, axis] + WEIGHTS[i, used] @ words[i, used, axis]
                new[i, axis] = total / (WEIGHTS[i, i] + WEIGHTS[i, used].sum())
        path.append(new)
    return np.stack(path)


def agents(channel, trims, lost, engine="exact"):
    """Lanes of the agents."""
    keys = AGENTS | {"topology": {"kind": "edges", "edges": EDGES}, "engine": engine}
    channel = channel | ({"loss": Thirds()} if lost else {})
    return systems.lanes(
        systems.study(**keys, attack=LIE, defence="w_msr" if trims else "none", channel=channel), 2
    )


@pytest.mark.parametrize(
    ("late", "missing", "trims", "step"), [(3, "drop", True, 0.0), (2, "hold", False, 0.01)]
)
def test_agents_step_towards_old_words(late, missing, trims, step):
    """300 steps of single integrators that hold their velocity, to 1e-12 m; words get lost; two lanes."""
    one = agents({"delay": late * H, "missing": missing, "quantisation": step}, trims, True)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number in range(2):
        states, lies = (outcome.series[name][number] for name in ("state", "attack"))
        known = stepped(states[0], lies, lambda n, i, j: late, missing, trims, True, step)
        np.testing.assert_allclose(states, known, rtol=0, atol=1e-12)


class Patterned(DrawnDelay):
    """Delays of 1 to 3 ticks, in a pattern of ticks and links."""

    def draw(self, time, links):
        """By tick, slot and listener."""
        slots, m = jnp.arange(links[0])[:, None, None], jnp.arange(links[1])[None, :, None]
        return patterned(jnp.round(time / H).astype(int)[None, None], m, slots)


def patterned(n, listener, slot):
    """Ticks by which a message is late, for NumPy and JAX."""
    return 1 + (n + listener + 2 * slot + n // 4) % 3


@pytest.mark.parametrize(("missing", "engine"), [("hold", "exact"), ("drop", "nonlinear")])
def test_the_newest_message_counts(missing, engine):
    """Messages overtake each other and get lost; agents under W-MSR, to 1e-12 m."""
    channel = {"delay": {"uniform": [H, 3 * H]}, "delay_of": "message", "missing": missing}
    one = agents(channel, True, True, engine)
    lane = one.inputs.lane
    one = one._replace(inputs=one.inputs._replace(lane=lane._replace(delay=Patterned(*lane.delay))))
    outcome, slots = systems.simulate(one), np.asarray(one.network.hearing.sources)

    def late(n, i, j):
        return patterned(n, i, int(np.flatnonzero(slots[:, i] == j + 1)[0]))

    overtaken = sum(late(n, 0, 1) > 1 + late(n + 1, 0, 1) for n in range(20))
    assert overtaken > 0
    states, lies = (outcome.series[name][1] for name in ("state", "attack"))
    np.testing.assert_allclose(
        states, stepped(states[0], lies, late, missing, True, True), rtol=0, atol=1e-12
    )


def test_each_link_draws_its_delay():
    """Every lane and link one of its own, whole ticks within the bounds; agents step by them."""
    one = agents({"delay": {"uniform": [0.6 * H, 3.4 * H]}}, True, True)
    delays, slots = np.asarray(one.inputs.lane.delay.time), np.asarray(one.network.hearing.sources)
    ticks = np.round(delays / H).astype(int)
    assert set(ticks.ravel()) == {1, 2, 3}
    assert (ticks[0] != ticks[1]).any()
    outcome = systems.simulate(one)
    for number in range(2):

        def late(n, i, j, number=number):
            return ticks[number, np.flatnonzero(slots[:, i] == j + 1)[0], i]

        states, lies = (outcome.series[name][number] for name in ("state", "attack"))
        known = stepped(states[0], lies, late, "drop", True, True)
        np.testing.assert_allclose(states, known, rtol=0, atol=1e-12)


def test_equal_draws_are_a_fixed_delay():
    """Bit for bit, with losses and trimming. Under the exact law: tests/engine/test_late.py."""
    drawn, fixed = (
        systems.simulate(agents({"delay": delay}, True, True)).series["state"]
        for delay in ({"choice": [3 * H]}, 3 * H)
    )
    np.testing.assert_array_equal(drawn, fixed)


def test_messages_are_late_as_often_as_the_distribution_says():
    """Each number of ticks, within five standard deviations."""
    one = agents({"delay": {"uniform": [0.5 * H, 3.0 * H]}, "delay_of": "message"}, False, False)
    delay = DrawnDelay(*(jnp.asarray(np.moveaxis(leaf, 0, -1)) for leaf in one.inputs.lane.delay))
    draw = jax.jit(lambda time: delay.draw(time, (6, 6)))
    drawn = np.stack([np.asarray(draw(jnp.full(2, n * H))) for n in range(100)])
    for ticks, share in {1: 0.4, 2: 0.4, 3: 0.2}.items():
        assert abs((drawn == ticks).mean() - share) < 5 * np.sqrt(share * (1 - share) / drawn.size)


def test_two_on_a_line_under_the_exact_law():
    """Messages of 1 to 3 ticks: the closed form of `ẏ + k y = α + β s`, tick by tick, behind a ramp."""
    k, speed, ticks = 1.3, 2.0, 40
    keys = {
        "vehicle": "single_integrator",
        "navigator": Powers(x=[1.0, speed], y=[0.0]),
        "topology": "path",
    }
    keys |= {
        "vehicles": 2,
        "gain": [k],
        "tick": H,
        "output_step": H,
        "horizon": ticks * H,
        "tail": 0.0,
    }
    keys |= {
        "initial": {"position": [[3.0, 0.0], [-2.0, 0.0]]},
        "attack": "none",
        "defence": "none",
    }
    channel = {"delay": {"uniform": [H, 3 * H]}, "delay_of": "message", "missing": "hold"}
    one = systems.lanes(systems.study(**keys, channel=channel, engine="exact"), 1)
    lane = one.inputs.lane
    one = one._replace(inputs=one.inputs._replace(lane=lane._replace(delay=Patterned(*lane.delay))))
    found = systems.simulate(one).series["state"][0, :, :, 0]
    y, told = (
        np.array([3.0, -2.0]),
        [[] for _ in range(3)],
    )  # what the navigator and both say, by tick
    drives, newest, path = [np.array([k * y[0], 0.0]), np.array([k * y[1], 0.0])], [-1, -1], [y]
    for n in range(ticks):
        told[0].append(np.array([k * (1.0 + speed * n * H) + speed, k * speed]))  # α, β
        for i in range(2):
            came = [
                b for b in range(max(0, n - 3), n) if b + patterned(b, i, 0) == n and b > newest[i]
            ]
            if came:
                newest[i], drives[i] = came[-1], told[i][came[-1]]
            elif n:
                drives[i] = np.array([drives[i] @ [1.0, H], 0.0])
            told[i + 1].append(drives[i])
        alpha, beta = np.transpose(drives)
        steady = alpha / k - beta / k**2  # y = steady + β s / k + c e^(-ks)
        path.append(steady + beta * H / k + (path[-1] - steady) * np.exp(-k * H))
    np.testing.assert_allclose(found, path, rtol=0, atol=1e-9)


def test_motions_obey_the_polynomial_of_late_exchanges():
    """On the ring, along each eigenvector; `check` tells the greatest root, known for 3 ticks."""
    tick, late, ticks = 0.02, 3, 60
    keys = {"topology": "cyclic", "law": "rounds", "channel": {"delay": late * tick}, "tick": tick}
    keys |= {"output_step": tick, "horizon": ticks * tick, "tail": 0.0, "engine": "exact"}
    study = systems.study(**keys, attack="none", defence="none")
    values, vectors = np.linalg.eig(matrix_of(Cyclic(), 12)[:, 1:])
    states = systems.simulate(parted(systems.lanes(study, 13), vectors)).series["state"]
    apart = (states[1:] - states[:1])[..., 0] + 1j * (states[1:] - states[:1])[..., 1]
    for value, path in zip(values, np.einsum("lti,il->lt", apart, vectors.conj()), strict=True):
        polynomial = late_polynomial(value, np.array([1.0, 3.0, 3.0]), tick, late).coeffs[::-1]
        windows = np.lib.stride_tricks.sliding_window_view(path[late + 1 :], len(polynomial))
        assert np.abs(windows @ polynomial).max() < 1e-11 * np.abs(path).max()
    told = " ".join(check_text(study).split())
    assert (
        "0.06 s late; no bound holds; stable, deviations times 0.988730 at each tick of 0.02 s"
        in told
    )


def test_a_place_is_reached_as_it_is_told():
    """Vehicles of order 1 end at the rounded word of a navigator at rest, off by at most half a step."""
    keys = {
        "vehicle": "single_integrator",
        "navigator": Powers(x=[3.37], y=[-1.24]),
        "topology": "star",
    }
    keys |= {
        "vehicles": 2,
        "gain": [2.0],
        "horizon": 20.0,
        "tail": 0.0,
        "attack": "none",
        "defence": "none",
    }
    study = systems.study(**keys, channel={"quantisation": 0.5}, engine="exact")
    ends = systems.simulate(systems.lanes(study, 1)).series["state"][0, -1]
    np.testing.assert_allclose(ends, [[3.5, -1.0]] * 2, rtol=0, atol=1e-9)
    told = " ".join(check_text(study).split())
    assert "like an attack of at most 0.25 on each axis" in told
