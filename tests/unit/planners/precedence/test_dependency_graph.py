"""The dependency graph, verb by verb, on plans that are small enough to follow by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from maps.grid import EAST, NORTH, SOUTH, WEST, GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.problem import Plan
from planners.precedence.dependency_graph import DependencyGraph
from planners.precedence.errors import CyclicPlanError, ExecutionError, IllegalPlanError, StalePlanError
from planners.status import Status
from tests.unit.planners.mapf.lanes import graph_of, one_way_loop, open_grid


def plan_of(*rows: Sequence[int]) -> Plan:
    return Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0)


def with_plan(graph: LaneGraph, *rows: Sequence[int]) -> DependencyGraph:
    dependencies = DependencyGraph(graph, rows[0])
    dependencies.extend(plan_of(*rows))
    return dependencies


def ends_of(graph: LaneGraph, moves: Sequence[int]) -> list[int]:
    return graph.move_to[list(moves)].tolist()


@pytest.fixture
def crossing() -> LaneGraph:
    """Two lanes, 0 -> 1 -> 2 and 3 -> 1 -> 4, that cross in cell 1."""
    return graph_of([0, 1, 2, 3, 1, 4], [(0, 1), (1, 2), (3, 4), (4, 5)])


def test_moves_are_granted_and_finished_in_order() -> None:
    graph = open_grid(1, 4)
    dependencies = with_plan(graph, [0], [1], [1], [2], [3])
    assert ends_of(graph, dependencies.next_moves(0)) == [1, 2, 3]
    assert dependencies.granted_states().tolist() == [0]
    first = dependencies.grant(0)
    second = dependencies.grant(0)
    assert ends_of(graph, [first, second]) == [1, 2]
    assert (dependencies.n_granted(0), dependencies.n_queued(0)) == (2, 1)
    assert dependencies.held_cells(0) == [0, 1, 2]
    assert dependencies.finish(0) == first
    assert dependencies.held_cells(0) == [1, 2]
    assert dependencies.tail_states().tolist() == [3]
    assert dependencies.granted_states().tolist() == [2]


def test_where_grants_end_is_told_anew_after_each_of_them() -> None:
    graph = open_grid(1, 5)
    dependencies = with_plan(graph, [0], [1], [2], [3])
    nowhere = np.zeros(graph.n_cells, dtype=np.bool_)
    assert dependencies.granted_states().tolist() == [0]
    dependencies.grant_all(1, nowhere)
    assert dependencies.granted_states().tolist() == [1]
    dependencies.grant(0)
    assert dependencies.granted_states().tolist() == [2]
    dependencies.halt(0)
    dependencies.finish_all([0, 0])
    dependencies.extend(plan_of([2], [3]))
    assert dependencies.granted_states().tolist() == [2]
    dependencies.relocate(0, 4)
    assert dependencies.granted_states().tolist() == [4]


def test_a_cell_is_entered_in_the_order_of_the_plan(crossing: LaneGraph) -> None:
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 4], [2, 5])
    assert not dependencies.grantable(1), "the other agent comes first, though the cell is free"
    assert dependencies.blockers(1) == [(0, 1)]
    dependencies.grant(0)
    dependencies.grant(0)
    dependencies.finish(0)
    assert not dependencies.grantable(1), "the cell is not left yet"
    dependencies.finish(0)
    assert dependencies.grantable(1)
    assert dependencies.blockers(1) == []


def test_what_is_left_counts_own_moves_and_the_waits_for_those_who_come_first(crossing: LaneGraph) -> None:
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 4], [2, 5])
    # The other agent leaves the crossing at the end of timestep 2; entering and leaving it takes two more.
    assert dependencies.timesteps_left().tolist() == [2, 4]
    dependencies.grant(0)
    dependencies.grant(0)
    assert dependencies.timesteps_left().tolist() == [2, 4]
    dependencies.finish(0)
    assert dependencies.timesteps_left().tolist() == [1, 3]
    dependencies.finish(0)
    assert dependencies.timesteps_left().tolist() == [0, 2]


def test_followers_start_one_after_another() -> None:
    dependencies = with_plan(open_grid(1, 5), [0, 1, 2], [1, 2, 3], [2, 3, 4])
    assert dependencies.timesteps_left().tolist() == [4, 3, 2]
    assert dependencies.n_queued(0) == 2, "nothing was changed"


def test_a_follower_of_the_same_timestep_waits_for_its_leader() -> None:
    dependencies = with_plan(open_grid(1, 4), [0, 1, 2], [1, 2, 3])
    assert [dependencies.grantable(agent) for agent in range(3)] == [False, False, True]
    assert dependencies.blockers(0) == [(1, 1)]


def test_a_cell_that_is_visited_twice_is_shared_in_between() -> None:
    """Out and back through a two-way cell, with another agent passing while the first is away."""
    graph = graph_of(range(4), [(0, 1), (1, 0), (2, 0), (0, 3)])
    dependencies = with_plan(graph, [0, 2], [1, 2], [1, 0], [1, 3], [0, 3])
    dependencies.grant(0)
    assert not dependencies.grantable(0), "the way back waits for the visitor"
    dependencies.finish(0)
    for _ in range(2):
        dependencies.grant(1)
        dependencies.finish(1)
    dependencies.grant(0)
    dependencies.finish(0)
    assert dependencies.held_cells(0) == [0]


def test_an_agent_keeps_its_cell_on_the_way_out_and_back() -> None:
    dependencies = with_plan(open_grid(1, 2), [0], [1], [0])
    dependencies.grant(0)
    dependencies.grant(0)
    dependencies.finish(0)
    assert sorted(dependencies.held_cells(0)) == [0, 1]
    dependencies.finish(0)
    assert dependencies.held_cells(0) == [0]


def test_all_swept_cells_are_held() -> None:
    graph = graph_of([0, 1, 2, 3], [(0, 2), (1, 3)], sweeps={(0, 2): (3,)})
    dependencies = with_plan(graph, [0, 1], [2, 1], [2, 3])
    assert not dependencies.grantable(1)
    dependencies.grant(0)
    assert sorted(dependencies.held_cells(0)) == [0, 2, 3]
    dependencies.finish(0)
    assert dependencies.grantable(1)


def test_a_move_that_is_not_grantable_is_refused_by_name() -> None:
    dependencies = with_plan(open_grid(1, 3), [0, 1], [1, 2])
    with pytest.raises(ExecutionError, match=r"agent 0 must not start.*\[\(1, 1\)\]"):
        dependencies.grant(0)


def test_nothing_is_finished_that_was_not_granted() -> None:
    with pytest.raises(ExecutionError, match="agent 0 has no granted move"):
        with_plan(open_grid(1, 3), [0], [1]).finish(0)


def test_all_that_is_grantable_is_granted_but_not_into_closed_cells() -> None:
    graph = open_grid(2, 4)
    dependencies = with_plan(graph, [0, 4], [1, 5], [2, 6], [3, 7])
    closed = np.zeros(graph.n_cells, dtype=np.bool_)
    closed[6] = True
    agents, moves = dependencies.grant_all(2, closed)
    assert agents.tolist() == [0, 0, 1]
    assert ends_of(graph, moves.tolist()) == [1, 2, 5]
    dependencies.finish_all([0, 1, 0])
    assert [dependencies.held_cells(agent) for agent in (0, 1)] == [[2], [5]]
    assert [len(found) for found in dependencies.grant_all(2, ~closed | closed)] == [0, 0]
    with pytest.raises(ExecutionError, match="agent 1 has no granted move"):
        dependencies.finish_all([1])


def test_memory_is_used_again() -> None:
    """A thousand moves of two agents that follow each other take no more room than the first few."""
    graph = one_way_loop(6)
    dependencies = DependencyGraph(graph, [0, 3])
    for k in range(500):
        dependencies.extend(plan_of([k % 6, (k + 3) % 6], [(k + 1) % 6, (k + 4) % 6]))
        assert dependencies.n_visits == 4
        dependencies.grant_all(1, np.zeros(6, dtype=np.bool_))
        dependencies.finish_all([0, 1])
        assert dependencies.n_visits == 0
    assert len(dependencies._q.visit_next) == 4
    assert dependencies._q.moves.shape == (2, 1)


# --------------------------------------------------------------------------------------------------------------- extend


def test_plans_are_appended() -> None:
    graph = open_grid(1, 4)
    dependencies = with_plan(graph, [0, 1], [0, 2])
    dependencies.extend(plan_of([0, 2], [1, 3]))
    assert ends_of(graph, dependencies.next_moves(1)) == [2, 3]
    assert dependencies.tail_states().tolist() == [1, 3]


def test_a_plan_from_elsewhere_is_refused() -> None:
    dependencies = with_plan(open_grid(1, 4), [0], [1])
    with pytest.raises(StalePlanError, match="starts agent 0 in state 0; valid: 1"):
        dependencies.extend(plan_of([0], [1]))


def test_a_plan_for_another_fleet_is_refused() -> None:
    with pytest.raises(StalePlanError, match=r"valid: \(timesteps \+ 1, 1\)"):
        DependencyGraph(open_grid(1, 4), [0]).extend(plan_of([0, 1]))


@pytest.mark.parametrize(
    ("rows", "match"),
    [
        (([0, 1], [1, 1]), r"agents \[0, 1\] at timestep 1 all in cell 1"),
        (([0, 1], [0, 3]), "agent 1 at timestep 0 steps from state 1 to 3"),
        (([0, 1], [0, 4]), "agent 1 at timestep 1 in state 4"),
    ],
)
def test_an_illegal_plan_is_refused_and_changes_nothing(rows: tuple[list[int], ...], match: str) -> None:
    dependencies = DependencyGraph(open_grid(1, 4), [0, 1])
    with pytest.raises(IllegalPlanError, match=match):
        dependencies.extend(plan_of(*rows))
    assert dependencies.tail_states().tolist() == [0, 1]
    assert not dependencies.next_moves(1)


def test_a_ring_is_refused_and_can_be_cut_off() -> None:
    rows = [0, 1, 2], [0, 1, 3], [1, 3, 0]
    graph = graph_of(range(4), [(0, 1), (1, 3), (3, 0), (2, 3)])
    dependencies = DependencyGraph(graph, rows[0])
    with pytest.raises(CyclicPlanError) as refused:
        dependencies.extend(plan_of(*rows))
    assert refused.value.timestep == 1
    assert sorted(refused.value.agents) == [0, 1, 2]
    assert dependencies.tail_states().tolist() == [0, 1, 2]
    dependencies.extend(plan_of(*rows[: refused.value.timestep + 1]))
    assert dependencies.tail_states().tolist() == [0, 1, 3]


def test_a_swap_is_a_ring_of_two() -> None:
    with pytest.raises(CyclicPlanError):
        with_plan(open_grid(1, 2), [0, 1], [1, 0])


def test_a_ring_is_told_from_who_follows_a_chain_and_who_turns() -> None:
    """Agents 0 and 1 follow each other into a free cell, 2 stands, 3 to 5 go round."""
    graph = graph_of(range(8), [(0, 1), (1, 2), (4, 5), (5, 6), (6, 4)])
    with pytest.raises(CyclicPlanError) as refused:
        with_plan(graph, [1, 0, 7, 4, 5, 6], [2, 1, 7, 5, 6, 4])
    assert (refused.value.timestep, refused.value.agents) == (0, (3, 4, 5))
    assert not with_plan(graph, [1, 0, 7, 4, 5, 3], [2, 1, 7, 5, 6, 3]).anyone_held_up


def test_a_plan_that_stands_still_is_nothing() -> None:
    dependencies = with_plan(open_grid(1, 2), [0, 1], [0, 1])
    assert not dependencies.n_queued(0)


def test_a_cycle_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planners.precedence.steps._check_rings", lambda *_: None)
    dependencies = with_plan(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0])
    assert dependencies.has_cycle()
    assert not any(dependencies.grantable(agent) for agent in range(4))


def test_two_agents_cannot_start_in_one_cell() -> None:
    graph = graph_of([0, 1, 1], [(0, 1)])
    with pytest.raises(ExecutionError, match="agents 0 and 1 both start in cell 1"):
        DependencyGraph(graph, [1, 2])


def test_a_start_state_must_exist() -> None:
    with pytest.raises(ExecutionError, match=r"start_states\[1\] = 9; valid: states 0\.\.3"):
        DependencyGraph(open_grid(1, 4), [0, 9])


# -------------------------------------------------------------------------------------------------------------- cutting


def test_the_cut_keeps_granted_moves_and_the_lookahead() -> None:
    graph = open_grid(1, 6)
    dependencies = with_plan(graph, [0], [1], [2], [3], [4], [5])
    dependencies.grant(0)
    assert dependencies.commit_cut(2).tolist() == [3]
    assert ends_of(graph, dependencies.next_moves(0)) == [2, 3]
    assert dependencies.commit_cut(0).tolist() == [1]
    dependencies.extend(plan_of([1], [2]))
    assert ends_of(graph, dependencies.next_moves(0)) == [2]


def test_the_cut_drops_moves_that_wait_for_dropped_ones() -> None:
    """The agent that crosses second would keep two moves, but it waits for a third one of the first agent."""
    graph = graph_of([0, 1, 2, 3, 2, 4, 5], [(0, 1), (1, 2), (2, 6), (3, 4), (4, 5)])
    dependencies = with_plan(graph, [0, 3], [1, 3], [2, 3], [6, 4], [6, 5])
    assert dependencies.commit_cut(2).tolist() == [2, 3]
    assert not dependencies.has_cycle()


def test_what_is_kept_stays_in_order_after_a_cut() -> None:
    graph = open_grid(1, 6)
    dependencies = with_plan(graph, [0, 1], [1, 2], [2, 3], [3, 4])
    assert dependencies.commit_cut(1).tolist() == [1, 2]
    assert not dependencies.grantable(0)
    dependencies.extend(plan_of([1, 2], [1, 3], [2, 3]))
    dependencies.grant(1)
    dependencies.finish(1)
    assert dependencies.grantable(0)


def test_a_negative_lookahead_is_refused() -> None:
    with pytest.raises(ExecutionError, match="lookahead = -1"):
        DependencyGraph(open_grid(1, 2), [0]).commit_cut(-1)


# ----------------------------------------------------------------------------------------------------------- exceptions


def test_halting_drops_the_agent_s_moves_and_what_waits_for_them() -> None:
    graph = open_grid(2, 4)
    dependencies = with_plan(graph, [0, 1, 4], [1, 2, 5], [2, 3, 6])
    dependencies.halt(1)
    assert dependencies.tail_states().tolist() == [0, 1, 6]
    assert dependencies.held_cells(1) == [1]


def test_halting_keeps_granted_moves_and_sends_nobody_into_their_cells() -> None:
    graph = open_grid(1, 5)
    dependencies = with_plan(graph, [0, 1], [1, 2], [2, 3])
    dependencies.grant(1)
    dependencies.halt(1)
    assert dependencies.tail_states().tolist() == [0, 2]
    assert dependencies.held_cells(1) == [1, 2]
    dependencies.finish(1)
    assert dependencies.held_cells(1) == [2]


def test_what_leads_through_an_avoided_cell_is_dropped_and_what_waits_for_that() -> None:
    graph = open_grid(2, 4)
    dependencies = with_plan(graph, [1, 0, 4], [2, 1, 5], [3, 2, 6])
    dependencies.avoid(3)
    assert dependencies.tail_states().tolist() == [2, 1, 6], "agent 0 stops before the cell, agent 1 behind agent 0"
    dependencies.grant(0)
    dependencies.avoid(2)
    assert dependencies.tail_states().tolist() == [2, 1, 6], "granted moves stay"


def test_a_reservation_holds_up_others_until_it_is_given_back() -> None:
    dependencies = with_plan(open_grid(2, 3), [0, 4], [1, 4], [2, 4])
    assert dependencies.reserve(1, [1, 5])
    assert not dependencies.grantable(0)
    assert dependencies.blockers(0) == [(1, 1)]
    assert dependencies.held_cells(1) == [4, 1, 5]
    dependencies.unreserve(1)
    assert dependencies.grantable(0)
    assert dependencies.held_cells(1) == [4]


def test_a_cell_that_somebody_holds_is_not_reserved() -> None:
    dependencies = with_plan(open_grid(2, 3), [0, 4], [1, 4], [2, 4])
    dependencies.grant(0)
    assert not dependencies.reserve(1, [5, 1])
    assert dependencies.held_cells(1) == [4]


def test_a_reservation_may_cover_the_agent_s_own_cells() -> None:
    dependencies = DependencyGraph(open_grid(1, 3), [1])
    assert dependencies.reserve(0, [0, 1])
    assert dependencies.reserve(0, [1, 2])
    dependencies.unreserve(0)
    assert dependencies.held_cells(0) == [1]
    assert dependencies.reserve(0, [0])


def test_a_cell_off_the_floor_cannot_be_reserved() -> None:
    with pytest.raises(ExecutionError, match=r"cell 3; valid: 0\.\.2"):
        DependencyGraph(open_grid(1, 3), [1]).reserve(0, [3])


def test_a_relocated_agent_starts_afresh() -> None:
    graph = open_grid(1, 6)
    dependencies = with_plan(graph, [1, 0], [2, 1], [3, 2])
    dependencies.grant(0)
    assert dependencies.reserve(0, [4])
    dependencies.relocate(0, 4)
    dependencies.unreserve(0)
    assert dependencies.held_cells(0) == [4]
    assert dependencies.tail_states().tolist() == [4, 1], "the follower's first move waited for nothing that is dropped"
    assert (dependencies.n_granted(0), dependencies.n_queued(0)) == (0, 0)
    dependencies.extend(plan_of([4, 1], [5, 2]))
    assert dependencies.grantable(0)
    assert dependencies.grantable(1)


def test_nobody_is_sent_through_the_new_cell_of_a_relocated_agent() -> None:
    graph = open_grid(2, 4)
    dependencies = with_plan(graph, [0, 4], [1, 4], [2, 4], [3, 4])
    dependencies.relocate(1, 2)
    assert dependencies.tail_states().tolist() == [1, 2]


def test_an_agent_is_not_relocated_into_a_cell_of_another() -> None:
    dependencies = DependencyGraph(open_grid(1, 3), [0, 1])
    with pytest.raises(ExecutionError, match="held by agent 0"):
        dependencies.relocate(1, 0)
    assert dependencies.held_cells(1) == [1]


def test_an_agent_is_not_relocated_into_a_state_that_does_not_exist() -> None:
    with pytest.raises(ExecutionError, match=r"state 7; valid: 0\.\.2"):
        DependencyGraph(open_grid(1, 3), [0]).relocate(0, 7)


# -------------------------------------------------------------------------------------------------------------- reorder

LATE, ON_TIME = np.ones(2, dtype=np.bool_), np.zeros(2, dtype=np.bool_)


def test_who_waits_at_a_crossing_for_a_late_agent_goes_first(crossing: LaneGraph) -> None:
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 4], [2, 5])
    assert dependencies.held_up().tolist() == [False, True]
    assert dependencies.anyone_held_up
    assert dependencies.line(1) == [(0, 0), (0, 1), (1, 2), (1, 3)]
    assert dependencies.go_first(1, LATE)
    assert dependencies.line(1) == [(1, 2), (1, 3), (0, 0), (0, 1)]
    assert dependencies.held_up().tolist() == [True, False]
    assert dependencies.anyone_held_up
    assert dependencies.tail_states().tolist() == [2, 5]
    for agent in (1, 1, 0, 0):
        dependencies.grant(agent)
        if dependencies.n_queued(agent) == 0:
            dependencies.finish(agent)
            dependencies.finish(agent)
    assert dependencies.n_visits == 0


def test_an_agent_that_is_about_to_come_keeps_its_turn(crossing: LaneGraph) -> None:
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 4], [2, 5])
    assert not dependencies.go_first(1, ON_TIME)
    assert dependencies.line(1) == [(0, 0), (0, 1), (1, 2), (1, 3)]


def test_an_agent_that_is_far_away_is_overtaken_without_being_late() -> None:
    """Four moves before the crossing: the other needs two to be through."""
    lanes = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (6, 7), (7, 8)]
    graph = graph_of([0, 1, 2, 3, 4, 5, 6, 4, 7], lanes)
    rows = [[0, 6], [1, 6], [2, 6], [3, 6], [4, 6], [5, 6], [5, 7], [5, 8]]
    assert with_plan(graph, *rows).go_first(1, ON_TIME)
    assert not with_plan(graph, *rows[3:]).go_first(1, ON_TIME)


def test_a_granted_turn_is_not_taken_back(crossing: LaneGraph) -> None:
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 4], [2, 5])
    dependencies.grant(0)
    assert not dependencies.held_up()[1], "the cell is not free"
    assert not dependencies.go_first(1, LATE)


def test_who_would_stay_on_the_crossing_waits(crossing: LaneGraph) -> None:
    """The plan ends on the crossing: nobody knows yet how the agent will get out of the other's way."""
    dependencies = with_plan(crossing, [0, 3], [1, 3], [2, 3], [2, 4])
    assert dependencies.held_up()[1]
    assert not dependencies.go_first(1, LATE)


