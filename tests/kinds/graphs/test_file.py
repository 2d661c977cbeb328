"""Graphs from files: read as written, stored in the study, and refused with their line."""

import pickle
import re
import sys

import networkx as nx
import numpy as np
import pytest
import yaml
from scipy import sparse
from scipy.io import mmwrite

import jaxnet
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.grid import Grid
from jaxnet.store.manifest import digest
from tests.matrices import matrix_of

EDGES = [(1, 0, 1.0), (2, 1, 0.1 + 0.2), (2, 0, 1e-9), (3, 2, 7.0)]
STUDY = "name: mine\nsamples: 2\nvehicles: 3\nattack: {vehicles: [2]}\nengine: exact\n"
STUDY += "horizon: 1.0\ntail: 0.5\n"
SIZELESS = STUDY.replace("vehicles: 3\n", "").replace("attack: {vehicles: [2]}", "attack: none")


def written(path, text=None, topology="{kind: file, path: mine.csv}", study=STUDY):
    """A study beside a file with this text, and its edges if that is none."""
    text = "".join(f"{i},{j},{w!r}\n" for i, j, w in EDGES) if text is None else text
    (path / "mine.csv").write_text(text)
    (path / "study.yaml").write_text(f"{study}topology: {topology}\n")
    return path / "study.yaml"


def weights_of(study):
    return matrix_of(study.cells[0].scenario.topology, study.config.vehicles)


def test_a_csv_is_the_edges_that_it_lists(tmp_path):
    """As of the kind `edges`; a missing weight is 1, blanks and empty lines do not count."""
    keys = {"vehicles": 3, "attack": "none"}
    edges = jaxnet.load({"topology": {"kind": "edges", "edges": EDGES}, **keys})
    np.testing.assert_array_equal(weights_of(jaxnet.load(written(tmp_path))), weights_of(edges))
    short = written(tmp_path, "1, 0\n\n2, 1\n2, 0, 3\n3, 2\n")
    np.testing.assert_array_equal(weights_of(jaxnet.load(short))[1], [0.75, 0.25, 0, 0])


def test_a_graph_written_as_graphml_is_read_back(tmp_path):
    """Bit for bit with weights; undirected ones both ways, unweighted ones with equal weights."""
    drawn = ErdosRenyi(probability=0.5, navigator={"share": 0.5}, weighting="metropolis")
    given, network = matrix_of(drawn, 3), nx.DiGraph()
    network.add_weighted_edges_from((i + 1, j, given[i, j]) for i, j in np.argwhere(given > 0))
    nx.write_graphml(network, tmp_path / "mine.graphml")
    file = written(tmp_path, topology="{kind: file, path: mine.graphml}")
    np.testing.assert_allclose(weights_of(jaxnet.load(file)), given, rtol=1e-15)
    nx.write_graphml(nx.path_graph(4), tmp_path / "mine.graphml")
    row = matrix_of(Grid(rows=1, columns=3, navigator=[1], navigator_weight=0.5), 3)
    np.testing.assert_array_equal(weights_of(jaxnet.load(file)), row)


def test_the_study_holds_what_the_file_held(tmp_path):
    """A stored study needs no file; another file makes another study, which its folder refuses."""
    file = written(tmp_path)
    results = jaxnet.run(file, out=tmp_path / "out")
    first = jaxnet.load(file)
    written(tmp_path, "1,0\n2,0\n3,0\n")
    assert digest(jaxnet.load(file).config) != digest(first.config)
    told = r"content.mine.csv is 1,0,1.0 2,1,.* there and 1,0,1.0 2,0,1.0"
    with pytest.raises(jaxnet.FolderError, match=told):
        jaxnet.run(file, out=tmp_path / "out")
    (tmp_path / "mine.csv").unlink()
    stored = jaxnet.open(tmp_path / "out").study
    assert digest(stored.config) == digest(results.study.config) == digest(first.config)
    np.testing.assert_array_equal(weights_of(stored), weights_of(first))
    with pytest.raises(jaxnet.ConfigError, match=r"mine.csv cannot be read: No such file"):
        jaxnet.load(file)


