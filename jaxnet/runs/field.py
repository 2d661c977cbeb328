"""The vector field of one lane for any integrator. Vehicles decide at each evaluation."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from jaxnet.config.scenario import is_ideal
from jaxnet.config.study import Study
from jaxnet.engine.methods.stacked import lane_field, undisturbed
from jaxnet.lanes.jobs import job, source_of

LaneField = Callable[..., jax.Array]  # of time [s], state (n, m) and an ignored argument


def field_of(study: Study, cell: int, sample: int) -> tuple[LaneField, jax.Array]:
    if cell >= len(study.cells):
        raise ValueError(f"the study has cells 0 to {len(study.cells) - 1} (got cell {cell})")
    if jnp.zeros(()).dtype != jnp.float64:
        told = "call jax.config.update('jax_enable_x64', True) first"
        raise RuntimeError(f"a vector field needs double precision: {told}")
    scenario = study.cells[cell].scenario
    attack, defence = scenario.attack, scenario.defence
    no_ticks, fault = "and a vector field knows of no ticks", ""
    if attack.strategic or (defence.decides and (defence.needs_ticks() or defence.draws())):
        kind = (attack if attack.strategic else defence).kind
        fault = f"{kind} decides at ticks only, {no_ticks}"
    elif attack.periods():
        fault = f"attacked vehicles change at ticks, {no_ticks}"
    elif defence.coasts():
        fault = f"{defence.kind} has isolated: coast, {no_ticks}"
    elif not scenario.law.solves():
        kind = scenario.law.kind
        fault = f"the vector field is that of the law solved at every instant (got {kind})"
    elif not is_ideal(scenario):
        fault = f"vehicles sense, and messages are lost, at ticks, {no_ticks}"
    if fault:
        raise ValueError(fault)
    source = source_of(study.config, scenario)
    one = job(scenario.model_copy(update={"tick": 0.0}), source, [sample])
    alone = jax.tree.map(lambda leaf: leaf[0], one.inputs.lane)
    lane, network = jax.tree.map(jnp.asarray, (alone, one.network))
    followed = undisturbed(lane)

    @jax.jit
    def derivative(time: ArrayLike, state: ArrayLike, args: object = None) -> jax.Array:
        now, state = jnp.asarray(time, float), jnp.asarray(state, float)
        return lane_field(now, state, followed, network, one.plan)

    return derivative, lane.initial
