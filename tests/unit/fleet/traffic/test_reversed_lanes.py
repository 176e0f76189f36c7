"""Reversed lanes: moves that may be driven backwards, and what hangs together then."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from fleet.traffic.reversed_lanes import both_ways, cut_moves, dead_ends, in_order, with_reversed
from maps.lane_graph import REVERSE, LaneGraph, build_lane_graph
from maps.site import load_site

SITES = ("small", "twin", "medium")


@pytest.fixture(scope="module", params=SITES)
def graph(request: pytest.FixtureRequest) -> LaneGraph:
    return build_lane_graph(load_site(request.param))


def drawn_blocks(graph: LaneGraph, seed: int) -> np.ndarray:
    """Some cells of lanes, at random."""
    blocked = np.zeros(graph.n_cells, dtype=np.bool_)
    blocked[np.random.default_rng(seed).choice(np.unique(graph.state_cell), 4, replace=False)] = True
    return blocked


def lanes_past(graph: LaneGraph, blocked: np.ndarray) -> nx.DiGraph:
    """The moves that lead from state to state and touch no blocked cell, found without the module under test."""
    lanes = nx.DiGraph()
    lanes.add_nodes_from(range(graph.n_states))
    for state in range(graph.n_states):
        for move in graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]].tolist():
            swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]
            if not blocked[swept].any():
                lanes.add_edge(state, int(graph.move_to[move]))
    return lanes


def test_a_reversed_move_leads_back_over_the_same_ground(graph: LaneGraph) -> None:
    moves = np.arange(0, graph.n_moves, 3, dtype=np.int32)
    longer = with_reversed(graph, moves, np.ones(len(moves), dtype=np.bool_))
    for k, move in enumerate(moves.tolist()):
        back = graph.n_moves + k
        assert (longer.move_from[back], longer.move_to[back]) == (graph.move_to[move], graph.move_from[move])
        assert longer.move_kind[back] == REVERSE
        assert longer.move_length[back] == graph.move_length[move]
        swept = [longer.swept_cell[longer.swept_ptr[m] : longer.swept_ptr[m + 1]].tolist() for m in (move, back)]
        assert swept[1] == swept[0][::-1]
        spans = [slice(longer.path_ptr[m], longer.path_ptr[m + 1]) for m in (move, back)]
        np.testing.assert_array_equal(longer.path_points[spans[1]], longer.path_points[spans[0]][::-1])
        assert longer.path_s[spans[1]][0] == 0.0
        np.testing.assert_allclose(longer.path_s[spans[1]], longer.move_length[move] - longer.path_s[spans[0]][::-1])


def test_moves_that_were_there_keep_their_numbers(graph: LaneGraph) -> None:
    moves = np.array([0, 5], dtype=np.int32)
    longer = with_reversed(graph, moves, np.ones(2, dtype=np.bool_))
    for name in ("move_from", "move_to", "move_kind", "move_length"):
        np.testing.assert_array_equal(getattr(longer, name)[: graph.n_moves], getattr(graph, name))
    for ptr, entries in (("swept_ptr", "swept_cell"), ("path_ptr", "path_points")):
        np.testing.assert_array_equal(getattr(longer, ptr)[: graph.n_moves + 1], getattr(graph, ptr))
        n = getattr(graph, ptr)[-1]
        np.testing.assert_array_equal(getattr(longer, entries)[:n], getattr(graph, entries))


def test_a_reversed_move_that_is_closed_leads_nowhere(graph: LaneGraph) -> None:
    longer = with_reversed(graph, np.array([0, 5], dtype=np.int32), np.array([False, True]))
    assert graph.n_moves not in longer.out_move
    assert graph.n_moves + 1 in longer.out_move
    assert len(longer.in_move) == len(longer.out_move) == graph.n_moves + 1


def test_in_order_means_by_from_state(graph: LaneGraph) -> None:
    moves = np.arange(0, graph.n_moves, 2, dtype=np.int32)
    ordered = in_order(with_reversed(graph, moves, moves % 4 == 0))
    assert (np.diff(ordered.move_from) >= 0).all()
    pairs = set(zip(ordered.move_from.tolist(), ordered.move_to.tolist(), strict=True))
    back = {(int(graph.move_to[m]), int(graph.move_from[m])) for m in moves[moves % 4 == 0].tolist()}
    assert pairs == set(zip(graph.move_from.tolist(), graph.move_to.tolist(), strict=True)) | back


def test_without_anything_reversed_order_changes_nothing(graph: LaneGraph) -> None:
    ordered = in_order(graph)
    for name in ("move_from", "move_to", "move_kind", "swept_ptr", "swept_cell", "out_ptr", "out_move", "in_ptr"):
        np.testing.assert_array_equal(getattr(ordered, name), getattr(graph, name))
        assert getattr(ordered, name).dtype == getattr(graph, name).dtype


@pytest.mark.parametrize("seed", range(4))
def test_driven_backwards_where_they_are_cut_lanes_hang_together(graph: LaneGraph, seed: int) -> None:
    blocked = drawn_blocks(graph, seed)
    cut = cut_moves(graph, blocked)
    opened = lanes_past(with_reversed(graph, cut, np.ones(len(cut), dtype=np.bool_)), blocked)
    before = {
        state: k
        for k, part in enumerate(nx.strongly_connected_components(lanes_past(graph, blocked * False)))
        for state in part
    }
    part = both_ways(graph, blocked)
    for together in nx.weakly_connected_components(opened):
        assert len({int(part[state]) for state in together}) == 1
        # What was connected before there was anything in the way is so again.
        states = sorted(together)
        for group in {before[state] for state in states}:
            members = [state for state in states if before[state] == group]
            assert all(nx.has_path(opened, members[0], other) for other in members)
            assert all(nx.has_path(opened, other, members[0]) for other in members)


def test_nothing_is_cut_where_nothing_is_blocked(graph: LaneGraph) -> None:
    nothing = np.zeros(graph.n_cells, dtype=np.bool_)
    assert cut_moves(graph, nothing).size == 0


@pytest.mark.parametrize("seed", range(3))
def test_dead_ends_are_what_lanes_do_not_go_round_in(graph: LaneGraph, seed: int) -> None:
    blocked = drawn_blocks(graph, seed)
    (ends, *inner), lanes = dead_ends(graph, blocked), lanes_past(graph, blocked)
    for part in nx.weakly_connected_components(lanes):
        stretches = sorted(nx.strongly_connected_components(lanes.subgraph(part)), key=len)
        rounds = [s for s in stretches if len(s) == len(stretches[-1])]
        goes_round = set().union(*rounds)
        assert {state for state in part if ends[state] < 0} == goes_round
        inside = lanes.subgraph(part - goes_round)
        for one in nx.weakly_connected_components(inside):
            assert len({int(ends[state]) for state in one}) == 1
        within = inner[0] if inner else ends
        for stretch in stretches:
            passes = len(stretch) > 1 or stretch in rounds
            assert {bool(within[state] < 0) for state in stretch} == {passes}
