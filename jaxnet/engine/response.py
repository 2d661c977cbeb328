"""The attacks' effect on a fleet: vectors `L⁻¹ d`, solved again where weights or attacks change."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine import tick
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.subset import LaneIndices, Stretch, for_each, for_stretches, picked, put
from jaxnet.engine.tick import DecisionState, Drive, LaneFlags, PerAxis, VehicleFlags
from jaxnet.model.lane import Lane, Network
from jaxnet.model.signal import ByFunction
from jaxnet.solvers.choice import solved_at_once, solved_in_a_row
from jaxnet.solvers.solver import System


def solve_response(
    response: ByFunction,
    cut_off: LaneFlags,
    flagged: LaneFlags,
    changed: VehicleFlags,
    decided: DecisionState,
    lane: Lane,
    network: Network,
    plan: Plan,
) -> tuple[ByFunction, LaneFlags]:
    """Return the response, solved again in flagged lanes, and the lanes with a vehicle cut off.

    `changed` are the vehicles whose retained sources changed. Where a tick changes only the rows of these
    vehicles, the solver may update the response near them. Defences that weigh, attackers that choose
    vectors, sensors with errors and lost messages change more rows at every tick, and so does a change of the
    attacked vehicles. A channel with errors, losses or delays changes nearly all lanes at every tick.
    """
    decision = decided.decision
    changing = decided.vectors, decided.noise, decided.coasting, decided.link_noise
    rows_change = any(each is not None for each in changing)
    if decision is not None and decision.dtype == bool and not rows_change:
        decision = decision.reshape(-1, *lane.weights.shape)
        system = System(network.hearing, lane.weights, decision, lane.vectors)
        response, flagged = network.solver.update(system, response, flagged, changed)

    if decided.late is not None:
        return late_response(decided), tick.disconnected(lane, network, decided, plan) & flagged

    def some(
        few: LaneIndices | Stretch, carry: tuple[ByFunction, LaneFlags]
    ) -> tuple[ByFunction, LaneFlags]:
        response, cut_off = carry
        part, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (lane, decided))
        drive = tick.drive(part, chosen, plan)
        new, residual = response_vectors(drive, network)
        if drive.known is None:
            cut = ~(residual < CONNECTED)
        else:
            cut = tick.disconnected(part, network, chosen, plan)
        return put(response, few, new), put(cut_off, few, cut)

    vehicles, carry = lane.initial.shape[1], (response, cut_off)
    if decided.reception is not None or decided.link_noise is not None:
        return for_stretches(flagged, solved_in_a_row(vehicles), some, carry)
    return for_each(flagged, solved_at_once(vehicles), some, carry)


def response_vectors(drive: Drive, network: Network) -> tuple[ByFunction, Any]:
    """Return the vectors `L⁻¹ d` of the attacks' effect, and the distance of `L⁻¹ a0` from 1.

    Where vehicles sense with errors or words are known before, the vectors of the navigator's path and of
    powers of time follow: `L_r x = z - share R(y_0)`, as x is relative to R(y_0).
    """
    weights, vectors, known = drive.weights, drive.vectors, drive.known
    functions, share = vectors.shape[2], None if known is None else known.share
    attack = [network.hearing.mean_added(weights, vectors[:, :, b]) for b in range(functions)]
    if known is not None:
        attack += list(jnp.moveaxis(known.drive, 1, 0))
    each = jnp.stack(attack)  # (B, 2, m, few)
    right = each.reshape(-1, len(weights), *each.shape[2:])  # (columns, axes, m, few)
    if share is not None:
        right = jnp.concatenate([right, -share[None]])
    solution, residual = network.solver.solve(network.hearing, weights, jnp.moveaxis(right, 2, 0))
    right = solution.transpose(1, 2, 0, 3)
    response = right[: 2 * len(each) // len(weights)].reshape(each.shape)
    if share is not None:
        path = jnp.stack(of_navigator(right[-1]))
        response = jnp.concatenate([response[:functions], path, response[functions:]])
    elif known is None and drive.noise is not None:
        response = jnp.concatenate([response, jnp.zeros_like(response[:1])])
    return response, residual


def late_response(decided: DecisionState) -> ByFunction:
    """Return the vectors of powers of time where all words are late and L is 1."""
    known, history = decided.known, decided.late
    assert known is not None
    assert known.share is not None
    assert history is not None
    assert history.leading is not None
    return jnp.moveaxis(known.drive, 1, 0) - known.share[None] * history.leading[:, :, None]


def of_navigator(share: Float[Array, "axes m lanes"]) -> tuple[PerAxis, PerAxis]:
    """Return the vectors of both components of R(y_0)."""
    nothing = jnp.zeros_like(share[0])
    return jnp.stack([share[0], nothing]), jnp.stack([nothing, share[-1]])
