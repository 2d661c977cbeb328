"""Trust that learns, waits and holds vehicles to their starts: limits, and a plain program."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxnet.kinds.defences.trust import Trust
from jaxnet.kinds.vehicles import Integrators
from tests import systems


class BelievedUntil(Trust):
    """Liars are believed until a tick, then never."""

    tick: int

    def decide(self, own, received, last, memory, around):
        """The truth, late."""
        known = (jnp.round(around.time) >= self.tick)[None, None]
        return ~(around.attacked & known), memory


FIVE = {"vehicles": 5, "topology": {"kind": "complete", "own_weight": 1.0}, "navigator": "none"}
FIVE |= {"vehicle": "single_integrator", "law": "local", "gain": [1.0], "tick": 1.0}
FIVE |= {"initial": {"position": [0.0, 1.0, 2.0, 3.0, 10.0]}, "output_step": 1.0, "tail": 0.0}
LIAR = {"kind": "own_path", "swing": [0.0, 0.0], "vehicles": [5], "moves": "as_told"}
EULER = {"kind": "sampled", "move": "euler"}
LIMITS = [
    (5, [7.21472, 5.82423769, 2.46241777, 1.50092661, 1.50000001]),
    (20, [9.90200167, 9.85175277, 9.25299105, 2.63749159, 1.50124188]),
]


@pytest.mark.parametrize(
    ("engine", "tick", "limits"),
    [
        ("exact", *LIMITS[0]),
        pytest.param("exact", *LIMITS[1], marks=pytest.mark.long),
        *[pytest.param(EULER, *each, marks=pytest.mark.long) for each in LIMITS],
    ],
)
def test_limits_with_confidence(engine, tick, limits):
    """Complete network of 4 honest vehicles and a liar at 10, believed until a tick.

    No anchor, then c = 0.9 and γ = 1, 0.3, 0.1, 0.05 (Ballotta and Yemini, arXiv 2404.07838).
    """
    anchors = [None, *({"scale": 0.9, "rate": rate} for rate in (1.0, 0.3, 0.1, 0.05))]
    for anchor, limit in zip(anchors, limits, strict=True):
        defence = BelievedUntil(tick=tick, anchor=anchor)
        keys = {**FIVE, "attack": LIAR, "defence": defence, "engine": engine, "horizon": 500.0}
        states = systems.outcome(1, **keys).series["state"]
        np.testing.assert_allclose(states[0, -1, :4, 0], limit, rtol=0, atol=6e-9)


def test_nobody_moves_before_the_wait():
    """To the last bit, under a liar that all believe; then all move."""
    keys = {**FIVE, "attack": LIAR, "engine": "exact", "horizon": 10.0}
    states = systems.outcome(1, **keys, defence={"kind": "trust", "wait": 6.0}).series["state"][0]
    assert (states[:7] == states[0]).all()
    assert (np.abs(states[7, :4] - states[0, :4]) > 0.1).any(axis=-1).all()


def test_an_anchor_leaves_the_weights_of_sources():
    """While all wait at 0, 1, 2, 3 and 10, they are 4, 2.75, 1.5, 0.25, 8.5 m from the others."""
    keys = {**FIVE, "attack": LIAR, "engine": "exact", "horizon": 4.0}
    outcome = systems.outcome(1, **keys, defence={"kind": "trust", "wait": 6.0})
    np.testing.assert_allclose(outcome.series["disagreement"][0], 3.4, rtol=1e-12)
    np.testing.assert_allclose(outcome.series["kept"].sum(axis=-1), 1.0, rtol=1e-12)


SPEED = 0.5  # [m/s] of double integrators at the start


class Hashed(Trust):
    """Observations by a hash of the tick, the listener and the source, in place of random ones."""

    def random(self, time, purpose, distribution, shape):
        """Numbers from 0 to 1, by slot: the numbers of sources differ by listener."""
        slots = jnp.arange(float(shape[0]))[:, None, None]
        listeners = jnp.arange(float(shape[1]))[None, :, None]
        return hashed(jnp.round(time / 0.25)[None, None], listeners, slots)


def hashed(tick, listener, slot):
    """A number from 0 to 1."""
    return ((7 * tick + 5 * listener + 11 * slot + 3 * tick * slot * listener) % 23 + 0.5) / 23


def plain_program(case):
    """Positions at ticks by matrix exponentials, or by held derivatives, from the keys alone."""
    m, h, gain, edges = case["m"], 0.25, np.array(case["gain"]), case["edges"]
    r, weights, own = len(gain), np.zeros((m, m)), np.zeros(m)
    for i, j, w in edges:
        weights[i - 1, j - 1] += w * (i != j)
        own[i - 1] += w * (i == j)
    lies = np.isin(np.arange(m), case["liars"])
    trust, x = np.zeros((m, m)), np.zeros((r, m))
    x[0] = case["starts"]
    if r == 2:
        x[1] = SPEED
    starts, paths = x[0].copy(), [x[0].copy()]
    told = np.where(lies, starts, 0.0)
    for tick in range(case["ticks"]):
        retained = np.zeros((m, m))
        for i in range(m):
            heard = np.flatnonzero(weights[i])
            for slot, j in enumerate(heard):
                u = hashed(tick, i, slot)
                trust[i, j] += alpha(case["observed"][int(lies[j])], 1 - u if lies[j] else u) - 0.5
            kept = [j for j in heard if trust[i, j] >= -1e-9]
            kept = kept or [j for j in heard if trust[i, j] == trust[i, heard].max()]
            retained[i, kept] = weights[i, kept] / (weights[i, kept].sum() + own[i])
        share = 1.0 if tick * h < case["wait"] else case["scale"] * np.exp(-case["rate"] * tick * h)
        pull = (1 - share) * (retained - np.diag(retained.sum(axis=1))) - share * np.eye(m)
        known = share * gain[0] * starts + (1 - share) * gain[0] * retained @ told
        heard_of = np.where(lies[None] & ~np.eye(m, dtype=bool), 0.0, pull)
        blocks = np.hstack([k * heard_of for k in gain])
        if case["hold"]:
            q = blocks @ x.ravel() + known
            powers = [h**n / np.prod(np.arange(1, n + 1)) for n in range(r + 1)]
            x = np.stack(
                [
                    sum(powers[n - k] * x[n] for n in range(k, r)) + powers[r - k] * q
                    for k in range(r)
                ]
            )
        else:
            flow = np.zeros((r * m + 1, r * m + 1))
            flow[: (r - 1) * m, m : r * m] = np.eye((r - 1) * m)
            flow[(r - 1) * m : r * m] = np.hstack([blocks, known[:, None]])
            x = (expm(flow * h) @ np.append(x.ravel(), 1.0))[:-1].reshape(r, m)
        paths.append(np.where(lies, starts, x[0]))
    return np.array(paths)


def alpha(observed, u):
    """An observation from a uniform number."""
    if isinstance(observed, float):
        return float(u < observed)
    if "uniform" in observed:
        low, high = observed["uniform"]
        return low + (high - low) * u
    return observed["choice"][int(u * len(observed["choice"]))]


def drawn_case(seed):
    """Keys of a random fleet."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(4, 8))
    edges = [
        [i, j, round(float(rng.uniform(0.5, 2)), 3)]
        for i in range(1, m + 1)
        for j in range(1, m + 1)
        if i == j or rng.random() < 0.7 or j == i % m + 1
    ]
    observed = [
        [0.7, 0.4],
        [{"uniform": [0.35, 0.75]}, {"uniform": [0.2, 0.7]}],
        [{"choice": [0.1, 0.9, 0.9]}, {"choice": [0.9, 0.1, 0.2]}],
    ][seed % 3]
    return {
        "m": m,
        "edges": edges,
        "liars": rng.choice(m, 1 + seed % 2, replace=False).tolist(),
        "starts": np.round(rng.uniform(-9, 9, m), 3),
        "observed": observed,
        "gain": [[0.8], [1.0, 1.5], [1.0, 3.0, 3.0]][seed % 3],
        "hold": seed % 4 < 2,
        "wait": float(rng.choice([0.0, 0.5, 1.25])),
        "scale": round(float(rng.uniform(0, 1)), 3),
        "rate": round(float(rng.uniform(0, 1)), 3),
        "ticks": 16,
    }


