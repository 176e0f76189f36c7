"""Arena: the rules of the League of Robot Runners and the books of one run."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import STRAIGHT, LaneGraph, grid_lane_graph
from maps.lorr import (
    CLOCKWISE,
    COUNTER_CLOCKWISE,
    FORWARD,
    NO_ACTION,
    START_HEADING,
    WAIT,
    Actions,
    Ints,
    LeagueProblem,
    LeagueResult,
)

Tasks = npt.NDArray[np.int64]
"""Task ids."""
Row = npt.NDArray[np.int64]
"""One number per robot, shape (n,)."""

NO_TASK = -1
_UNKNOWN, _WAITING, _OPENED, _FINISHED = range(4)
"""Life of a task: not revealed, no errand done yet, some done, all done."""
_VALID, _SIZE, _ILLEGAL, _VERTEX, _EDGE = range(5)
_MOVE_TEXTS = ("", "incorrect vector size", "unallowed move", "vertex conflict", "edge conflict")
_GONE, _TWICE, _LEFT = 2, 3, 4
_SCHEDULE_TEXTS = (
    "",
    "Invalid schedule size",
    "task already finished",
    "task is already assigned by the second agent at the same time",
    "task is already opened by the second agent",
)


class Arena:
    """Where the robots are, which tasks are known, who does what; a timestep passes with each `apply`.

    The rules are those of the League's own simulator of 2024; a problem of 2023 hands its tasks out itself. Robots may
    follow each other into cells that are vacated in the same timestep, closed rings too. A robot that stands on the
    cell of its task's next errand at the end of a timestep has done that errand, one per timestep.

    Controllers read, only `apply` and `idle` write. Arrays that are handed out hold until the next timestep.

    Args:
        problem: The problem.

    Source: Simulator.cpp, ActionModel.cpp and TaskManager.cpp of https://github.com/MAPF-Competition/Start-Kit, tag
    v2.1.2; for problems of 2023 InfAssignSystem in CompetitionSystem.cpp, tag v1.1.5.
    """

    def __init__(self, problem: LeagueProblem) -> None:
        n = problem.n_robots
        self.problem = problem
        self.graph: LaneGraph = grid_lane_graph(problem.grid, "rotating")
        self.timestep = 0
        self.n_finished = 0
        """Tasks done."""
        self.states: Ints = self.graph.state_index[problem.start_cell, START_HEADING]
        """State of each robot, shape (n,)."""
        self.task_of: Tasks = np.full(n, NO_TASK, dtype=np.int64)
        """Task that each robot holds, or `NO_TASK`, shape (n,)."""
        self.errand_of: Ints = np.zeros(n, dtype=np.int32)
        """Errands of it that are done, shape (n,); a task is opened, and stays with its robot, from the first on."""
        self.planner_errors: list[tuple[int, int, int, str]] = []
        """Robot, other robot or -1, timestep, text."""
        self.schedule_errors: list[tuple[int, int, int, int, str]] = []
        """Task, robot, other robot or -1, timestep, text."""
        self.n_timeouts = 0
        """Timesteps that passed in `idle`."""
        self._cells = problem.start_cell
        self._table = _action_table(self.graph)
        self._after = np.full(self.graph.n_cells, -1, dtype=np.int32)
        self._books = _Books(n)
        self._life = np.full(1024, _UNKNOWN, dtype=np.int8)
        self._holder = np.full(1024, -1, dtype=np.int32)
        self._release = np.zeros(1024, dtype=np.int32)
        self._pool: Tasks = np.empty(0, dtype=np.int64)
        self._given = np.zeros(n, dtype=np.int64)
        self._n_revealed = 0
        self._reveal()

    @property
    def errand_ptr(self) -> Ints:
        """With `errand_cell`, the tasks of the problem's file as CSR; task t is row t modulo their number."""
        return self.problem.errand_ptr

    @property
    def errand_cell(self) -> Ints:
        """Cells of all errands."""
        return self.problem.errand_cell

    def pool(self) -> Tasks:
        """Tasks that are known and not opened by anybody, ascending, those included that a robot is on its way to."""
        return self._pool

    def next_cell(self) -> Ints:
        """Cell of the next errand of each robot, -1 without a task, shape (n,)."""
        row = self.task_of % self.problem.n_tasks
        place = np.minimum(self.errand_ptr[row] + self.errand_of, len(self.errand_cell) - 1)
        cells: Ints = np.where(self.task_of == NO_TASK, np.int32(-1), self.errand_cell[place])
        return cells

    def apply(self, next_states: npt.NDArray[np.integer[Any]], task_of: npt.NDArray[np.integer[Any]]) -> None:
        """Let a timestep pass.

        If one move is none of the graph or two robots come into conflict, nobody moves; if one entry of the schedule
        is not allowed, all keep the tasks they have. Either counts as one error.

        Args:
            next_states: State of each robot after the timestep, shape (n,).
            task_of: Task of each robot from now on, or `NO_TASK`, shape (n,). A task must be known and unfinished and
                have one robot; a robot keeps a task it has opened. Not read where the problem hands out its tasks.
        """
        self.timestep += 1
        self._move(_row(next_states, len(self.states)))
        self._assign(self.task_of if self.problem.round_robin else _row(task_of, len(self.states)))
        self._tick()
        self._reveal()

    def idle(self, timesteps: int) -> None:
        """Let timesteps pass in which everybody waits for a late planner, and no errand counts."""
        nothing = np.full(len(self.states), NO_ACTION, dtype=np.int8)
        for _ in range(timesteps):
            self._books.moved(nothing, nothing)
            self._books.held += self.task_of != NO_TASK
        self.timestep += timesteps
        self.n_timeouts += timesteps

    def result(self, planner_times_s: npt.NDArray[np.float64]) -> LeagueResult:
        """What happened so far."""
        books = self._books
        known = np.flatnonzero(self._life != _UNKNOWN)
        return LeagueResult(
            problem=self.problem,
            actual=books.actions(books.actual),
            planned=books.actions(books.planned),
            planner_times_s=planner_times_s,
            n_finished=self.n_finished,
            makespan=int(books.held.max()),
            n_timeouts=self.n_timeouts,
            task_id=known,
            task_release=self._release[known],
            events=np.concatenate(books.events),
            schedule=np.concatenate(books.schedule),
            proposed=np.concatenate(books.proposed),
            planner_errors=tuple(self.planner_errors),
            schedule_errors=tuple(self.schedule_errors),
        )

    def _move(self, wanted: Row | None) -> None:
        n, graph = len(self.states), self.graph
        planned, there = np.full(n, NO_ACTION, dtype=np.int8), np.empty(n, dtype=np.int32)
        error, robot, other = _SIZE, -1, -1
        if wanted is not None:
            error, robot, other = _judge_moves(
                self.states, self._cells, wanted, self._table, graph.state_cell, self._after, planned, there
            )
        if error != _VALID or wanted is None:
            self.planner_errors.append((robot, other, self.timestep, _MOVE_TEXTS[error]))
            self._books.moved(np.full(n, WAIT, dtype=np.int8), planned)
        else:
            self._books.moved(planned, planned)
            self.states, self._cells = wanted.astype(np.int32), there

    def _assign(self, wanted: Row | None) -> None:
        if wanted is None:
            self.schedule_errors.append((-1, -1, -1, self.timestep, _SCHEDULE_TEXTS[_SIZE]))
        else:
            self._books.proposes(self.timestep, wanted)
            error, robot, other = _judge_schedule(self.task_of, self.errand_of, wanted, self._life, self._holder)
            if error == _VALID:
                self.task_of = wanted.copy()
                self._books.assigned(self.timestep, wanted)
            else:
                text = _SCHEDULE_TEXTS[error]
                self.schedule_errors.append((int(wanted[robot]), robot, other, self.timestep, text))
        self._books.held += self.task_of != NO_TASK

    def _tick(self) -> None:
        """Errands that are reached are done; robots at the end of a task are free."""
        self.task_of, self.errand_of = self.task_of.copy(), self.errand_of.copy()
        events = np.empty((len(self.states), 4), dtype=np.int32)
        n_events, n_finished = _tick_errands(
            self.timestep,
            self._cells,
            self.errand_ptr,
            self.errand_cell,
            self.task_of,
            self.errand_of,
            self._life,
            events,
        )
        self.n_finished += n_finished
        if n_events:
            self._books.events.append(events[:n_events].copy())
            self._pool = self._pool[self._life[self._pool] == _WAITING]

    def _reveal(self) -> None:
        """Make tasks known until the pool is full, or every robot has one."""
        if self.problem.round_robin:
            free = np.flatnonzero(self.task_of == NO_TASK)
            fresh = self._given[free] * len(self.states) + free
            self._given[free] += 1
            self.task_of[free] = fresh
        else:
            missing = self.problem.pool_size - (self._n_revealed - self.n_finished)
            fresh = np.arange(self._n_revealed, self._n_revealed + missing)
        if not fresh.size:
            return
        self._n_revealed += len(fresh)
        while fresh.max() >= len(self._life):
            self._life = np.append(self._life, np.full_like(self._life, _UNKNOWN))
            self._holder = np.append(self._holder, np.full_like(self._holder, -1))
            self._release = np.append(self._release, np.zeros_like(self._release))
        self._life[fresh] = _WAITING
        self._release[fresh] = self.timestep
        self._pool = np.concatenate((self._pool, fresh))
        if self.problem.round_robin:
            self._pool.sort()


