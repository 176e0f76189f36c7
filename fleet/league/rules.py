"""Rules: what the League's simulator refuses, and when an errand is done, as kernels over all robots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.formats.lorr import CLOCKWISE, COUNTER_CLOCKWISE, FORWARD, NO_ACTION, WAIT, Actions, Ints
from maps.lane_graph import STRAIGHT, LaneGraph

Tasks = npt.NDArray[np.int64]
"""Task ids."""
Lives = npt.NDArray[np.int8]
"""Life of tasks."""

NO_TASK = -1
UNKNOWN, WAITING, OPENED, FINISHED = range(4)
"""Life of a task: not known, no errand done yet, some done, all done."""

VALID = 0
WRONG_SIZE, UNALLOWED, VERTEX, EDGE = range(1, 5)
MOVE_TEXTS = ("", "incorrect vector size", "unallowed move", "vertex conflict", "edge conflict")
"""What the League's files say of each error of the planner."""
GONE, TWICE, LEFT = range(2, 5)
SCHEDULE_TEXTS = (
    "",
    "Invalid schedule size",
    "task already finished",
    "task is already assigned by the second agent at the same time",
    "task is already opened by the second agent",
)
"""What the League's files say of each error of the schedule: `WRONG_SIZE`, `GONE`, `TWICE`, `LEFT`."""


def move_actions(graph: LaneGraph) -> Actions:
    """Action that makes each move of a graph of robots that turn on the spot, shape (n_moves,)."""
    quarter = (graph.state_heading[graph.move_to] - graph.state_heading[graph.move_from]) % 4
    action = np.select([graph.move_kind == STRAIGHT, quarter == 1], [FORWARD, COUNTER_CLOCKWISE], default=CLOCKWISE)
    return action.astype(np.int8)


def action_table(graph: LaneGraph) -> Ints:
    """State after each action, -1 where it cannot be done, shape (n_states, 4)."""
    table = np.full((graph.n_states, 4), -1, dtype=np.int32)
    table[:, WAIT] = np.arange(graph.n_states)
    table[graph.move_from, move_actions(graph)] = graph.move_to
    return table


@njit(cache=True, nogil=True)
def judge_moves(
    states: Ints, cells: Ints, wanted: Tasks, table: Ints, state_cell: Ints, after: Ints, actions: Actions, there: Ints
) -> tuple[int, int, int]:  # pragma: no cover - compiled
    """Find the first error of a timestep: its kind, the robot, the other robot.

    Writes the action of each robot and the cell it goes to. `after` is room for who comes to stand in each cell, all
    -1, and is left so.
    """
    n = len(states)
    for robot in range(n):
        for action in range(4):
            if wanted[robot] >= 0 and table[states[robot], action] == wanted[robot]:
                actions[robot] = action
                there[robot] = state_cell[wanted[robot]]

    error, first, other = VALID, -1, -1
    decided = 0
    while decided < n:
        robot = decided
        if actions[robot] == NO_ACTION:
            error, first = UNALLOWED, robot
            break
        if after[there[robot]] >= 0:
            error, first, other = VERTEX, robot, after[there[robot]]
            break
        opposite = after[cells[robot]]
        if cells[robot] != there[robot] and opposite >= 0 and cells[opposite] == there[robot]:
            error, first, other = EDGE, robot, opposite
            break
        after[there[robot]] = robot
        decided += 1
    for robot in range(decided):
        after[there[robot]] = -1
    return error, first, other


@njit(cache=True, nogil=True)
def judge_schedule(
    task_of: Tasks, errand_of: Ints, wanted: Tasks, life: Lives, holder: Ints
) -> tuple[int, int, int]:  # pragma: no cover - compiled
    """Find the first error of a schedule: its kind, the robot, the other robot.

    `holder` is room for who gets each task, all -1, and is left so.
    """
    error, first, other = VALID, -1, -1
    decided = 0
    while decided < len(wanted):
        robot, task = decided, wanted[decided]
        if task != NO_TASK:
            if task < 0 or task >= len(life) or life[task] == UNKNOWN or life[task] == FINISHED:
                error, first = GONE, robot
                break
            if holder[task] >= 0:
                error, first, other = TWICE, robot, holder[task]
                break
        if errand_of[robot] > 0 and task != task_of[robot]:
            error, first, other = LEFT, robot, robot
            break
        if task != NO_TASK:
            holder[task] = robot
        decided += 1
    for robot in range(decided):
        if wanted[robot] != NO_TASK:
            holder[wanted[robot]] = -1
    return error, first, other


@njit(cache=True, nogil=True)
def tick_errands(
    timestep: int,
    cells: Ints,
    errand_ptr: Ints,
    errand_cell: Ints,
    task_of: Tasks,
    errand_of: Ints,
    life: Lives,
    events: Ints,
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Tick off errands in place; returns how many, and how many tasks they finished."""
    n_events, n_finished = 0, 0
    n_tasks = len(errand_ptr) - 1
    for robot in range(len(cells)):
        task = task_of[robot]
        if task == NO_TASK:
            continue
        row = task % n_tasks
        if errand_cell[errand_ptr[row] + errand_of[robot]] != cells[robot]:
            continue
        errand_of[robot] += 1
        life[task] = OPENED
        events[n_events, 0], events[n_events, 1] = timestep, robot
        events[n_events, 2], events[n_events, 3] = task, errand_of[robot]
        n_events += 1
        if errand_ptr[row] + errand_of[robot] == errand_ptr[row + 1]:
            life[task] = FINISHED
            task_of[robot] = NO_TASK
            errand_of[robot] = 0
            n_finished += 1
    return n_events, n_finished


@njit(cache=True, nogil=True)
def tick_errands_on_way(
    ptr: Ints, cells: Ints, errand_ptr: Ints, errand_cell: Ints, task_of: Tasks, errand_of: Ints, life: Lives
) -> None:  # pragma: no cover - compiled
    """Tick off, in place, the errands that robots do on their ways, given as CSR, with the tasks they hold."""
    n_tasks = len(errand_ptr) - 1
    for robot in range(len(task_of)):
        row = task_of[robot] % n_tasks
        for k in range(ptr[robot], ptr[robot + 1]):
            while task_of[robot] != NO_TASK and errand_cell[errand_ptr[row] + errand_of[robot]] == cells[k]:
                errand_of[robot] += 1
                life[task_of[robot]] = OPENED
                if errand_ptr[row] + errand_of[robot] == errand_ptr[row + 1]:
                    life[task_of[robot]] = FINISHED
                    task_of[robot] = NO_TASK
                    errand_of[robot] = 0
