"""The same lanes in programs that one would write without jaxnet: SciPy, diffrax and GNU Octave.

Each takes an untrimmed job and gives positions [m] at its output times, (lanes, times, m, 2), by an
adaptive 5(4) method at rtol 1e-7 and atol 1e-9. None shares a line of the model with the package.
What does not depend on the state is computed once per lane; in particular what is received of
navigator and attacks,

    a0 ⊗ (y_0‴ + P(y_0)) + d‴ + P(d),        P(y) = k0 y + k1 ẏ + k2 ÿ,

is a sum of harmonics of time whose vectors are known beforehand, so that the law is left with `L (σ
+ P(y) + ψ u) = received`. It is solved as the paper states it, `M u = …` with the dense 2m × 2m
matrix `M = Ψ⁻¹ (L ⊗ I₂) Ψ` of the moment (inputs in the order u_1 of all vehicles, then u_2 of
all), or, with `dense=False`, by the structure of M: with the inverse of L, computed once.

And both engines' loops by hand, in C, of the default study alone: the exact one of lanes that it
draws itself, the nonlinear one without attack.
"""

import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.io import loadmat, savemat

from experiments import exactness
from jaxnet.engine.batch import Job
from jaxnet.model.signal import Harmonic

RTOL, ATOL = 1e-7, 1e-9

Positions = Float[np.ndarray, "lanes times m 2"]


class NotInstalledError(Exception):
    """A program that a peer needs is not on this machine."""


class Fleet(NamedTuple):
    """One lane in plain numbers."""

    initial: Float[np.ndarray, "6 m"]
    laplacian: Float[np.ndarray, "m m"]
    inverse: Float[np.ndarray, "m m"]
    gain: Float[np.ndarray, "3"]
    frequency: Float[np.ndarray, "3"]  # [rad/s], of the navigator's axes and the attack
    cosine: Float[np.ndarray, "3 2 m"]  # what is received at cos(frequency t)
    sine: Float[np.ndarray, "3 2 m"]


def fleets(job: Job) -> list[Fleet]:
    """The lanes of an untrimmed job."""
    return [Fleet(*(leaf[n] for leaf in side_by_side(job))) for n in range(job.size)]


def side_by_side(job: Job) -> Fleet:
    """All lanes at once, each array with the lanes as its first axis."""
    assert job.clock.ticks == 1, "the peers do not trim"
    lane, heard = (
        jax.tree.map(np.asarray, each) for each in (job.inputs.lane, job.network.hearing)
    )
    assert isinstance(lane.signal, Harmonic), "the peers know harmonic attacks alone"
    assert (heard.carried_sources == heard.sources).all(), "the peers know attacks that add alone"
    kinds, kind = np.unique(lane.weights, axis=0, return_inverse=True)
    each = [links(weights, heard.sources, heard.attacked, heard.signals) for weights in kinds]
    laplacian, from_navigator, added = (np.stack(arrays) for arrays in zip(*each, strict=True))
    inverse = np.linalg.inv(laplacian)
    laplacian, from_navigator, added, inverse = (
        array[kind] for array in (laplacian, from_navigator, added, inverse)
    )
    # What is received is the real part of these vectors times exp(i frequency t).
    vectors: Any = np.zeros((job.size, 3, 2, lane.initial.shape[2]), complex)
    path = -1j * lane.navigator.amplitude * np.exp(1j * lane.navigator.phase)
    vectors[:, [0, 1], [0, 1]] = path[:, :, None] * from_navigator[:, None]
    vectors[:, 2] = np.einsum(
        "lxs,lms->lxm", lane.vectors[..., 0] - 1j * lane.vectors[..., 1], added
    )
    frequency = np.concatenate([lane.navigator.frequency, lane.signal.frequency[:, None]], axis=1)
    turn, gain = 1j * frequency, lane.gain[:, :, None]
    vectors *= (gain[:, 0] + gain[:, 1] * turn + gain[:, 2] * turn**2 + turn**3)[..., None, None]
    return Fleet(
        lane.initial, laplacian, inverse, lane.gain, frequency, vectors.real, -vectors.imag
    )


