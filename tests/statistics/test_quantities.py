"""Quantities of cells: intervals that hold, statistics as one would compute them from the rows."""

import numpy as np
import pytest

import jaxnet
from jaxnet.statistics.quantities import (
    asked_quantity,
    known_quantities,
    quantity_of,
)
from jaxnet.store.folder import FolderError


@pytest.fixture(scope="module")
def results():
    """Two cells of twenty lanes, one attacked."""
    keys = {
        "engine": "exact",
        "horizon": 10.0,
        "tail": 2.0,
        "vehicles": 3,
        "attack": {"vehicles": [2]},
    }
    keys |= {"samples": 20, "recovery": {"tau": 0.5}, "defence": "none"}
    return jaxnet.simulate(keys | {"sweep": {"attack.magnitude": [0, 20]}}, progress=False)


STATISTICS = {
    "median": np.median,
    "max": np.max,
    "mean": np.mean,
    "q05": lambda lanes: np.quantile(lanes, 0.05),
}


@pytest.mark.parametrize(
    "name", ["tail_max", "tail_max_median", "min_speed_q05", "peak_error_max", "tail_mean_mean"]
)
def test_statistics_are_those_of_the_rows(results, name):
    """Of any metric of the rows, whether cells.csv has it or not."""
    metric, statistic = ("tail_max", "median") if name == "tail_max" else name.rsplit("_", 1)
    found = quantity_of(results, results.study.cells, name)
    for cell in (0, 1):
        lanes = results.lanes[results.lanes["cell"] == cell][metric].to_numpy()
        value, low, high = found.values.loc[cell, ["value", "low", "high"]]
        assert value == pytest.approx(STATISTICS[statistic](lanes), rel=1e-12)
        assert not low > value
        assert not high < value
    assert found.unit == ("m/s" if metric == "min_speed" else "m")


def test_shares_are_in_percent_and_what_has_none_is_blank(results):
    """Nobody is attacked in the first cell, so nothing is there to recover from."""
    found = quantity_of(results, results.study.cells, "unrecovered")
    values = found.values[["value", "low", "high"]].to_numpy(dtype=float)
    assert np.isnan(values[0]).all()
    share = 100 * results.cells.loc[1, ["unrecovered", "unrecovered_low", "unrecovered_high"]]
    np.testing.assert_allclose(values[1], share.to_numpy(dtype=float))
    assert found.ends == (0, 100)
    failed = quantity_of(results, results.study.cells, "failed").values
    assert failed["value"].tolist() == [0, 0]
    assert failed["high"].iloc[0] == pytest.approx(100 * (1 - 0.025 ** (1 / 20)))


def test_what_the_study_asks_for_is_drawn_and_other_names_are_refused(results):
    """A share where it asks for recovery, else the error over the tail, or the spread."""
    config = results.study.config
    assert asked_quantity(config) == "unrecovered"
    assert asked_quantity(jaxnet.load({"recovery": None}).config) == "tail_mean"
    own = {"metrics": ["min_separation"]}
    assert asked_quantity(jaxnet.load(own).config) == "tail_mean"
    alone = {"navigator": "none", "law": "local"}
    assert asked_quantity(jaxnet.load(own | alone).config) == "spread"
    with pytest.raises(
        FolderError, match=r"y: must be one of unrecovered, failed, tail_mean, .* \(got speed\)"
    ):
        quantity_of(results, results.study.cells, "speed")
    for name in known_quantities(config):
        assert quantity_of(results, results.study.cells, name).words
