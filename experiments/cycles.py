"""Small random digraphs with vehicles that announce nothing yet do not reach the navigator.

Theorem 1 of docs/guarantees.md says of a set S, which may hear outsiders, that its announcements
vanish. It was once taken to say that E vanishes too. Here every vehicle announces and trims, liars
carry constants of either sign along a line and announce what they carry, and weights are small
whole numbers. In each round a vehicle drops the ϑ_i greatest |r|, announces the mean of the rest,
and the motion has X = R(E) from the same weights, X = Ã X + B c. So no lane is simulated: X is
exact.

The table counts, among digraphs, those in which a vehicle runs through a cycle for good, and those
in which the mean of X over a cycle is not the mean of what the vehicle announces. Each of these
makes a counterexample: relays average the announcements over one cycle, a constant liar cancels the
average, and a vehicle of S retains the sum, which announces 0 and moves. The script builds one from
the digraph whose counterexample has the greatest error, and has the exact engine simulate it.

The last columns look at vehicles that are safe by majority, whose sets hear no outsider: how many
there are, of how many somebody else is cut off, so that the law of the fleet is singular, and how
many of the others are off. Theorem 3 says none. A search then chooses the directions of the
constants that drive the last vehicle farthest.

Run it with `python experiments/cycles.py`; with `--digraphs 2000` to try it.
"""

from typing import Any, NamedTuple

import click
import numpy as np

import jaxnet
from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.kinds.metrics import Metric
from jaxnet.runs.cache import enable

ROUNDS, WINDOW = 240, 120  # rounds in all, and the last of them, in which a cycle is looked for
LONGEST = 24  # rounds of a cycle that is counted
SHORT = 6  # rounds of a cycle that a counterexample is built from
HEARD = 0.8  # weight of the sum at the vehicle of S, where it retains the sum
MOVES = 1e-3  # of the liars' constant: an X or a difference of means that is counted
SETTLED = 1e-9  # of the liars' constant: announcements that have vanished
BATCH = 2_000
MAGNITUDE = 10.0  # ā [m]
SEARCH: dict[str, Any] = {
    "over": {"attack.direction": {"each": [0.0, 6.283]}},
    "maximise": "last_vehicle",
}


def of_last(seen: Any) -> Any:
    """Error of the last vehicle, 0 for the others: (m, lanes) [m]."""
    errors = seen.errors()
    return errors.at[:-1].set(0.0)


LAST = Metric(
    "last_vehicle", "m", of_last, "tail", "max", "max", "greatest error of the last vehicle"
)


class Digraphs(NamedTuple):
    """Random networks of m vehicles: weights (n, m, m + 1), ϑ (n, m), what liars carry (n, m)."""

    weights: np.ndarray
    theta: np.ndarray
    carried: np.ndarray

    def one(self, number: int) -> "Digraphs":
        """One of them."""
        return Digraphs(*(each[number : number + 1] for each in self))


def drawn(rng: np.random.Generator, number: int, vehicles: int) -> Digraphs:
    """Digraphs that the navigator reaches if nobody is dropped, with one or two liars."""
    shape = number, vehicles, vehicles + 1
    heard = rng.random(shape) < rng.uniform(0.2, 0.6, (number, 1, 1))
    heard[:, range(vehicles), range(1, vehicles + 1)] = False
    weights = heard * rng.integers(1, 6, shape)
    weights[:, :, 0] *= rng.random((number, vehicles)) < 0.5
    theta = (rng.random((number, vehicles)) < 0.5).astype(int)
    liars = rng.random((number, vehicles)).argsort(axis=1) < rng.integers(1, 3, (number, 1))
    carried = liars * rng.choice([-1.0, 1.0], (number, vehicles))
    reached = np.zeros((number, vehicles + 1), bool)
    reached[:, 0] = True
    for _ in range(vehicles):
        reached[:, 1:] |= ((weights > 0) & reached[:, None]).any(axis=2)
    whole = reached.all(axis=1)
    return Digraphs(weights[whole].astype(float), theta[whole], carried[whole])


def kept_of(given: Digraphs, received: np.ndarray) -> np.ndarray:
    """Weights in force: a vehicle that hears more than ϑ sources drops the ϑ greatest vehicles."""
    heard = given.weights > 0
    score = np.where(heard, np.abs(received), -1.0)
    score[:, :, 0] = -1.0  # the navigator is trusted
    worst = score.argmax(axis=2)
    drops = (given.theta > 0) & (heard.sum(axis=2) > 1) & (score.max(axis=2) >= 0)
    kept = given.weights.copy()
    n, i = np.nonzero(drops)
    kept[n, i, worst[n, i]] = 0.0
    return kept / kept.sum(axis=2, keepdims=True)