def links(
    weights: np.ndarray, sources: np.ndarray, attacked: np.ndarray, signals: np.ndarray
) -> tuple[np.ndarray, ...]:
    """From weights by slot: L, a0, and the weight with which each vehicle (row) gets an attack."""
    m = sources.shape[1]
    laplacian, from_navigator, added, everyone = (
        np.eye(m),
        np.zeros(m),
        np.zeros((m, m)),
        np.arange(m),
    )
    for source, carries, signal, weight in zip(sources, attacked, signals, weights, strict=True):
        vehicle = source > 0
        laplacian[everyone, np.where(vehicle, source - 1, everyone)] -= np.where(
            vehicle, weight, 0.0
        )
        from_navigator += np.where(vehicle, 0.0, weight)
        added[everyone, signal] += np.where(carries, weight, 0.0)
    return laplacian, from_navigator, added


def output_times(job: Job) -> Float[np.ndarray, " times"]:
    """Output times [s]."""
    return np.arange(int(job.clock.outputs) + 1) * float(job.clock.interval)


def greatest_error(job: Job, positions: Positions) -> float:
    """Greatest distance [m] from the exact solution, over vehicles, output times and lanes."""
    with jax.enable_x64(True):
        errors = [
            exactness.greatest_distance(
                jax.tree.map(lambda leaf, n=n: jnp.asarray(leaf[n]), job.inputs),
                job.network.hearing,
                float(job.clock.interval),
                {"state": path, "kept": kept(job, n)},
            )
            for n, path in enumerate(positions)
        ]
    return float(np.max(errors))


def kept(job: Job, number: int) -> Float[np.ndarray, "times slots m"]:
    """Weights of a lane that nobody trims, at every output time."""
    weights = job.inputs.lane.weights[number]
    return np.broadcast_to(weights, (int(job.clock.outputs) + 1, *weights.shape))


# --- SciPy ---------------------------------------------------------------------------------------


def with_scipy(job: Job, dense: bool = True, tolerance: float = RTOL) -> Positions:
    """`solve_ivp`, lane after lane."""
    times = output_times(job)
    return np.stack([scipy_lane(each, times, dense, tolerance) for each in fleets(job)])


def scipy_lane(
    lane: Fleet, times: np.ndarray, dense: bool, tolerance: float
) -> Float[np.ndarray, "times m 2"]:
    """One lane."""
    field, initial, atol = numpy_field(lane, dense), lane.initial.ravel(), tolerance * ATOL / RTOL
    solution = solve_ivp(field, times[[0, -1]], initial, t_eval=times, rtol=tolerance, atol=atol)
    if not solution.success:
        raise RuntimeError(solution.message)
    return solution.y.reshape(6, -1, len(times))[:2].T


def numpy_field(lane: Fleet, dense: bool) -> Callable[[float, np.ndarray], np.ndarray]:
    """`ẋ = f(t, x)` of the flattened state, all vehicles at once; plane vectors as complex numbers.

    With h = exp(iθ), n = ih: ψ_i⁻¹ ψ_j has the entries Re(conj(r_i) c_j), r = (h, n / v), c = (h, v
    n).
    """
    m, (k0, k1, k2), frequency = lane.initial.shape[1], lane.gain, lane.frequency
    harmonics = np.concatenate([lane.cosine, lane.sine])
    harmonics = harmonics[:, 0] + 1j * harmonics[:, 1]
    laplacian, inverse = lane.laplacian.astype(complex), lane.inverse.astype(complex)
    doubled = np.tile(lane.laplacian, (2, 2))
    rows, columns = np.empty((2, m), complex), np.empty((2, m), complex)

    def field(t: float, state: Any) -> np.ndarray:
        x, y, heading, speed, turn_rate, force = state.reshape(6, m)
        along, sideways, angle = np.exp(1j * heading), speed * turn_rate, frequency * t
        own = k0 * (x + 1j * y) + along * (
            k1 * speed
            + k2 * force
            - turn_rate * sideways
            + 1j * (k2 * sideways + 2.0 * turn_rate * force)
        )
        demand = np.concatenate([np.cos(angle), np.sin(angle)]) @ harmonics - laplacian @ own
        velocity = speed * along
        if dense:
            left = 1j * along
            columns[0], columns[1] = along, speed * left
            rows[0], rows[1] = along.conj(), left.conj() / speed
            mixing = doubled * (rows.reshape(2 * m, 1) * columns.reshape(2 * m)).real
            force_rate, turn = np.linalg.solve(mixing, (rows * demand).real.ravel()).reshape(2, m)
        else:
            jerk = along.conj() * (inverse @ demand)
            force_rate, turn = jerk.real, jerk.imag / speed
        return np.concatenate([velocity.real, velocity.imag, turn_rate, force, turn, force_rate])

    return field