@pytest.fixture
def merging() -> LaneGraph:
    """Two lanes that run together through cells 2, 3 and 4 and part again: 0 2 3 4 5 and 1 2 3 4 6."""
    return graph_of([0, 1, 2, 3, 4, 5, 6], [(0, 2), (1, 2), (2, 3), (3, 4), (4, 5), (4, 6)])


def test_a_shared_stretch_is_exchanged_as_a_whole(merging: LaneGraph) -> None:
    rows = [[0, 1], [2, 1], [3, 1], [4, 1], [5, 1], [5, 2], [5, 3], [5, 4], [5, 6]]
    dependencies = with_plan(merging, *rows)
    assert dependencies.go_first(1, LATE)
    for cell in (2, 3, 4):
        assert [agent for agent, _ in dependencies.line(cell)] == [1, 1, 0, 0]
    assert not dependencies.has_cycle()


def test_a_shared_stretch_without_its_end_stays_as_it_is(merging: LaneGraph) -> None:
    dependencies = with_plan(merging, [0, 1], [2, 1], [3, 1], [4, 1], [5, 1], [5, 2], [5, 3], [5, 4])
    assert not dependencies.go_first(1, LATE)


def test_an_exchange_that_would_close_a_cycle_is_not_made() -> None:
    """Agent 2 on the crossing would wait for agent 1 ahead, who waits for agent 0, whom it has overtaken."""
    graph = graph_of(range(8), [(0, 1), (1, 2), (2, 3), (4, 1), (1, 5), (5, 2), (2, 6), (5, 7)])
    rows = [[0, 5, 4], [1, 5, 4], [2, 5, 4], [3, 2, 1], [3, 6, 5], [3, 6, 7]]
    dependencies = with_plan(graph, *rows)
    assert dependencies.held_up().tolist() == [False, True, True]
    assert not dependencies.go_first(2, np.ones(3, dtype=np.bool_))
    assert dependencies.go_first(1, np.ones(3, dtype=np.bool_)), "agent 1 may, and then the way is free for agent 2"
    assert dependencies.go_first(2, np.ones(3, dtype=np.bool_))
    assert not dependencies.has_cycle()


