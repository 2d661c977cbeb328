"""The vector field of one lane for any integrator. Vehicles decide at each evaluation."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from jaxnet.config.scenario import is_ideal
from jaxnet.config.study import Study
from jaxnet.engine.methods.stacked import lane_field, undisturbed, with_lane_axis
from jaxnet.engine.vehicles import first_states
from jaxnet.lanes.jobs import job, source_of

LaneField = Callable[..., jax.Array]  # of time [s], state (n, m) and an ignored argument


def field_of(study: Study, cell: int, sample: int) -> tuple[LaneField, jax.Array]:
    if cell >= len(study.cells):
        raise ValueError(f"the study has cells 0 to {len(study.cells) - 1} (got cell {cell})")
    if jnp.zeros(()).dtype != jnp.float64:
        told = "call jax.config.update('jax_enable_x64', True) first"
        raise RuntimeError(f"a vector field needs double precision: {told}")
    scenario = study.cells[cell].scenario
    attack, defence, law = scenario.attack, scenario.defence, scenario.law
    at_ticks = defence.decides and (defence.needs_ticks() or defence.draws())
    faults = {
        f"{attack.kind} decides at ticks only": attack.strategic,
        f"{defence.kind} decides at ticks only": at_ticks,
        "attacked vehicles change at ticks": attack.periods(),
        f"{defence.kind} has isolated: coast": defence.coasts(),
        f"{scenario.vehicle.kind} has standstill: stop": scenario.vehicle.standstill == "stop",
        f"{law.kind} is not the law solved at every instant": not law.solves(),
        f"the {scenario.engine.kind} engine holds inputs": scenario.engine.samples,
        "vehicles sense, and messages are lost, at ticks": not is_ideal(scenario),
    }
    if fault := next((words for words, broken in faults.items() if broken), ""):
        raise ValueError(f"{fault}, and a vector field knows of no ticks")
    source = source_of(study.config, scenario)
    one = job(scenario.model_copy(update={"tick": 0.0}), source, [sample])
    alone = jax.tree.map(lambda leaf: leaf[0], one.inputs.lane)
    lane, network = jax.tree.map(jnp.asarray, (alone, one.network))
    followed = undisturbed(lane)

    @jax.jit
    def derivative(time: ArrayLike, state: ArrayLike, args: object = None) -> jax.Array:
        now, state = jnp.asarray(time, float), jnp.asarray(state, float)
        return lane_field(now, state, followed, network, one.plan)

    return derivative, first_states(with_lane_axis(lane))[..., 0]
