"""Graphs from files: read as they were written, stored in the study, and refused with their line."""

import contextlib
import re
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
            "mine.csv:2: must be i, j or i, j, w: whole numbers, 0 the navigator, and a weight > 0;"
            " no header; commas, semicolons or blanks between them (got 2;1)",
        ),
        ("i,j\n1,0\n", "mine.csv:1: must be i, j or i, j, w"),
        ("1,0\n2,1,1,1\n", "mine.csv:2: must be"),
        ("1,0\n2,1.5\n", "(got 2,1.5)"),
        ("1,0\n2,1,-1\n", "(got 2,1,-1)"),
        ("1,0\n2,1,nan\n", "(got 2,1,nan)"),
        ("1,0\n2,1,1_0\n", "(got 2,1,1_0)"),
        ("1,0\n٢,1\n", "(got ٢,1)"),
        ("source,target,weight\n1,0,1\n", "mine.csv:1: must be i, j or i, j, w"),
        ("0,0,0,0\n1,0,0,0\n0,1,0,0\n0,0,1,0\n", "mine.csv:1: must be i, j or i, j, w"),
        ("1 0 {'weight': 2}\n", "mine.csv:1: must be i, j or i, j, w"),
        ("1,0\n4,1\n", "mine.csv: i is 1 to 3 and j 0 to 3 (got [4, 1])"),
        ("1,0\n2,2\n", "mine.csv: 2 hears itself"),
        ("1,0\n1,0,3\n", "mine.csv: [1, 0] is given twice"),
        ("1,0\n2,3\n3,2\n", "the navigator does not reach 2, 3"),
        ("", "mine.csv has no edge"),
        ("# 1,0\n", "mine.csv has no edge"),
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
    "text", ["<graphml", "1,0\n", '<graphml><graph edgedefault="directed"><node id="a"/></graph></graphml>']
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


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf1,0\r\n2,1\r\n3,2\r\n",
        b"1 0 1.0\n2 1 1\n3 2 1.0\n",
        b"1\t0\n2\t1\n3\t2\n",
        b"1;0;1,0\n2;1;0,5\n3;2;1,0\n",
        b"# 1.0,0.0\n1.0,0.0,1.0\n2.0,1.0,1.0\n3.000e+00,2.0,1.0\n",
        b'"1","0"\n"2","1"\n"3","2"\n',
    ],
)
def test_tables_of_other_programs_are_read(content, tmp_path):
    """A byte order mark, blanks, tabs, decimal commas, whole numbers with a point, quotes: 1 hears 0 …"""
    file = written(tmp_path)
    (tmp_path / "mine.csv").write_bytes(content)
    edges = jaxnet.load(file).cells[0].scenario.topology.edges()
    assert [edge[:2] for edge in edges] == [(1, 0), (2, 1), (3, 2)]
    assert edges[1][2] == (0.5 if b"0,5" in content else 1.0)


@pytest.mark.parametrize(
    "content", ["1,0\n2,1\n".encode("utf-16"), "# café\n1,0\n".encode("latin-1"), b"\xff\xfe"]
)
def test_text_that_is_not_utf_8_is_told(content, tmp_path):
    """In one line, at the config's place."""
    file = written(tmp_path)
    (tmp_path / "mine.csv").write_bytes(content)
    with pytest.raises(jaxnet.ConfigError, match=r"^.*topology.path: mine.csv is not UTF-8 text$"):
        jaxnet.load(file)


HEAD = '<graphml><key id="w" for="edge" attr.name="weight" attr.type="double"/>'
HEAD += '<key id="c" for="edge" attr.name="cost" attr.type="double"/>'
HEAD += '<key id="v" for="node" attr.name="name" attr.type="string"/><graph edgedefault="directed">'
NODES = "".join(f'<node id="n{n}"/>' for n in range(4))
LINKS = '<edge source="n1" target="n0"/><edge id="e" source="n2" target="n1"/>'
LINKS += '<edge source="n3" target="n2"><data key="w">2</data></edge>'
TAIL = "</graph></graphml>"


def loaded(tmp_path, graphml):
    """A study of a GraphML file with this text."""
    (tmp_path / "mine.graphml").write_text(graphml)
    return jaxnet.load(written(tmp_path, topology="{kind: file, path: mine.graphml}"))


def test_nodes_of_igraph_are_numbered_by_their_ids(tmp_path):
    """Also where their names say so."""
    edges = [(1, 0, 1.0), (2, 1, 1.0), (3, 2, 2.0)]
    for nodes in (NODES, NODES.replace('"n2"/>', '"n2"><data key="v">2</data></node>')):
        assert loaded(tmp_path, HEAD + nodes + LINKS + TAIL).cells[0].scenario.topology.edges() == edges


def test_the_default_of_a_key_is_the_weight_of_edges_without_one(tmp_path):
    """As the standard of GraphML says."""
    head = HEAD.replace('attr.type="double"/>', 'attr.type="double"><default>9</default></key>', 1)
    edges = [(1, 0, 9.0), (2, 1, 9.0), (3, 2, 2.0)]
    assert loaded(tmp_path, head + NODES + LINKS + TAIL).cells[0].scenario.topology.edges() == edges


LAUGHS = '<!DOCTYPE x [<!ENTITY a0 "ha">'
LAUGHS += "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(12)) + "]>"


