"""Lanes and the lane graph of layouts on no grid, with a referee of its own: shapely's polygons."""

import math
from dataclasses import replace
from itertools import pairwise

import networkx as nx
import numpy as np
import numpy.typing as npt
import pytest
from shapely import Polygon, STRtree, unary_union
from shapely.geometry.base import BaseGeometry

from maps.free_lanes.graph import FreeLanes, free_lanes
from maps.free_lanes.lanes import lanes_of_layout
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError
from tests.unit.maps.free_lanes.floors import BODY, RING, TREE, layout_of, ring, tree

CROSSING = layout_of(
    {**RING, "e": (-3.0, 2.5), "f": (3.0, 9.0), "g": (9.0, 1.5)},
    [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"), ("e", "g"), ("g", "f"), ("f", "e"), ("a", "e"), ("e", "d")],
)
FLOORS = {"ring": ring(), "tree": tree(), "crossing": CROSSING}


def swept(poses: npt.NDArray[np.float64]) -> BaseGeometry:
    """What a body takes of the floor on its way."""
    corners = np.array([(0.41, 0.15), (0.41, -0.15), (-0.09, -0.15), (-0.09, 0.15)])
    bodies = []
    for x, y, yaw in poses.tolist():
        turned = np.array([(math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))])
        bodies.append(Polygon(corners @ turned + (x, y)))
    return unary_union(bodies)


def check(lanes: FreeLanes) -> None:
    """What has no cell in common does not touch, wherever cars are on their moves, and paths are smooth."""
    graph = lanes.graph
    bounds = graph.path_ptr.tolist()
    paths = [graph.path_points[a:b] for a, b in pairwise(bounds)]
    cells = [set(graph.swept_cell[a:b].tolist()) for a, b in pairwise(graph.swept_ptr)]
    for move, path in enumerate(paths):
        begin, end = graph.move_from[move], graph.move_to[move]
        np.testing.assert_allclose(path[0, :2], graph.state_pose[begin, :2], atol=1e-6)
        np.testing.assert_allclose(path[-1, :2], graph.state_pose[end, :2], atol=1e-6)
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() < 0.05
        bend = np.abs(np.diff(path[:, 2])) / np.maximum(np.diff(graph.path_s[bounds[move] : bounds[move + 1]]), 0.01)
        assert np.median(bend) <= 1 / 0.38
    floors = [swept(path[np.r_[0 : len(path) : 3, -1]]) for path in paths]
    tree = STRtree(floors)
    for i, j in tree.query(floors, predicate="intersects").T.tolist():
        assert cells[i] & cells[j], (i, j)
    stands = [swept(pose[None]) for pose in graph.state_pose]
    for state, move in tree.query(stands, predicate="intersects").T.tolist():
        assert state in cells[move], (state, move)


@pytest.mark.parametrize("name", FLOORS)
def test_what_shares_no_cell_does_not_touch(name: str) -> None:
    check(free_lanes(FLOORS[name], BODY, where=name))


@pytest.mark.parametrize("name", FLOORS)
def test_from_everywhere_a_way_leads_to_every_node(name: str) -> None:
    lanes = free_lanes(FLOORS[name], BODY, where=name)
    assert nx.is_strongly_connected(lanes.graph.to_networkx())
    assert set(lanes.states_at) <= {node.name for node in FLOORS[name].nodes}
    assert {station.node for station in FLOORS[name].stations} <= set(lanes.states_at)


def test_who_stands_is_in_the_way_only_of_those_that_want_to_go_there() -> None:
    """But for stations; else two cars could block each other for ever."""
    graph = free_lanes(CROSSING, BODY, where="crossing").graph
    for move in range(graph.n_moves):
        cells = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]
        states = set(cells[cells < graph.n_states].tolist())
        assert states == {int(graph.move_from[move]), int(graph.move_to[move])}


def test_cars_keep_right_and_turn_round_at_ends_only() -> None:
    lanes = lanes_of_layout(tree(), radius_m=0.4, spacing_m=0.8, where="tree")
    assert set(lanes.lanes["hub east"].turns) == {"east hub"}
    assert set(lanes.lanes["east hub"].turns) == {"hub north", "hub west"}
    x, y, yaw = lanes.lanes["hub east"].line.pose(2.0)
    (ex, ey) = TREE["east"]
    along = math.atan2(ey, ex)
    assert yaw == pytest.approx(along, abs=1e-6)
    assert math.sin(along) * x - math.cos(along) * y == pytest.approx(0.4, abs=1e-6)  # to the right of the edge
    assert "3 edges lead both ways" in lanes.notes[0]


def test_a_ring_of_one_way_lanes_is_as_long_as_it_is() -> None:
    lanes = free_lanes(ring(), BODY, where="ring")
    length = sum(math.dist(RING[a], RING[b]) for a, b in ("ab", "bc", "cd", "da"))
    assert lanes.graph.move_length.sum() == pytest.approx(length, rel=0.06)
    assert lanes.graph.move_length.sum() < length  # corners are cut
    assert lanes.notes == ()
    assert 1.0 < lanes.path_ratio < 2.0  # one way round, by the shorter way of both


def wrong(what: str) -> FloorLayout:
    if what == "dead end":
        return layout_of(
            {**RING, "e": (9.0, 0.0)},
            [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"), ("b", "e")],
            stations={"e": "pick"},
        )
    if what == "tight":
        corner = (((0.0, 0.0), (3.0, 0.2)), ((3.0, 0.2), (6.0, 0.0)), ((6.0, 0.0), (6.0, 0.3)))
        return layout_of(
            {**RING, "b": (6.0, 0.3)},
            [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")],
            curves={("a", "b"): corner},
        )
    if what == "beside":
        return layout_of(
            RING, [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")], curves={("a", "b"): (((0.0, 0.0), (5.0, 0.0)),)}
        )
    if what == "same place":
        return layout_of({**RING, "b": (0.0, 0.01)}, [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")])
    return layout_of(RING, [("a", "b"), ("b", "c")])


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("dead end", "bad: station 'pick at e' at node 'e' is on no way that leads on and comes back"),
        ("tight", "bad: edge 'a b' bends with a radius of"),
        ("beside", "bad: the curve of edge 'a b' ends 1.00 m beside node 'b'; valid: at most 0.05 m"),
        ("same place", "bad: edge 'a b' leads from 'a' to 'b' at the same place"),
        ("nothing goes round", "bad: no way comes back to where it began"),
    ],
)
def test_layouts_that_cannot_be_driven_are_refused_by_name(what: str, said: str) -> None:
    with pytest.raises(LayoutError) as caught:
        free_lanes(wrong(what), BODY, where="bad")
    assert str(caught.value).startswith(said)
    assert "; valid: " in str(caught.value)


def test_ways_backwards_are_left_out_and_said() -> None:
    back = LayoutEdge(name="back", start="b", end="a", backwards=True)
    lanes = free_lanes(replace(ring(), edges=(*ring().edges, back)), BODY, where="ring")
    assert lanes.notes == ("1 ways are left out, on which vehicles reverse",)
