"""Local update of the solution of `L x = b`, in windows around the rows that have changed.

x solved the system before the change, so `b - L x` is nearly 0 outside the changed rows. Where
every vehicle hears the navigator, L is strictly diagonally dominant. The effect of a row then
decays geometrically with distance. So x is corrected in a window of blocks around the row, and
stays fixed outside the window. A residual is left only in the two blocks next to the window. The
residual is at most the correction at the window's edges.

`L 1 = a0`, so the error of x is at most the residual over the least a0.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxnet.model import retained
from jaxnet.model.elimination import identity
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.signal import ByFunction
from jaxnet.solvers.blocks import Blocks, from_block_to_block
from jaxnet.solvers.solver import SolvedLanes, System

WINDOWS_TOGETHER = 16  # windows of all lanes that are solved at once
WINDOW_ACCURACY = 1e-13  # error of a response, relative to the attacks' greatest vector component
SIDE_BY_SIDE = 4  # windows of one lane that are corrected at once
WINDOW = 33  # blocks in a window

WindowNumbers = Int[Array, " few"]
FlaggedBlocks = Bool[Array, "blocks lanes"]
Corrected = tuple[FlaggedBlocks, Int[Array, " lanes"], ByFunction]  # flags, windows so far, x


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Windowed(Blocks):
    """Block elimination that updates a solution only near the changed rows."""

    def update(self, system, x, flagged, changed):
        """Update x near the changed vehicles of flagged lanes; return x and the flagged lanes left.

        The windows of a lane do not depend on other lanes. A lane is left in three cases: too many
        of its vehicles changed, a vehicle does not hear the navigator, or the effect of a change
        reaches too far.
        """
        most = len(self.vehicles) // WINDOW
        heard = (system.hearing.sources[0] == 0)[:, None] & system.decision[:, 0].all(axis=0)
        least = jnp.where(heard, system.weights[0], 0.0).min(axis=0)  # no more than the least a0
        allowed = WINDOW_ACCURACY * jnp.abs(system.vectors).max(axis=(0, 1, 2)) * least
        blocks = changed.at[self.vehicles].get(mode="fill", fill_value=False).any(axis=1)
        suited = flagged & (least > 0) & (blocks.sum(axis=0) <= most)

        def going(carry: Corrected) -> SolvedLanes:
            blocks, windows, _ = carry
            return blocks.any(axis=0) & (windows < most)

        def some(carry: Corrected) -> Corrected:
            (blocks, windows, x), goes = carry, going(carry)
            starts, needed = window_starts(blocks)
            up_to = jnp.cumsum(jnp.where(goes, needed.sum(axis=0), 0))
            taken = needed & (goes & (up_to <= WINDOWS_TOGETHER))[None]  # all of a lane or none
            number = (jnp.cumsum(taken)[None] <= jnp.arange(WINDOWS_TOGETHER)[:, None]).sum(axis=1)
            lanes = jnp.where(number < taken.size, number % flagged.size, flagged.size)
            theirs = starts.ravel().at[number].get(mode="clip")
            x, at_edges = self.correct(system, x, lanes, theirs)
            over = at_edges > allowed.at[lanes].get(mode="clip")[None]
            blocks = clear_flags(blocks, lanes, theirs, over)
            return blocks, windows + taken.sum(axis=0), x

        carry = blocks & suited[None], jnp.zeros(flagged.shape, int), x
        blocks, _, x = jax.lax.while_loop(lambda carry: going(carry).any(), some, carry)
        return x, flagged & (~suited | blocks.any(axis=0))

    def correct(
        self, system: System, x: ByFunction, lanes: WindowNumbers, starts: WindowNumbers
    ) -> tuple[ByFunction, Float[Array, "2 few"]]:
        """Correct the solution in a window of each given lane; `starts` are windows' first blocks.

        Return the solution, and the greatest correction in each window's first and last block.
        """
        size, functions = self.vehicles.shape[1], len(x)
        vehicles, carried_sources, weights, left = jax.vmap(
            lambda lane, start: self.left_in_window(system, x, lane, start), -1, -1
        )(lanes, starts)
        first = (starts[None] + jnp.arange(WINDOW)[:, None] - 1) * size  # place of the first column
        shape = len(carried_sources), WINDOW, size, -1
        place = jnp.asarray(self.place)[carried_sources - 1].reshape(shape) - first[None, :, None]
        dropped = carried_sources.reshape(place.shape) == 0  # by a column out of range
        columns = jnp.where(dropped, 3 * size, place)
        heard = jnp.moveaxis(weights, 0, 2).reshape(*place.shape[:3], len(weights), -1)
        nothing = jnp.zeros((WINDOW, size, 3 * size, *heard.shape[3:]))
        rows = np.arange(WINDOW)[None, :, None, None], np.arange(size)[None, None, :, None]
        there = *rows, columns, slice(None), jnp.arange(len(lanes))[None, None, None]
        table = nothing.at[there].add(heard.swapaxes(3, 4), mode="drop")
        before, own, after = jnp.split(table, 3, axis=2)
        by_axis = left.reshape(WINDOW, size, -1, len(weights), functions, len(lanes)).swapaxes(3, 4)
        right = by_axis.reshape(WINDOW, size, -1, len(weights), len(lanes))
        found = from_block_to_block(before, identity(own) - own, after, right)
        at_edges = jnp.abs(found.at[np.array([0, -1])].get()).max(axis=(1, 2, 3))
        added = found.reshape(by_axis.shape).swapaxes(3, 4).reshape(left.shape)
        added = added.transpose(2, 1, 0, 3)
        return x.at[:, :, vehicles, lanes[None]].add(added, mode="drop"), at_edges

    def left_in_window(
        self, system: System, x: ByFunction, lane: LoopIndex, start: LoopIndex
    ) -> tuple[
        Int[Array, " w"], Int[Array, "slots w"], Float[Array, "axes slots w"], Float[Array, "w 2 _"]
    ]:
        """The vehicles of one window of a lane, their sources and weights, and their `b - L x`."""
        vehicles = jax.lax.dynamic_slice_in_dim(jnp.asarray(self.vehicles), start, WINDOW).ravel()
        used = vehicles < x.shape[2]
        heard = (each.at[:, vehicles].get(mode="clip") for each in system.hearing)
        _, carried_sources, attacked, signals = heard
        weights = system.weights.at[:, vehicles, lane].get(mode="clip")
        decision = system.decision.at[:, :, vehicles, lane].get(mode="clip")
        weights = jnp.where(used[None, None], retained.in_force(weights, decision), 0.0)
        own, sent = (
            jnp.moveaxis(x.at[:, :, who, lane].get(mode="clip"), (0, 1), (-1, -2))
            for who in (vehicles, carried_sources - 1)
        )
        false = system.vectors.at[:, signals, :, lane].get(mode="clip")
        received = jnp.where((carried_sources > 0)[..., None, None], sent, 0.0)
        received = received + jnp.where(attacked[..., None, None], false, 0.0)
        left = (jnp.moveaxis(weights, 0, 2)[..., None] * received).sum(axis=0) - own
        return vehicles, carried_sources, weights, jnp.where(used[:, None, None], left, 0.0)


def window_starts(
    flagged: FlaggedBlocks,
) -> tuple[Int[Array, "windows lanes"], Bool[Array, "windows lanes"]]:
    """The first block of each of a lane's windows, and which windows are needed.

    The first flagged block is in a window's middle if possible; a block or more separates windows.
    """
    blocks, free = len(flagged), jnp.zeros(flagged.shape[1:], int)
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
    blocks: FlaggedBlocks, lanes: WindowNumbers, starts: WindowNumbers, over: Bool[Array, "2 few"]
) -> FlaggedBlocks:
    """The flags of blocks after windows have been corrected.

    A block within a window loses its flag. A block next to a window is flagged where `over` says
    that its residual is too large; no window of the lane contains it. Windows past the last lane
    are padding.
    """
    beyond = jnp.pad(blocks, [(1, 1), (0, 0)])

    def one(number: LoopIndex, beyond: FlaggedBlocks) -> FlaggedBlocks:
        place = starts[number], lanes[number]
        old = jax.lax.dynamic_slice(beyond, place, (WINDOW + 2, 1))
        left = [old[:1] | over[0, number], jnp.zeros_like(old[1:-1]), old[-1:] | over[1, number]]
        new = jnp.where(lanes[number] < blocks.shape[1], jnp.concatenate(left), old)
        return jax.lax.dynamic_update_slice(beyond, new, place)

    return jax.lax.fori_loop(0, lanes.size, one, beyond)[1:-1]