class Triple(Integrators):
    """An agent of order 3 that starts at rest."""

    order = 3
    states = ("x", "y", "u", "v", "a", "b")
    units = ("m", "m", "m/s", "m/s", "m/s²", "m/s²")

    def start(self, position, heading, speed):
        """At rest."""
        return jnp.concatenate([position, jnp.zeros((4, *position.shape[1:]))])

    def pace(self, state, inputs):
        """Speed, and no turn rate."""
        return jnp.hypot(state[2], state[3]), 0.0 * state[0]


ENGINES = [
    ("exact", 1e-9),
    ({"kind": "sampled"}, 1e-9),
    ({"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-12}, 1e-7),
    ({"kind": "nonlinear", "solver": "dopri5", "rtol": 1e-10, "atol": 1e-12}, 1e-7),
    ({"kind": "stacked", "rtol": 1e-10, "atol": 1e-12}, 1e-7),
]


def simulated(case, engine):
    """Positions at ticks of the package."""
    vehicle = ["single_integrator", "double_integrator", Triple()][len(case["gain"]) - 1]
    honest, liar = case["observed"]
    given: Any = {"anchor": {"scale": case["scale"], "rate": case["rate"]}, "trusted": "none"}
    given |= {"observation": "random", "observed": {"honest": honest, "liar": liar}}
    keys = {
        "vehicles": case["m"],
        "topology": {"kind": "edges", "edges": case["edges"]},
        "navigator": "none",
        "vehicle": vehicle,
        "law": {"kind": "local", "hold": case["hold"]},
        "gain": case["gain"],
        "initial": {"position": case["starts"].tolist(), "heading": 0.0, "speed": SPEED},
        "attack": {**LIAR, "vehicles": [one + 1 for one in case["liars"]]},
        "defence": Hashed(wait=case["wait"], **given),
        "engine": engine,
        **systems.clock(0.25, 0.25 * case["ticks"]),
    }
    outcome = systems.outcome(1, **keys)
    assert outcome.status.tolist() == [0]
    return outcome.series["state"][0, :, :, 0]


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(s, marks=pytest.mark.long) for s in (0, 2, 3, 4, 5))]
)
def test_it_moves_as_a_plain_program(seed):
    """Drawn fleets of orders 1 to 3, with drawn observations, liars, waits and anchors."""
    case = drawn_case(seed)
    np.testing.assert_allclose(simulated(case, "exact"), plain_program(case), rtol=0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(("engine", "accuracy"), ENGINES[1:], ids=str)
@pytest.mark.parametrize("seed", [1, 2])
def test_other_engines_move_so_too(seed, engine, accuracy):
    """Orders 2 and 3; the sampled engine knows held derivatives alone, the stacked one none."""
    case = drawn_case(seed)
    case["hold"] = {"sampled": True, "stacked": False}.get(engine["kind"], case["hold"])
    found = simulated(case, engine)
    np.testing.assert_allclose(found, plain_program(case), rtol=0, atol=accuracy)


def test_it_holds_while_messages_are_late():
    """Messages of three ticks ago, by a plain recursion; nobody hears any before."""
    keys = {**FIVE, "attack": "none", "engine": "exact", "horizon": 12.0, "channel": {"delay": 3.0}}
    anchor = {"scale": 0.7, "rate": 0.2}
    defence = {"kind": "trust", "observation": "random", "accuracy": 1.0, "anchor": anchor}
    states = systems.outcome(1, **keys, defence=defence).series
    x = [np.array(FIVE["initial"]["position"])]
    for tick in range(12):
        share, mean = 0.7 * np.exp(-0.2 * tick), x[-1]
        if tick >= 3:
            mean = (x[-1] - x[-4] + x[-4].sum()) / 5
        x.append(share * x[0] + (1 - share) * mean)
    np.testing.assert_allclose(states["state"][0, ..., 0], x, rtol=0, atol=1e-12)


@pytest.mark.long
def test_engines_agree_on_losses_and_late_messages():
    """Order 2 at every instant, with a navigator: exact and stacked, to 1e-6 m."""
    keys = {
        "vehicles": 5,
        "topology": {"kind": "complete", "own_weight": 0.5},
        "vehicle": "double_integrator",
        "gain": [1.0, 2.0],
        "law": {"kind": "local", "hold": False},
        "attack": {"kind": "rotating", "vehicles": [2]},
        "defence": {"kind": "trust", "wait": 0.5, "anchor": {"scale": 0.8, "rate": 0.3}},
        "channel": {"delay": 0.1, "loss": {"kind": "bernoulli", "probability": 0.3}},
        **systems.clock(0.1, 3.0, 1.0),
    }
    exact, stacked = (
        systems.outcome(2, engine=engine, **keys).series["state"]
        for engine in ("exact", ENGINES[-1][0])
    )
    np.testing.assert_allclose(stacked, exact, rtol=0, atol=1e-6)
    assert (np.abs(exact[:, 10] - exact[:, 4]) > 0.1).any()
