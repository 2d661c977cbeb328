"""Graphs from files: read as they were written, stored in the study, and refused with their line."""

import sys

import networkx as nx
import numpy as np
import pytest
import yaml

import jaxnet
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.grid import Grid
from jaxnet.store.folder import digest
from tests.matrices import matrix_of

EDGES = [(1, 0, 1.0), (2, 1, 0.1 + 0.2), (2, 0, 1e-9), (3, 2, 7.0)]
STUDY = (
    "name: mine\nsamples: 2\nvehicles: 3\nattack: {vehicles: [2]}\nengine: exact\nhorizon: 1.0\ntail: 0.5\n"
)


def written(path, text=None, topology="{kind: file, path: mine.csv}"):
    """A study beside a file with this text, and its edges if that is none."""
    text = "".join(f"{i},{j},{w!r}\n" for i, j, w in EDGES) if text is None else text
    (path / "mine.csv").write_text(text)
    (path / "study.yaml").write_text(f"{STUDY}topology: {topology}\n")
    return path / "study.yaml"


def weights_of(study):
    """The graph of a study of one cell."""
    return matrix_of(study.cells[0].scenario.topology, study.config.vehicles)


def network_of(weights):
    """A graph of networkx with these weights, (i, j) "i hears j"."""
    network = nx.DiGraph()
    network.add_weighted_edges_from((i + 1, j, weights[i, j]) for i, j in np.argwhere(weights > 0))
    return network


def test_a_csv_is_the_edges_that_it_lists(tmp_path):
    """As of the kind `edges`; a weight that is left out is 1, blanks and empty lines do not count."""
    edges = jaxnet.load({"topology": {"kind": "edges", "edges": EDGES}, "vehicles": 3, "attack": "none"})
    np.testing.assert_array_equal(weights_of(jaxnet.load(written(tmp_path))), weights_of(edges))
    short = written(tmp_path, "1, 0\n\n2, 1\n2, 0, 3\n3, 2\n")
    np.testing.assert_array_equal(weights_of(jaxnet.load(short))[1], [0.75, 0.25, 0, 0])


def test_a_graph_written_as_graphml_is_read_back(tmp_path):
    """Bit for bit with its weights; one without direction both ways, without weights with equal ones."""
    given = matrix_of(ErdosRenyi(probability=0.5, navigator={"share": 0.5}, weighting="metropolis"), 3)
    nx.write_graphml(network_of(given), tmp_path / "mine.graphml")
    file = written(tmp_path, topology="{kind: file, path: mine.graphml}")
    np.testing.assert_allclose(weights_of(jaxnet.load(file)), given, rtol=1e-15)
    nx.write_graphml(nx.path_graph(4), tmp_path / "mine.graphml")
    row = matrix_of(Grid(rows=1, columns=3, navigator=[1], navigator_weight=0.5), 3)
    np.testing.assert_array_equal(weights_of(jaxnet.load(file)), row)


def test_the_study_holds_what_the_file_held(tmp_path):
    """A stored study needs no file; with another file it is another study, and its folder refuses that."""
    file = written(tmp_path)
    results = jaxnet.run(file, out=tmp_path / "out")
    first = jaxnet.load(file)
    written(tmp_path, "1,0\n2,0\n3,0\n")
    assert digest(jaxnet.load(file).config) != digest(first.config)
    with pytest.raises(
        jaxnet.FolderError, match=r"content.mine.csv is 1,0,1.0 2,1,.* there and 1,0,1.0 2,0,1.0"
    ):
        jaxnet.run(file, out=tmp_path / "out")
    (tmp_path / "mine.csv").unlink()
    stored = jaxnet.open(tmp_path / "out").study
    assert digest(stored.config) == digest(results.study.config) == digest(first.config)
    np.testing.assert_array_equal(weights_of(stored), weights_of(first))
    with pytest.raises(jaxnet.ConfigError, match=r"mine.csv cannot be read: No such file"):
        jaxnet.load(file)


