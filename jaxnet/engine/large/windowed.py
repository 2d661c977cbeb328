"""Local update of the solution of `L x = b`, in windows around the rows that have changed.

x solved the system before the change, so `b - L x` is nearly 0 outside the changed rows. Where every vehicle
hears the navigator, L is strictly diagonally dominant. The effect of a row then decays geometrically with
distance. So x is corrected in a window of blocks around the row, and stays fixed outside the window. A
residual is left only in the two blocks next to the window. The residual is at most the correction at the
window's edges.

`L 1 = a0`, so the error of x is at most the residual over the least a0.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.plan import Plan
from jaxnet.engine.subset import numbered, picked
from jaxnet.engine.tick import DecisionState, LaneFlags, VehicleFlags
from jaxnet.model import elimination, retained
from jaxnet.model.elimination import NoOrder, Order
from jaxnet.model.hearing import Hearing, SlotWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.signal import Vectors

WINDOWS_TOGETHER = 16  # windows of all lanes that are solved at once
WINDOW_ACCURACY = 1e-13  # error of a response, relative to the attacks' greatest vector component
SIDE_BY_SIDE = 4  # windows of one lane that are corrected at once
LEAST_WINDOWS = 16  # windows of a lane; below so many, a whole solve is as quick
WINDOW = 33  # blocks in a window

WindowNumbers = Int[Array, " few"]


class System(NamedTuple):
    """Hearing, weights, decisions and attack vectors, from which L and b of lanes follow."""

    hearing: Hearing
    weights: SlotWeights
    decision: Bool[Array, "axes slots m lanes"]  # axes: 1 if both share a decision, else 2
    vectors: Vectors  # of the attacks


def window_count(order: Order | NoOrder) -> int:
    """Return the most windows of a lane: as many as cover its blocks once; 0 in a small fleet."""
    number = len(order.vehicles) // WINDOW if isinstance(order, Order) else 0
    return number if number >= LEAST_WINDOWS else 0


def window_starts(
    order: Order, flagged: Bool[Array, "blocks lanes"]
) -> tuple[Int[Array, "windows lanes"], Bool[Array, "windows lanes"]]:
    """Return the first block of each of a lane's windows, and which windows are needed.

    A window has its first flagged block in the middle where possible. At least one block separates two
    windows.
    """
    blocks, free = len(order.vehicles), jnp.zeros(flagged.shape[1:], int)
    numbers, found, needed = jnp.arange(blocks)[:, None], [], []
    for window in range(SIDE_BY_SIDE):
        middle = numbers >= free[None] + (WINDOW // 2 if window else 0)
        first = jnp.where(flagged & middle, numbers, blocks).min(axis=0)
        start = jnp.clip(first - WINDOW // 2, 0, blocks - WINDOW)
        found.append(start)
        needed.append((first < blocks) & (start >= free))
        free = start + WINDOW + 1
    return jnp.stack(found), jnp.stack(needed)


def clear_flags(
    blocks: Bool[Array, "blocks lanes"],
    lanes: WindowNumbers,
    starts: WindowNumbers,
    over: Bool[Array, "2 few"],
) -> Bool[Array, "blocks lanes"]:
    """Return the flags of blocks after windows have been corrected.

    A block within a window loses its flag. A block next to a window is flagged where `over` says that its
    residual is too large. Windows past the last lane are padding.
    """
    there, edges = lanes < blocks.shape[1], jnp.stack([starts - 1, starts + WINDOW])
    over = over & there[None] & (edges >= 0) & (edges < len(blocks))

    def within(number: Any, blocks: Any) -> Any:
        place = starts[number], lanes[number]
        left = jax.lax.dynamic_slice(blocks, place, (WINDOW, 1)) & ~there[number]
        return jax.lax.dynamic_update_slice(blocks, left, place)

    def beside(number: Any, blocks: Any) -> Any:
        for edge in range(2):
            place = edges[edge, number], lanes[number]
            left = jax.lax.dynamic_slice(blocks, place, (1, 1)) | over[edge, number]
            blocks = jax.lax.dynamic_update_slice(blocks, left, place)
        return blocks

    return jax.lax.fori_loop(0, lanes.size, beside, jax.lax.fori_loop(0, lanes.size, within, blocks))


def dominance(system: System) -> Float[Array, " lanes"]:
    """Return a lower bound on the least a0; 0 where a vehicle does not hear or retain the navigator."""
    heard = (system.hearing.sources[0] == 0)[:, None] & system.decision[:, 0].all(axis=0)
    return jnp.where(heard, system.weights[0], 0.0).min(axis=0)


def correct_windows(
    order: Order, system: System, x: Vectors, lanes: WindowNumbers, starts: WindowNumbers
) -> tuple[Vectors, Float[Array, "2 few"]]:
    """Correct the solution in one window of each given lane; `starts` are the windows' first blocks.

    Return the solution, and the greatest correction in the first and in the last block of each window.
    """
    size, functions = order.vehicles.shape[1], x.shape[2]
    vehicles, carried_sources, weights, left = jax.vmap(
        lambda lane, start: left_in_window(order, system, x, lane, start), -1, -1
    )(lanes, starts)
    first = (starts[None] + jnp.arange(WINDOW)[:, None] - 1) * size  # place of the first column
    place = jnp.asarray(order.place)[carried_sources - 1].reshape(len(carried_sources), WINDOW, size, -1)
    columns = jnp.where(
        carried_sources.reshape(place.shape) > 0, place - first[None, :, None], 3 * size
    )  # out of range: dropped
    heard = jnp.moveaxis(weights, 0, 2).reshape(*place.shape[:3], len(weights), -1)
    nothing = jnp.zeros((WINDOW, size, 3 * size, *heard.shape[3:]))
    rows = np.arange(WINDOW)[None, :, None, None], np.arange(size)[None, None, :, None]
    each = jnp.arange(len(lanes))[None, None, None]
    table = nothing.at[(*rows, columns, slice(None), each)].add(heard.swapaxes(3, 4), mode="drop")
    before, own, after = jnp.split(table, 3, axis=2)
    by_axis = left.reshape(WINDOW, size, -1, len(weights), functions, len(lanes)).swapaxes(3, 4)
    right = by_axis.reshape(WINDOW, size, -1, len(weights), len(lanes))
    found = elimination.from_block_to_block(before, elimination.identity(own) - own, after, right)
    at_edges = jnp.abs(found.at[np.array([0, -1])].get()).max(axis=(1, 2, 3))
    added = jnp.moveaxis(found.reshape(by_axis.shape).swapaxes(3, 4).reshape(left.shape), -1, 1)
    return x.at[:, vehicles, :, lanes[None]].add(added, mode="drop"), at_edges


def left_in_window(order: Order, system: System, x: Vectors, lane: Any, start: Any) -> Any:
    """Return the vehicles of one lane's window, their sources, their weights, and `b - L x` in their rows."""
    vehicles = jax.lax.dynamic_slice_in_dim(jnp.asarray(order.vehicles), start, WINDOW).ravel()
    heard = (each.at[:, vehicles].get(mode="clip") for each in system.hearing)
    _, carried_sources, attacked, signals, _ = heard
    weights = system.weights.at[:, vehicles, lane].get(mode="clip")
    weights = retained.in_force(weights, system.decision.at[:, :, vehicles, lane].get(mode="clip"))
    weights = jnp.where(vehicles[None, None] < x.shape[1], weights, 0.0)
    own, sent = (x.at[:, who, :, lane].get(mode="clip") for who in (vehicles, carried_sources - 1))
    false = system.vectors.at[:, signals, :, lane].get(mode="clip")
    told = jnp.where((carried_sources > 0)[..., None, None], sent, 0.0)
    told = told + jnp.where(attacked[..., None, None], false, 0.0)
    left = (jnp.moveaxis(weights, 0, 2)[..., None] * told).sum(axis=0) - own
    return vehicles, carried_sources, weights, jnp.where((vehicles < x.shape[1])[:, None, None], left, 0.0)


