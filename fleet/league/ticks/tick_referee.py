"""Referee of a run in ticks: drives its actions once more, does its tasks, and lists everything that is wrong.

Shares no code with whoever plays.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from fleet.errors import FleetError
from maps.formats.lorr import CLOCKWISE, COUNTER_CLOCKWISE, FORWARD, START_HEADING, WAIT, LeagueProblem, LeagueResult
from maps.formats.lorr_2026 import Ticks
from maps.grid import DCOL, DROW
from planners.mapf.validate import Conflict

Wide = npt.NDArray[np.int64]

_STEP = np.column_stack((DROW, DCOL)).astype(np.int64)
_ROUNDING = 1e-9


def check_ticks(result: LeagueResult) -> list[Conflict]:
    """Find what the rules of 2026 do not allow.

    Kinds: `vertex`, two squares overlap at some time of a tick; `illegal_move`, a drive off the free floor, or an
    action that breaks into another one; `delayed`, an action in spite of a delay; `errand`, an errand that is not done
    where it is, or by somebody else than whoever has the task, or out of order.

    Args:
        result: What happened in a run of a problem of 2026.

    Returns:
        What is wrong, by tick; of a tick in which somebody leaves the floor nothing more.
    """
    return sorted(
        [*_delayed(result), *_driven(result), *_errands(result)],
        key=lambda conflict: conflict.timestep,
    )


def _delayed(result: LeagueResult) -> Iterator[Conflict]:
    delays = np.empty((0, 3)) if result.ticked is None else result.ticked.delays
    for robot, first, end in delays.tolist():
        moved = np.flatnonzero(result.actual[int(first) : int(end), int(robot)] != WAIT)
        if moved.size:
            yield Conflict(kind="delayed", timestep=int(first + moved[0]), agents=(int(robot),), where=-1)


def _driven(result: LeagueResult) -> Iterator[Conflict]:
    """Overlaps, and drives and actions that cannot be."""
    grid, ticks = result.problem.grid, _ticks(result)
    whole = ticks.per_action
    free = np.zeros((grid.rows + 2, grid.cols + 2), dtype=np.bool_)
    free[1:-1, 1:-1] = grid.free
    for step, place, step_of, action, broken in _motion(result.problem, whole, result.actual):
        for robot in broken.tolist():
            yield Conflict(kind="illegal_move", timestep=step, agents=(robot,), where=-1)
        after = place + step_of
        ahead = np.where(step_of > 0, -(-after // whole), after // whole) + 1
        off = np.flatnonzero((action == FORWARD) & ~free[ahead[:, 0], ahead[:, 1]])
        if off.size:
            first = int(off[0])
            yield Conflict(
                kind="illegal_move", timestep=step, agents=(first,), where=_cell(place[first] // whole, grid.cols)
            )
            return
        for one, two in _overlaps(place, step_of, ticks.size * whole):
            yield Conflict(kind="vertex", timestep=step, agents=(one, two), where=_cell(place[one] // whole, grid.cols))


def _cell(place: Wide, cols: int) -> int:
    return int(place[0] * cols + place[1])


def _motion(
    problem: LeagueProblem, whole: int, actions: npt.NDArray[np.int8]
) -> Iterator[tuple[int, Wide, Wide, npt.NDArray[np.int8], npt.NDArray[np.intp]]]:
    """Each tick: where the robots are and how they move, in parts of a drive, what they do, who breaks it off."""
    row, col = problem.grid.row_col(problem.start_cell.astype(np.int64))
    place = np.column_stack((row, col)) * whole
    n = len(place)
    heading = np.full(n, START_HEADING, dtype=np.int64)
    spent = np.zeros(n, dtype=np.int64)
    begun = np.full(n, WAIT, dtype=np.int8)
    for step, action in enumerate(actions):
        acts = action != WAIT
        broken = np.flatnonzero(acts & (spent > 0) & (action != begun))
        step_of = np.where((action == FORWARD)[:, None], _STEP[heading], 0)
        yield step, place.copy(), step_of, action, broken
        place += step_of
        begun = np.where(acts, action, begun)
        spent += acts
        over = spent == whole
        heading = (heading + (over & (action == COUNTER_CLOCKWISE)) - (over & (action == CLOCKWISE))) % 4
        spent[over] = 0


def _overlaps(place: Wide, step_of: Wide, edge: float) -> list[tuple[int, int]]:
    """Pairs whose squares overlap on the way: what parts them in the direction that parts them most is too little."""
    one, two = KDTree(place).query_pairs(edge + 2, p=np.inf, output_type="ndarray").T
    apart, way = place[one] - place[two], step_of[one] - step_of[two]
    least = np.minimum(np.abs(apart).max(axis=1), np.abs(apart + way).max(axis=1))
    # On the way the larger of two distances is least where one of them is nought, or where they are equal.
    for over, under in (
        (-apart[:, 0], way[:, 0]),
        (-apart[:, 1], way[:, 1]),
        (apart[:, 1] - apart[:, 0], way[:, 0] - way[:, 1]),
        (-apart[:, 1] - apart[:, 0], way[:, 0] + way[:, 1]),
    ):
        when = np.clip(over / np.where(under == 0, 1, under), 0.0, 1.0)[:, None]
        least = np.minimum(least, np.abs(apart + when * way).max(axis=1))
    bad = least < edge - _ROUNDING
    return sorted(zip(one[bad].tolist(), two[bad].tolist(), strict=True))


def _errands(result: LeagueResult) -> Iterator[Conflict]:
    """Errands that were not done as they are said to be."""
    problem = result.problem
    cells = _cells(problem, _ticks(result).per_action, result.actual)
    has = np.full(problem.n_robots, -1, dtype=np.int64)
    done: dict[int, int] = {}
    by: dict[int, int] = {}
    changes = result.schedule.tolist()
    k = 0
    for tick, robot, task, count in result.events.tolist():
        while k < len(changes) and changes[k][0] < tick:
            has[changes[k][1]] = changes[k][2]
            k += 1
        stops = problem.errands(task).tolist()
        right = (
            has[robot] == task
            and by.setdefault(task, robot) == robot
            and done.get(task, 0) + 1 == count <= len(stops)
            and stops[count - 1] == cells[tick - 1][robot]
        )
        if not right:
            yield Conflict(kind="errand", timestep=tick - 1, agents=(robot,), where=stops[min(count, len(stops)) - 1])
        done[task] = count
    finished = sum(count == len(problem.errands(task)) for task, count in done.items())
    if finished != result.n_finished:
        yield Conflict(kind="errand", timestep=len(result.actual), agents=(), where=-1)


def _cells(problem: LeagueProblem, whole: int, actions: npt.NDArray[np.int8]) -> list[Wide]:
    """Cell of each robot at the end of each tick: the one it has reached last."""
    row, col = problem.grid.row_col(problem.start_cell.astype(np.int64))
    reached = np.column_stack((row, col))
    cells = []
    for _, place, step_of, _, _ in _motion(problem, whole, actions):
        after = place + step_of
        there = (after % whole == 0).all(axis=1)
        reached = np.where(there[:, None], after // whole, reached)
        cells.append(reached[:, 0] * problem.grid.cols + reached[:, 1])
    return cells


def _ticks(result: LeagueResult) -> Ticks:
    if result.problem.ticks is None:
        raise FleetError(f"league: {result.problem.name} is played in timesteps; valid: a problem of 2026, with ticks")
    return result.problem.ticks