def test_files_are_found_from_the_config_and_swept_as_kinds(tmp_path, monkeypatch):
    """Two configs may call different files by one name, and none is taken from the current folder."""
    (tmp_path / "elsewhere").mkdir()
    written(tmp_path / "elsewhere", "1,0\n2,0\n3,0\n")
    monkeypatch.chdir(tmp_path / "elsewhere")
    file = written(tmp_path, topology="star\nsweep: {topology: [star, {kind: file, path: mine.csv}]}")
    study = jaxnet.load(file)
    assert [cell.labels["topology"] for cell in study.cells] == ["star", "file"]
    assert study.cells[1].scenario.topology.edges() == EDGES
    star = {**yaml.safe_load(STUDY), "topology": {"kind": "file", "path": "mine.csv"}}
    assert (weights_of(jaxnet.load(star))[:, 0] == 1).all(), "a mapping's file is from the current folder"
    two = written(
        tmp_path, topology="{kind: file, path: mine.csv}\nsweep: {topology.path: [mine.csv, other.csv]}"
    )
    with pytest.raises(
        jaxnet.ConfigError, match=r"other.csv was not read: sweep topology, each with its path"
    ):
        jaxnet.load(two)


def test_another_path_reads_another_file(tmp_path):
    """Also over a study that has stored what the first one held."""
    stored = jaxnet.load(written(tmp_path))
    (tmp_path / "other.csv").write_text("1,0\n2,0\n3,0\n")
    other = jaxnet.load(stored, {"topology.path": str(tmp_path / "other.csv")})
    assert (weights_of(other)[:, 0] == 1).all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "1,0\n2;1\n",
            "mine.csv:2: must be i, j or i, j, w: whole numbers, 0 the navigator, and a weight > 0 (got 2;1)",
        ),
        ("i,j\n1,0\n", "mine.csv:1: must be i, j or i, j, w"),
        ("1,0\n2,1,1,1\n", "mine.csv:2: must be"),
        ("1,0\n2,1.5\n", "(got 2,1.5)"),
        ("1,0\n2,1,-1\n", "a weight > 0 (got 2,1,-1)"),
        ("1,0\n2,1,nan\n", "a weight > 0 (got 2,1,nan)"),
        ("1,0\n4,1\n", "mine.csv: i is 1 to 3 and j 0 to 3 (got [4, 1])"),
        ("1,0\n2,2\n", "mine.csv: 2 hears itself"),
        ("1,0\n1,0,3\n", "mine.csv: [1, 0] is given twice"),
        ("1,0\n2,1\n", "the navigator does not reach 3"),
        ("", "the navigator does not reach 1, 2, 3"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_once(text, says, tmp_path):
    """At the config's place, with the file and its line."""
    file = written(tmp_path, text)
    with pytest.raises(jaxnet.ConfigError) as raised:
        jaxnet.load(file)
    (problem,) = raised.value.problems
    assert says in problem.message
    assert problem.key == "topology.path"
    assert problem.place.startswith(f"{file}:8:")


@pytest.mark.parametrize(
    "text", ["<graphml", "1,0\n", '<graphml><graph edgedefault="directed"><node id="n0"/></graph></graphml>']
)
def test_what_is_no_graphml_is_told(text, tmp_path):
    """Nor nodes that are no numbers."""
    (tmp_path / "mine.graphml").write_text(text)
    with pytest.raises(
        jaxnet.ConfigError, match=r"topology.path: mine.graphml: must be GraphML with edges i, j"
    ):
        jaxnet.load(written(tmp_path, topology="{kind: file, path: mine.graphml}"))


def test_without_networkx_it_is_said_what_to_install(tmp_path, monkeypatch):
    """And CSV is read all the same."""
    (tmp_path / "mine.graphml").write_text("")
    monkeypatch.setitem(sys.modules, "networkx", None)
    jaxnet.load(written(tmp_path))
    with pytest.raises(
        jaxnet.ConfigError, match=r"GraphML needs networkx: pip install 'jaxnet-sim\[graphs\]'"
    ):
        jaxnet.load(written(tmp_path, topology="{kind: file, path: mine.graphml}"))