def test_a_follower_is_let_in_behind_whoever_drives_on_straight_ahead() -> None:
    graph = grid_lane_graph(GridMap(np.ones((1, 5), dtype=np.bool_)), "rotating")
    east = [graph.state_at(cell, EAST) for cell in range(5)]
    dependencies = with_plan(graph, [east[1], east[0]], [east[2], east[1]], [east[3], east[2]])
    assert dependencies.grant_behind() == 0, "nobody leaves yet"
    dependencies.grant(0)
    assert not dependencies.grantable(1)
    assert dependencies.grant_behind() == 1
    assert (dependencies.n_granted(0), dependencies.n_granted(1)) == (1, 1)
    assert dependencies.grant_behind() == 0, "one at a time"
    dependencies.finish_all([0, 1])
    assert dependencies.holders().tolist() == [-1, 1, 0, -1, -1]
    dependencies.grant(0)
    assert dependencies.grant_behind() == 1
    dependencies.finish_all([1, 0])
    assert dependencies.holders().tolist() == [-1, -1, 1, 0, -1], "in any order"


def test_nobody_is_let_in_behind_who_turns_or_whose_turn_it_is_not() -> None:
    graph = grid_lane_graph(GridMap(np.ones((2, 3), dtype=np.bool_)), "rotating")
    south, east = graph.state_at(1, SOUTH), [graph.state_at(cell, EAST) for cell in range(3)]
    dependencies = with_plan(graph, [south, east[0]], [graph.state_at(4, SOUTH), east[1]])
    dependencies.grant(0)
    assert dependencies.grant_behind() == 0
    # Agent 0 leaves cell 1 straight ahead of agent 1, but agent 2 comes into it first.
    north = graph.state_at(4, NORTH)
    dependencies = with_plan(
        graph,
        [east[1], east[0], north],
        [east[2], east[0], graph.state_at(1, NORTH)],
        [east[2], east[0], graph.state_at(1, WEST)],
    )
    dependencies.grant(0)
    assert dependencies.grant_behind() == 0
