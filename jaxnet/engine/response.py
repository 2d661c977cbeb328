"""The attacks' effect on a fleet: vectors `L⁻¹ d`, solved again where weights or attacks change."""

from typing import Any

import jax
import jax.numpy as jnp

from jaxnet.engine import tick
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.subset import LaneIndices, for_each, picked, put
from jaxnet.engine.tick import DecisionState, LaneFlags, VehicleFlags
from jaxnet.model.hearing import AxisWeights
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
    vehicles, the solver may update the response near them. Defences that weigh, and attackers that choose
    vectors, change more rows at every tick.
    """
    if plan.decides and decided.decision.dtype == bool and not plan.strategic:
        decision = decided.decision.reshape(-1, *lane.weights.shape)
        system = System(network.hearing, lane.weights, decision, lane.vectors)
        response, flagged = network.solver.update(system, response, flagged, changed)

    def some(few: LaneIndices, carry: tuple[Vectors, LaneFlags]) -> tuple[Vectors, LaneFlags]:
        response, cut_off = carry
        part, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (lane, decided))
        weights, vectors = tick.drive(part, chosen, plan)
        new, residual = response_vectors(vectors, weights, network)
        return put(response, few, new), put(cut_off, few, ~(residual < CONNECTED))

    return for_each(flagged, solved_at_once(lane.initial.shape[1]), some, (response, cut_off))


def response_vectors(vectors: Vectors, weights: AxisWeights, network: Network) -> tuple[Vectors, Any]:
    """Return the vectors `L⁻¹ d` of the attacks' effect, and the distance of `L⁻¹ a0` from 1."""
    axes, m, functions = len(weights), weights.shape[2], vectors.shape[2]
    each = [network.hearing.mean_added(weights, vectors[:, :, b]) for b in range(functions)]
    attack = jnp.stack(each)  # (B, 2, m, few)
    right = attack.reshape(-1, axes, m, attack.shape[-1]).transpose(2, 0, 1, 3)
    solution, residual = network.solver.solve(network.hearing, weights, right)
    response = solution.transpose(1, 2, 0, 3).reshape(attack.shape)
    return response.transpose(1, 2, 0, 3), residual
