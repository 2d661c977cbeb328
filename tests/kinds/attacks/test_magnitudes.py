"""A magnitude for each order of derivatives that attacked links falsify on its own."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import binom

import jaxnet
from jaxnet.config.amplitude import known_amplitude
from jaxnet.config.naming import value_alone, value_name
from jaxnet.statistics.limits import bounds_of, slopes_table

SPOOF = {"kind": "spoof", "magnitude": [15, 10, 5], "vehicles": [1, 3], "direction": 0.3}
STAR = {"engine": "exact", "vehicles": 3, "topology": "star", "defence": "none"}
CLOCK = {"horizon": 4.0, "tail": 1.0, "tick": 0.1}


def constant_response(gain, rho, start, times):
    """Position of E with `E^(r) + … + k1 Ė + k0 E = ρ` from these jets, by the matrix exponential."""
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
    keys = (
        STAR
        | CLOCK
        | {"vehicle": vehicle, "gain": gain, "attack": attack, "save": {"trajectories": "all"}}
    )
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


@pytest.mark.parametrize("kind", ["sinusoid", "envelope"])
def test_each_order_is_heard_within_its_magnitude(kind):
    """A sinusoid in position and acceleration; a spoof in an envelope, which is no path either."""
    attack = {"kind": "sinusoid", "orders": [0, 2], "frequency": 1.7, "phase": 0.2}
    if kind == "envelope":
        attack = {"kind": "envelope", "of": "spoof", "start": 0.5, "rise": 1.0}
    keys = {"attack": attack | {"magnitude": [4, 0, 9]}, "engine": "exact"}
    keys |= {"horizon": 2.0, "tail": 0.0, "save": {"trajectories": "all"}, "defence": "none"}
    results = jaxnet.simulate(keys, samples=1, progress=False)
    signal = results.trajectories["attack"].sel(cell=0, sample=0)
    time = signal["time"].values
    unit = (
        np.sin(1.7 * time + 0.2)
        if kind == "sinusoid"
        else binom.sf(3, 7, np.clip(time - 0.5, 0, 1))
    )
    rough = 1e-3 if kind == "envelope" else 1e-9  # bounds on an envelope are those of pieces
    np.testing.assert_allclose(signal.values[:, 1, 0], 4.0 * unit, atol=rough)
    if kind == "sinusoid":
        assert known_amplitude(results.study.cells[0].scenario) == pytest.approx(4.0)


def test_bounds_follow_from_the_list():
    """Σ_k k_k ā_k γ_i ‖h‖₁ with ‖h‖₁ = 1 at the gains (1, 3, 3)."""
    study = jaxnet.load(STAR | CLOCK | {"attack": SPOOF})
    bounds = bounds_of(study.cells[0].scenario)
    per_size = np.array([1.0, 0.0, 1.0]) * (1 * 15 + 3 * 10 + 3 * 5) / 15
    np.testing.assert_allclose(bounds["peak_gain"].vehicles, per_size, rtol=1e-9)
    assert np.isnan(bounds["static"].vehicles).all()


@pytest.mark.parametrize(
    ("attack", "message"),
    [
        (
            {"kind": "rotating", "magnitude": [1, 2]},
            "derivatives of rotating follow from its signal",
        ),
        (SPOOF | {"magnitude": [1, 2, 3, 4, 5]}, "at most 4 numbers, of the orders 0 to 3"),
        ({"kind": "rotating", "orders": [0, 1], "magnitude": [1, 2, 3]}, "leaves order 2 true"),
        (SPOOF | {"magnitude": [1, -2]}, "must be at least 0"),
        ({"kind": "freeze", "magnitude": [1, 2]}, "must be a number"),
    ],
)
def test_a_list_without_meaning_is_refused(attack, message):
    with pytest.raises(jaxnet.ConfigError, match=message):
        jaxnet.load({"attack": attack})


def test_swept_lists_have_names_and_bounds_of_their_own():
    """A list's values are told with their units; β differs from list to list."""
    keys = STAR | CLOCK | {"attack": SPOOF, "sweep": {"attack.magnitude": [[15, 10], [0, 0, 2.5]]}}
    cells = jaxnet.load(keys).cells
    slopes = slopes_table(cells).query("bound == 'peak_gain' and vehicle == 'worst'")
    np.testing.assert_allclose(slopes["slope"], [(15 + 30) / 15, 3.0], rtol=1e-9)
    first, second = slopes["attack.magnitude"]
    assert value_name("attack.magnitude", first).replace("\xa0", " ") == "ā = (15 m, 10 m/s)"
    assert value_alone("attack.magnitude", second).replace("\xa0", " ") == "(0 m, 0 m/s, 2.5 m/s²)"
