"""Tick rules: who may go on in a tick, and what becomes of a schedule, as kernels over all robots."""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import BoolArray
from fleet.league.rules import FINISHED, GONE, NO_TASK, OPENED, TWICE, UNKNOWN, Lives, Tasks
from maps.formats.lorr import CLOCKWISE, COUNTER_CLOCKWISE, FORWARD, WAIT, Actions, Ints

HELD, TAKEN = range(5, 7)
MEND_TEXTS = {
    GONE: "task already finished",
    TWICE: "task is already assigned by the second agent at the same time",
    HELD: "schedule agent to another task who is already opened a task",
    TAKEN: "task is already opened by other agent",
}
"""What the League's files say of each error of the schedule."""

_AROUND = 2
"""Cells, in a row or a column, between robots that can meet in one tick."""
_WIDTH = 2 * _AROUND + 1
_TOUCH = 1e-9
"""Overlap that is none, in parts of a tick."""
_OPEN, _ASKED, _GOES, _STAYS = range(4)


@njit(cache=True, nogil=True)
def _meet(row: float, col: float, row_to: float, col_to: float, size: float) -> bool:  # pragma: no cover - compiled
    """Whether two squares overlap at any time of a tick in which one goes, as the other sees it, from here to there."""
    begin, end = 0.0, 1.0
    for at, to in ((row, row_to), (col, col_to)):
        way = to - at
        if way == 0.0:
            if abs(at) >= size - _TOUCH:
                return False
            continue
        first, last = (-size - at) / way, (size - at) / way
        begin, end = max(begin, min(first, last)), min(end, max(first, last))
    return end - begin > _TOUCH


@njit(cache=True, nogil=True)
def _in_the_way(
    at: Tasks, step: Tasks, robot: int, other: int, goes: bool, size: float
) -> bool:  # pragma: no cover - compiled
    """Whether a robot's step runs into another one, which goes its own or stands."""
    row, col = float(at[robot, 0] - at[other, 0]), float(at[robot, 1] - at[other, 1])
    row_to, col_to = row + step[robot, 0], col + step[robot, 1]
    if goes:
        row_to -= step[other, 0]
        col_to -= step[other, 1]
    return _meet(row, col, row_to, col_to, size)


@njit(cache=True, nogil=True)
def judge_tick(
    poses: Ints, cols: int, drow: Ints, dcol: Ints, wanted: Actions, occupant: Ints, edge: int, size: float
) -> BoolArray:  # pragma: no cover - compiled
    """Which robots may do as they want, shape (n,); the others stand still for the tick.

    A robot that would run into where another one stands waits for what is decided of that one; whoever is asked while
    others wait for it, in a ring, and whoever runs into somebody who goes, does not go.

    Args:
        poses: Row, column, heading and ticks of a drive ahead under way, shape (n, 4); robots do not overlap.
        cols: Columns of the floor.
        drow: Row step of each heading.
        dcol: Column step of each heading.
        wanted: Action of each robot, shape (n,); a drive leads to a free cell.
        occupant: Room for who stands in each cell, all -1, shape (n_cells,); left so.
        edge: Ticks that a drive takes from cell to cell.
        size: Edge of a robot's square [ticks of a drive].

    Source: ActionModel.cpp of https://github.com/MAPF-Competition/Start-Kit, tag v3.1.0. Here all numbers are whole
    as far as the size is; there they are of single precision, so that close followers may be stopped for a tick.
    """
    n = len(poses)
    at = np.empty((n, 2), np.int64)
    step = np.zeros((n, 2), np.int64)
    beside = np.full(n, -1, np.int32)  # small robots may be two in a cell
    for robot in range(n):
        row, col, heading, ticks = poses[robot]
        at[robot, 0] = row * edge + drow[heading] * ticks
        at[robot, 1] = col * edge + dcol[heading] * ticks
        if wanted[robot] == FORWARD:
            step[robot, 0], step[robot, 1] = drow[heading], dcol[heading]
        beside[robot] = occupant[row * cols + col]
        occupant[row * cols + col] = robot
    rows = len(occupant) // cols
    status = np.zeros(n, np.int8)
    look = np.zeros(n, np.int32)
    stack = np.empty(n, np.int32)
    for begin in range(n):
        if status[begin] != _OPEN:
            continue
        stack[0] = begin
        status[begin] = _ASKED
        depth = 1
        while depth > 0:
            robot = stack[depth - 1]
            if wanted[robot] != FORWARD:
                status[robot] = _GOES
                depth -= 1
                continue
            asks = -1
            while asks < 0 and status[robot] == _ASKED and look[robot] < _WIDTH * _WIDTH:
                row = poses[robot, 0] + look[robot] // _WIDTH - _AROUND
                col = poses[robot, 1] + look[robot] % _WIDTH - _AROUND
                other = -1
                if 0 <= row < rows and 0 <= col < cols:
                    other = occupant[row * cols + col]
                while other >= 0:
                    if other != robot and _in_the_way(at, step, robot, other, status[other] == _GOES, size):
                        if status[other] == _OPEN:
                            asks = other
                        else:
                            status[robot] = _STAYS
                        break
                    other = beside[other]
                if other < 0:
                    look[robot] += 1
            if asks >= 0:
                status[asks] = _ASKED
                stack[depth] = asks
                depth += 1
                continue
            if status[robot] == _ASKED:
                status[robot] = _GOES
            depth -= 1
    for robot in range(n):
        occupant[poses[robot, 0] * cols + poses[robot, 1]] = -1
    return status == _GOES


