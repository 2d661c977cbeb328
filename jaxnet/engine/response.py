"""The attacks' effect on a fleet: vectors `L⁻¹ d`, solved again where weights or attacks change."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import LaneFlags, VehicleFlags
from jaxnet.engine.plan import CONNECTED
from jaxnet.engine.stages.known import KnownDrive
from jaxnet.engine.stages.late import Late
from jaxnet.engine.subset import LaneIndices, Stretch, for_each, for_stretches, picked, put
from jaxnet.engine.tick import DecisionState, Drive
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
) -> tuple[ByFunction, LaneFlags]:
    """The response, solved again in flagged lanes, and the lanes with a vehicle cut off.

    `changed` are the vehicles whose retained sources changed. Where a tick changes only the rows of
    these vehicles, the solver may update the response near them. Defences that weigh, attackers
    that choose vectors, sensors with errors and lost messages change more rows at every tick, and
    so does a change of the attacked vehicles. A channel with errors, losses or delays changes
    nearly all lanes at every tick.
    """
    if isinstance(decided.late, Late):  # no message is live, and L is 1
        known = decided.late.known
        response = known.drive.terms - known.share[None] * decided.late.leading[:, :, None]
        return response, decided.disconnected(lane, network) & flagged
    decision = decided.judged.single(lane)
    steady = not decided.instead and not decided.sensed.errs and not decided.links.present
    if decision is not None and steady and not (decided.heard.lossy or decided.coasting.drives):
        system = System(network.hearing, lane.weights, decision, lane.vectors)
        response, flagged = network.solver.update(system, response, flagged, changed)

    def some(
        few: LaneIndices | Stretch, carry: tuple[ByFunction, LaneFlags]
    ) -> tuple[ByFunction, LaneFlags]:
        response, cut_off = carry
        part, chosen = jax.tree.map(lambda leaf: picked(leaf, few), (lane, decided))
        drive = chosen.drive(part)
        new, residual = response_vectors(drive, network)
        cut = ~(residual < CONNECTED)
        if isinstance(drive.known, KnownDrive):
            cut = chosen.disconnected(part, network)
        return put(response, few, new), put(cut_off, few, cut)

    vehicles, carry = lane.initial.shape[1], (response, cut_off)
    if decided.heard.lossy or decided.links.present:
        return for_stretches(flagged, solved_in_a_row(vehicles), some, carry)
    return for_each(flagged, solved_at_once(vehicles), some, carry)


def response_vectors(drive: Drive, network: Network) -> tuple[ByFunction, Float[Array, " lanes"]]:
    """The vectors `L⁻¹ d` of the attacks' effect, and the distance of `L⁻¹ a0` from 1.

    Where vehicles sense with errors or messages are known before, the vectors of the navigator's
    path and of powers of time follow: `L_r x = z - share R(y_0)`, as x is relative to R(y_0).
    """
    weights, vectors, known = drive.weights, drive.vectors, drive.known
    functions, axes = vectors.shape[2], len(weights)
    attack = [network.hearing.mean_added(weights, vectors[:, :, b]) for b in range(functions)]
    each = jnp.stack(known.columns(attack))  # (B, 2, m, few)
    right = each.reshape(-1, axes, *each.shape[2:])  # (columns, axes, m, few)
    if drive.coasting.drives:
        right = jnp.concatenate([right, -known.row_share(weights)[None]])
    solution, residual = network.solver.solve(network.hearing, weights, jnp.moveaxis(right, 2, 0))
    right = solution.transpose(1, 2, 0, 3)
    response = right[: 2 * len(each) // axes].reshape(each.shape)
    if drive.coasting.drives:
        share, nothing = right[-1], jnp.zeros_like(right[-1][0])  # of R(y_0), by component
        path = jnp.stack([jnp.stack([share[0], nothing]), jnp.stack([nothing, share[-1]])])
        response = jnp.concatenate([response[:functions], path, response[functions:]])
    elif not isinstance(known, KnownDrive) and drive.sensed.errs:
        response = jnp.concatenate([response, jnp.zeros_like(response[:1])])
    return response, residual
