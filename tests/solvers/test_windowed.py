"""Fleets solved for near those who decided otherwise, against NumPy's solution and as one block."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.engine import batch
from jaxnet.model import hearing
from jaxnet.solvers import choice, windowed
from jaxnet.solvers.blocks import Blocks
from jaxnet.solvers.dense import Dense
from jaxnet.solvers.iterative import Iterative
from jaxnet.solvers.solver import System
from jaxnet.solvers.windowed import Windowed
from tests import systems

VEHICLES = 601
ATTACK = {"kind": "rotating", "sybils": 2}
TOPOLOGIES = {  # blocks of a window, share of links with the navigator's word, lanes left
    "ring": ({"kind": "cyclic", "navigator_weight": 0.5}, 41, 0.3, []),
    "lattice": ({"kind": "lattice", "neighbours": 4, "navigator_weight": 0.6}, 33, 0.3, []),
    "hardly heard": ({"kind": "cyclic", "navigator_weight": 0.01}, 33, 0.0, [0, 1]),
}


def known(lane, network, decision):
    """`L⁻¹ d` (2, m, B, lanes) by matrices, for who is retained (axes, slots, m, lanes)."""
    weights = np.where(decision, np.asarray(lane.weights), 0.0)
    weights = np.broadcast_to(
        weights / weights.sum(axis=1, keepdims=True), (2, *lane.weights.shape)
    )
    heard, vectors = jax.tree.map(np.asarray, (network.hearing, lane.vectors))
    found = np.zeros((2, VEHICLES, lane.vectors.shape[2], weights.shape[-1]))
    for axis, number in np.ndindex(2, weights.shape[-1]):
        laplacian, right = np.eye(VEHICLES), np.zeros((VEHICLES, found.shape[2]))
        weight = weights[axis, ..., number]
        slots, listeners = np.nonzero(heard.carried_sources > 0)
        carried = heard.carried_sources[slots, listeners] - 1
        np.subtract.at(laplacian, (listeners, carried), weight[slots, listeners])
        slots, listeners = np.nonzero(heard.attacked)
        told = vectors[axis, heard.signals[slots, listeners], :, number]
        np.add.at(right, listeners, weight[slots, listeners, None] * told)
        found[axis, ..., number] = np.linalg.solve(laplacian, right)
    return found


def begun(topology, replaced, lanes):
    """Lanes of a fleet in which all links are attacked at random, its network, and everybody
    retained.

    A share of the links carry the navigator's word instead, and attacked vehicles have identities.
    """
    given = systems.study(vehicles=VEHICLES, topology=topology, engine="exact", attack=ATTACK)
    one = systems.lanes(given, lanes, ())
    lane = jax.tree.map(
        lambda leaf: jnp.asarray(np.moveaxis(np.asarray(leaf), 0, -1)), one.inputs.lane
    )
    network = jax.tree.map(jnp.asarray, one.network)
    rng, carried_sources = np.random.default_rng(0), np.asarray(network.hearing.carried_sources)
    vectors = np.asarray(lane.attack_scale) * rng.uniform(-1, 1, lane.vectors.shape)
    spoken = np.where(rng.random(carried_sources.shape) < replaced, 0, carried_sources)
    sources, _, _, signals = map(np.asarray, network.hearing)
    heard = jax.tree.map(
        jnp.asarray, hearing.Hearing(sources, spoken, carried_sources > 0, signals)
    )
    everybody = np.ones((2, *lane.weights.shape), bool)
    return lane._replace(vectors=jnp.asarray(vectors)), network._replace(hearing=heard), everybody


@pytest.mark.long
@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_who_decides_otherwise_is_solved_for_near_by(topology, axes, monkeypatch):
    """To 1e-12 of the attack, also where a window ends beside others who did, and over several
    windows.

    Left are lanes with too many of them, or where somebody dropped the navigator; ended ones are
    not touched.
    """
    keys, window, replaced, beyond = TOPOLOGIES[topology]
    monkeypatch.setattr(windowed, "WINDOW", window)
    monkeypatch.setattr(choice, "LEAST_WINDOWED", 2 * window)
    lane, network, before = begun(keys, replaced, 5)
    vehicles, after = np.asarray(network.solver.vehicles), before[:axes].copy()
    middle, edge = vehicles[40, 0], vehicles[40 + window // 2, 0]
    for number, those in enumerate(
        [[middle], [middle, edge, 1], [middle], range(VEHICLES), [middle]]
    ):
        after[-1, 2, those, number] = False
    after[0, 0, middle, 2] = False
    changed = (after != before[:axes]).any(axis=(0, 1))
    system = System(network.hearing, lane.weights, jnp.asarray(after), lane.vectors)
    start, flagged = np.moveaxis(known(lane, network, before), 2, 0), jnp.arange(5) < 4
    update = jax.jit(lambda solver, *given: solver.update(*given))
    found, left = update(network.solver, system, jnp.asarray(start), flagged, jnp.asarray(changed))
    np.testing.assert_array_equal(np.nonzero(left)[0], [*beyond, 2, 3])
    np.testing.assert_array_equal(np.asarray(found)[..., 2:], start[..., 2:])
    exact, within = np.moveaxis(known(lane, network, after), 2, 0), slice(len(beyond), 2)
    assert (np.abs(exact - start)[..., :2].max(axis=(0, 1, 2)) > 0.01 * lane.attack_scale[:2]).all()
    np.testing.assert_allclose(
        found[..., within], exact[..., within], rtol=0, atol=1e-12 * lane.attack_scale.max()
    )


LOSSES = {"loss": {"kind": "bernoulli", "probability": 0.5}}
SOLVERS = {  # what is patched so that this one is chosen
    Dense: (choice, "ONE_BLOCK", 150),
    Windowed: (choice, "LEAST_WINDOWED", 2 * windowed.WINDOW),
    Iterative: (choice, "LARGEST_BLOCK", 1),
    Blocks: (choice, "LARGEST_BLOCK", 96),
}


@pytest.mark.long
def test_lanes_with_errors_and_losses_go_as_with_one_dense_matrix():
    """All rows change at every tick, and some vehicles hear nobody."""
    keys = {"topology": "cyclic", "vehicles": 150, "horizon": 0.5, "tail": 0.5}
    keys |= {"attack": "rotating", "sensing": {"position": 0.1}, "channel": LOSSES}
    study, found = systems.study(engine="exact", **keys), []
    for solver, limit in SOLVERS.items():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(*limit)
            lanes = systems.lanes(study, 2, ("state",))
        assert type(lanes.network.solver) is solver
        found.append(batch.simulate(lanes, systems.FEW))
    dense, *others = found
    assert (dense.unheard > 0).all()
    for ours in others:
        for name in ("status", "switches", "unheard"):
            assert getattr(ours, name).tolist() == getattr(dense, name).tolist()
        np.testing.assert_allclose(ours.series["state"], dense.series["state"], rtol=0, atol=1e-9)


@pytest.mark.usefixtures("traced_anew")
def test_a_fleet_solved_for_near_by_goes_as_one_block_does(monkeypatch):
    """To 1e-9 m, through decisions; a lane is the same to the last bit beside others and alone."""
    monkeypatch.setattr(choice, "LEAST_WINDOWED", 2 * windowed.WINDOW)
    monkeypatch.setattr(windowed, "WINDOWS_TOGETHER", windowed.SIDE_BY_SIDE)
    keys = {"horizon": 3.0, "tail": 1.0, "vehicles": 300, "attack": "rotating"}
    given = systems.study(engine="exact", **keys)
    small = systems.lanes(given, 3, ("state",))
    monkeypatch.setattr(choice, "ONE_BLOCK", 300)
    dense = systems.lanes(given, 3, ("state",))
    assert isinstance(small.network.solver, Windowed)
    assert isinstance(dense.network.solver, Dense)
    ours, theirs = (batch.simulate(one, systems.FEW) for one in (small, dense))
    assert (ours.status == 0).all()
    assert (ours.switches > 30).all()
    np.testing.assert_array_equal(ours.switches, theirs.switches)
    np.testing.assert_allclose(ours.series["state"], theirs.series["state"], rtol=0, atol=1e-9)
    alone = batch.simulate(small._replace(inputs=batch.part(small.inputs, 2, 3)), systems.FEW)
    np.testing.assert_array_equal(alone.series["state"], ours.series["state"][2:])
