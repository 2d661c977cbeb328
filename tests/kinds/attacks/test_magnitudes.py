"""A magnitude for each order of derivatives that attacked links falsify on its own."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet

SPOOF = {"kind": "spoof", "magnitude": [15, 10, 5], "vehicles": [1, 3], "direction": 0.3}
STAR = {"engine": "exact", "vehicles": 3, "topology": "star", "defence": "none"}
CLOCK = {"horizon": 4.0, "tail": 1.0, "tick": 0.1}


def constant_response(gain, rho, start, times):
    """E with `E^(r) + … + k1 Ė + k0 E = ρ` from these jets, by the matrix exponential."""
    order = len(gain)
    system = np.zeros((order + 1, order + 1))  # the last state is the constant 1
    system[: order - 1, 1:order] = np.eye(order - 1)
    system[order - 1] = [*-np.array(gain), rho]
    return np.array([(expm(system * t) @ [*start, 1.0])[0] for t in times])


@pytest.mark.parametrize(
    ("vehicle", "magnitude", "gain"),
    [
        ("double_integrator", [2, 0, 7], [2.0, 0.9]),
        ("planar_quadrotor", [3, 1, 0, 0.5, 2], [1.0, 4.0, 6.0, 4.0]),
    ],
)
def test_a_star_responds_to_a_constant_disturbance(vehicle, magnitude, gain):
    """ρ = Σ_k k_k ā_k with k_r = 1; orders beyond the list are true; vehicle 2 is not attacked."""
    attack = SPOOF | {"magnitude": magnitude}
    keys = STAR | CLOCK | {"vehicle": vehicle, "gain": gain, "attack": attack}
    keys |= {"save": {"trajectories": "all"}}
    results = jaxnet.simulate(keys, samples=1, progress=False)
    data = results.trajectories.sel(cell=0, sample=0)
    (study,) = results.study.cells
    kind, times = study.scenario.vehicle, data["time"].values
    path = np.asarray(study.scenario.navigator.jets(times))[0].T
    first = np.stack(kind.output_jets(data["states"].values[0].T[:, :, None]))[..., 0]  # (r, 2, 3)
    first -= np.asarray(study.scenario.navigator.jets(np.zeros(1)))[: len(first)]
    rho = np.dot([*gain, 1.0][: len(magnitude)], magnitude) * np.array([np.cos(0.3), np.sin(0.3)])
    for vehicle, axis in np.ndindex(3, 2):
        forced = 0.0 if vehicle == 1 else rho[axis]
        known = path[:, axis] + constant_response(gain, forced, first[:, axis, vehicle], times)
        np.testing.assert_allclose(data["states"].values[:, vehicle, axis], known, atol=1e-8)
