import math

import networkx as nx
import numpy as np
import pytest

from maps.grid import EAST, NORTH, SOUTH, WEST, GridMap
from maps.lane_graph import MotionError, MoveKind, build_lane_graph, grid_lane_graph
from maps.site import load_site, site_from_plan
from maps.vehicle import BODY_FRONT_M

ARC_M = 0.4 * math.pi / 2


@pytest.fixture(scope="module")
def small():
    """The small site and its graph: straight docks, crossings, pull-through parking."""
    site = load_site("small")
    return site, build_lane_graph(site)


def moves_of(graph, state):
    return graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]


def points_of(graph, move):
    span = slice(graph.path_ptr[move], graph.path_ptr[move + 1])
    return graph.path_points[span], graph.path_s[span]


def test_first_states_are_the_first_of_their_cells(small):
    _, graph = small
    cells = np.unique(graph.state_cell).tolist()
    assert graph.first_states(cells).tolist() == [graph.states_of_cell(cell)[0] for cell in cells]


def test_every_lane_is_a_state_that_waits_0_1_m_inside(small):
    site, graph = small
    assert graph.n_states == len(site.lanes)
    docks = {station.dock.cell for station in site.stations}
    for before, cell in site.lanes.tolist():
        (state,) = [
            s
            for s in graph.states_of_cell(cell)
            if site.grid.neighbour(cell, (graph.state_heading[s] + 2) % 4) == before
        ]
        middle = (site.grid.cell_xy(before)[0] + site.grid.cell_xy(cell)[0]) / 2
        depth = np.hypot(*(graph.state_pose[state, :2] - middle))
        assert depth == pytest.approx(0.34 if cell in docks else 0.1)


def test_dock_state_is_the_stop_pose_and_leaves_straight(small):
    site, graph = small
    for station in site.stations:
        state = graph.state_at(station.dock.cell, station.dock.heading)
        np.testing.assert_allclose(graph.state_pose[state], station.dock.pose)
        np.testing.assert_allclose(station.dock.tray_xy, site.grid.cell_xy(station.dock.cell)[0])
        assert [graph.move_kind[m] for m in moves_of(graph, state)] == [MoveKind.STRAIGHT]


def test_lengths_of_moves(small):
    site, graph = small
    docks = np.isin(graph.state_cell, [station.dock.cell for station in site.stations])
    plain = ~docks[graph.move_from] & ~docks[graph.move_to]
    straight, turn = graph.move_kind == MoveKind.STRAIGHT, np.isin(graph.move_kind, [MoveKind.LEFT, MoveKind.RIGHT])
    np.testing.assert_allclose(graph.move_length[plain & straight], 1.0)
    np.testing.assert_allclose(graph.move_length[plain & turn], ARC_M + 0.2)
    np.testing.assert_allclose(graph.move_length[docks[graph.move_from]], 0.76)
    np.testing.assert_allclose(graph.move_length[docks[graph.move_to] & straight], 1.24)


def test_paths_run_from_pose_to_pose_in_small_steps(small):
    _, graph = small
    for move in range(graph.n_moves):
        points, s = points_of(graph, move)
        start, end = graph.state_pose[graph.move_from[move]], graph.state_pose[graph.move_to[move]]
        np.testing.assert_allclose(points[0], start, atol=1e-12)
        np.testing.assert_allclose(points[-1, :2], end[:2], atol=1e-12)
        assert math.cos(points[-1, 2] - end[2]) == pytest.approx(1.0)
        assert s[0] == 0.0
        assert s[-1] == pytest.approx(graph.move_length[move])
        assert np.all((np.diff(s) > 0) & (np.diff(s) <= 0.05 + 1e-9))
        chords = np.hypot(*np.diff(points[:, :2], axis=0).T)
        np.testing.assert_allclose(chords, np.diff(s), atol=1e-4)  # an arc of 0.05 m is 3e-5 m longer than its chord
        # The car drives where it points: chord direction lies between the yaws at its ends.
        direction = np.arctan2(*np.diff(points[:, :2], axis=0).T[::-1])
        middle = (points[1:, 2] + points[:-1, 2]) / 2
        np.testing.assert_allclose(np.cos(direction - middle), 1.0, atol=1e-3)


def test_body_stays_in_the_swept_cells(small):
    site, graph = small
    # The racecar reaches 0.09 m behind its rear axle and 0.14 m to each side.
    outline = np.array([(x, y) for x in np.linspace(-0.09, BODY_FRONT_M, 11) for y in (-0.14, 0.14)])
    for move in range(graph.n_moves):
        points, _ = points_of(graph, move)
        cos, sin = np.cos(points[:, 2:]), np.sin(points[:, 2:])
        x = points[:, :1] + cos * outline[:, 0] - sin * outline[:, 1]
        y = points[:, 1:2] + sin * outline[:, 0] + cos * outline[:, 1]
        touched = {site.grid.index(*site.grid.cell_at(a, b)) for a, b in zip(x.ravel(), y.ravel(), strict=True)}
        swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist()
        assert touched == set(swept)
        assert swept == [graph.state_cell[graph.move_from[move]], graph.state_cell[graph.move_to[move]]]