# --- diffrax -------------------------------------------------------------------------------------


def with_diffrax(job: Job, dense: bool = True, tolerance: float = RTOL) -> Positions:
    """`jit(vmap(diffeqsolve))`, all lanes at once."""
    lanes = side_by_side(job)
    with jax.enable_x64(True):
        states = diffrax_lanes(lanes, output_times(job), dense, tolerance)
        return np.asarray(states)[:, :, :2].swapaxes(2, 3)


@functools.partial(jax.jit, static_argnames="dense")
def diffrax_lanes(lanes: Fleet, times: jax.Array, dense: bool, tolerance: float) -> jax.Array:
    """States (lanes, times, 6, m)."""

    def one(lane: Fleet) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(functools.partial(jax_field, dense=dense)),  # pyright: ignore[reportArgumentType]
            diffrax.Dopri5(),
            t0=times[0],
            t1=times[-1],
            dt0=None,
            y0=lane.initial,
            args=lane,
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance * ATOL / RTOL),
            max_steps=100_000,
        )
        return solution.ys

    return jax.vmap(one)(lanes)


def jax_field(t: Any, state: Any, lane: Fleet, dense: bool) -> jax.Array:
    """`ẋ = f(t, x)` of one lane, the state (6, m)."""
    heading, speed, turn_rate, force = (state[row : row + 1] for row in range(2, 6))
    k0, k1, k2 = lane.gain
    along = jnp.concatenate([jnp.cos(heading), jnp.sin(heading)])
    left = jnp.stack([-along[1], along[0]])
    velocity, acceleration = speed * along, force * along + speed * turn_rate * left
    drift = 2.0 * force * turn_rate * left - speed * turn_rate**2 * along
    own = k0 * state[:2] + k1 * velocity + k2 * acceleration + drift
    angle = lane.frequency * t
    received = jnp.tensordot(jnp.cos(angle), lane.cosine, 1) + jnp.tensordot(
        jnp.sin(angle), lane.sine, 1
    )
    demand = received - own @ lane.laplacian.T
    if dense:
        rows, columns = jnp.stack([along, left / speed]), jnp.stack([along, speed * left])
        mixing = jnp.einsum("axi,bxj,ij->aibj", rows, columns, lane.laplacian)
        right = jnp.einsum("axi,xi->ai", rows, demand)
        inputs = jnp.linalg.solve(mixing.reshape(right.size, -1), right.ravel()).reshape(
            right.shape
        )
    else:
        jerk = demand @ lane.inverse.T
        inputs = jnp.stack([(along * jerk).sum(axis=0), (left * jerk).sum(axis=0) / speed[0]])
    return jnp.concatenate([velocity, turn_rate, force, inputs[::-1]])


# --- GNU Octave ----------------------------------------------------------------------------------

