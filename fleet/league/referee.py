"""Referee: drives a run's actions once more and lists everything that is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from maps.formats.lorr import CLOCKWISE, COUNTER_CLOCKWISE, FORWARD, START_HEADING, Actions, Ints, LeagueProblem
from maps.grid import DCOL, DROW
from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.mapf.validate import Conflict, conflicts
from planners.status import Status

BLOCK = 2_000_000
"""States that are looked at together, so that long runs of many robots need little memory."""
_DROW, _DCOL = np.array(DROW), np.array(DCOL)


def check_actions(problem: LeagueProblem, graph: LaneGraph, actions: Actions, *, block: int = BLOCK) -> list[Conflict]:
    """Find conflicts, and moves into obstacles.

    Args:
        problem: The floor and the starts.
        graph: The problem's `rotating` lane graph.
        actions: Action of each robot in each timestep, shape (T, n).
        block: States to look at together.

    Returns:
        What is wrong, by timestep, up to the first robot that leaves the floor; empty = legal.
    """
    found: list[Conflict] = []
    for first, states in _drive(problem, graph, actions, max(1, block // problem.n_robots)):
        lost = np.argwhere(states < 0)
        if lost.size:
            row, robot = lost[0].tolist()
            before = int(states[row - 1, robot])
            lost_one = Conflict(kind="illegal_move", timestep=first + row - 1, agents=(robot,), where=before)
            return [*found, *_conflicts(graph, states[:row], first), lost_one]
        found += _conflicts(graph, states, first)
    return list(dict.fromkeys(found))


def _conflicts(graph: LaneGraph, states: Ints, first: int) -> list[Conflict]:
    plan = Plan(states=states, status=Status.FEASIBLE, iterations=0)
    found = conflicts(graph, plan, allow_rotation=True)
    return [replace(conflict, timestep=conflict.timestep + first) for conflict in found]


def _drive(problem: LeagueProblem, graph: LaneGraph, actions: Actions, rows: int) -> Iterator[tuple[int, Ints]]:
    """States in blocks that share their border rows: the first row's timestep, shape (<= rows + 1, n); -1 = nowhere."""
    grid = problem.grid
    row, col = grid.row_col(problem.start_cell.astype(np.int64))
    heading = np.full(problem.n_robots, START_HEADING, dtype=np.int64)
    states = graph.state_index[problem.start_cell, heading][None]
    for first in range(0, max(len(actions), 1), rows):
        block = [states[-1]]
        for action in actions[first : first + rows]:
            heading = (heading + (action == COUNTER_CLOCKWISE) - (action == CLOCKWISE)) % 4
            row = row + _DROW[heading] * (action == FORWARD)
            col = col + _DCOL[heading] * (action == FORWARD)
            inside = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
            cell = np.where(inside, row * grid.cols + col, 0)
            block.append(np.where(inside, graph.state_index[cell, heading], np.int32(-1)))
        states = np.array(block, dtype=np.int32)
        yield first, states
