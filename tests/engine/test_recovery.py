"""What trimming does not save: the share of lanes that three independent programs have found (SCIENCE O6)."""

from experiments import agreement


def test_trimming_leaves_the_known_share_of_lanes_unrecovered():
    """Cyclic, rotating attack of 10 m, 90 s: 4 to 9 % of 2,000 lanes stay over a hundredth of it."""
    assert 0.04 <= agreement.unrecovered(2000) <= 0.09
