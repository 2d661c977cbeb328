"""Some received derivatives are falsified, each by its magnitude: exact answers (O10)."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from tests import systems

CONSISTENT = 3.1034482758620690  # worst vehicle's static gain on the ring, theorems.md O3


def worst_at_the_end(attack):
    """Greatest error over ā on the ring, after 50 s."""
    clock = {"horizon": 50.0, "tail": 0.0, "output_step": 0.5, "tick": 0.5}
    study = systems.study(engine="exact", attack=attack, defence="none", topology="cyclic", **clock)
    outcome = systems.simulate(systems.lanes(study, 1, ()))
    assert (outcome.status == 0).all()
    return outcome.metrics["tail_max"] / attack["magnitude"]


@pytest.mark.parametrize("orders", [[1], [0, 2]])
def test_a_constant_in_some_orders(orders):
    """Each order counts by its gain, over k0."""
    share = sum([1.0, 3.0, 3.0, 1.0][k] for k in orders)
    found = worst_at_the_end({"kind": "spoof", "magnitude": 2.0, "orders": orders})
    np.testing.assert_allclose(found, share * CONSISTENT, rtol=0, atol=1e-6)


def test_orders_that_are_zero_do_nothing():
    """A harmonic that may have the frequency 0 is a constant then, without a velocity."""
    attack = {"kind": "rotating", "frequency": {"choice": [0.0]}, "orders": [1, 3]}
    attack |= {"magnitude": 2.0}
    assert (worst_at_the_end(attack) < 1e-9).all()


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
        pytest.param(
            *("planar_quadrotor", [3, 1, 0, 0.5, 2], [1.0, 4.0, 6.0, 4.0]), marks=pytest.mark.long
        ),
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
