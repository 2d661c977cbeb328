"""Several metrics of one kind in a study, each in a column of its own name."""

import json
import pickle
import re

import numpy as np
import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.kinds import registry
from jaxnet.kinds.metrics import Metric, MetricKeys
from jaxnet.kinds.metrics.settling_time import SETTLING_TIME
from jaxnet.statistics.quantities import quantity_of
from jaxnet.view.columns import default_columns
from jaxnet.view.text.check import check_text
from jaxnet.view.text.tables import summary_text
from tests import systems
from tests.kinds.metrics.test_alarm_times import alarmed, first
from tests.kinds.metrics.test_keys import KEYS, STUDY, folder

__all__ = ["folder"]


def test_the_first_alarm_of_attacked_and_honest_links_in_one_run():
    """Vehicle 2 lies to 1 and 3. Alarms are planned: 1 about 2 at 0.4 s, 3 about 2 at 1.15 s, 2
    about 1 at 0.75 s.
    """
    known = {
        "attacked": (first(), 0.4),
        "all_attacked": (first(which="last"), 1.15),
        "honest": (first(of="honest"), 0.75),
        "from_2_to_3": (first(listener=3, source=2), 1.15),
        "from_1_to_2": (first(of="honest", listener=2, source=1), 0.75),
    }
    metrics = [asked | {"name": name} for name, (asked, _) in known.items()]
    outcome = systems.simulate(systems.lanes(alarmed([*metrics, first()]), 2, save=()))
    assert outcome.metrics["first_alarm"] == pytest.approx(0.4)
    for name, (_, time) in known.items():
        assert outcome.metrics[name] == pytest.approx(time), name


def settling(below, name=None):
    return {"kind": "settling_time", "below": below} | ({"name": name} if name else {})


LANES = {"engine": "exact", "horizon": 19.0, "tail": 2.0, "defence": "none"}
LANES |= {"attack": {"kind": "sinusoid", "magnitude": 10.0, "vehicles": [2, 7]}}
LANES |= {"sweep": {"attack.magnitude": [10, 100]}}


@pytest.fixture(scope="module")
def both():
    metrics = [settling(7.5), settling(20.0, "near")]
    return jaxnet.simulate({**LANES, "metrics": metrics}, 12, progress=False)


def test_a_name_changes_no_other_column(both):
    alone = jaxnet.simulate({**LANES, "metrics": [settling(20.0)]}, 12, progress=False)
    rows, those = both.lanes, alone.lanes
    assert [*rows.columns.difference(those.columns)] == ["near"]
    np.testing.assert_array_equal(rows["near"], those["settling_time"])
    assert not np.array_equal(rows["near"], rows["settling_time"])
    for name in those.columns.drop(["settling_time"]):
        np.testing.assert_array_equal(rows[name], those[name])
    for name in alone.cells.columns:
        mine = name.replace("settling_time", "near").replace("unsettled", "near_unsettled")
        np.testing.assert_array_equal(both.cells[mine], alone.cells[name])


@pytest.mark.long
def test_tables_figures_and_page_tell_them_apart(both, undrawn, tmp_path):
    columns = default_columns(both.study.config, both.cells, both.study.cells)
    wanted = ["settling_time_median", "near_median", "unsettled", "near_unsettled"]
    assert [name for name in columns if name in wanted] == wanted
    text = summary_text(both, ["near", "near_unsettled"])
    assert "near, median" in text
    assert "> 19" in text
    assert "(near) [%]" in text
    assert "above the limit at the last output time" in text
    figure = both.plot.curve(y="near")
    assert "near, median of lanes" in figure.axes[0].get_ylabel().replace("\n", " ")
    assert "near: settling time to 20 m" in figure.get_supxlabel().replace("\n", " ")
    assert both.plot.curve(y="near_unsettled").axes
    page = both.report(tmp_path / "report.html", replay=False).read_text()
    for name in ("7.5 m", "20 m (near)"):
        assert re.search(rf"<li>Settling time to {re.escape(name)} (is|ranges from) <b>", page)


def test_check_asks_for_the_least_of_all_lengths():
    """The start is told below 0.1 m, whichever metric asks for it."""
    quiet = {"engine": "exact", "attack": "none"}
    for metrics in ([settling(0.1), settling(5.0, "near")], [settling(5.0), settling(0.1, "near")]):
        text = check_text(systems.study(metrics=metrics, **quiet))
        assert "the effect of the start is below 0.1 m after" in text


def test_a_metric_is_the_same_to_what_needs_its_kind():
    """Of a metric with another name: a detector is needed, faults are found, robots are drawn."""
    with pytest.raises(ConfigError, match="without a detector"):
        systems.study(metrics=[{"kind": "alarms", "name": "noticed"}])
    touching = {"metrics": [{"kind": "collisions", "name": "touching"}]}
    with pytest.raises(ConfigError, match="has no heading: give forward: 0"):
        systems.study(law="local", vehicle="single_integrator", gain=[1], **touching)


def test_names_are_stored_changed_sent_and_looked_at_without_code(folder):
    """Two from outside: they are equal to each alone, and to what a folder without code tells."""
    asked = [KEYS | {"beyond": 165.0}, KEYS | {"beyond": 170.0, "name": "beyond_170"}]
    (folder / "study.yaml").write_text(json.dumps(STUDY | {"name": "near", "metrics": asked}))
    study = jaxnet.load("study.yaml")
    again = jaxnet.load(study, {"samples": 2})
    assert again.config.model_dump(mode="json")["metrics"] == asked
    assert pickle.loads(pickle.dumps(again.config.metrics)) == again.config.metrics
    jaxnet.run("study.yaml", "results", progress=False)
    away = jaxnet.open("results").trajectories["states"].values[0, ..., :2] - [20.0, 0.0]
    farthest = np.linalg.norm(away, axis=-1).max(axis=-1)
    assert (farthest > 165).sum() > (farthest > 170).sum() > 0
    (folder / "near_kinds.py").unlink()
    registry.LOADED.clear()
    opened = jaxnet.open("results")
    assert opened.study.config.model_dump(mode="json")["metrics"] == asked
    for name, length in {"far_from": 165.0, "beyond_170": 170.0}.items():
        np.testing.assert_array_equal(opened.lanes[name], (farthest > length).sum(axis=1))
    told = quantity_of(opened, opened.study.cells, "beyond_170")
    assert (told.words, told.note) == ("beyond 170, median of lanes", "beyond 170: far from")


class Times(MetricKeys):
    times: float = 1.0

    def __call__(self, seen):
        return self.times * seen.errors()


TIMES = Metric("times", "m", Times(), words="error")


def test_a_script_passes_several_of_one():
    given = [TIMES.with_keys(times=2.0, name="twice"), TIMES, TIMES.with_keys(times=3.0, name="a")]
    given += [SETTLING_TIME.with_keys(below=0.2, name="near"), SETTLING_TIME]
    for metrics in (given, given[::-1]):
        config = jaxnet.load({"engine": "exact", "horizon": 1.0, "tail": 0.5, "metrics": metrics})
        assert config.config.metrics == metrics
        assert jaxnet.load(config.config.model_dump()).config.metrics == metrics
    keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "metrics": given[:3]}
    rows = jaxnet.simulate(keys, 2, progress=False).lanes
    np.testing.assert_allclose(rows["twice"], 2 * rows["times"])
    np.testing.assert_allclose(rows["a"], 3 * rows["times"])


def test_no_key_of_one_s_own_may_be_called_name():
    class Named(MetricKeys):
        name: str = "x"

    with pytest.raises(jaxnet.KindError, match="name is the name of the column"):
        Metric("named", "", Named())
