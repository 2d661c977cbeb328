"""What the attacks do to a fleet, the vectors `L⁻¹ d`, where weights or attacks have changed.

They are solved for in the lanes concerned alone; in large fleets of which few vehicles have decided
otherwise, near these alone.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxnet.engine import tick
from jaxnet.engine.plan import CONNECTED, Plan
from jaxnet.engine.subset import Few as LaneIndices
from jaxnet.engine.subset import for_each, numbered, picked, put
from jaxnet.engine.tick import DecisionState
from jaxnet.model import elimination, near
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.near import System
from jaxnet.model.signal import Vectors

SOLVED, SOLVED_OF_LARGE = 16, 4  # lanes whose Laplacians are solved at once
LARGE = 128  # vehicles; from there on lanes that need it not cost more than another pass does
WINDOWS = 16  # windows that are solved for at once
ACCURACY = 1e-13  # of a response near somebody, relative to the greatest of the attacks' vectors

Lanes = Bool[Array, "lanes"]
Changed = Bool[Array, "m lanes"]  # vehicles that decided otherwise


def solved(
    response: Vectors,
    cut_off: Lanes,
    flagged: Lanes,
    decided: DecisionState,
    lane: Lane,
    network: Network,
    plan: Plan,
) -> tuple[Vectors, Lanes]:
    """Return the response, solved for again in flagged lanes, and the lanes with a vehicle cut off."""

    def some(few: LaneIndices, carry: tuple[Vectors, Lanes]) -> tuple[Vectors, Lanes]:
        response, cut_off = carry
        part, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (lane, decided))
        weights, vectors = tick.drive(part, chosen, plan)
        new, residual = forced(vectors, weights, network)
        return put(response, few, new), put(cut_off, few, ~(residual < CONNECTED))

    at_once = SOLVED if lane.initial.shape[1] < LARGE else SOLVED_OF_LARGE
    return for_each(flagged, at_once, some, (response, cut_off))


def forced(vectors: Vectors, weights: AxisWeights, network: Network) -> tuple[Vectors, Any]:
    """Vectors `L⁻¹ d` of what the attacks do to the fleet, and how far `L⁻¹ a0` is from 1."""
    axes, m, functions = len(weights), weights.shape[2], vectors.shape[2]
    each = [network.hearing.mean_added(weights, vectors[:, :, b]) for b in range(functions)]
    attack = jnp.stack(each)  # (B, 2, m, few)
    right = attack.reshape(-1, axes, m, attack.shape[-1]).transpose(2, 0, 1, 3)
    solution, residual = elimination.solve(network.order, network.hearing, weights, right)
    response = solution.transpose(1, 2, 0, 3).reshape(attack.shape)
    return response.transpose(1, 2, 0, 3), residual


def local(decided: DecisionState, network: Network, plan: Plan) -> bool:
    """Whether at a tick only rows of vehicles change that retain others, in a fleet with room for windows.

    Rules that weigh, and attackers that plan, change more rows at every tick.
    """
    retaining = plan.decides and decided.decision.dtype == bool
    return retaining and not plan.strategic and near.windows(network.order) > 0


def solved_near(
    response: Vectors, flagged: Lanes, changed: Changed, decided: DecisionState, lane: Lane, network: Network
) -> tuple[Vectors, Lanes]:
    """The response of flagged lanes near who has changed, and which of them are left.

    A lane's windows do not depend on other lanes. Left are those in which too many have, or somebody does not
    hear the navigator, or what one has decided reaches too far.
    """
    order, decision = network.order, decided.decision.reshape(-1, *lane.weights.shape)
    system = System(network.hearing, lane.weights, decision, lane.vectors)
    most = near.windows(order)
    dominance = near.dominance(system)
    allowed = ACCURACY * jnp.abs(lane.vectors).max(axis=(0, 1, 2)) * dominance
    blocks = changed.at[order.vehicles].get(mode="fill", fill_value=False).any(axis=1)
    suited = flagged & (dominance > 0) & (blocks.sum(axis=0) <= most)

    def going(carry: Any) -> Lanes:
        blocks, windows, _ = carry
        return blocks.any(axis=0) & (windows < most)

    def some(carry: Any) -> Any:
        blocks, windows, response = carry
        starts, needed = near.starts(order, blocks)
        up_to = jnp.cumsum(jnp.where(going(carry), needed.sum(axis=0), 0))
        taken = needed & (going(carry) & (up_to <= WINDOWS))[None]  # all of a lane's or none
        number = numbered(jnp.cumsum(taken), 0, WINDOWS)
        lanes = jnp.where(number < taken.size, number % flagged.size, flagged.size)
        theirs = picked(starts.ravel(), number)
        response, at_edges = near.corrected(order, system, response, lanes, theirs)
        blocks = near.done(blocks, lanes, theirs, at_edges > picked(allowed, lanes)[None])
        return blocks, windows + taken.sum(axis=0), response

    carry = blocks & suited[None], jnp.zeros(flagged.shape, int), response
    blocks, _, response = jax.lax.while_loop(lambda carry: going(carry).any(), some, carry)
    return response, flagged & (~suited | blocks.any(axis=0))