def test_files_are_found_from_the_config_and_swept_as_kinds(tmp_path, monkeypatch):
    """Two configs may call two files by one name, and none is taken from the current folder."""
    (tmp_path / "elsewhere").mkdir()
    written(tmp_path / "elsewhere", "1,0\n2,0\n3,0\n")
    monkeypatch.chdir(tmp_path / "elsewhere")
    swept = "star\nsweep: {topology: [star, {kind: file, path: mine.csv}]}"
    study = jaxnet.load(written(tmp_path, topology=swept))
    assert [cell.labels["topology"] for cell in study.cells] == ["star", "file"]
    assert study.cells[1].scenario.topology.listed() == EDGES
    star = {**yaml.safe_load(STUDY), "topology": {"kind": "file", "path": "mine.csv"}}
    # A mapping's file is from the current folder
    assert (weights_of(jaxnet.load(star))[:, 0] == 1).all()
    two = "{kind: file, path: mine.csv}\nsweep: {topology.path: [mine.csv, other.csv]}"
    told = "other.csv was not read: sweep topology, each with its path"
    with pytest.raises(jaxnet.ConfigError, match=told):
        jaxnet.load(written(tmp_path, topology=two))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1,0\n2;1\n", "mine.csv:2: a row is i, j or i, j, w, numbers or names and a weight > 0; "),
        ("1,0\n2;1\n", "matrix n × n or m × (m + 1) (got 2;1); also read: networkx's edge list,"),
        ("1,0\n2,1,1,1\n", "mine.csv:2: a row is"),
        ("1,0\n2,1.5\n", "(got 2,1.5)"),
        ("1,0\n2,1,-1\n", "(got 2,1,-1)"),
        ("1,0\n2,1,nan\n", "(got 2,1,nan)"),
        ("1,0\n2,1,1_0\n", "(got 2,1,1_0)"),
        ("1,0\n,1\n", "mine.csv:2: a row is"),
        ("1,0\n٢,1\n", "mine.csv:2: nodes are numbers or names, not both: 1, ٢ (got ٢,1)"),
        ("1,0\n2,l\n3,2\n", "mine.csv:2: nodes are numbers or names, not both: 1, l (got 2,l)"),
        ("ann,bob\nbob,eve\n", "which node is the navigator? leader is one of ann, bob, eve"),
        ("1 0 {'weight': 2, 'cost': 1}\n", "mine.csv:1: a row is"),
        ("1,0\n4,1\n", "mine.csv: nodes are numbered 0 to 4, but node 2 has no edge"),
        ("0,1\n1,2\n2,3\n", "would hear 1, and it hears nobody; with direction: tells"),
        ("0,0,0,0\n1,0,0,0\n0,1,0,0\n0,0,-1,0\n", "rows sum to 0 (row 2 sums to 1)"),
        ("0,0,0,0\n1,0,0,0\n0,1,0,0\n0,0,1e99,0\n", "(got 1e+99 in row 4, column 3)"),
        ("1,0\n2,2\n", "mine.csv: 2 hears itself, which law: local alone allows"),
        ("1,0\n1,0,3\n", "mine.csv: [1, 0] is given twice"),
        ("1,0\n2,3\n3,2\n", "the navigator does not reach 2, 3"),
        ("", "mine.csv has no edge"),
        ("source,target\n", "mine.csv has no edge"),
        ("# 1,0\n", "mine.csv has no edge"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_once(text, says, tmp_path):
    file = written(tmp_path, text)
    with pytest.raises(jaxnet.ConfigError) as raised:
        jaxnet.load(file)
    (problem,) = raised.value.problems
    assert says in problem.message
    assert problem.key == "topology.path"
    assert problem.place.startswith(f"{file}:8:")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("mine.graphml", b"<graphml", "mine.graphml: must be GraphML with nodes and"),
        ("mine.graphml", b"<graphml/>", "mine.graphml: must be GraphML with nodes and"),
        ("mine.npy", b"1,0\n", "mine.npy is not an array of NumPy"),
        ("mine.npy", pickle.dumps({}), "not an array of NumPy"),  # a pickle may run anything
        ("mine.mtx", b"1,0\n", "mine.mtx is not a matrix of Matrix Market"),
        ("bad.csv", "1,0\n2,1\n".encode("utf-16"), "bad.csv is not UTF-8 text$"),
        ("bad.csv", "# café\n1,0\n".encode("latin-1"), "bad.csv is not UTF-8 text$"),
    ],
)
def test_a_file_that_is_not_what_its_ending_says_is_refused_in_a_line(
    name, content, says, tmp_path
):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(jaxnet.ConfigError, match=f"topology.path: .*{says}") as raised:
        jaxnet.load(written(tmp_path, topology=f"{{kind: file, path: {name}}}"))
    assert len(raised.value.problems) == 1


