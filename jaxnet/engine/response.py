"""The attacks' effect on a fleet: vectors `L⁻¹ d`, solved again where weights or attacks change."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine import tick
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.subset import LaneIndices, for_each, picked, put
from jaxnet.engine.tick import DecisionState, Drive, LaneFlags, VehicleFlags
from jaxnet.model.lane import Lane, Network
from jaxnet.model.signal import Vectors
from jaxnet.solvers.choice import solved_at_once
from jaxnet.solvers.solver import System


def solve_response(
    response: Vectors,
    cut_off: LaneFlags,
    flagged: LaneFlags,
    changed: VehicleFlags,
    decided: DecisionState,
    lane: Lane,
    network: Network,
    plan: Plan,
) -> tuple[Vectors, LaneFlags]:
    """Return the response, solved again in flagged lanes, and the lanes with a vehicle cut off.

    `changed` are the vehicles whose retained sources changed. Where a tick changes only the rows of these
    vehicles, the solver may update the response near them. Defences that weigh, attackers that choose
    vectors, sensors with errors and lost messages change more rows at every tick, and so does a change of the
    attacked vehicles.
    """
    decision = decided.decision
    changing = decided.vectors, decided.noise, decided.coasting, decided.link_noise
    rows_change = any(each is not None for each in changing)
    if decision is not None and decision.dtype == bool and not rows_change:
        decision = decision.reshape(-1, *lane.weights.shape)
        system = System(network.hearing, lane.weights, decision, lane.vectors)
        response, flagged = network.solver.update(system, response, flagged, changed)

    def some(few: LaneIndices, carry: tuple[Vectors, LaneFlags]) -> tuple[Vectors, LaneFlags]:
        response, cut_off = carry
        part, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (lane, decided))
        drive = tick.drive(part, chosen, plan)
        new, residual = response_vectors(drive, network, late=lane.delay is not None)
        if drive.known is None:
            cut = ~(residual < CONNECTED)
        else:
            cut = tick.disconnected(part, network, chosen, plan)
        return put(response, few, new), put(cut_off, few, cut)

    return for_each(flagged, solved_at_once(lane.initial.shape[1]), some, (response, cut_off))


def response_vectors(drive: Drive, network: Network, late: bool) -> tuple[Vectors, Any]:
    """Return the vectors `L⁻¹ d` of the attacks' effect, and the distance of `L⁻¹ a0` from 1.

    Where words are `late`, none is live: L is the identity, and the distance is None. Where vehicles sense
    with errors or words are known before, the vectors of further functions follow (`signal.WithNavigator`,
    `signal.WithPowers`).
    """
    weights, vectors = drive.weights, drive.vectors
    axes, m, functions = len(weights), weights.shape[2], vectors.shape[2]
    each = [network.hearing.mean_added(weights, vectors[:, :, b]) for b in range(functions)]
    attack = jnp.stack([*each, *kept_columns(drive)])  # (B, 2, m, few)
    if late:
        return attack.transpose(1, 2, 0, 3), None
    right = attack.reshape(-1, axes, m, attack.shape[-1]).transpose(2, 0, 1, 3)
    solution, residual = network.solver.solve(network.hearing, weights, right)
    response = solution.transpose(1, 2, 0, 3).reshape(attack.shape)
    return response.transpose(1, 2, 0, 3), residual


def kept_columns(drive: Drive) -> list[Float[Array, "2 m few"]]:
    """Return the right-hand sides of known words: `L_r x = z - share R(y_0)`, as x is relative to R(y_0)."""
    if drive.known is None:
        nothing = jnp.zeros((2, *drive.weights.shape[2:]))
        return [] if drive.noise is None else [nothing] * 3
    share, nothing = -drive.known.share, jnp.zeros_like(drive.known.share[0])
    constant, *powers = jnp.moveaxis(drive.known.drive, 1, 0)
    return [constant, jnp.stack([share[0], nothing]), jnp.stack([nothing, share[-1]]), *powers]
