"""Errors of words and correlated errors of sensors: covariances, and engines path by path."""

import numpy as np
import pytest

from jaxnet.model.graph import dense
from jaxnet.theory import noise
from tests import systems
from tests.reference import navigator_at

# Variance of E over s² g at gain (1, 3, 3) and a tick of 0.05 s, white and correlated over 1 s.
WHITE, CORRELATED = 0.00937435, 0.312565
SIZES = {"position": 0.1, "velocity": 0.05, "acceleration": 0.02}
DRIVE = 0.1**2 + (3 * 0.05) ** 2 + (3 * 0.02) ** 2  # s² = Σ k_k² σ_k²
QUIET = {"attack": "none", "defence": "none", "horizon": 20.0, "output_step": 20.0, "tail": 0.0}


def covariance(topology, of):
    """Of the errors over s²: of links L⁻¹ diag(Σ w²) L⁻ᵀ, of transmitters (L⁻¹A)(L⁻¹A)ᵀ."""
    ahead, behind = np.eye(12, k=1), np.eye(12, k=-1)
    if topology == "path":
        weights, navigator = behind, np.eye(12)[0]
    else:
        weights = 0.45 * (ahead + behind + np.eye(12, k=11) + np.eye(12, k=-11))
        navigator = np.full(12, 0.1)
    inverse = np.linalg.inv(np.eye(12) - weights)
    if of == "transmitter":
        return inverse @ weights @ (inverse @ weights).T
    return inverse @ np.diag((weights**2).sum(axis=1) + navigator**2) @ inverse.T


@pytest.mark.parametrize(
    ("topology", "of", "correlation"),
    [
        pytest.param("cyclic", "link", 0.0, marks=pytest.mark.long),  # also in test_chi_squared.py
        ("path", "transmitter", 1.0),
    ],
)
def test_words_with_errors_drive_the_fleet_as_the_theory_says(topology, of, correlation):
    """Sum of squares over vehicles, and of each vehicle, inside 99 % intervals."""
    noise = {**SIZES, "of": of, "correlation": correlation}
    keys = QUIET | {"engine": "exact", "topology": topology, "channel": {"noise": noise}}
    one = systems.lanes(systems.study(**keys), 250)
    positions = systems.simulate(one).series["state"][:, -1, :, :2]
    error = (positions - navigator_at(one, 0)(20.0)[0]).transpose(0, 2, 1).reshape(-1, 12)
    known = DRIVE * (CORRELATED if correlation else WHITE) * covariance(topology, of)
    width = 2.576 * np.sqrt(2 * (known**2).sum() / len(error))
    assert abs((error**2).sum(axis=1).mean() - np.trace(known)) <= width
    each = np.diag(known)
    off = np.abs((error**2).mean(axis=0) - each)
    assert (off <= 3.6 * np.sqrt(2 / len(error)) * each + 1e-7).all()


OUTLIERS = {"outliers": 0.05, "outlier_factor": 6.0}


@pytest.mark.long
def test_engines_draw_the_same_errors():
    """Path by path to 1e-5 m: outliers, errors of jerks, held readings; lost words are held."""
    loss = {"kind": "gilbert_elliott", "fail": 0.3, "recover": 0.4, "of": "transmitter"}
    noise = {**SIZES, "correlation": 0.3, "jerk": 0.1, **OUTLIERS}
    keys = {"attack": "none", "defence": "none", "vehicles": 4}
    keys |= {"tick": 0.1, "horizon": 3.0, "tail": 1.0}
    keys["channel"] = {"noise": noise, "loss": loss, "missing": "hold"}
    keys["sensing"] = {"position": 0.1, "correlation": 0.2, "dropout": 0.2, **OUTLIERS}
    studies = (systems.study(engine=engine, **keys) for engine in ("exact", "nonlinear"))
    outcomes = [systems.simulate(systems.lanes(study, 2)) for study in studies]
    exact, nonlinear = (each.series["state"][..., :2] for each in outcomes)
    assert np.abs(exact - nonlinear).max() <= 1e-5


@pytest.mark.long
def test_the_highest_derivative_of_single_integrators_is_their_velocity():
    """Its errors drive as `k0 y`'s do: variance `(1 - e^(-h))² / (1 - e^(-2h))` of both."""
    noise = {"position": 0.3, "jerk": 0.4, "velocity": 7.0}  # a velocity of order 1 is `jerk` alone
    keys = QUIET | {"engine": "exact", "topology": "star", "vehicle": "single_integrator"}
    keys |= {"horizon": 10.0, "output_step": 10.0, "tick": 0.1, "channel": {"noise": noise}}
    outcome = systems.outcome(200, **keys)
    positions = outcome.series["state"][:, -1, :, :2]
    squares = (positions - positions.mean(axis=(0, 1))) ** 2
    known = (0.3**2 + 0.4**2) * (1 - np.exp(-0.1)) ** 2 / (1 - np.exp(-0.2))
    assert abs(squares.mean() - known) <= 2.576 * squares.std() / np.sqrt(squares.size)


def test_variances_are_those_of_the_discrete_lyapunov_equation():
    """At ticks of 0.05 and 0.1 s; order 1 has `h² / (1 - e^(-2h))` of held noise."""
    assert abs(noise.held_variance([1.0, 3.0, 3.0], 0.1) - 0.0187448) < 1e-7
    assert abs(noise.held_variance([1.0, 3.0, 3.0], 0.05) - WHITE) < 1e-8
    assert abs(noise.held_variance([1.0, 3.0, 3.0], 0.05, 1.0) - CORRELATED) < 1e-6
    h = 0.3
    assert abs(noise.held_variance([1.0], h) - (1 - np.exp(-h)) ** 2 / (1 - np.exp(-2 * h))) < 1e-12
    for topology in ("cyclic", "path"):
        (cell,) = systems.study(topology=topology).cells
        weights = dense(cell.scenario.topology.normalised_rows(12))
        for of, ring, first in (("link", 5.242067, 1), ("transmitter", 9.009307, 0)):
            known = np.diag(covariance(topology, of))
            told = ring if topology == "cyclic" else first + np.arange(12)
            np.testing.assert_allclose(known, told, atol=1e-6)
            np.testing.assert_allclose(noise.link_gains(weights, of), known, rtol=0, atol=1e-9)