def test_moves_turn_by_their_kind_and_never_round(small):
    _, graph = small
    quarter = (graph.state_heading[graph.move_to] - graph.state_heading[graph.move_from]) % 4
    expected = {MoveKind.STRAIGHT: 0, MoveKind.LEFT: 1, MoveKind.RIGHT: 3}
    assert all(expected[MoveKind(k)] == q for k, q in zip(graph.move_kind, quarter, strict=True))


def test_in_and_out_tables_list_every_move_once(small):
    _, graph = small
    for ptr, table, end in (
        (graph.out_ptr, graph.out_move, graph.move_from),
        (graph.in_ptr, graph.in_move, graph.move_to),
    ):
        assert sorted(table.tolist()) == list(range(graph.n_moves))
        for state in range(graph.n_states):
            assert all(end[m] == state for m in table[ptr[state] : ptr[state + 1]])


def test_networkx_export_is_the_same_strongly_connected_graph(small):
    _, graph = small
    exported = graph.to_networkx()
    assert exported.number_of_nodes() == graph.n_states
    assert exported.number_of_edges() == graph.n_moves
    assert nx.is_strongly_connected(exported)
    first = exported.edges[int(graph.move_from[0]), int(graph.move_to[0])]
    assert first["length"] == graph.move_length[0]
    assert exported.nodes[3]["cell"] == graph.state_cell[3]


def test_dock_left_by_a_turn_keeps_the_waiting_pose():
    plan = ["########", "AP....K#", "_.####.#", "#.####.#", "#......_", "#.####DA", "#......_", "########"]
    site = site_from_plan(plan, name="corner")
    graph = build_lane_graph(site)
    dock = site.stations[0].dock
    assert (dock.stop_offset_m, dock.heading) == (0.0, NORTH)
    state = graph.state_at(dock.cell, NORTH)
    assert [graph.move_kind[m] for m in moves_of(graph, state)] == [MoveKind.RIGHT]
    assert site.stations[0].arm.pose == pytest.approx((0.9, dock.pose[1] + 0.16, 0.0, 0.0))


def test_reverse_moves_only_where_allowed():
    plan = load_site("cell").plan
    graph = build_lane_graph(site_from_plan(plan, name="c", allow_reverse=True))
    back = np.flatnonzero(graph.move_kind == MoveKind.REVERSE)
    assert len(back) > 0
    for move in back:
        points, _ = points_of(graph, move)
        yaw = points[0, 2]
        step = points[-1, :2] - points[0, :2]
        assert np.dot(step, (math.cos(yaw), math.sin(yaw))) == pytest.approx(-graph.move_length[move])
        assert graph.state_heading[graph.move_from[move]] == graph.state_heading[graph.move_to[move]]
    assert not (build_lane_graph(site_from_plan(plan, name="c")).move_kind == MoveKind.REVERSE).any()


def test_pebble_graph_joins_free_neighbours():
    graph = grid_lane_graph(GridMap(np.array([[1, 1, 0], [0, 1, 1]], dtype=bool)), "pebble")
    pairs = {
        (int(graph.state_cell[a]), int(graph.state_cell[b]))
        for a, b in zip(graph.move_from, graph.move_to, strict=True)
    }
    assert pairs == {(0, 1), (1, 0), (1, 4), (4, 1), (4, 5), (5, 4)}
    assert graph.state_at(2, 0) == -1
    assert graph.states_of_cell(4).tolist() == [graph.state_at(4, 0)]
    assert graph.first_states([4]).tolist() == [graph.state_at(4, 0)]
    assert graph.first_states([]).tolist() == []


def test_rotating_graph_turns_on_the_spot():
    graph = grid_lane_graph(GridMap(np.array([[1, 1]], dtype=bool)), "rotating")
    assert (graph.n_states, graph.n_moves) == (8, 8 * 2 + 2)
    east = graph.state_at(0, EAST)
    reached = {(int(graph.state_cell[s]), int(graph.state_heading[s])) for s in graph.move_to[moves_of(graph, east)]}
    assert reached == {(1, EAST), (0, NORTH), (0, SOUTH)}
    turns = np.flatnonzero(graph.move_kind == MoveKind.TURN)
    assert np.all(np.diff(graph.swept_ptr)[turns] == 1)
    assert np.all(graph.move_length[turns] == 0)
    assert graph.state_at(1, WEST) >= 0


@pytest.mark.parametrize("motion", ["carlike", "hovering"])
def test_unknown_motion_is_refused(motion):
    with pytest.raises(MotionError, match="valid: "):
        grid_lane_graph(GridMap(np.ones((2, 2), dtype=bool)), motion)
    with pytest.raises(MotionError, match="valid: 'carlike'"):
        build_lane_graph(load_site("cell"), "pebble")