def test_without_networkx_it_is_said_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "mine.graphml").write_text("")
    monkeypatch.setitem(sys.modules, "networkx", None)
    jaxnet.load(written(tmp_path))
    told = r"GraphML needs networkx: pip install 'jaxnet-sim\[graphs\]'"
    with pytest.raises(jaxnet.ConfigError, match=told):
        jaxnet.load(written(tmp_path, topology="{kind: file, path: mine.graphml}"))


HEAD = '<graphml><key id="w" for="edge" attr.name="weight" attr.type="double"/>'
HEAD += '<key id="c" for="edge" attr.name="cost" attr.type="double"/>'
HEAD += '<key id="v" for="node" attr.name="name" attr.type="string"/><graph edgedefault="directed">'
NODES = "".join(f'<node id="n{n}"/>' for n in range(4))
LINKS = '<edge source="n1" target="n0"/><edge id="e" source="n2" target="n1"/>'
LINKS += '<edge source="n3" target="n2"><data key="w">2</data></edge>'
TAIL = "</graph></graphml>"
NAMED = '"n2"><data key="v">9</data></node>'
GRAPH = '<graph edgedefault="directed"><node id="n4"/>'
INSIDE = '"n3"><graph edgedefault="directed"/></node>'
FOREIGN = '<!DOCTYPE x [<!ENTITY a SYSTEM "study.yaml">]>'


LAUGHS = '<!DOCTYPE x [<!ENTITY a0 "ha">'
LAUGHS += "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(12)) + "]>"


@pytest.mark.parametrize(
    ("graphml", "says"),
    [
        (HEAD + NODES + LINKS.replace('"w"', '"c"') + TAIL, "'cost'; only 'weight' is read"),
        (HEAD + NODES + '<node id="2"/>' + LINKS + TAIL, "two nodes have one name"),
        (HEAD + NODES + '<node id="n7"/>' + LINKS + TAIL, "node 7 has no edge"),
        (HEAD + NODES.replace('"n2"/>', NAMED) + LINKS + TAIL, "node 2 has no edge"),
        (HEAD + NODES + LINKS.replace(">2<", ">-2<") + TAIL, "a weight is a number > 0"),
        (HEAD + NODES + LINKS + "</graph>" + GRAPH + TAIL, "more than one graph"),
        (HEAD + NODES.replace('"n3"/>', INSIDE) + LINKS + TAIL, "more than one graph"),
        (HEAD.replace(' edgedefault="directed"', "") + NODES + LINKS + TAIL, "no edgedefault"),
        (HEAD.replace('"cost"', '"id"') + NODES + LINKS + TAIL, "data called 'id' are not read"),
        (LAUGHS + HEAD + "&a12;" + NODES + LINKS + TAIL, "entities are not read"),
        (FOREIGN + HEAD + "&a;" + TAIL, "entities are not read"),
    ],
)
def test_graphml_that_means_something_else_is_told(graphml, says, tmp_path):
    """Attributes that nobody reads, names beside numbers, and entities, before any is expanded."""
    (tmp_path / "mine.graphml").write_text(graphml)
    with pytest.raises(jaxnet.ConfigError, match=says) as raised:
        jaxnet.load(written(tmp_path, topology="{kind: file, path: mine.graphml}"))
    assert len(raised.value.problems) == 1


NO_WEIGHTS = (None, np.nan, np.inf, -1.0, 0, "heavy", True)


def line_of(*nodes, **attributes):
    network = nx.DiGraph(name=attributes.pop("name", ""))
    network.add_edges_from(zip(nodes[1:], nodes, strict=False), **attributes)
    return network


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (line_of("a", "b", "c", "d"), "which node is the navigator? leader is one of b, a, c, d"),
        (nx.grid_2d_graph(2, 2), "leader is one of (0, 0), (0, 1), (1, 0), (1, 1)"),
        (line_of(0, "1", 1), "two nodes have one name"),
        (line_of(0, True, 2), "(got True)"),
        (line_of(0, -1), "(got -1)"),
        *((line_of(0, 1, weight=w), f"(got {w!r})") for w in NO_WEIGHTS),
        (line_of(0, 1, 2, cost=3), "edge (1, 0) has the attribute 'cost'; only 'weight' is read"),
        (nx.DiGraph(), "the network has no edge"),
        (nx.DiGraph([(0, 1)]), "would hear 1, and it hears nobody; with direction: tells"),
        (nx.empty_graph(4), "node 0 has no edge"),
        (nx.MultiDiGraph([(1, 0), (1, 0), (2, 1), (3, 2)]), "[1, 0] is given twice"),
        (nx.DiGraph([(1, 0), (2, 1), (2, 2), (3, 2)]), "2 hears itself, which law: local"),
        (nx.Graph([(1, 0), (2, 1), (2, 2), (3, 2)]), "2 hears itself, which law: local"),
        (nx.path_graph(6), "i is 1 to 3 and j 0 to 3"),
        (nx.path_graph(3), "the graph has 2 vehicles (got 3)"),
    ],
)
def test_networks_that_mean_no_graph_are_config_errors(network, says):
    with pytest.raises(jaxnet.ConfigError, match=re.escape(says)):
        jaxnet.load({"vehicles": 3, "topology": network, "attack": "none"})


