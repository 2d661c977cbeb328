"""One lane's field, integrated by diffrax without jaxnet: how far is it from the exact solution?

The ring of twelve without a defence, the same attack on four of its vehicles. Run it with
`python experiments/one_lane.py`; it takes some seconds.
"""

import diffrax
import jax
import numpy as np

import jaxnet

STUDY = {"defence": "none", "attack": {"kind": "rotating", "magnitude": 5.0}, "horizon": 10.0}


def main() -> None:
    """One line."""
    jax.config.update("jax_enable_x64", True)
    print(f"{distance():.1e} m from the exact solution after {STUDY['horizon']:g} s")


def distance() -> float:
    """Greatest distance [m] of a vehicle from where the exact solution has it at the end."""
    field, start = jaxnet.field(STUDY)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Tsit5(),
        t0=0.0,
        t1=STUDY["horizon"],
        dt0=None,
        y0=start,
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-9),
    )
    assert solution.ys is not None
    exact = jaxnet.simulate({**STUDY, "engine": "exact"}, samples=1, progress=False).replay(0, 0)
    known = exact.trajectory["states"].to_numpy()[0, -1, :, :2]
    return float(np.linalg.norm(solution.ys[0, :2].T - known, axis=1).max())


if __name__ == "__main__":
    main()
