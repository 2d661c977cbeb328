"""A random number belongs to (seed, name, sample, vehicle, component), and to nothing else."""

import numpy as np
import pytest
from scipy import stats

from jaxnet.study import config
from jaxnet.study.draws import draw
from tests import systems


def test_a_draw_does_not_depend_on_who_is_drawn_beside_it():
    """Not on the number of samples, nor on which vehicles or components are drawn."""
    uniform = config.Uniform(uniform=[-1.0, 1.0])
    whole = draw(uniform, 7, "initial.position", range(600), range(1, 13), 2)
    part = draw(uniform, 7, "initial.position", [599, 3], [12, 2], 1)
    np.testing.assert_array_equal(part[:, :, 0], whole[[599, 3]][:, [11, 1], 0])


def test_seed_name_sample_vehicle_and_component_each_matter():
    """All draws of several keys are different numbers."""
    uniform = config.Uniform(uniform=[0.0, 1.0])
    drawn = [
        draw(uniform, seed, name, range(50), range(1, 13), 2)
        for seed in (0, 1, 2**40)
        for name in ("initial.position", "initial.speed")
    ]
    assert len(np.unique(drawn)) == np.size(drawn)


@pytest.mark.parametrize(
    ("number", "distribution"),
    [
        (config.Uniform(uniform=[2.0, 5.0]), stats.uniform(2, 3)),
        (config.Normal(normal=[1.0, 2.0]), stats.norm(1, 2)),
    ],
)
def test_draws_follow_their_distribution(number, distribution):
    """Kolmogorov and Smirnov, 20,000 draws."""
    values = draw(number, 0, "attack.magnitude", range(20_000), [0])[:, 0, 0]
    assert stats.kstest(values, distribution.cdf).pvalue > 1e-3


def test_a_choice_takes_each_value_alike():
    """Chi-squared, 20,000 draws of three values."""
    values = draw(config.Choice(choice=[1.0, 5.0, 9.0]), 0, "attack.magnitude", range(20_000), [0])
    listed, counts = np.unique(values, return_counts=True)
    assert listed.tolist() == [1.0, 5.0, 9.0]
    assert stats.chisquare(counts).pvalue > 1e-3


def test_a_draw_is_the_inverse_cdf_of_one_uniform_number():
    """Distributions of the same quantity are monotone in each other: common random numbers."""
    place = (3, "attack.magnitude", range(100), [0])
    uniform = draw(config.Uniform(uniform=[0.0, 1.0]), *place)[:, 0, 0]
    normal = draw(config.Normal(normal=[0.0, 1.0]), *place)[:, 0, 0]
    np.testing.assert_allclose(stats.norm.cdf(normal), uniform, atol=1e-12)


def test_cells_share_their_draws():
    """Sample s starts alike and is attacked in the same phase whatever is swept."""
    sweep = {"attack.magnitude": [1, 9], "gain": [[1, 3, 3], [6, 11, 6]]}
    cells = [one.inputs.lane for one in systems.lanes(systems.study(sweep=sweep), 3).jobs]
    initial = [lane.initial for lane in cells]
    phases = [np.arctan2(*lane.attack.cosine.swapaxes(0, 1)[::-1]) for lane in cells]
    for cell in range(1, 4):
        np.testing.assert_array_equal(initial[cell], initial[0])
        np.testing.assert_allclose(phases[cell], phases[0], atol=1e-14)
    assert not np.array_equal(initial[0][0], initial[0][1])


def test_initial_states_are_in_their_ranges():
    """SCIENCE, section 1: positions, headings, speeds, and ω = F = 0."""
    initial = systems.lanes(systems.study(), 200).inputs.lane.initial
    for column, (low, high) in enumerate([(-200, 200), (-200, 200), (-np.pi, np.pi), (0.2, 0.4)]):
        assert low <= initial[:, column].min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < initial[:, column].max() <= high
    assert not initial[:, 4:].any()
