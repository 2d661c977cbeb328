"""Why the guarantees need each assumption: drop it, and some lane ends off (docs/guarantees.md).

The first table takes the assumptions of the announced score in turn, on four vehicles where 1 and 2
hear each other, 3 and 4. The second asks the ring which scores a smooth attack can pass, and what a
filter changes. The third measures what an attack can do between two ticks, which the theorem bounds
by `γ Λ h`.

Run it with `python experiments/counterexamples.py`; with `--samples 20` to try it.
"""

from typing import Any

import click
import jax.numpy as jnp
import numpy as np

import jaxnet
from jaxnet.kinds.attacks import Attack, harmonic_sizes, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle
from jaxnet.kinds.registry import find
from jaxnet.model.signal import Harmonic
from jaxnet.runs.cache import enable

MAGNITUDE = 10.0  # ā [m]
OFF = 0.01  # of ā, over which a lane is off
LIAR = 4


class Harmonics(Attack):
    """`Re Σ_k c_k e^{ikωt}` along a direction and its `Im` across: smooth, with all derivatives."""

    frequency: float = 1.0  # ω [rad/s]
    real: list[float]  # parts of c_0, c_1, …
    imaginary: list[float]
    across: float = 1.0  # 0 leaves the sum on a line
    direction: Angle = FULL_TURN

    def terms(self) -> list[Any]:
        """Parts of a coefficient, (lanes,) each, with its frequency."""
        rates = (k * self.frequency for k in range(len(self.real)))
        return list(zip(self.real, self.imaginary, rates, strict=True))

    def basis(self, time: Any) -> Any:
        """Real and imaginary part."""
        turning = [(re, im, Harmonic(rate).basis(time)) for re, im, rate in self.terms()]
        return sum(
            re[None, None] * each + im[None, None] * jnp.stack([-each[:, 1], each[:, 0]], axis=1)
            for re, im, each in turning
        )

    def vectors(self) -> np.ndarray:
        """The direction, and what is a quarter turn on."""
        cosine, sine = unit_vectors(self.direction)
        across = np.stack([-sine, cosine]) * self.across
        return np.stack([np.stack([cosine, sine]), across], axis=2)

    def sizes(self, horizon: float) -> np.ndarray:
        """The sums of what the harmonics come to, or more."""
        each = [
            np.hypot(re, im) * harmonic_sizes(np.atleast_1d(rate)) for re, im, rate in self.terms()
        ]
        return np.sum(each, axis=0)


def operator(frequency: float) -> complex:
    """R(iω) at gain (1, 3, 3)."""
    return (1 + 1j * frequency) ** 3


def between_ticks(tick: float, size: float = MAGNITUDE) -> Harmonics:
    """One whose `R(a) = 1 - cos(2πt/h)`, but for its size, is 0 at every tick."""
    turn = 2 * np.pi / tick
    part = -1 / operator(turn)
    numbers: dict[str, Any] = {"real": [1.0, part.real], "imaginary": [0.0, part.imag]}
    return Harmonics(magnitude=size, vehicles=[LIAR], frequency=turn, across=0.0, **numbers)


PAIRS = [[1, 2], [1, 3], [1, 4], [2, 1], [2, 3], [2, 4], [3, 0], [4, 0]]
ANNOUNCED: dict[str, Any] = {"kind": "trusted_trim", "score": "announced", "theta": {1: 1, 2: 1}}
BIAS: dict[str, Any] = {
    "kind": "bias",
    "magnitude": MAGNITUDE,
    "vehicles": [LIAR],
    "direction": {"uniform": [0, 6.28]},
}
TICK = 0.1
TICKS = 0.2, 0.1, 0.05, 0.025

TRUSTING = {**ANNOUNCED, "trusted": {1: [2], 2: [1]}, "theta": {1: 2, 2: 2}}
UNJOINED = {
    "topology": [[1, 0], [2, 1], [2, 3], [3, 1], [3, 2], [4, 0], [4, 1], [4, 2]],
    "defence": {**ANNOUNCED, "theta": {2: 1, 3: 1}, "first_announcement": 0.0},
}

# What is dropped, and what differs from the network, defence and attack above, which nobody fails.
ASSUMPTIONS: list[tuple[str, dict[str, Any]]] = [
    ("none", {}),
    ("A1: two bad links, ϑ = 1", {"attack": {**BIAS, "vehicles": [3, 4], "direction": 0.0}}),
    ("A2: the bad link is trusted", {"defence": {**ANNOUNCED, "trusted": {1: [4]}}}),
    ("A1: ϑ = 3, so that nobody trims", {"defence": {**ANNOUNCED, "theta": {1: 3, 2: 3}}}),
    ("A3: 1 and 2 trust each other, ϑ = 2", {"defence": TRUSTING}),
    ("A3: 2 and 3 may both drop 1", UNJOINED),
    ("B1: the liar announces 0", {"attack": {**BIAS, "announces": "zero"}}),
    ("B1: the liar announces honestly", {"attack": {**BIAS, "announces": "honest"}}),
    ("B2: R(a) is 0 at every tick", {"attack": between_ticks(TICK)}),
]