def drawn_matrix(number, sparse_rows):
    """A random matrix [a0 | A] of a graph that the navigator reaches."""
    random = np.random.default_rng(number)
    weights = random.random((6, 7)).round(3) * (random.random((6, 7)) < 0.4)
    weights[:, 0] += np.eye(6)[0]
    weights[np.arange(1, 6), np.arange(1, 6)] += 0.5
    weights[np.arange(6), np.arange(1, 7)] = 0.0
    return sparse.csr_array(weights) if sparse_rows else weights


def square_of(weights):
    """The adjacency matrix of a graph with the navigator as node 0, who hears nobody."""
    return np.vstack([np.zeros(len(weights) + 1), weights])


def laplacian_of(weights):
    square = square_of(weights)
    return np.diag(square.sum(axis=1)) - square


def written_matrix(path, matrix):
    if path.suffix == ".npy":
        np.save(path, matrix)
    elif path.suffix == ".mtx":
        mmwrite(path, sparse.coo_array(matrix))
    else:
        np.savetxt(path, matrix, delimiter=",")


@pytest.mark.parametrize("ending", ["csv", "npy", "mtx"])
@pytest.mark.parametrize("form", [lambda weights: weights, square_of, laplacian_of])
@pytest.mark.parametrize("number", range(3))
def test_a_matrix_in_each_form_and_file_is_one_graph(number, form, ending, tmp_path):
    """[a0 | A], an adjacency matrix and a Laplacian, as text, of NumPy and of Matrix Market."""
    weights = drawn_matrix(number, sparse_rows=False)
    file = written(tmp_path, topology=f"{{kind: file, path: mine.{ending}}}", study=SIZELESS)
    written_matrix(tmp_path / f"mine.{ending}", form(weights))
    found = weights_of(jaxnet.load(file))
    np.testing.assert_allclose(found, weights / weights.sum(axis=1, keepdims=True), rtol=1e-12)


@pytest.mark.parametrize("sparse_rows", [False, True])
def test_matrices_of_numpy_and_scipy_are_topologies(sparse_rows):
    """As they are, swept with labels, and the other way round."""
    weights = drawn_matrix(5, sparse_rows)
    study = jaxnet.load({"topology": weights, "attack": "none"})
    dense = weights.toarray() if sparse_rows else weights
    expected = dense / dense.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(weights_of(study), expected, rtol=1e-15)
    assert (study.config.vehicles, study.cells[0].scenario.vehicles) == (6, 6)
    told = jaxnet.network(sparse.csr_array(square_of(dense).T), direction="tells", label="told")
    both = jaxnet.load({"attack": "none", "sweep": {"topology": [weights, told, "star"]}})
    assert [cell.labels["topology"] for cell in both.cells] == ["edges", "told", "star"]
    assert [cell.scenario.vehicles for cell in both.cells] == [6, 6, 12]
    np.testing.assert_allclose(matrix_of(both.cells[1].scenario.topology, 6), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (np.eye(3, 5), "n × n, or m × (m + 1) with the navigator in column 0 (got 3 × 5)"),
        (np.ones(3), "(got 3)"),
        (np.eye(3) * 1j, "a matrix has real numbers (got complex128)"),
        (np.zeros((3, 3)), "the network has no edge"),
        (np.diag([1.0, np.nan], k=-1), "(got nan in row 3, column 2)"),
        ([[0, 1]], "a network is a matrix or a networkx graph (got list)"),
    ],
)
def test_objects_that_mean_no_network_are_config_errors(given, says):
    with pytest.raises(jaxnet.ConfigError, match=re.escape(says)):
        jaxnet.network(given)


