"""Spaced values are the doubles that the decimal numbers would be, written one by one."""

from decimal import Decimal, localcontext
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

import jaxnet
from jaxnet.config.spacings import geomspace, linspace, multiples

BOUNDS = st.decimals(-1000, 1000, allow_nan=False, places=3).map(float)


def test_a_spacing_is_the_list_that_somebody_writes():
    assert linspace(0.1, 1.1, 11) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1]
    assert linspace(-1e308, 1e308, 3) == [-1e308, 0.0, 1e308]
    assert linspace(0.7, 5.0, 1) == [0.7]
    assert geomspace(1e-3, 1e3, 7) == [1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0]
    assert geomspace(1e-300, 1e300, 3) == [1e-300, 1.0, 1e300]


@given(BOUNDS, BOUNDS, st.integers(2, 40))
def test_each_value_is_the_nearest_double(low, high, count):
    """No neighbour is nearer to `low + k (high - low)/(count - 1)` of the decimal bounds."""
    first, last = Fraction(repr(low)), Fraction(repr(high))
    exact = [first + k * (last - first) / (count - 1) for k in range(count)]
    assert linspace(low, high, count) == [float(each) for each in exact]


@given(BOUNDS.filter(lambda low: low > 0), BOUNDS.filter(lambda high: high > 0), st.integers(2, 40))
def test_each_value_of_a_geometric_row_is_the_nearest_double(low, high, count):
    """To `low (high/low)^(k/(count - 1))`, products of the ratio's power of 60 digits."""
    first, last = Decimal(repr(low)), Decimal(repr(high))
    with localcontext(prec=60):
        ratio = (last / first) ** (1 / Decimal(count - 1))
        products = [first * ratio**k for k in range(count)]
    assert geomspace(low, high, count) == [float(each) for each in products]


def test_a_spacing_and_a_list_share_their_cells():
    """So `compare` pairs them, and tables find 0.3."""

    def labels(values):
        study = jaxnet.load({"sweep": {"attack.magnitude": values}})
        return [cell.labels["attack.magnitude"] for cell in study.cells]

    assert {0.1, 0.3, 0.7} <= {*labels({"linspace": [0.1, 1.1, 11]})}
    assert labels({"linspace": [0, 4, 3]}) == [0, 2, 4]


def test_multiples_are_what_a_reader_writes():
    """`k` steps of 0.01 are the doubles that 0.00, 0.01, … print as."""
    times = multiples(0.01, range(1001))
    assert times == [float(f"{k // 100}.{k % 100:02d}") for k in range(1001)]
    assert sum(k * 0.01 != time for k, time in enumerate(times)) == 129