@njit(cache=True, nogil=True)
def mend_schedule(
    task_of: Tasks, errand_of: Ints, wanted: Tasks, life: Lives, holder: Ints, owner: Ints, errors: Tasks
) -> int:  # pragma: no cover - compiled
    """Put right in place what is not allowed in a schedule, robot by robot; returns the number of errors.

    Args:
        task_of: Task of each robot now, shape (n,).
        errand_of: Errands of it that are done.
        wanted: The schedule, changed in place.
        life: Life of tasks.
        holder: Room for who gets each task, all -1; left so.
        owner: The same for who has each task now.
        errors: Receives kind, task, robot and other robot; room for (3 n, 4).
    """
    count = 0
    for robot in range(len(wanted)):
        if task_of[robot] != NO_TASK:
            owner[task_of[robot]] = robot
    for robot in range(len(wanted)):
        task = wanted[robot]
        if task != NO_TASK and (task < 0 or task >= len(life) or life[task] == UNKNOWN or life[task] == FINISHED):
            _note(errors, count, GONE, task, robot, -1)
            count, task = count + 1, NO_TASK
        if task != NO_TASK and holder[task] >= 0:
            _note(errors, count, TWICE, task, robot, holder[task])
            count, task = count + 1, NO_TASK
        if errand_of[robot] > 0 and task != task_of[robot]:
            _note(errors, count, HELD, task, robot, -1)
            count, task = count + 1, task_of[robot]
        if task != NO_TASK and life[task] == OPENED and owner[task] != robot:
            _note(errors, count, TAKEN, task, robot, owner[task])
            count, task = count + 1, NO_TASK
        wanted[robot] = task
        if task != NO_TASK:
            holder[task] = robot
    for robot in range(len(wanted)):
        if wanted[robot] != NO_TASK:
            holder[wanted[robot]] = -1
        if task_of[robot] != NO_TASK:
            owner[task_of[robot]] = -1
    return count


@njit(cache=True, nogil=True)
def _note(
    errors: Tasks, count: int, kind: int, task: int, robot: int, other: int
) -> None:  # pragma: no cover - compiled
    errors[count, 0], errors[count, 1] = kind, task
    errors[count, 2], errors[count, 3] = robot, other


@njit(cache=True, nogil=True)
def pass_tick(
    cells: Ints, headings: Ints, ticks: Ints, doing: Actions, done: Actions, steps: Ints, per_action: int
) -> BoolArray:  # pragma: no cover - compiled
    """Let robots do a tick of their actions, in place; returns who came to the end of one, shape (n,).

    Args:
        cells: Where they are.
        headings: Where they look.
        ticks: Ticks done of the action under way.
        doing: That action, or `WAIT`.
        done: What each robot does in this tick.
        steps: Cells from one to the next in each heading.
        per_action: Ticks of an action.
    """
    ended = np.zeros(len(cells), np.bool_)
    for robot in range(len(cells)):
        action = done[robot]
        if action == WAIT:
            continue
        doing[robot] = action
        ticks[robot] += 1
        if ticks[robot] < per_action:
            continue
        ended[robot] = True
        ticks[robot], doing[robot] = 0, WAIT
        if action == FORWARD:
            cells[robot] += steps[headings[robot]]
        elif action == COUNTER_CLOCKWISE:
            headings[robot] = (headings[robot] + 1) % 4
        elif action == CLOCKWISE:
            headings[robot] = (headings[robot] + 3) % 4
    return ended