def test_nodes_have_any_names_and_the_leader_any_place():
    """Tuples, text, numbers that are not whole: the vehicles keep the order of the nodes."""
    square = jaxnet.network(nx.grid_2d_graph(2, 2), leader=(0, 1))
    assert square.names == ["(0, 0)", "(1, 0)", "(1, 1)"]
    ends = [(1, 0), (1, 2), (2, 1), (2, 3), (3, 0), (3, 2)]
    assert sorted(square.edges) == [(*each, 1) for each in ends]
    floats = jaxnet.network(line_of(0, 1.9, 2.2, 3.7))
    assert floats.edges == [(1, 0, 1), (2, 1, 1), (3, 2, 1)]
    assert floats.names == ["1.9", "2.2", "3.7"]
    last = jaxnet.network(line_of(3, 1, 2, 0), leader=3)
    assert last.edges == [(2, 0, 1), (3, 2, 1), (1, 3, 1)]
    assert last.names == ["0", "1", "2"]
    study = jaxnet.load({"topology": line_of("leader", "ann", "bob"), "attack": "none"})
    assert list(study.config.topology.vehicle_names()) == ["ann", "bob"]
    with pytest.raises(jaxnet.ConfigError, match="no node is called '9': leader is one of 0-3"):
        jaxnet.network(line_of(3, 1, 2, 0), leader=9)


def test_a_file_has_names_a_leader_and_a_direction(tmp_path):
    """Also numbers from 1; `names` replaces those of the file; what is stored is read alike."""
    (tmp_path / "mine.csv").write_text('from,to\n"the boss",ann\nann,bob\n"the boss",bob\n')
    given = {"kind": "file", "path": str(tmp_path / "mine.csv")}
    given |= {"leader": "the boss", "direction": "tells"}
    study = jaxnet.load({"topology": given, "attack": "none"})
    graph = study.cells[0].scenario.topology
    assert graph.listed() == [(1, 0, 1.0), (2, 1, 1.0), (2, 0, 1.0)]
    assert list(graph.vehicle_names()) == ["ann", "bob"]
    assert jaxnet.load(study, {"samples": 3}).cells[0].scenario.topology.listed() == graph.listed()
    renamed = jaxnet.load({"topology": given | {"names": ["a", "b"]}, "attack": "none"})
    assert list(renamed.config.topology.vehicle_names()) == ["a", "b"]
    told = r"names is a list of 2, one for each vehicle \(got 1\)"
    with pytest.raises(jaxnet.ConfigError, match=told):
        jaxnet.load({"topology": given | {"names": ["a"]}, "attack": "none"})
    with pytest.raises(jaxnet.ConfigError, match="two vehicles are called a"):
        jaxnet.load({"topology": given | {"names": ["a", "a"]}, "attack": "none"})
    written(tmp_path, "2,1\n3,2\n")
    first = {"kind": "file", "path": str(tmp_path / "mine.csv"), "first": 1}
    ones = jaxnet.load({"topology": first, "attack": "none"})
    assert ones.config.topology.listed() == [(1, 0, 1.0), (2, 1, 1.0)]
    assert list(ones.config.topology.vehicle_names()) == ["2", "3"]


CASES = {
    "bom.csv": b"\xef\xbb\xbf1,0\r\n2,1\r\n3,2\r\n",
    "networkx.edgelist": b"1 0 1.0\n2 1 0.5\n3 2 1.0\n",
    "networkx_data.edgelist": b"1 0 {}\n2 1 {'weight': 0.5}\n3 2 {}\n",
    "header.csv": b"source,target,weight\n1,0,1\n2,1,1\n3,2,1\n",
    "semicolon.csv": b"1;0;1,0\n2;1;0,5\n3;2;1,0\n",
    "numpy_savetxt.csv": b"1.0,0.0,1.0\n2.0,1.0,1.0\n3.0,2.0,1.0\n",
    "adjacency_matrix.csv": b"0,0,0,0\n1,0,0,0\n0,1,0,0\n0,0,1,0\n",
}


@pytest.mark.parametrize("name", CASES)
def test_exports_of_other_programs_are_read(name, tmp_path):
    """Each file means: 1 hears 0, 2 hears 1, 3 hears 2."""
    (tmp_path / name).write_bytes(CASES[name])
    graph = jaxnet.load(written(tmp_path, topology=f"{{kind: file, path: {name}}}")).config.topology
    assert [edge[:2] for edge in graph.listed()] == [(1, 0), (2, 1), (3, 2)]
    assert list(graph.vehicle_names()) == []


