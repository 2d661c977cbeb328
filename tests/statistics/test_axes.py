"""Axes of a figure: every cell has its own place, and what cannot be drawn is refused in words."""

import itertools

import pytest

from jaxnet.statistics.axes import choose_axes, geometric, ordered_values, panels_of
from jaxnet.store.folder import FolderError
from tests import systems

SWEEP = {
    "defence": ["none", "trusted_trim", "trusted_only"],
    "attack.frequency": [0.1, 0.3, 1.0, 3.0],
    "vehicles": [3, 4],
    "topology": ["star"],
}
CELLS = systems.study(sweep=SWEEP, attack={"kind": "rotating", "vehicles": [2]}).cells


def test_numbers_go_across_and_kinds_into_colours():
    """The key of most numbers is on x, the kinds are the hue, the rest are panels."""
    assert choose_axes(CELLS) == ("attack.frequency", "defence", ("vehicles", "topology"))
    assert choose_axes(CELLS, x="vehicles")[:2] == ("vehicles", "defence")
    assert choose_axes(CELLS, hue="vehicles") == (
        "attack.frequency",
        "vehicles",
        ("defence", "topology"),
    )
    assert choose_axes(CELLS[:1]) == (
        None,
        None,
        ("defence", "attack.frequency", "vehicles", "topology"),
    )


@pytest.mark.parametrize(
    "named", [{}, *({a: k} for a, k in itertools.product(("x", "hue", "panel"), SWEEP))]
)
def test_no_two_cells_have_one_place(named):
    """Whatever is chosen, the values of x and hue within a panel are those of one cell."""
    axes = choose_axes(CELLS, **named)
    assert sorted([axes.x, axes.hue, *axes.panel]) == sorted(SWEEP)
    places = [
        (tuple(labels.items()), *(cell.labels[key] for key in (axes.x, axes.hue) if key))
        for labels, cells in panels_of(CELLS, axes)
        for cell in cells
    ]
    assert len(set(places)) == len(places) == len(CELLS)


@pytest.mark.parametrize(
    ("named", "words"),
    [
        (
            {"x": "tick"},
            r"x: tick is not swept \(swept are defence; attack.frequency; vehicles; topology\)",
        ),
        ({"x": "vehicles", "hue": "vehicles"}, "vehicles is named twice"),
        (
            {"hue": "attack.frequency", "most_hues": 3},
            "hue: attack.frequency has 4 values, and 3 can be told",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(named, words):
    """With the key, what is wrong, and what can be done."""
    with pytest.raises(FolderError, match=words):
        choose_axes(CELLS, **named)


def test_a_log_axis_is_for_geometric_numbers():
    """Over most of a decade and more evenly than on a linear axis; 0 has no place on it."""
    assert geometric([0.1, 0.3, 1.0, 3.0, 10.0])
    assert geometric([1, 10])
    assert not geometric(list(range(1, 11)))
    assert not geometric([0.0, 0.1, 1.0, 10.0])
    assert not geometric([1, 2, 4])
    assert not geometric([0, 5])


def test_numbers_rise_and_kinds_keep_their_order():
    """On every axis."""
    cells = systems.study(
        sweep={"attack.magnitude": [5, 1, 3], "defence": ["trusted_trim", "none"]}
    ).cells
    assert ordered_values(cells, "attack.magnitude") == [1, 3, 5]
    assert ordered_values(cells, "defence") == ["trusted_trim", "none"]
