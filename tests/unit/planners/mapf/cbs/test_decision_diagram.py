"""Decision diagrams on floors small enough to list all cheapest paths by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.mapf.cbs.decision_diagram import ENTER, STAND, SWEEP, Diagram, Fact, Seeker, draw
from planners.mapf.distance_table import DistanceTable
from tests.unit.planners.mapf.lanes import graph_of, king_grid, open_grid

CORNER = graph_of(range(3), [(0, 2)], sweeps={(0, 2): (1,)})
"""From 0 to 2 across the corner of 1, and no other way."""


def seek(graph: LaneGraph, start: int, goal: int, *, bans: Sequence[Fact] = (), stay: bool = False) -> Diagram | None:
    distance = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)).to(max(goal, 0))
    finite = distance[distance < graph.n_states]
    seeker = Seeker(
        start=start,
        goal=goal,
        stay=stay,
        may_move=np.ones(graph.n_moves, dtype=np.bool_),
        distance=distance,
        farthest=int(finite.max()) if goal >= 0 else 0,
    )
    return draw(graph, seeker, bans, [])


def layers(diagram: Diagram | None) -> list[list[int]]:
    assert diagram is not None
    return [np.flatnonzero(layer).tolist() for layer in diagram.layers]


def test_layers_hold_every_cheapest_path_and_no_other() -> None:
    assert layers(seek(open_grid(2, 3), 0, 5)) == [[0], [1, 3], [2, 4], [5]]


@pytest.mark.parametrize(
    ("ban", "expected"),
    [
        (Fact(STAND, 1, 1, -1), [[0], [3], [4], [5]]),
        (Fact(ENTER, 1, 1, 2), [[0], [1, 3], [4], [5]]),
        (Fact(STAND, 3, 5, -1), [[0], [0, 1, 3], [1, 2, 3, 4], [2, 4], [5]]),
        (Fact(STAND, 2, 5, -1), [[0], [1, 3], [2, 4], [5]]),
    ],
    ids=["a cell", "a step", "the goal", "the goal, earlier"],
)
def test_a_ban_takes_paths_away_or_costs_time(ban: Fact, expected: list[list[int]]) -> None:
    assert layers(seek(open_grid(2, 3), 0, 5, bans=[ban])) == expected


def test_a_ban_of_the_goal_later_on_delays_the_arrival_until_then() -> None:
    diagram = seek(open_grid(1, 2), 0, 1, bans=[Fact(STAND, 6, 1, -1)])
    assert diagram is not None
    assert diagram.cost == 7


def test_only_who_need_not_stay_looks_in_at_its_goal_before() -> None:
    ban = Fact(STAND, 2, 1, -1)
    assert layers(seek(open_grid(1, 2), 0, 1, bans=[ban])) == [[0], [0, 1], [0], [1]]
    assert layers(seek(open_grid(1, 2), 0, 1, bans=[ban], stay=True)) == [[0], [0], [0], [1]]


def test_without_a_goal_it_stays_until_it_must_go() -> None:
    assert layers(seek(open_grid(1, 3), 1, -1)) == [[1]]
    assert layers(seek(open_grid(1, 3), 1, -1, bans=[Fact(STAND, 1, 1, -1)])) == [[1], [0, 2]]


def test_bans_that_leave_no_path() -> None:
    assert seek(open_grid(1, 3), 0, 2, bans=[Fact(STAND, 0, 0, -1)]) is None
    assert seek(graph_of(range(2), [(0, 1)]), 0, 1, bans=[Fact(STAND, 1, 0, -1), Fact(STAND, 1, 1, -1)]) is None


def test_what_all_cheapest_paths_do_is_forced() -> None:
    graph = king_grid(2, 2)
    straight = seek(graph, 0, 3)
    assert straight is not None
    for fact in (Fact(SWEEP, 0, 1, -1), Fact(ENTER, 0, 0, 3), Fact(STAND, 1, 3, -1), Fact(STAND, 9, 3, -1)):
        assert straight.forced(graph, fact)
    for fact in (Fact(SWEEP, 1, 1, -1), Fact(ENTER, 0, 0, 1), Fact(STAND, 1, 1, -1), Fact(SWEEP, 0, 3, -1)):
        assert not straight.forced(graph, fact)


def test_what_only_some_do_is_not() -> None:
    graph = king_grid(2, 2)
    around = seek(graph, 0, 3, bans=[Fact(SWEEP, 0, 1, -1)])
    assert layers(around) == [[0], [0, 1, 2], [3]]
    assert around is not None
    for fact in (Fact(STAND, 1, 1, -1), Fact(ENTER, 0, 0, 1), Fact(SWEEP, 1, 1, -1), Fact(SWEEP, 0, 1, -1)):
        assert not around.forced(graph, fact)


def test_a_wait_sweeps_nothing() -> None:
    late = seek(CORNER, 0, 2, bans=[Fact(STAND, 1, 2, -1)])
    assert layers(late) == [[0], [0], [2]]
    assert late is not None
    assert not late.forced(CORNER, Fact(SWEEP, 0, 1, -1))
    assert late.forced(CORNER, Fact(SWEEP, 1, 1, -1))
