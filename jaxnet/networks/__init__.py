"""Networks as other programs write them: nodes with labels, and links in either direction.

A reader (`files`, `tables`, `objects`) returns a `NamedNetwork`. `number_nodes` makes
of it the edges (i, j, w) of a graph, "vehicle i hears source j", in which source 0 is the
navigator.
"""

import itertools
import re
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple
from urllib.parse import quote, unquote

from jaxnet.model.wording import ranges
from jaxnet.outside.modules import KindError

GREATEST_EDGE_WEIGHT = 1e9  # weight of an edge
DECIMAL_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)
NODE_NUMBER = re.compile(r"[0-9]{1,9}", re.ASCII)
LEADER_NAMES = ("0", "navigator", "leader")
MOST_NAMED = 8  # nodes that an error names

Direction = Literal["hears", "tells"]
LinkList = list[tuple[str, str, float]]  # two ends as they were written, and the weight
EdgeList = list[tuple[int, int, float]]  # listener, source and weight


class NamedNetwork(NamedTuple):
    """Nodes, none if they are numbers, and links, as an object or a file has them."""

    nodes: tuple[str, ...]
    links: LinkList
    navigator: str | None = None  # the node of column 0 of [a0 | A]


class NumberedNetwork(NamedTuple):
    """Edges between vehicles 1 … m and the navigator 0; names, none if numbers name vehicles."""

    edges: EdgeList
    names: tuple[str, ...]


def write_network(network: NamedNetwork) -> str:
    """Return a network as one line of text: its nodes and its links a,b,w, between blanks."""
    nodes = [quote(node, safe="") for node in network.nodes]
    links = [
        f"{quote(one, safe='')},{quote(other, safe='')},{weight}"
        for one, other, weight in network.links
    ]
    return " ".join(
        [*nodes, *links, *([] if network.navigator is None else [f"={network.navigator}"])]
    )


def parse_network(content: str) -> NamedNetwork:
    """Return the network in text of `write_network`; raise ValueError."""
    nodes, links, navigator = [], [], None
    for item in content.split():
        first, *others = item.split(",")
        if item.startswith("="):  # which `quote` writes nowhere
            navigator = item[1:]
        elif others:
            second, weight = others
            links.append((unquote(first), unquote(second), parse_weight(weight)))
        else:
            nodes.append(unquote(first))
    return NamedNetwork(tuple(nodes), links, navigator)


def parse_number(text: str) -> float:
    if not DECIMAL_NUMBER.fullmatch(text.strip()):
        raise ValueError("no number")
    return float(text)


def parse_weight(text: str) -> float:
    weight = parse_number(text)
    if not 0 < weight <= GREATEST_EDGE_WEIGHT:
        raise ValueError("a weight is positive")
    return weight


def number_nodes(
    network: NamedNetwork,
    direction: Direction = "hears",
    first: int = 0,
    leader: str | None = None,
    names: Sequence[str] = (),
    leads: bool = True,
) -> NumberedNetwork:
    """Number the nodes of a network: the navigator is 0, vehicles are 1 … m in the nodes' order.

    A link (a, b) means that a `hears` or `tells` b. `first` is the number of the first node, if
    nodes are numbers. The navigator has the label `leader`, by default `first`, 0, navigator or
    leader; unless `leads`, every node is a vehicle. `names` of vehicles replace the labels. Raises
    KindError if no node is the navigator, if nodes are numbered with gaps, if the navigator hears a
    vehicle that does not hear it, or if something names the navigator of a network without one.
    """
    labels = list(network.nodes or dict.fromkeys(end for *ends, _ in network.links for end in ends))
    if not network.links:
        raise KindError("the network has no edge")
    numbered = all(map(NODE_NUMBER.fullmatch, labels))
    if not leads:
        refuse_navigator(network, first, leader)
        first = min(1, *map(int, labels)) if numbered else 0
    if numbered:
        labels = range_of_numbers(labels, first, len(network.links))
    order = ["", *labels]  # whose first is no node
    if leads:
        named = [label for label in labels if label.casefold() in LEADER_NAMES]
        if leader is not None:
            chosen = leader
        elif numbered:
            chosen = str(first)
        elif len(named) == 1:
            chosen = named[0]
        else:
            raise KindError(f"which node is the navigator? leader is one of {listed(labels)}")
        if chosen not in labels:
            raise KindError(f"no node is called {chosen!r}: leader is one of {listed(labels)}")
        order = [chosen, *(label for label in labels if label != chosen)]
    numbers = {label: number for number, label in enumerate(order)}
    pairs = [(numbers[one], numbers[other], weight) for one, other, weight in network.links]
    if direction == "tells":
        told = any(one == 0 for one, _, _ in pairs)
        pairs = [(i, j, w) if not told and j == 0 else (j, i, w) for i, j, w in pairs]
    informed = {i for i, j, _ in pairs if j == 0}
    for listener, source, _ in pairs:  # a link that is most likely the wrong way round
        if listener == 0 and source not in (informed | {0}):
            other = "tells" if direction == "hears" else "hears"
            told = f"the navigator {order[0]} would hear {order[source]}, and it hears nobody;"
            raise KindError(f"{told} with direction: {other} a link means the opposite")
    edges = [edge for edge in pairs if edge[0] > 0]
    given = tuple(order[1:])
    known = () if given == tuple(map(str, range(1, len(order)))) else given
    return NumberedNetwork(edges, check_names(names, len(given)) or known)


def refuse_navigator(network: NamedNetwork, first: int, leader: str | None) -> None:
    """Raise KindError if a key, or a link from column 0 of `[a0 | A]`, names a navigator."""
    none = "and there is no navigator (navigator: none)"
    if first or leader is not None:
        raise KindError(
            f"{'first' if first else 'leader'} says which node is the navigator, {none}"
        )
    if any(source == network.navigator for _, source, _ in network.links):
        raise KindError(
            f"column 0 of a matrix m × (m + 1) is what the navigator tells, {none}: give zeros"
        )


def range_of_numbers(labels: Iterable[str], first: int, links: int) -> list[str]:
    """Return the labels from the first number to the last; raise KindError for a long gap."""
    numbers = [int(label) for label in labels]
    if min(numbers) < first:
        raise KindError(f"nodes are numbered from {first} (got {min(numbers)})")
    if max(numbers) - first > links:
        missing = next(number for number in itertools.count(first) if number not in numbers)
        raise KindError(
            f"nodes are numbered {first} to {max(numbers)}, but node {missing} has no edge"
        )
    return [str(number) for number in range(first, max(numbers) + 1)]


def check_names(names: Sequence[str], vehicles: int) -> tuple[str, ...]:
    """Return the names; raise KindError unless there are none, or one for each vehicle."""
    if names and len(names) != vehicles:
        raise KindError(f"names is a list of {vehicles}, one for each vehicle (got {len(names)})")
    if twice := [name for number, name in enumerate(names) if name in names[:number]]:
        raise KindError(f"two vehicles are called {twice[0]}")
    return tuple(names)


def listed(labels: Sequence[str]) -> str:
    if all(map(NODE_NUMBER.fullmatch, labels)):
        return ranges(sorted(map(int, labels)))
    return ", ".join([*labels[:MOST_NAMED], *["…"] * (len(labels) > MOST_NAMED)])