def orbit(frequency: float) -> Harmonics:
    """Constant plus turning: `P(a)` circles through the origin; once a turn it is 0, not R(a)."""
    turning = 1 / frequency**3
    constant = abs(operator(frequency) - (1j * frequency) ** 3) * turning
    return Harmonics(
        magnitude=MAGNITUDE, frequency=frequency, real=[constant, turning], imaginary=[0.0, 0.0]
    )


def cusp(frequency: float) -> Harmonics:
    """`(1 - e^{iωt})³`: position, velocity and acceleration are 0 once a turn, jerk is not."""
    real = [1.0, -3.0, 3.0, -1.0]
    return Harmonics(magnitude=MAGNITUDE, frequency=frequency, real=real, imaginary=[0.0] * 4)


SINUSOID: dict[str, Any] = {"kind": "sinusoid", "magnitude": MAGNITUDE, "frequency": 16.0}
SCORES: list[tuple[str, dict[str, Any]]] = [
    ("jets", {"score": "jets"}),
    ("feedback", {"score": "feedback"}),
    ("feedback, low-pass of 1 s", {"score": "feedback", "filter": 1.0}),
    ("announced", {"score": "announced"}),
    ("announced; the liar announces 0", {"score": "announced", "announces": "zero"}),
    ("announced; honestly", {"score": "announced", "announces": "honest"}),
]
SIGNALS: list[tuple[str, Any]] = [
    ("rotating, 16 rad/s", {**SINUSOID, "kind": "rotating"}),
    ("sinusoid, 16 rad/s", SINUSOID),
    ("circle through 0 of P(a), 16 rad/s", orbit(16.0)),
    ("(1 - e^(iωt))³, 4 rad/s", cusp(4.0)),
    ("third derivative alone", {**BIAS, "kind": "spoof", "orders": [3], "vehicles": [2, 5, 8, 11]}),
]


def pair(**keys: Any) -> jaxnet.Study:
    """The four vehicles, with what differs."""
    edges = keys.pop("topology", PAIRS)
    study: dict[str, Any] = {"attack": BIAS, "defence": ANNOUNCED, "tick": TICK, **keys}
    topology = {"kind": "edges", "edges": [[*edge, 1.0] for edge in edges]}
    return lanes_of(vehicles=4, horizon=60.0, tail=4.0, topology=topology, output_step=0.4, **study)


def ring(attack: Any, score: dict[str, Any], tick: float) -> jaxnet.Study:
    """The paper's ring of twelve with this score; `announces` is a key of the attack."""
    score = {**score}
    announces = score.pop("announces", "consistent")
    if isinstance(attack, dict):
        attack = {**attack, "announces": announces}
    else:
        attack = attack.model_copy(update={"announces": find("announcement", announces)()})
    return lanes_of(
        horizon=90.0,
        tail=5.0,
        output_step=0.5,
        tick=tick,
        attack=attack,
        defence={"kind": "trusted_trim", **score},
    )


def lanes_of(**keys: Any) -> jaxnet.Study:
    """A study by the exact engine."""
    return jaxnet.load({"name": "counterexamples", "engine": "exact", **keys})


def outcome(study: jaxnet.Study, samples: int) -> tuple[float, float, float]:
    """Shares of lanes disconnected and of lanes that end off; a vehicle's greatest error over ā."""
    lanes = jaxnet.simulate(study, samples=samples).lanes
    cut, worst = (
        lanes["status"].to_numpy() == "disconnected",
        lanes["tail_max"].to_numpy() / MAGNITUDE,
    )
    return cut.mean(), (worst > OFF).mean(), np.nanmax(worst, initial=0.0)


@click.command()
@click.option("--samples", default=400, show_default=True, help="Lanes of each line.")
def main(samples: int) -> None:
    """Three tables."""
    enable()
    print(f"{'dropped':54} disconnected     off   worst error / ā")
    for name, keys in ASSUMPTIONS:
        cut, off, worst = outcome(pair(**keys), samples)
        print(f"{name:54} {cut:12.1%} {off:7.1%} {worst:17.3g}", flush=True)
    print(f"\n{'attack on the ring':36} {'score':32} {'tick':>6}     off   worst error / ā")
    for name, attack in SIGNALS:
        for label, score in SCORES:
            for tick in (0.05, 0.0125):
                _, off, worst = outcome(ring(attack, score, tick), samples)
                print(f"{name:36} {label:32} {tick:6} {off:7.1%} {worst:17.3g}", flush=True)
    print("\nR(a) = 0 at every tick, Λ held\ntick [s]   Λ h / ā   worst error / ā")
    for tick in TICKS:
        size = MAGNITUDE * tick / TICKS[0]
        study = pair(attack=between_ticks(tick, size), tick=tick)
        print(
            f"{tick:8} {2 * np.pi * size / MAGNITUDE:9.4g} {outcome(study, 20)[2]:17.4g}",
            flush=True,
        )


if __name__ == "__main__":
    main()
