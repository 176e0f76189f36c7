"""Arena: where everybody is in a run of the League, and how a timestep passes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.league.ledger import TaskLedger
from fleet.league.result_log import ResultLog
from fleet.league.rules import (
    MOVE_TEXTS,
    NO_TASK,
    SCHEDULE_TEXTS,
    VALID,
    WRONG_SIZE,
    Tasks,
    action_table,
    judge_moves,
)
from maps.formats.lorr import NO_ACTION, START_HEADING, WAIT, Ints, LeagueProblem, LeagueResult
from maps.lane_graph import LaneGraph, grid_lane_graph

__all__ = ["NO_TASK", "Arena", "Tasks"]

Row = npt.NDArray[np.int64]
"""One number per robot, shape (n,)."""


class Arena:
    """Where the robots are, which tasks are known, who does what; a timestep passes with each `apply`.

    The rules are those of the League's own simulator of 2024; a problem of 2023 hands its tasks out itself. Robots may
    follow each other into cells that are vacated in the same timestep, closed rings too. A robot that stands on the
    cell of its task's next errand at the end of a timestep has done that errand, one per timestep.

    Only `apply` and `idle` change anything: what is handed out is a copy, and holds until the next timestep.

    Args:
        problem: The problem.

    Source: Simulator.cpp, ActionModel.cpp and TaskManager.cpp of https://github.com/MAPF-Competition/Start-Kit, tag
    v2.1.2; for problems of 2023 InfAssignSystem in CompetitionSystem.cpp, tag v1.1.5.
    """

    allow_rotation = True
    """Whether robots may follow each other in a closed ring."""

    def __init__(self, problem: LeagueProblem) -> None:
        n = problem.n_robots
        self.problem = problem
        self.graph: LaneGraph = grid_lane_graph(problem.grid, "rotating")
        self.timestep = 0
        self.planner_errors: list[tuple[int, int, int, str]] = []
        """Robot, other robot or -1, timestep, text."""
        self.schedule_errors: list[tuple[int, int, int, int, str]] = []
        """Task, robot, other robot or -1, timestep, text."""
        self.n_timeouts = 0
        """Timesteps that passed in `idle`."""
        self._states: Ints = self.graph.state_index[problem.start_cell, START_HEADING]
        self._ledger = TaskLedger(problem)
        self._cells = problem.start_cell
        self._table = action_table(self.graph)
        self._after = np.full(self.graph.n_cells, -1, dtype=np.int32)
        self._log = ResultLog(n)
        self._publish()

    @property
    def n_finished(self) -> int:
        """Tasks done."""
        return self._ledger.n_finished

    @property
    def n_errands_done(self) -> int:
        """Errands done, those of unfinished tasks included."""
        return sum(len(events) for events in self._log.events)

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
        return self._ledger.pool()

    def next_cell(self, task_of: Tasks) -> Ints:
        """Cell of the next errand of each robot under a schedule, -1 without a task, shape (n,)."""
        return self._ledger.next_cell(task_of)

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
        self._move(_row(next_states, len(self._states)))
        self._assign(self._ledger.task_of.copy() if self.problem.round_robin else _row(task_of, len(self._states)))
        events = self._ledger.tick(self.timestep, self._cells)
        if len(events):
            self._log.events.append(events)
        self._ledger.reveal(self.timestep)
        self._publish()

    def idle(self, timesteps: int) -> None:
        """Let timesteps pass in which everybody waits for a late planner, and no errand counts."""
        nothing = np.full(len(self._states), NO_ACTION, dtype=np.int8)
        for _ in range(timesteps):
            self._log.moved(nothing, nothing)
            self._log.held += self._ledger.task_of != NO_TASK
        self.timestep += timesteps
        self.n_timeouts += timesteps

    def result(self, planner_times_s: FloatArray) -> LeagueResult:
        """What happened so far."""
        log = self._log
        known, release = self._ledger.known()
        return LeagueResult(
            problem=self.problem,
            actual=log.actions(log.actual),
            planned=log.actions(log.planned),
            planner_times_s=planner_times_s,
            n_finished=self.n_finished,
            makespan=int(log.held.max(initial=0)),
            n_timeouts=self.n_timeouts,
            task_id=known,
            task_release=release,
            events=np.concatenate(log.events),
            schedule=np.concatenate(log.schedule),
            proposed=np.concatenate(log.proposed),
            planner_errors=tuple(self.planner_errors),
            schedule_errors=tuple(self.schedule_errors),
        )

    def _move(self, wanted: Row | None) -> None:
        n, graph = len(self._states), self.graph
        planned, there = np.full(n, NO_ACTION, dtype=np.int8), np.empty(n, dtype=np.int32)
        error, robot, other = WRONG_SIZE, -1, -1
        if wanted is not None:
            error, robot, other = judge_moves(
                self._states, self._cells, wanted, self._table, graph.state_cell, self._after, planned, there
            )
        if error != VALID or wanted is None:
            self.planner_errors.append((robot, other, self.timestep, MOVE_TEXTS[error]))
            self._log.moved(np.full(n, WAIT, dtype=np.int8), planned)
        else:
            self._log.moved(planned, planned)
            self._states[:] = wanted
            self._cells = there

    def _assign(self, wanted: Row | None) -> None:
        if wanted is None:
            self.schedule_errors.append((-1, -1, -1, self.timestep, SCHEDULE_TEXTS[WRONG_SIZE]))
        else:
            self._log.proposes(self.timestep, wanted)
            error, robot, other = self._ledger.judge(wanted)
            if error == VALID:
                self._ledger.give(wanted)
                self._log.assigned(self.timestep, wanted)
            else:
                text = SCHEDULE_TEXTS[error]
                self.schedule_errors.append((int(wanted[robot]), robot, other, self.timestep, text))
        self._log.held += self._ledger.task_of != NO_TASK

    def _publish(self) -> None:
        self.states: Ints = self._states.copy()
        """State of each robot, shape (n,)."""
        self.task_of: Tasks = self._ledger.task_of.copy()
        """Task that each robot holds, or `NO_TASK`, shape (n,)."""
        self.errand_of: Ints = self._ledger.errand_of.copy()
        """Errands of it that are done, shape (n,); a task is opened, and stays with its robot, from the first on."""


def _row(values: npt.NDArray[np.integer[Any]], n: int) -> Row | None:
    """A copy of the values, or None if they are not one whole number per robot."""
    array = np.asarray(values)
    if array.shape != (n,) or not np.issubdtype(array.dtype, np.integer):
        return None
    return array.astype(np.int64)