OCTAVE = r"""
1;
function slope = field(t, state, p)
  s = reshape(state, [], 6);
  v = s(:, 4); w = s(:, 5); F = s(:, 6);
  along = exp(1i * s(:, 3)); left = 1i * along;
  own = p.gain(1) * (s(:, 1) + 1i * s(:, 2)) + p.gain(2) * v .* along ...
      + p.gain(3) * (F .* along + v .* w .* left) + 2 * F .* w .* left - v .* w .^ 2 .* along;
  angle = p.frequency * t;
  demand = p.cosine * cos(angle) + p.sine * sin(angle) - p.laplacian * own;
  rows = conj([along; left ./ v]); columns = [along; v .* left];
  u = (p.doubled .* real(rows * columns.')) \ real(rows .* [demand; demand]);
  slope = [real(v .* along); imag(v .* along); w; F; u(end / 2 + 1:end); u(1:end / 2)];
end
files = argv();
job = load(files{1});
options = odeset('RelTol', job.rtol, 'AbsTol', job.atol);
for n = 1:numel(job.fleets)
  p = job.fleets{n};
  [~, states] = ode45(@(t, state) field(t, state, p), job.times, p.initial, options);
  positions(n, :, :) = states(:, 1:end / 3);
end
save('-v6', files{2}, 'positions');
"""


def with_octave(job: Job) -> Positions:
    """`ode45` with the dense M, lane after lane; raises NotInstalledError without octave-cli."""
    program = shutil.which("octave-cli")
    if program is None:
        raise NotInstalledError("octave-cli")
    times = output_times(job)
    cells = np.empty(job.size, object)
    cells[:] = [octave_fleet(each) for each in fleets(job)]
    numbers = {"times": times, "rtol": RTOL, "atol": ATOL, "fleets": cells}
    with tempfile.TemporaryDirectory() as folder:
        script, given, found = (
            Path(folder) / name for name in ("peer.m", "job.mat", "positions.mat")
        )
        script.write_text(OCTAVE)
        savemat(given, numbers, oned_as="column")
        command = [program, "--quiet", "--norc", script, given, found]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        positions = loadmat(found)["positions"]
    return positions.reshape(job.size, len(times), 2, -1).swapaxes(2, 3)


def octave_fleet(lane: Fleet) -> dict[str, np.ndarray]:
    """A lane as Octave takes it: columns, vectors of the plane as complex numbers."""
    vectors = {name: getattr(lane, name) for name in ("cosine", "sine")}
    return {
        "initial": lane.initial.ravel(),
        "laplacian": lane.laplacian,
        "doubled": np.tile(lane.laplacian, (2, 2)),
        "gain": lane.gain,
        "frequency": lane.frequency,
        **{name: (each[:, 0] + 1j * each[:, 1]).T for name, each in vectors.items()},
    }


# --- by hand -------------------------------------------------------------------------------------


class ByHand(NamedTuple):
    """What the exact loop in C finds, of lanes of its own."""

    rate: float  # lanes per second
    tail_mean: float  # [m], mean over lanes
    share: float  # of lanes with a mean tail error over 0.1 m


def by_hand(job: Job) -> ByHand:
    """Lanes of the default study by `exact_loop.c`; raises NotInstalledError without a compiler."""
    command = [loop("exact_loop"), str(job.size), str(int(job.plan.decides))]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    return ByHand(*map(float, found.stdout.split()))


def nonlinear_by_hand(job: Job) -> Positions:
    """Lanes of the default study without attack by `nonlinear_loop.c`; raises as `by_hand`."""
    with tempfile.TemporaryDirectory() as folder:
        starts, found = Path(folder) / "starts", Path(folder) / "positions"
        side_by_side(job).initial.tofile(starts)
        command = [loop("nonlinear_loop"), str(job.size), starts, found]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        return np.fromfile(found).reshape(job.size, len(output_times(job)), -1, 2)


@functools.cache
def loop(name: str) -> Path:
    """A program in C, compiled for this machine; raises NotInstalledError without a compiler."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise NotInstalledError("gcc")
    program = Path(tempfile.mkdtemp()) / name
    source = Path(__file__).with_name(f"{name}.c")
    options = ["-O3", "-march=native", "-ffast-math", "-fopenmp", "-Wno-psabi"]
    subprocess.run([compiler, *options, source, "-o", program, "-lm"], check=True)
    return program