def histories(given: Digraphs, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Announcements ρ and drives X in the last rounds, (WINDOW, n, m); NaN if any is cut off."""
    told, vehicles = first, given.theta.shape[1]
    lies = np.append(np.zeros((len(told), 1)), given.carried, axis=1)[:, None]
    announced, moved = [], []
    for number in range(ROUNDS):
        received = np.append(np.zeros((len(told), 1)), told, axis=1)[:, None] + lies
        kept = kept_of(given, np.broadcast_to(received, given.weights.shape))
        told = (kept * received).sum(axis=2)
        if number >= ROUNDS - WINDOW:
            system = np.eye(vehicles) - kept[:, :, 1:]
            regular = np.abs(np.linalg.det(system)) > 1e-9
            system[~regular] = np.eye(vehicles)
            drive = np.linalg.solve(system, (kept * lies).sum(axis=2)[..., None])[..., 0]
            announced.append(told)
            moved.append(np.where(regular[:, None], drive, np.nan))
    return np.array(announced), np.array(moved)


def period_of(announced: np.ndarray) -> np.ndarray:
    """Rounds after which all announcements of a digraph repeat, 0 if none up to LONGEST: (n,)."""
    found = np.zeros(announced.shape[1], int)
    for period in range(LONGEST, 0, -1):
        repeats = np.abs(announced[period:] - announced[:-period]).max(axis=(0, 2)) < 1e-9
        found[repeats] = period
    return found


def unlike(announced: np.ndarray, moved: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Mean of X less mean of ρ over a cycle, of each vehicle: (n, m), 0 where there is no cycle."""
    apart = np.zeros(announced.shape[1:])
    for each in np.unique(period[period > 1]).tolist():
        here = period == each
        apart[here] = np.mean(moved[-each:, here] - announced[-each:, here], axis=0)
    return np.nan_to_num(apart)


class Found(NamedTuple):
    """A digraph with a cycle; a vehicle whose mean motion differs from its mean announcement."""

    digraph: Digraphs
    vehicle: int
    period: int
    average: float  # of what the vehicle announces
    apart: float  # mean of X less that average

    @property
    def constant(self) -> float:
        """Sum of what the vehicle transmits over one cycle, which the canceller has to undo."""
        return self.period * (self.average + float(self.digraph.carried[0, self.vehicle]))

    @property
    def error(self) -> float:
        """Error per ā of the vehicle of S that retains the sum at every tick."""
        return HEARD * self.period * abs(self.apart) / (self.period + abs(self.constant))


def survey(vehicles: int, number: int, seed: int) -> tuple[dict[str, int], Found | None]:
    """Counts over digraphs of so many vehicles, and the one with the strongest cycle of use."""
    rng, best = np.random.default_rng([seed, vehicles]), None
    counts: dict[str, int] = dict.fromkeys(
        ("digraphs", "cycles", "unlike", "majority", "cut off", "off"), 0
    )
    while counts["digraphs"] < number:
        given = drawn(rng, BATCH, vehicles)
        announced, moved = histories(given, rng.normal(size=given.theta.shape))
        period = period_of(announced)
        apart = unlike(announced, moved, period)
        safe, off = majority(given), np.abs(moved[-1])
        counts["digraphs"] += len(period)
        counts["cycles"] += int((period > 1).sum())
        counts["unlike"] += int(np.any(np.abs(apart) > MOVES, axis=1).sum())
        counts["majority"] += int(safe.sum())
        whole = np.all(np.isfinite(moved), axis=(0, 2))[:, None]
        counts["cut off"] += int((safe & ~whole).sum())
        counts["off"] += int((safe & whole & (off >= SETTLED)).sum())
        everybody = joined(given.weights > 0, given.theta, np.ones_like(safe)).all(axis=1)
        useful = np.flatnonzero((np.abs(apart) > MOVES).any(axis=1) & everybody)
        for n in useful[period[useful] <= SHORT].tolist():
            i, cycle = int(np.abs(apart[n]).argmax()), int(period[n])
            average = float(announced[-cycle:, n, i].mean())
            this = Found(given.one(n), i, cycle, average, float(apart[n, i]))
            if best is None or this.error > best.error:
                best = this
    return counts, best


def joined(heard: np.ndarray, bears: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Vehicles that some vehicles keep joined to the navigator, whoever is dropped (A3): (n, m)."""
    reached = np.append(np.ones((len(heard), 1), bool), np.zeros_like(among), axis=1)
    for _ in range(among.shape[1]):
        near = heard & reached[:, None]
        reached[:, 1:] |= among & (near[:, :, 0] | (near.sum(axis=2) > bears))
    return reached[:, 1:]


def majority(given: Digraphs) -> np.ndarray:
    """Vehicles in the greatest set that hears nobody outside and meets A1 to A3: (n, m)."""
    heard = given.weights > 0
    sources = heard.sum(axis=2)
    bears = np.where(sources > given.theta, given.theta, 0)
    liars = np.append(np.zeros((len(heard), 1), bool), given.carried != 0, axis=1)
    inside = (heard & liars[:, None]).sum(axis=2) <= bears
    while True:
        outside = np.append(np.zeros((len(heard), 1), bool), ~inside, axis=1)
        left = inside & ~(heard & outside[:, None]).any(axis=2)
        left &= joined(heard, bears, left)
        if (left == inside).all():
            return left
        inside = left


def counterexample(found: Found) -> dict[str, Any]:
    """Study of a counterexample; the last vehicle is the one of S.

    Relays average what the found vehicle transmits over one cycle. A liar cancels the average. The
    last vehicle hears the sum, an honest vehicle and the navigator.
    """
    given, i, period = found.digraph, found.vehicle + 1, found.period
    m, constant = given.theta.shape[1], found.constant
    edges = [
        [int(a) + 1, int(b), float(given.weights[0, a, b])]
        for a, b in np.argwhere(given.weights[0] > 0).tolist()
    ]
    relays = list(range(m + 1, m + period))
    edges += [[new, old, 1.0] for new, old in zip(relays, [i, *relays], strict=False)]
    canceller, honest, summing, safe = range(m + period, m + period + 4)
    edges += [[summing, source, 1.0] for source in [i, *relays]]
    edges += [
        [canceller, 0, 1.0],
        [honest, 0, 1.0],
        [safe, 0, 1.0],
        [safe, honest, 4.0],
        [safe, summing, 4.0],
    ]
    edges += [[summing, canceller, abs(constant)]] * (constant != 0)
    signs = {int(n) + 1: given.carried[0, n] for n in np.flatnonzero(given.carried[0])}
    signs |= {canceller: -np.sign(constant)}
    theta = {n: 1 for n, most in enumerate(given.theta[0], 1) if most} | {safe: 1}
    return {
        "name": "cycle",
        "vehicles": safe,
        "engine": "exact",
        "horizon": 60.0,
        "output_step": 0.5,
        "topology": {"kind": "edges", "edges": edges},
        "attack": {
            "kind": "bias",
            "vehicles": list(signs),
            "direction": [0.0 if sign > 0 else float(np.pi) for sign in signs.values()],
            "magnitude": MAGNITUDE,
        },
        "defence": {"kind": "trusted_trim", "score": "announced", "theta": theta, "noise": 1e-6},
        "metrics": [LAST],
    }


@click.command()
@click.option("--digraphs", default=100_000, show_default=True, help="Of each size.")
@click.option("--seed", default=0, show_default=True, help="Of the digraphs.")
@click.option("--budget", default=4_000, show_default=True, help="Lanes of the search.")
def main(digraphs: int, seed: int, budget: int) -> None:
    """The table, the counterexample, and a search on it."""
    enable()
    strongest: Found | None = None
    print("vehicles   digraphs     cycles  X unlike ρ  by majority    cut off        off")
    for vehicles in (3, 4, 5, 6, 7):
        counts, found = survey(vehicles, digraphs, seed)
        print(f"{vehicles:8}" + "".join(f" {number:10,}" for number in counts.values()), flush=True)
        if found and (strongest is None or found.error > strongest.error):
            strongest = found
    if strongest is None:
        return
    keys = counterexample(strongest)
    study = jaxnet.load(keys)
    scenario = study.cells[0].scenario
    known, last = situation_of(scenario), scenario.vehicles
    certified = any(
        each.vehicles[last - 1] for each in safe_in(scenario, known.graph, known.attacked)
    )
    off = jaxnet.simulate(study, samples=100).lanes["last_vehicle"].to_numpy() / MAGNITUDE
    print(
        f"\n{last} vehicles, a cycle of {strongest.period} rounds;"
        f" vehicle {last} certified safe: {certified}"
    )
    print(f"vehicle {last} off by {off.min():.4f} to {off.max():.4f} ā in 100 lanes;", end=" ")
    print(f"{strongest.error:.4f} ā if the vehicle retained the sum at every tick")
    attack = {key: each for key, each in keys["attack"].items() if key != "direction"}
    searched = jaxnet.load(keys | {"attack": attack, "search": SEARCH | {"budget": budget}})
    worst = jaxnet.search(searched, fresh=True).worst
    print(
        "searched over all directions of the constants:"
        f" {worst['last_vehicle'].max() / MAGNITUDE:.2g} ā"
    )


if __name__ == "__main__":
    main()
