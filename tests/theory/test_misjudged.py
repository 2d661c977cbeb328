"""How likely trust misjudges: tables, closed forms, and what runs show."""

import math

import numpy as np
import pytest
from scipy.stats import binom

import jaxnet
from jaxnet.kinds.fields import DiscreteChoice, Uniform
from jaxnet.theory.misjudged import below_half
from jaxnet.view.text.check import check_text
from tests import systems

TICKS = (1, 2, 5, 10, 20, 50, 100)
TABLE = {  # honest sources dropped, liars kept, after these ticks
    0.8: (
        [0.2, 0.04, 0.05792, 0.00636938, 0.00056341, 4.9e-7],
        [0.2, 0.36, 0.05792, 0.03279350, 0.00259483, 2.09e-6],
    ),
    0.6: (
        [0.4, 0.16, 0.31744, 0.16623862, 0.12752125, 0.05734376, 0.01676169],
        [0.4, 0.64, 0.31744, 0.36689674, 0.24466280, 0.09780736, 0.02709920],
    ),
}
UNIFORM = {1: 0.375, 5: 0.1717478434, 10: 0.0867211958, 20: 0.0261748763, 50: 0.0010276956}
UNIFORM |= {100: 6.3421e-6}


@pytest.mark.parametrize("p", TABLE)
def test_tables_of_misjudgement(p):
    """Yemini et al. 2022, to the digits given, and the binomial distribution."""
    dropped, kept = TABLE[p]
    for t, honest, liar in zip(TICKS, dropped, kept, strict=False):
        assert below_half(p, t) == pytest.approx(honest, abs=5e-9)
        assert 1 - below_half(1 - p, t) == pytest.approx(liar, abs=5e-9)
        assert below_half(p, t) == pytest.approx(binom.cdf((t - 1) // 2, t, p), abs=1e-12)


@pytest.mark.parametrize(("t", "known"), UNIFORM.items())
def test_uniform_observations(t, known):
    """α uniform on [0.35, 0.75], of an honest source; below the bound."""
    found = below_half(Uniform(uniform=[0.35, 0.75]), t)
    assert found == pytest.approx(known, abs=5e-11)
    assert found <= math.exp(-2 * t * 0.05**2)


def test_listed_observations_are_counted_exactly():
    """Three values with ties at one half: all sums of five, one by one."""
    values, below = [0.1, 0.6, 0.8], 0
    for each in np.ndindex(3, 3, 3, 3, 3):
        below += sum(round(10 * values[k]) for k in each) < 25
    assert below_half(DiscreteChoice(choice=values), 5) == pytest.approx(below / 3**5, abs=1e-12)
    assert below_half(Uniform(uniform=[0.7, 0.7]), 3) == 0
    assert below_half(Uniform(uniform=[0.5, 0.5]), 3) == 0  # ties trust


def test_check_tells_exact_probabilities_and_the_bound():
    """At the first motion too; beyond a thousand observations the bound alone."""
    keys = {"name": "x", "defence": {"kind": "trust", "observation": "random"}, "tick": 0.1}
    told = " ".join(check_text(jaxnet.load(keys | {"horizon": 300.0})).split())
    assert "0.2, 0.2 (at most 0.8353, 0.8353) after 1 observation;" in told
    assert "0.006369, 0.03279 (at most 0.1653, 0.1653) after 10" in told
    assert "; at most 3.027e-235, 3.027e-235 after 3000" in told
    defence = keys["defence"] | {"observed": {"honest": {"uniform": [0.35, 0.75]}, "liar": 0.4}}
    keys |= {"defence": defence | {"wait": 0.9}, "law": "local", "vehicle": "single_integrator"}
    told = " ".join(
        check_text(jaxnet.load(keys | {"horizon": 2.0, "tail": 1.0, "gain": [1.0]})).split()
    )
    assert "0.08672, 0.3669 (at most 0.9512, 0.8187) after 10" in told
    assert "0.02617, 0.2447 (at most 0.9048, 0.6703) after 20" in told
    assert "nothing is known of its stability: the defence holds vehicles to their starts" in told
    assert "misjudged" not in check_text(jaxnet.load({"name": "x", "defence": "trust"}))


OBSERVED = [
    {"accuracy": 0.8},
    {"observed": {"honest": 0.6, "liar": 0.3}},
    {"observed": {"honest": {"uniform": [0.35, 0.75]}, "liar": {"choice": [0.2, 0.2, 0.9]}}},
]


@pytest.mark.parametrize(
    "keys", [OBSERVED[2], *(pytest.param(k, marks=pytest.mark.long) for k in OBSERVED[:2])], ids=str
)
def test_runs_misjudge_as_often(keys):
    """Retained links of 12 vehicles that all hear each other, four of them liars, in 100 lanes.

    Five standard deviations; each vehicle has eight honest sources or more, so that it never drops
    all.
    """
    study = systems.study(
        topology="complete",
        navigator="none",
        law="local",
        vehicle="single_integrator",
        gain=[0.1],
        attack={"kind": "bias", "vehicles": [1, 2, 3, 4]},
        defence={"kind": "trust", "observation": "random", "trusted": "none", **keys},
        engine="exact",
        tick=1.0,
        output_step=1.0,
        horizon=9.0,
        tail=1.0,
    )
    kept = systems.simulate(systems.lanes(study, 100)).series["kept"][..., 1:] > 0
    honest, liar, _ = study.cells[0].scenario.defence.observes() or (0.0, 0.0, 0.0)
    others = ~np.eye(12, dtype=bool)
    for t in (1, 2, 5, 10):
        known = below_half(honest, t), 1 - below_half(liar, t)
        links = ~kept[:, t - 1, :, 4:][:, others[:, 4:]], kept[:, t - 1, :, :4][:, others[:, :4]]
        for rate, p in zip(links, known, strict=True):
            assert abs(rate.mean() - p) < 5 * math.sqrt(p * (1 - p) / rate.size)


@pytest.mark.long
def test_accuracy_is_a_shorthand():
    """Equal rows, to the last bit."""
    keys = {"engine": "exact", "horizon": 4.0, "tail": 1.0, "seed": 3}
    each = [
        jaxnet.simulate(
            {**keys, "defence": {"kind": "trust", "observation": "random", **given}},
            samples=4,
            progress=False,
        ).lanes.drop(columns="cell")
        for given in ({"accuracy": 0.8}, {"observed": {"honest": 0.8, "liar": 0.2}})
    ]
    assert each[0].equals(each[1])
