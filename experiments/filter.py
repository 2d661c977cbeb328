"""How often do lies about places break a safety filter?

From the results of `configs/filter.yaml`: the share of lanes in which a pair came nearer than D,
with exact 95 % intervals. And a robot that stands at the goal of another, obeys no filter, and
tells a place that turns around its own at 2 rad/s: how near the other comes, by halves.

Run it with `jaxnet run configs/filter.yaml`, then `python experiments/filter.py`.
"""

from typing import Literal, get_args

import click
import jax
import jax.numpy as jnp
import numpy as np

import jaxnet
from jaxnet.kinds.filters.barrier import Barrier
from jaxnet.kinds.kind import as_pytree
from jaxnet.statistics.intervals import clopper_pearson

DISTANCE, STEP, LANES = 0.15, 0.033, 64
Form = Literal["joint", "halves"]
FORMS: tuple[Form, ...] = get_args(Form)
ROUNDING = 1e-9  # [m]


def shares(folder: str) -> None:
    """Print the share of broken lanes of each cell, and the least separation of all its lanes."""
    lanes = jaxnet.open(folder).lanes
    keys = ["filter", "defence", "attack.magnitude"]
    for _, rows in lanes.groupby("cell"):
        least = rows["min_separation"].to_numpy()
        broken, all_lanes = np.array([(least < DISTANCE - ROUNDING).sum()]), np.array([len(least)])
        low, high = (100 * end.item() for end in clopper_pearson(broken, all_lanes, 0.95))
        share = 100 * broken.item() / len(least)
        print(
            *rows[keys].iloc[0],
            f"{share:.2f} % [{low:.1f}, {high:.1f}]  least {least.min():.3f} m",
            sep="\t",
        )


def nearest_to_a_liar(seconds: float, form: Form, lie: float, rate: float) -> np.ndarray:
    """Least distance [m] from 0.5 m on to a standing liar, for even phases of its lie (lanes,).

    The robot asks for the way to its goal [m] in m/s, at most 0.2 m/s.
    """
    given = Barrier(form=form)
    arrays = {key: jnp.full(LANES, getattr(given, key)) for key in ("distance", "gain", "speed")}
    safety = as_pytree(given.filled({**given.config_keys(), **arrays}))
    phase = jnp.linspace(0, 2 * np.pi, LANES, endpoint=False)

    def one(step: jax.Array, carry: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        place, least = carry
        angle = rate * STEP * step.astype(float) + phase
        away, still = jnp.hypot(*place), jnp.zeros_like(place)
        wanted = -place / jnp.maximum(1.0, away / 0.2)[None]
        own = jnp.stack([place, still], axis=1)
        told = own.at[:, 1].set(lie * jnp.stack([jnp.cos(angle), jnp.sin(angle)]))
        found = safety.nearest(jnp.stack([wanted, still], axis=1), own, told)[:, 0]
        place = place + STEP * jnp.where(jnp.isnan(found), 0.0, found)
        return place, jnp.minimum(least, jnp.hypot(*place))

    start = jnp.stack([jnp.full(LANES, -0.5), jnp.zeros(LANES)]), jnp.full(LANES, 0.5)
    return np.asarray(jax.lax.fori_loop(0, round(seconds / STEP), one, start)[1])


@click.command()
@click.argument("folder", default="results/filter")
def main(folder: str) -> None:
    jax.config.update("jax_enable_x64", True)
    shares(folder)
    for seconds in (10, 20, 30, 60):
        for form in FORMS:
            least = nearest_to_a_liar(seconds, form, lie=0.05, rate=2.0)
            print(f"standing liar, {form}, {seconds} s: {least.min():.3f} to {least.max():.3f} m")


if __name__ == "__main__":
    main()
