"""The core of PIBT on floors of a few cells, with keys written by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.mapf.inheritance import PUSHED, SETTLED, STUCK, Claims, claims_of, clear, enter, push, stay
from planners.mapf.options import Options, options_of
from planners.mapf.problem import NOBODY
from tests.unit.planners.mapf.lanes import graph_of, one_way_loop, open_grid

USED_UP = 2**62


class Floor:
    """Agents that stand somewhere and try their options in a given order."""

    def __init__(self, graph: LaneGraph, starts: Sequence[int], wishes: Sequence[Sequence[int]]) -> None:
        self.options: Options = options_of(graph, np.zeros(graph.n_cells, dtype=np.bool_))
        self.claims: Claims = claims_of(self.options, graph.n_cells, len(starts))
        self.now = np.array(starts, dtype=np.int32)
        self.after = np.full(len(starts), -1, dtype=np.int32)
        self.keys = np.full((len(starts), self.options.widest + 1), USED_UP, dtype=np.int64)
        for agent, states in enumerate(wishes):
            enter(self.claims, agent, graph.state_cell[starts[agent]])
            for key, state in enumerate(states):
                aims = self.options.aim[starts[agent], :, 0].tolist()
                self.keys[agent, 0 if state == starts[agent] else aims.index(state) + 1] = key

    def decide(self, agent: int, *, allow_rotation: bool = False) -> int:
        """Let an agent, and whomever it pushes, decide; how it ended."""
        self.claims.stack[0] = agent
        end, depth = PUSHED, 0
        while end == PUSHED:
            end, depth = push(
                self.options, self.claims, self.keys, USED_UP, self.now, self.after, depth, allow_rotation
            )
        return int(end)


def test_who_stands_in_the_way_makes_room() -> None:
    floor = Floor(open_grid(1, 4), [0, 1, 2], [[1, 0], [2, 1], [3, 2]])
    assert floor.decide(0) == SETTLED
    assert floor.after.tolist() == [1, 2, 3]


def test_a_step_is_taken_back_when_the_last_of_a_chain_cannot_move() -> None:
    """The first agent pushes two others against the wall, and takes its second choice."""
    floor = Floor(open_grid(2, 3), [0, 1, 2], [[1, 3, 0], [2, 1], [2]])
    assert floor.decide(0) == SETTLED
    assert floor.after.tolist() == [3, 1, 2]


def test_neighbours_do_not_swap_even_where_rings_are_legal() -> None:
    floor = Floor(open_grid(1, 2), [0, 1], [[1, 0], [0, 1]])
    assert floor.decide(0, allow_rotation=True) == SETTLED
    assert floor.after.tolist() == [0, 1]


@pytest.mark.parametrize("allow_rotation", [False, True])
def test_a_ring_closes_only_where_that_is_legal(allow_rotation: bool) -> None:
    floor = Floor(one_way_loop(3), [0, 1, 2], [[1, 0], [2, 1], [0, 2]])
    floor.decide(0, allow_rotation=allow_rotation)
    assert floor.after.tolist() == ([1, 2, 0] if allow_rotation else [0, 1, 2])


def test_nobody_enters_what_another_sweeps_over() -> None:
    """From 0 to 2 over 1, which an agent in 3 wants."""
    graph = graph_of(range(4), [(0, 2), (3, 1)], sweeps={(0, 2): (1,)})
    floor = Floor(graph, [0, 3], [[2, 0], [1, 3]])
    floor.decide(0)
    floor.decide(1)
    assert floor.after.tolist() == [2, 3]
    clear(floor.options, floor.claims, floor.now)
    assert (floor.claims.crossed == NOBODY).all()
    assert (floor.claims.cells == NOBODY).all()


def test_a_step_that_is_taken_back_sweeps_over_nothing() -> None:
    """The agent in 0 cannot go to 2 over 1, because whoever stands in 2 stays; so the one in 3 may go to 1."""
    graph = graph_of(range(4), [(0, 2), (3, 1)], sweeps={(0, 2): (1,)})
    floor = Floor(graph, [0, 3, 2], [[2, 0], [1, 3], [2]])
    floor.decide(0)
    floor.decide(1)
    assert floor.after.tolist() == [0, 1, 2]


def test_who_must_stay_where_another_goes_is_stuck() -> None:
    """The second agent was told to go where the first one stands, who has nowhere to go."""
    floor = Floor(open_grid(1, 2), [0], [[0]])
    floor.claims.cells[0, 1] = 1
    assert floor.decide(0) == STUCK


def test_who_is_decided_is_not_pushed() -> None:
    floor = Floor(open_grid(1, 3), [0, 1], [[1, 0], [2, 1]])
    stay(floor.claims, floor.now, floor.after, 1)
    assert floor.decide(0) == SETTLED
    assert floor.after.tolist() == [0, 1]
