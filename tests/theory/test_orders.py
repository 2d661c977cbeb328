"""Constants of vehicles of order 1 to 4, against closed forms and plain quadrature."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.theory import exact, lyapunov, response, rounds
from tests.matrices import matrix_of

BINOMIAL = {1: [1.0], 2: [1.0, 2.0], 3: [1.0, 3.0, 3.0], 4: [1.0, 4.0, 6.0, 4.0]}
# For each order: η, 2‖PB‖ and √κ(P), at binomial gain and Q = I.
CONSTANTS = {
    1: (math.sqrt(2), 1.0, 1.0),
    2: (2.0, math.sqrt(2), 2.414214),
    3: (2.828427, 2.099107, 4.762563),
}
CONSTANTS[4] = (4.0, 3.259601, 9.179216)
GAINS = [[0.7], [2.0, 0.3], [0.4, 3.0], [5.0, 1.0], [1.354, 9.748, 0.259], [2.0, 3.0, 3.0]]
GAINS += [[1.0, 2.0, 3.0, 2.0], [50.0, 65.0, 34.0, 9.0], [9.13, 25.0, 11.08, 3.1]]  # of order 4


@pytest.mark.parametrize("order", BINOMIAL)
def test_constants_of_binomial_gains(order):
    """Published for order 3, worked out twice for the others."""
    gain = np.array(BINOMIAL[order])
    eta, printed, root = CONSTANTS[order]
    assert response.impulse_norm(gain) == pytest.approx(1.0, abs=1e-6)
    assert response.harmonic_norm(gain) == pytest.approx(eta, abs=1e-6)
    assert lyapunov.printed_constant(gain) == pytest.approx(printed, abs=1e-6)
    assert lyapunov.corrected_constant(gain) == pytest.approx(printed * root, abs=1e-5)


@pytest.mark.parametrize("gain", GAINS[1::3])
def test_the_impulse_norm_is_the_integral(gain):
    """Of |h| by quadrature between the zeros of h."""
    A, order = exact.companion(np.array(gain)), len(gain)

    def h(t):
        return float(expm(A * t)[0, order - 1])

    times = np.linspace(0, 60 / -np.linalg.eigvals(A).real.max(), 6001)
    step, state = expm(A * times[1]), np.eye(order)[:, -1]
    values = []
    for _ in times:
        values.append(state[0])
        state = step @ state
    turns = times[np.flatnonzero(np.diff(np.sign(values)))]
    ends = [0.0, *turns[turns > 0], times[-1]]
    total = sum(quad(lambda t: abs(h(t)), *pair, limit=200)[0] for pair in itertools.pairwise(ends))
    assert response.impulse_norm(np.array(gain)) == pytest.approx(total, rel=2e-5)


@pytest.mark.parametrize("gain", GAINS)
def test_the_harmonic_norm_is_the_greatest_on_a_grid(gain):
    """|R(iω)| / max(1, ω^r), with r the order."""
    omega = np.concatenate([np.linspace(0, 1, 20_001), np.geomspace(1, 1e4, 20_001)])
    R = np.polyval([1.0, *gain[::-1]], 1j * omega)
    greatest = (np.abs(R) / np.maximum(1, omega ** len(gain))).max()
    assert response.harmonic_norm(np.array(gain)) == pytest.approx(greatest, rel=1e-6)


@pytest.mark.parametrize("gain", GAINS)
@pytest.mark.parametrize("kind", [Cyclic(), ErdosRenyi(probability=0.4, navigator={"share": 0.5})])
def test_the_local_law_grows_by_the_spectral_radius_of_the_whole_fleet(gain, kind):
    """Of the step matrix of all vehicles, held for a tick, also where it is unstable."""
    weights, order, tick = matrix_of(kind, 12), len(gain), 0.3
    L = np.eye(12) - weights[:, 1:]
    chain = np.kron(np.eye(order, k=1), np.eye(12))
    whole = np.zeros((12 * (order + 1), 12 * (order + 1)))
    whole[: 12 * order, : 12 * order] = chain
    whole[12 * (order - 1) : 12 * order, 12 * order :] = np.eye(12)
    flow = expm(whole * tick)
    step = flow[: 12 * order, : 12 * order] - flow[: 12 * order, 12 * order :] @ np.kron(
        np.array(gain)[None], L
    )
    radius = np.abs(np.linalg.eigvals(step)).max()
    grown = rounds.local_growth(rounds.eigenvalues(weights), np.array(gain), tick)
    assert grown == pytest.approx(radius, rel=1e-6)
