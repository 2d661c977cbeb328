"""A config of ten lines for every kind that is not the paper's: loaded, checked, and run in both engines.

Six vehicles with three or six slots, so that all kinds share two programs of each engine, one of them with
what tests of defences run.
"""

import numpy as np
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.kinds import registry
from tests import systems

CONFIG = """# jaxnet run study.yaml
name: study
vehicles: 6
topology: {topology}
attack: {{kind: rotating, vehicles: [2]}}
defence: {{kind: clipping, trusted: {trusted}}}
horizon: 2.0
tail: 1.0
tick: 0.1
engine: {engine}
"""
TOPOLOGIES = {
    "lattice": "{kind: lattice, neighbours: 2, navigator: {share: 0.5}}",
    "circulant": "{kind: circulant, offsets: [1, 2], weighting: metropolis}",
    "complete": "complete",
    "grid": "{kind: grid, rows: 2, columns: 3, navigator: [1, 6]}",
    "erdos_renyi": "{kind: erdos_renyi, redraw: true, navigator: {share: 0.5}}",
    "random_regular": "{kind: random_regular, redraw: true, degree: 3}",
    "small_world": "{kind: small_world, redraw: true}",
    "file": "{kind: file, path: edges.csv}",
    "switching": "{kind: switching, every: 0.5, networks: [complete, {kind: lattice, neighbours: 2}]}",
}
TRUSTED = {
    "lattice": "{share: 0.5}",
    "circulant": "none",
    "complete": "{nearest: 2}",
    "grid": "{nearest: 1}",
}
OLDER = {"star", "cyclic", "path", "figure1", "edges"}


def test_every_kind_has_its_config():
    """But for those that other tests have long had."""
    assert set(TOPOLOGIES) | OLDER == set(registry.kind_names("topology"))


@pytest.mark.parametrize("kind", TOPOLOGIES)
def test_a_config_of_ten_lines_is_checked_and_runs_in_both_engines(kind, tmp_path):
    """The kind whose lanes differ most in both: positions to 1e-6 m, decisions alike.

    Networks that take turns in both: tests/engine/test_reference.py.
    """
    (tmp_path / "edges.csv").write_text(
        "".join(f"{i},{j}\n" for i in range(1, 7) for j in (0, i % 6 + 1, (i + 1) % 6 + 1))
    )
    seen, engines = [], ["exact", "{kind: nonlinear, rtol: 1e-10, atol: 1e-12}"]
    for engine in engines if kind == "erdos_renyi" else engines[:1]:
        keys = {
            "topology": TOPOLOGIES[kind],
            "trusted": TRUSTED.get(kind, "{3: [2]}"),
            "engine": engine,
        }
        (tmp_path / "study.yaml").write_text(CONFIG.format(**keys))
        seen.append(systems.simulate(systems.lanes(jaxnet.load(tmp_path / "study.yaml"), 2)))
    exact, nonlinear = seen[0], seen[-1]
    assert exact.status.tolist() == nonlinear.status.tolist() == [0, 0]
    positions = (outcome.series["state"][..., :2] for outcome in (exact, nonlinear))
    assert np.abs(np.subtract(*positions)).max() <= 1e-6
    np.testing.assert_allclose(exact.series["kept"], nonlinear.series["kept"], rtol=0, atol=1e-8)
    checked = CliRunner().invoke(main, ["check", str(tmp_path / "study.yaml")])
    assert checked.exit_code == 0, checked.output
    assert f"\n{kind}" in checked.output