class _Books:
    """What a result file tells, one array per timestep or change."""

    def __init__(self, n: int) -> None:
        self.held = np.zeros(n, dtype=np.int32)
        """Timesteps in which each robot held a task."""
        self.actual: list[Actions] = []
        self.planned: list[Actions] = []
        self.events: list[Ints] = [np.empty((0, 4), dtype=np.int32)]
        self.schedule: list[Ints] = [np.empty((0, 3), dtype=np.int32)]
        self.proposed: list[Ints] = [np.empty((0, 3), dtype=np.int32)]
        # No task at all, not even none: the first entry of every robot is written.
        self._last = np.full(n, NO_TASK - 1, dtype=np.int64)
        self._last_proposed = self._last

    def moved(self, actual: Actions, planned: Actions) -> None:
        """Note a timestep's actions; equal ones are one array."""
        self.actual.append(actual)
        self.planned.append(planned)

    def assigned(self, timestep: int, task_of: Tasks) -> None:
        """Note what changed in the schedule."""
        self.schedule.append(_changes(timestep, self._last, task_of))
        self._last = task_of

    def proposes(self, timestep: int, task_of: Tasks) -> None:
        """Note what changed in what the controller wants."""
        self.proposed.append(_changes(timestep, self._last_proposed, task_of))
        self._last_proposed = task_of

    def actions(self, rows: list[Actions]) -> Actions:
        """Rows as one array, shape (T, n)."""
        return np.array(rows, dtype=np.int8).reshape(len(rows), len(self.held))