def can_update_locally(decided: DecisionState, network: Network, plan: Plan) -> bool:
    """Return whether a tick changes only the rows of vehicles that retain other sources, in a large fleet.

    Defences that weigh, and attackers that choose vectors, change more rows at every tick.
    """
    retaining = plan.decides and decided.decision is not None and decided.decision.dtype == bool
    retaining = retaining and decided.reception is None
    return retaining and not plan.strategic and window_count(network.order) > 0


def solve_locally(
    response: Vectors,
    flagged: LaneFlags,
    changed: VehicleFlags,
    decided: DecisionState,
    lane: Lane,
    network: Network,
) -> tuple[Vectors, LaneFlags]:
    """Return the response, solved near the changed vehicles of flagged lanes, and the flagged lanes left.

    The windows of a lane do not depend on other lanes. A lane is left in three cases: too many of its
    vehicles changed, a vehicle does not hear the navigator, or the effect of a change reaches too far.
    """
    assert decided.decision is not None
    order, decision = network.order, decided.decision.reshape(-1, *lane.weights.shape)
    system = System(network.hearing, lane.weights, decision, lane.vectors)
    most, least = window_count(order), dominance(system)
    allowed = WINDOW_ACCURACY * jnp.abs(lane.vectors).max(axis=(0, 1, 2)) * least
    blocks = changed.at[order.vehicles].get(mode="fill", fill_value=False).any(axis=1)
    suited = flagged & (least > 0) & (blocks.sum(axis=0) <= most)

    def going(carry: Any) -> LaneFlags:
        blocks, windows, _ = carry
        return blocks.any(axis=0) & (windows < most)

    def some(carry: Any) -> Any:
        blocks, windows, response = carry
        starts, needed = window_starts(order, blocks)
        up_to = jnp.cumsum(jnp.where(going(carry), needed.sum(axis=0), 0))
        taken = needed & (going(carry) & (up_to <= WINDOWS_TOGETHER))[None]  # all windows of a lane or none
        number = numbered(jnp.cumsum(taken), 0, WINDOWS_TOGETHER)
        lanes = jnp.where(number < taken.size, number % flagged.size, flagged.size)
        theirs = picked(starts.ravel(), number)
        response, at_edges = correct_windows(order, system, response, lanes, theirs)
        blocks = clear_flags(blocks, lanes, theirs, at_edges > picked(allowed, lanes)[None])
        return blocks, windows + taken.sum(axis=0), response

    carry = blocks & suited[None], jnp.zeros(flagged.shape, int), response
    blocks, _, response = jax.lax.while_loop(lambda carry: going(carry).any(), some, carry)
    return response, flagged & (~suited | blocks.any(axis=0))
