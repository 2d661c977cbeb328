"""Keys that take values together: the same lanes as of cells that are written one by one."""

import itertools
import shutil

import numpy as np
import pandas as pd
import pytest

import jaxnet
from jaxnet.config.cells import to_plain

KEYS = ("attack.magnitude", "attack.frequency")
PAIRS = "attack.magnitude, attack.frequency"
ROWS = [[1, 0.35], [2, 0.7], [2, 1.4]]
STUDY = {"vehicles": 4, "horizon": 2.0, "tail": 1.0, "engine": "exact", "attack": {"vehicles": [2]}}
STUDY |= {"samples": 2, "recovery": {"tau": 0.01}}
NAMED = [{"values": row, "label": name} for row, name in zip(ROWS, "abc", strict=True)]


def swept(**sweep):
    return STUDY | {"sweep": sweep}


def test_rows_are_those_of_cells_written_one_by_one():
    """To the last bit, beside another key, with and without labels."""
    for entries in (ROWS, NAMED):
        many = jaxnet.simulate(swept(**{"defence": ["none", "w_msr"], PAIRS: entries}))
        for number, (defence, row) in enumerate(itertools.product(["none", "w_msr"], ROWS)):
            keys = dict(zip(KEYS, row, strict=True)) | {"defence": defence}
            alone = jaxnet.simulate(jaxnet.load(STUDY, keys)).lanes.drop(columns="cell")
            mine = pd.DataFrame(many.lanes[many.lanes["cell"] == number]).reset_index(drop=True)
            told = pd.DataFrame(mine[[*alone.columns]])
            pd.testing.assert_frame_equal(told, alone, check_exact=True)
            for key, value in keys.items():
                assert set(mine[key]) == {value}
            assert PAIRS not in mine or set(mine[PAIRS]) == {"abc"[number % 3]}
    assert many.lanes.dtypes[KEYS[0]] == np.int64


def test_rows_of_a_product_that_is_written_as_pairs():
    """A single key and a product have the rows that they had: draws and order stay."""
    one = jaxnet.simulate(swept(**{KEYS[0]: [1, 2], KEYS[1]: [0.35, 0.7]})).lanes
    rows = [list(row) for row in itertools.product([1, 2], [0.35, 0.7])]
    pd.testing.assert_frame_equal(jaxnet.simulate(swept(**{PAIRS: rows})).lanes, one)


@pytest.mark.parametrize(
    ("written", "entries"),
    [
        ("topology, vehicles", [["star", 3], ["star", 4], [{"kind": "path"}, 3]]),
        ("attack, attack.magnitude", [["bias", 2], ["bias", 1.0], ["rotating", 1]]),
        ("attack, tick, attack.frequency", [["rotating", 0.1, 1.0], ["sinusoid", 0.05, 1.0]]),
        ("gain.0, channel, gain.1", [[0.5, {"delay": 0.1}, 2.5], [0.5, {"label": "clear"}, 3]]),
        ("navigator, law, attack.vehicles", [["none", "local", [2]], ["driven", "exact", [1, 2]]]),
    ],
)
def test_scenarios_are_those_of_cells_written_one_by_one(written, entries):
    """Of kinds, of records, of three keys, and where later keys set into earlier ones."""
    keys = written.split(", ")
    study = jaxnet.load(swept(**{"defence.isolated": ["fail", "coast"], written: entries}))
    for cell, (isolated, row) in zip(
        study.cells, itertools.product(["fail", "coast"], entries), strict=True
    ):
        lists = {key: [value] for key, value in zip(keys, row, strict=True)}
        (alone,) = jaxnet.load(swept(**{"defence.isolated": [isolated], **lists})).cells
        own = {"metrics": study.config.metrics}  # of a study where any cell has no navigator
        assert to_plain(cell.scenario) == to_plain(alone.scenario.model_copy(update=own))


def test_what_reads_alike_is_one_study():
    """A tuple of keys, of arrays or tuples, a file, and the study as it is stored."""
    one = jaxnet.load(swept(**{PAIRS: ROWS}))
    rows = np.array(ROWS)
    for sweep in (
        {KEYS: ROWS},
        {KEYS: [tuple(row) for row in ROWS]},
        {"attack.magnitude,attack.frequency": ROWS},
    ):
        other = jaxnet.load(STUDY | {"sweep": sweep})
        assert [each.labels for each in other.cells] == [each.labels for each in one.cells]
    assert [*jaxnet.load(STUDY | {"sweep": {KEYS: rows}}).cells[2].labels.values()] == [2.0, 1.4]
    again = jaxnet.load(jaxnet.load(one, {"seed": 3}), {"seed": 0})
    assert [to_plain(each.scenario) for each in again.cells] == [
        to_plain(each.scenario) for each in one.cells
    ]


def test_a_network_stands_in_a_pair():
    chain = jaxnet.network(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), label="chain")
    for entry in ((chain, 0.1), {"values": (chain, 0.1), "label": "slow"}):
        (cell,) = jaxnet.load({"attack": "none", "sweep": {("topology", "tick"): [entry]}}).cells
        assert (cell.scenario.vehicles, cell.scenario.tick) == (2, 0.1)
        assert cell.labels["topology"] == "chain"


def test_a_run_goes_on_in_shards_and_is_replayed(tmp_path):
    """With labels, in a folder, from a file."""
    lines = ["name: pairs", *(f"{key}: {value}" for key, value in STUDY.items()), "sweep:"]
    lines += ["  defence: [none, w_msr]", f"  {PAIRS}:"]
    lines += [
        f"    - {{values: {row}, label: {name}}}" for row, name in zip(ROWS, "abc", strict=True)
    ]
    (tmp_path / "pairs.yaml").write_text("\n".join(lines))
    study = jaxnet.load(tmp_path / "pairs.yaml")
    whole = jaxnet.run(study, tmp_path / "whole")
    for part in (1, 0):
        jaxnet.run_part(study, part, 2, tmp_path / "parts")
    rows = jaxnet.run(study, tmp_path / "parts").lanes
    pd.testing.assert_frame_equal(rows, whole.lanes)
    for shard in sorted((tmp_path / "parts" / "lanes").iterdir())[1:]:
        shard.unlink()
    shutil.rmtree(tmp_path / "parts" / "tables", ignore_errors=True)
    pd.testing.assert_frame_equal(jaxnet.run(study, tmp_path / "parts").lanes, whole.lanes)
    again = jaxnet.open(tmp_path / "whole")
    assert (
        again.replay(4, 1).row["tail_mean"]
        == rows.query("cell == 4 and sample == 1")["tail_mean"].item()
    )
    assert set(again.cells[PAIRS]) == {*"abc"}