def _row(values: npt.NDArray[np.integer[Any]], n: int) -> Row | None:
    """A copy of the values, or None if they are not one whole number per robot."""
    array = np.asarray(values)
    if array.shape != (n,) or not np.issubdtype(array.dtype, np.integer):
        return None
    return array.astype(np.int64)


def _changes(timestep: int, before: Tasks, after: Tasks) -> Ints:
    robots = np.flatnonzero(before != after)
    return np.column_stack((np.full(len(robots), timestep), robots, after[robots])).astype(np.int32)


def _action_table(graph: LaneGraph) -> Ints:
    """State after each action, -1 where it cannot be done, shape (n_states, 4)."""
    table = np.full((graph.n_states, 4), -1, dtype=np.int32)
    table[:, WAIT] = np.arange(graph.n_states)
    quarter = (graph.state_heading[graph.move_to] - graph.state_heading[graph.move_from]) % 4
    action = np.select([graph.move_kind == STRAIGHT, quarter == 1], [FORWARD, COUNTER_CLOCKWISE], default=CLOCKWISE)
    table[graph.move_from, action] = graph.move_to
    return table


@njit(cache=True, nogil=True)
def _judge_moves(
    states: Ints, cells: Ints, wanted: Row, table: Ints, state_cell: Ints, after: Ints, actions: Actions, there: Ints
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

    error, first, other = _VALID, -1, -1
    decided = 0
    while decided < n:
        robot = decided
        if actions[robot] == NO_ACTION:
            error, first = _ILLEGAL, robot
            break
        if after[there[robot]] >= 0:
            error, first, other = _VERTEX, robot, after[there[robot]]
            break
        opposite = after[cells[robot]]
        if cells[robot] != there[robot] and opposite >= 0 and cells[opposite] == there[robot]:
            error, first, other = _EDGE, robot, opposite
            break
        after[there[robot]] = robot
        decided += 1
    for robot in range(decided):
        after[there[robot]] = -1
    return error, first, other


@njit(cache=True, nogil=True)
def _judge_schedule(
    task_of: Tasks, errand_of: Ints, wanted: Tasks, life: npt.NDArray[np.int8], holder: Ints
) -> tuple[int, int, int]:  # pragma: no cover - compiled
    """Find the first error of a schedule: its kind, the robot, the other robot.

    `holder` is room for who gets each task, all -1, and is left so.
    """
    error, first, other = _VALID, -1, -1
    decided = 0
    while decided < len(wanted):
        robot, task = decided, wanted[decided]
        if task != NO_TASK:
            if task < 0 or task >= len(life) or life[task] == _UNKNOWN or life[task] == _FINISHED:
                error, first = _GONE, robot
                break
            if holder[task] >= 0:
                error, first, other = _TWICE, robot, holder[task]
                break
        if errand_of[robot] > 0 and task != task_of[robot]:
            error, first, other = _LEFT, robot, robot
            break
        if task != NO_TASK:
            holder[task] = robot
        decided += 1
    for robot in range(decided):
        if wanted[robot] != NO_TASK:
            holder[wanted[robot]] = -1
    return error, first, other


@njit(cache=True, nogil=True)
def _tick_errands(
    timestep: int,
    cells: Ints,
    errand_ptr: Ints,
    errand_cell: Ints,
    task_of: Tasks,
    errand_of: Ints,
    life: npt.NDArray[np.int8],
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
        life[task] = _OPENED
        events[n_events, 0], events[n_events, 1] = timestep, robot
        events[n_events, 2], events[n_events, 3] = task, errand_of[robot]
        n_events += 1
        if errand_ptr[row] + errand_of[robot] == errand_ptr[row + 1]:
            life[task] = _FINISHED
            task_of[robot] = NO_TASK
            errand_of[robot] = 0
            n_finished += 1
    return n_events, n_finished
