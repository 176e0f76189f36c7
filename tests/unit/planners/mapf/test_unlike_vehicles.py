"""Vehicles of several kinds on one floor: each on lanes of its own, over cells that all of them share."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from maps.lane_graph import LEFT, RIGHT, LaneGraph, build_lane_graph, side_by_side
from maps.vehicle import Footprint
from maps.warehouse import generate_warehouse
from planners.mapf import PLANNERS, planner_named
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.problem import Instance, Plan, Status
from planners.mapf.validate import breaches, conflicts

SITE = generate_warehouse(rows=18, cols=24, pick=2, drop=2, parking=4, lanes=3)
"""Aisles of three lanes, in some of which there is room to turn for a bus."""
CAR = build_lane_graph(SITE)
BUS = build_lane_graph(SITE, footprint=Footprint(front_m=0.65, rear_m=0.09, half_width_m=0.3, turn_radius_m=0.4))
BOTH = side_by_side((CAR, BUS))


def going_round(graph: LaneGraph) -> np.ndarray:
    """States of the largest part of a graph from which a vehicle comes back."""
    ends = (graph.move_from, graph.move_to)
    moves = coo_array((np.ones(graph.n_moves), ends), shape=(graph.n_states, graph.n_states))
    part = connected_components(moves, directed=True, connection="strong")[1]
    return np.flatnonzero(part == np.bincount(part).argmax())


def moves_of(graph: LaneGraph) -> set[tuple[int, ...]]:
    """Cells and headings of both ends of each move, its kind, and the cells that it sweeps."""
    place = 4 * graph.state_cell.astype(int) + graph.state_heading
    swept = [
        tuple(sorted(graph.swept_cell[a:b].tolist()))
        for a, b in zip(graph.swept_ptr[:-1], graph.swept_ptr[1:], strict=True)
    ]
    ends = zip(place[graph.move_from].tolist(), place[graph.move_to].tolist(), graph.move_kind.tolist(), strict=True)
    return {(*end, *cells) for end, cells in zip(ends, swept, strict=True)}


def test_each_kind_has_its_own_states_and_moves() -> None:
    assert (BOTH.n_kinds, BOTH.n_states, BOTH.n_moves) == (2, 2 * CAR.n_states, CAR.n_moves + BUS.n_moves)
    kinds = BOTH.move_from // BOTH.n_places, BOTH.move_to // BOTH.n_places
    assert np.array_equal(*kinds)
    assert np.array_equal(BOTH.state_cell[BOTH.n_places :], CAR.state_cell)
    assert moves_of(BOTH) == moves_of(CAR) | moves_of(BUS)
    for state in (0, CAR.n_states - 1, CAR.n_states, BOTH.n_states - 1):
        out = BOTH.out_move[BOTH.out_ptr[state] : BOTH.out_ptr[state + 1]]
        into = BOTH.in_move[BOTH.in_ptr[state] : BOTH.in_ptr[state + 1]]
        assert (BOTH.move_from[out] == state).all()
        assert (BOTH.move_to[into] == state).all()
        assert state in BOTH.states_like(state)
        assert BOTH.place_of(state) == state % CAR.n_states
    for move in (0, CAR.n_moves, BOTH.n_moves - 1):
        path = BOTH.path_points[BOTH.path_ptr[move] : BOTH.path_ptr[move + 1]]
        np.testing.assert_allclose(path[0, :2], BOTH.state_pose[BOTH.move_from[move], :2], atol=1e-9)
        np.testing.assert_allclose(path[-1, :2], BOTH.state_pose[BOTH.move_to[move], :2], atol=1e-9)
    assert side_by_side((CAR,)) is CAR


def test_the_large_one_goes_round_by_wide_lanes_only() -> None:
    nothing = np.zeros(BOTH.n_cells, dtype=np.bool_)
    tables = DistanceTable(BOTH, nothing)
    ring = going_round(BUS)
    goal = int(ring[0])
    of_car, of_bus = tables.to(goal), tables.to(goal + BOTH.n_places)
    assert (of_bus[ring + BOTH.n_places].astype(int) >= of_car[ring]).all()
    assert (of_bus[: BOTH.n_places] == UNREACHABLE).all(), "no car becomes a bus"
    cut_off = np.setdiff1d(going_round(CAR), ring)
    assert len(cut_off)
    assert (of_bus[cut_off + BOTH.n_places] == UNREACHABLE).any()


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("seed", range(4))
def test_plans_keep_what_sweeps_more_cells_apart_from_others(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ring = going_round(BUS)
    starts = _apart(rng.permutation(ring))[:24]
    n = len(starts)
    kinds = (np.arange(n) % 3 == 0).astype(np.int64)
    goals = rng.choice(ring, n) + kinds * BOTH.n_places
    instance = Instance(
        graph=BOTH,
        starts=(starts + kinds * BOTH.n_places).astype(np.int32),
        goals=goals.astype(np.int32),
        priorities=rng.random(n),
        stay=np.zeros(n, dtype=np.bool_),
        fixed=np.zeros(n, dtype=np.bool_),
        blocked=np.zeros(BOTH.n_cells, dtype=np.bool_),
        allow_rotation=False,
        horizon=20,
    )
    plan = planner_named(name, seed=seed).plan(instance, DistanceTable(BOTH, instance.blocked))
    assert breaches(instance, plan) == []
    assert (plan.states // BOTH.n_places == kinds).all()
    wide = np.diff(BOTH.swept_ptr)[_moves_between(plan)] > 2
    assert wide.any(), "nobody swept a third cell"


def test_the_referee_sees_a_car_in_a_cell_that_a_bus_sweeps() -> None:
    turn = int(np.flatnonzero(np.isin(BUS.move_kind, (LEFT, RIGHT)))[0])
    beside = int(BUS.swept_cell[BUS.swept_ptr[turn] + 2])
    car = int(CAR.states_of_cell(beside)[0])
    bus = BUS.move_from[turn] + BOTH.n_places, BUS.move_to[turn] + BOTH.n_places
    states = np.array([[car, bus[0]], [car, bus[1]]], dtype=np.int32)
    plan = Plan(states=states, status=Status.FEASIBLE, iterations=0)
    assert [found.kind for found in conflicts(BOTH, plan, allow_rotation=False)] == ["swept"]


def _apart(states: np.ndarray) -> np.ndarray:
    """The first state in each cell."""
    _, first = np.unique(BOTH.state_cell[states], return_index=True)
    return states[np.sort(first)]


def _moves_between(plan: Plan) -> np.ndarray:
    """Moves of a plan."""
    number = {ends: k for k, ends in enumerate(zip(BOTH.move_from.tolist(), BOTH.move_to.tolist(), strict=True))}
    steps = zip(plan.states[:-1].ravel().tolist(), plan.states[1:].ravel().tolist(), strict=True)
    return np.array([number[step] for step in steps if step[0] != step[1]])
