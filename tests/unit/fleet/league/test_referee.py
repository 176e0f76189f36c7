"""The referee of a run drives its actions again and names what is wrong, however the run is cut into blocks."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.league.controller import PibtController
from fleet.league.play import play
from fleet.league.referee import check_actions
from maps.formats.lorr import LETTERS, LeagueProblem
from maps.lane_graph import grid_lane_graph
from planners.mapf.validate import Conflict
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, problem_of, random_problem


def check(problem: LeagueProblem, *paths: str, block: int = 10**6) -> list[Conflict]:
    actions = np.array([[LETTERS.index(letter) for letter in path] for path in paths], dtype=np.int8).T
    return check_actions(problem, grid_lane_graph(problem.grid, "rotating"), actions, block=block)


@pytest.mark.parametrize("block", [1, 2, 3, 10**6])
@pytest.mark.parametrize(
    ("starts", "paths", "kind", "timestep"),
    [
        ([0, 2], ["WFF", "WWW"], "vertex", 3),
        ([0, 3], ["RRW", "RRW"], None, 0),
        ([0, 1], ["WWWF", "RRWF"], "edge", 3),
        ([0, 5], ["FFW", "FWW"], "illegal_move", 0),
        ([0, 5], ["CFW", "WWW"], "illegal_move", 1),
        ([0, 5], ["FFFFR", "WWWWW"], None, 0),
    ],
)
def test_what_is_wrong_is_named(
    starts: list[int], paths: list[str], kind: str | None, timestep: int, block: int
) -> None:
    found = check(problem_of(ROOM, starts, [[35]]), *paths, block=block)
    assert [(conflict.kind, conflict.timestep) for conflict in found] == ([] if kind is None else [(kind, timestep)])


def test_driving_into_an_obstacle_is_an_illegal_move() -> None:
    found = check(problem_of(CORRIDOR, [0], [[4]]), "FRFW")
    assert [(conflict.kind, conflict.timestep, conflict.agents) for conflict in found] == [("illegal_move", 2, (0,))]


def test_a_closed_ring_is_legal() -> None:
    assert check(problem_of(ROOM, [0, 1, 7, 6], [[35]]), "WWF", "RWF", "RRF", "CWF") == []


def test_a_played_run_with_a_changed_letter_is_seen() -> None:
    """A planted fault: an action of a dense run that is taken out again leads into somebody."""
    problem = random_problem(3, n_robots=30)
    played = play(problem, PibtController(), 40, 1.0)
    graph = grid_lane_graph(problem.grid, "rotating")
    assert check_actions(problem, graph, played.result.actual, block=100) == []
    first = int(np.argmax((played.result.actual == LETTERS.index("F")).sum(axis=1) > 5))
    robot = int(np.flatnonzero(played.result.actual[first] == LETTERS.index("F"))[0])
    changed = played.result.actual.copy()
    changed[first, robot] = LETTERS.index("R")
    assert check_actions(problem, graph, changed, block=100) != []