@pytest.mark.parametrize(
    ("graphml", "says"),
    [
        (HEAD + NODES + LINKS.replace('"w"', '"c"') + TAIL, "attribute 'cost'; only 'weight' is read"),
        (HEAD + NODES + '<node id="2"/>' + LINKS + TAIL, "two nodes have one number"),
        (HEAD + NODES + '<node id="n7"/>' + LINKS + TAIL, "node 7 has no edge"),
        (HEAD + NODES.replace('"n2"/>', '"n2"><data key="v">9</data></node>') + LINKS + TAIL, "called '9'"),
        (HEAD + NODES + LINKS.replace(">2<", ">-2<") + TAIL, "a weight is a number > 0"),
        (
            HEAD + NODES + LINKS + '</graph><graph edgedefault="directed"><node id="n4"/>' + TAIL,
            "more than one graph",
        ),
        (
            HEAD + NODES.replace('"n3"/>', '"n3"><graph edgedefault="directed"/></node>') + LINKS + TAIL,
            "more than one graph",
        ),
        (HEAD.replace(' edgedefault="directed"', "") + NODES + LINKS + TAIL, "no edgedefault"),
        (HEAD.replace('"cost"', '"id"') + NODES + LINKS + TAIL, "data called 'id' are not read"),
        (LAUGHS + HEAD + "&a12;" + NODES + LINKS + TAIL, "entities are not read"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "study.yaml">]>' + HEAD + "&a;" + TAIL, "entities are not read"),
    ],
)
def test_graphml_that_means_something_else_is_told(graphml, says, tmp_path):
    """Attributes that nobody reads, names beside numbers, and entities, before any is expanded."""
    with pytest.raises(jaxnet.ConfigError, match=says) as raised:
        loaded(tmp_path, graphml)
    assert len(raised.value.problems) == 1


def test_damaged_graphml_loads_or_is_a_config_error(tmp_path):
    """Characters of a file deleted, doubled or exchanged, wherever that is."""
    random, text = np.random.default_rng(38), HEAD + NODES + LINKS + TAIL
    for _ in range(80):
        start, length = random.integers(len(text)), random.integers(1, 9)
        part = text[start : start + length]
        other = text[(at := random.integers(len(text))) : at + length]
        new = ["", part * 2, other, "\0", "<", "é"][random.integers(6)]
        with contextlib.suppress(jaxnet.ConfigError):
            loaded(tmp_path, text[:start] + new + text[start + length :])


def line_of(*nodes, **attributes):
    """A directed graph in which each node hears the one before it."""
    network = nx.DiGraph(name=attributes.pop("name", ""))
    network.add_edges_from(zip(nodes[1:], nodes, strict=False), **attributes)
    return network


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (line_of(0, "a", "b"), "nodes are whole numbers, 0 the navigator (got 'a')"),
        (nx.grid_2d_graph(2, 2), "(got (0, 0))"),
        (line_of(0, 1.9, 2.2, 3.7), "(got 1.9)"),
        (line_of(0, True, 2), "(got True)"),
        (line_of(0, -1), "(got -1)"),
        *((line_of(0, 1, weight=w), f"(got {w!r})") for w in (None, np.nan, np.inf, -1.0, 0, "heavy", True)),
        (line_of(0, 1, 2, cost=3), "edge (1, 0) has the attribute 'cost'; only 'weight' is read"),
        (nx.DiGraph(), "the network has no edge"),
        (nx.DiGraph([(0, 1)]), "the network has no edge (i, j) with i > 0"),
        (nx.empty_graph(4), "node 0 has no edge"),
        (nx.MultiDiGraph([(1, 0), (1, 0), (2, 1), (3, 2)]), "[1, 0] is given twice"),
        (nx.DiGraph([(1, 0), (2, 1), (2, 2), (3, 2)]), "2 hears itself"),
        (nx.Graph([(1, 0), (2, 1), (2, 2), (3, 2)]), "2 hears itself"),
        (nx.path_graph(6), "i is 1 to 3 and j 0 to 3"),
        (nx.path_graph(3), "the graph has 2 vehicles (got 3)"),
    ],
)
def test_networks_that_mean_no_graph_are_config_errors(network, says):
    """At `topology`, or at what of it is at fault."""
    with pytest.raises(jaxnet.ConfigError, match=re.escape(says)):
        jaxnet.load({"vehicles": 3, "topology": network, "attack": "none"})


def test_labels_of_numpy_are_numbers_and_names_are_labels():
    """Two swept networks are told apart by their names."""
    networks = [line_of(*np.arange(4), name="line", weight=np.float32(2)), nx.star_graph(3)]
    networks[1].name = "star"
    study = jaxnet.load({"vehicles": 3, "attack": "none", "sweep": {"topology": networks}})
    assert [cell.labels["topology"] for cell in study.cells] == ["line", "star"]
    assert study.cells[0].scenario.topology.edges == [(1, 0, 2.0), (2, 1, 2.0), (3, 2, 2.0)]
    for network in networks:
        network.name = ""
    with pytest.raises(jaxnet.ConfigError, match="give each a label, a networkx graph a name"):
        jaxnet.load({"vehicles": 3, "attack": "none", "sweep": {"topology": networks}})
