"""Keys that are swept together, and labels: where tables, figures and `check` show them."""

import pytest

import jaxnet
from jaxnet.kinds.metrics import Metric
from jaxnet.statistics.axes import choose_axes
from jaxnet.store.folder import FolderError
from jaxnet.view.columns import pivoted, summary_columns
from jaxnet.view.text import check, tables

KEYS = ("attack.magnitude", "attack.frequency")
PAIRS = ", ".join(KEYS)
ROWS = [[1, 0.35], [2, 0.7], [3, 1.4]]
NAMED = [{"values": row, "label": name} for row, name in zip(ROWS, ("a", "b", "c"), strict=True)]
STUDY = {"vehicles": 3, "horizon": 1.0, "tail": 0.5, "engine": "exact", "attack": {"vehicles": [2]}}
RULES = ["none", {"kind": "w_msr", "F": 2, "label": "strict"}]


def study(entries, **keys):
    return jaxnet.load(STUDY | keys | {"sweep": {"defence": RULES, PAIRS: entries}})


@pytest.fixture(scope="module")
def results():
    name = {"labels": {PAIRS: "manoeuvre"}}
    return [jaxnet.simulate(study(NAMED, **name)), jaxnet.simulate(study(ROWS))]


@pytest.mark.parametrize(
    ("entries", "named", "axes"),
    [
        (NAMED, {}, (PAIRS, "defence", ())),
        (ROWS, {}, (KEYS[1], "defence", ())),
        (ROWS, {"x": KEYS[0]}, (KEYS[0], "defence", ())),
        (NAMED, {"x": KEYS[0]}, (KEYS[0], "defence", ())),
        (NAMED, {"x": "defence"}, ("defence", PAIRS, ())),
        (NAMED, {"x": KEYS[1], "panel": PAIRS}, (KEYS[1], "defence", (PAIRS,))),
        ([[1, 2], [1, 3], [2, 3]], {"x": KEYS[0]}, (KEYS[0], "defence", (KEYS[1],))),
    ],
)
def test_keys_together_have_one_axis(entries, named, axes):
    """Of their labels, or of one key. A key that this one does not decide has its own."""
    assert choose_axes(study(entries).cells, **named) == axes


def test_figures_tell_what_labels_stand_for_and_which_key_changes_too(results):
    labelled, plain = results
    told = labelled.plot.curve(y="tail_mean").get_supxlabel().replace("\n", " ")
    assert "a: ā = 1 m, attack frequency = 0.35 rad/s; b: ā = 2 m" in told.replace("\xa0", " ")
    assert told.count("strict: kind w_msr, F 2") == told.count("a: ā") == 1
    assert "changes with" not in told
    told = plain.plot.curve(y="tail_mean", x=KEYS[1]).get_supxlabel().replace("\n", " ")
    assert "attack magnitude changes with attack frequency" in told
    assert "changes with" not in plain.plot.curve(y="tail_mean", hue=KEYS[0]).get_supxlabel()


def test_tables_have_a_column_for_each_key_and_one_for_labels(results, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    labelled, plain = results
    assert [each.title for each in summary_columns(labelled)][1:5] == [
        "defence",
        "manoeuvre",
        "attack magnitude ā [m]",
        "attack frequency [rad/s]",
    ]
    assert [each.name for each in summary_columns(plain)][2:4] == list(KEYS)
    text = tables.summary_text(labelled)
    assert text.count("strict: kind w_msr, F 2") == 1
    assert "a: " not in text  # the columns tell it
    for where in ({PAIRS: "b"}, {KEYS[1]: 0.7}, {KEYS[0]: [2]}):
        assert summary_columns(labelled, where=where)[0].values == [1, 4]
    with pytest.raises(FolderError, match="takes its values together with other keys"):
        pivoted(summary_columns(plain), KEYS[0])


def test_check_lists_entries_not_products():
    text = check.check_text(study(ROWS))
    assert f"{PAIRS}: [1, 0.35], [2, 0.7], [3, 1.4]\n" in text
    assert f"  {KEYS[0]}: " not in text
    assert f"{PAIRS}: a [1, 0.35], b [2, 0.7], c [3, 1.4]\n" in check.check_text(study(NAMED))


def test_a_number_without_dimension_has_no_unit():
    assert Metric("ratio", "1", lambda seen: seen.speed).column_unit == ""
    for unit, column in [("1", "s"), ("", "s"), ("m", "m·s")]:
        summed = Metric("ratio", unit, lambda seen: seen.speed, time="integral")
        assert summed.column_unit == column
    ratio = Metric("ratio", "1", lambda seen: abs(seen.speed), words="a ratio")
    results = jaxnet.simulate(STUDY | {"metrics": [ratio], "samples": 2})
    assert "ratio, median" in [each.title for each in summary_columns(results)]