RING = np.roll(np.eye(8), 1, axis=1) + np.roll(np.eye(8), -1, axis=1)
DIRECTED = nx.cycle_graph([*"abcdefgh"], create_using=nx.DiGraph)
ALONE = {"navigator": "none", "vehicle": "single_integrator", "law": "local", "gain": [1.0]}
ALONE |= {"attack": "none", "defence": "none", "engine": "exact"}


@pytest.mark.parametrize(
    ("given", "weights"),
    [
        (RING, RING),
        (np.diag(RING.sum(axis=1)) - RING, RING),
        (np.hstack([np.zeros((8, 1)), RING]), RING),
        (nx.cycle_graph(8), RING),
        (nx.relabel_nodes(nx.cycle_graph(8), dict(enumerate("abcdefgh"))), RING),
        (DIRECTED, np.roll(np.eye(8), 1, axis=1)),
        (jaxnet.network(RING, leads=False), RING),
    ],
    ids=["square", "laplacian", "a0 | A", "graph", "named", "directed", "network"],
)
def test_without_a_navigator_every_node_is_a_vehicle(given, weights, tmp_path):
    """Eight vehicles from an object, and a file of the network, also where networks take turns."""
    if isinstance(given, np.ndarray):
        np.savetxt(tmp_path / "ring.csv", given, fmt="%g", delimiter=",")
    elif isinstance(given, nx.Graph):
        ring = list(zip(given, [*list(given)[1:], next(iter(given))], strict=True))
        rows = [f"{i},{j}\n" for i, j in ring]
        rows += [] if given.is_directed() else [f"{j},{i}\n" for i, j in ring]
        (tmp_path / "ring.csv").write_text("".join(rows))
    topologies = [given]
    if not isinstance(given, Graph):
        file = {"kind": "file", "path": str(tmp_path / "ring.csv")}
        topologies += [file, {"kind": "switching", "networks": [file, file], "every": 1.0}]
    for topology in topologies:
        study = jaxnet.load({**ALONE, "topology": topology})
        assert study.config.vehicles == 8
        found = matrix_of(study.cells[0].scenario.topology, 8)
        known = np.hstack([np.zeros((8, 1)), weights / weights.sum(axis=1)])
        np.testing.assert_allclose(found, known)


@pytest.mark.parametrize(
    ("topology", "says"),
    [
        ({"leader": "1"}, "leader says which node is the navigator, and there is no navigator"),
        ({"first": 1}, "first says which node is the navigator, and there is no navigator"),
        (np.hstack([np.ones((8, 1)), RING]), "column 0 of a matrix m × (m + 1) is what the"),
        (np.diag(np.arange(3.0) < 2, k=1), "node 3 has no edge"),
        (jaxnet.network(RING), "a node leads this network, and navigator is none"),
    ],
    ids=["leader", "first", "a0 | A", "no edge", "network"],
)
def test_without_a_navigator_nothing_names_one(topology, says, tmp_path):
    """Neither a key, nor a column, nor `jaxnet.network`; no node gets lost."""
    if isinstance(topology, dict):
        np.savetxt(tmp_path / "ring.csv", RING, fmt="%g", delimiter=",")
        topology = {"kind": "file", "path": str(tmp_path / "ring.csv"), **topology}
    with pytest.raises(jaxnet.ConfigError, match=re.escape(says)):
        jaxnet.load({**ALONE, "topology": topology})


def test_a_cell_without_a_navigator_has_a_vehicle_more(tmp_path):
    """In a sweep over navigators as alone; an object is asked for who leads."""
    np.savetxt(tmp_path / "ring.csv", RING, fmt="%g", delimiter=",")
    keys = {**ALONE, "topology": {"kind": "file", "path": str(tmp_path / "ring.csv")}}
    swept = {"sweep": {"navigator": ["none", "lissajous"]}}
    assert [cell.scenario.vehicles for cell in jaxnet.load(keys | swept).cells] == [8, 7]
    with pytest.raises(jaxnet.ConfigError, match="navigator is none in some cells only"):
        jaxnet.load(keys | swept | {"topology": RING})
    led = keys | {"topology": RING, "navigator": "lissajous"}
    assert jaxnet.load(led, ["navigator=none"]).lanes == 1
    assert jaxnet.load(jaxnet.load(keys), {"samples": 3}).cells[0].scenario.vehicles == 8
