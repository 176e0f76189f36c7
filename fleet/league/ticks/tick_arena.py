"""TickArena: where everybody is in a run of 2026, and how a tick passes."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.errors import FleetError
from fleet.league.ledger import TaskLedger
from fleet.league.result_log import ResultLog
from fleet.league.rules import NO_TASK, Tasks, action_table
from fleet.league.ticks.delay_stream import DelayStream
from fleet.league.ticks.tick_rules import MEND_TEXTS, judge_tick, mend_schedule, pass_tick
from maps.formats.lorr import FORWARD, START_HEADING, WAIT, Actions, Ints, LeagueProblem, LeagueResult
from maps.formats.lorr_2026 import SEGMENT, TickedRun, Ticks
from maps.grid import DCOL, DROW
from maps.lane_graph import LaneGraph, grid_lane_graph


class TickArena:
    """Where the robots are, which tasks are known, who does what; a tick passes with each `apply`.

    The rules are those of the League's own simulator of 2026. An action takes several ticks and is never given up, only
    interrupted. Robots are squares that must not overlap at any time; whoever would run into another one stands still
    for a tick. A robot whose delay is not over stands still. Errands are done at the end of a tick in which the robot
    is in the cell; it has left a cell when it is all the way in the next.

    Args:
        problem: A problem of 2026.

    Raises:
        FleetError: It is a problem of another year.

    Source: Simulator.cpp, ActionModel.cpp and TaskManager.cpp of https://github.com/MAPF-Competition/Start-Kit, tag
    v3.1.0.
    """

    def __init__(self, problem: LeagueProblem) -> None:
        n, cols = problem.n_robots, problem.grid.cols
        if problem.ticks is None:
            raise FleetError(f"league: {problem.name} is played in timesteps; valid: a problem of 2026, with ticks")
        self.problem = problem
        self.graph: LaneGraph = grid_lane_graph(problem.grid, "rotating")
        self.timestep = 0
        """Ticks that passed."""
        self.ledger = TaskLedger(problem)
        self.schedule_errors: list[tuple[int, int, int, int, str]] = []
        """Task, robot, other robot or -1, tick, text."""
        self.ticks: Ticks = problem.ticks
        """How time passes."""
        self._delays = DelayStream(self.ticks.delays, n)
        self._cells = problem.start_cell.copy()
        self._headings = np.full(n, START_HEADING, dtype=np.int32)
        self._done = np.zeros(n, dtype=np.int32)
        self._doing = np.full(n, WAIT, dtype=np.int8)
        self._proposed: Tasks = np.full(n, NO_TASK, dtype=np.int64)
        self._steps = np.array([row * cols + col for row, col in zip(DROW, DCOL, strict=True)], dtype=np.int32)
        self._blind = action_table(self.graph)[:, FORWARD] < 0
        self._occupant = np.full(problem.grid.n_cells, -1, dtype=np.int32)
        self._log = ResultLog(n)
        self._poses: list[Ints] = []

    @property
    def n_finished(self) -> int:
        """Tasks done."""
        return self.ledger.n_finished

    @property
    def states(self) -> Ints:
        """State of each robot: the cell it is in or about to leave, and its heading before a turn; shape (n,)."""
        states: Ints = self.graph.state_index[self._cells, self._headings]
        return states

    @property
    def under_way(self) -> Ints:
        """Ticks that are done of the action under way of each robot, 0 = none, shape (n,)."""
        return self._done.copy()

    def propose(self, task_of: Tasks) -> None:
        """Say who shall do which task from the next `assign` on; who finishes a task until then gets none."""
        self._proposed = np.array(task_of, dtype=np.int64)

    def assign(self) -> None:
        """Let what was proposed come into force, but for what is not allowed, which counts as an error each."""
        ledger, wanted = self.ledger, self._proposed
        self._log.proposes(self.timestep, wanted.copy())
        errors = np.empty((3 * len(wanted), 4), dtype=np.int64)
        count = mend_schedule(
            ledger.task_of,
            ledger.errand_of,
            wanted,
            ledger.life,
            ledger.holder,
            np.full_like(ledger.holder, -1),
            errors,
        )
        for kind, task, robot, other in errors[:count].tolist():
            self.schedule_errors.append((task, robot, other, self.timestep + 1, MEND_TEXTS[kind]))
        ledger.give(wanted)
        self._log.assigned(self.timestep, wanted.copy())

    def apply(self, wanted: Actions) -> BoolArray:
        """Let a tick pass.

        Args:
            wanted: What each robot shall do, shape (n,). Who is in the middle of an action goes on with it, or waits.

        Returns:
            Who came to the end of an action, shape (n,).
        """
        if self.timestep % SEGMENT == 0:
            self._poses.append(np.column_stack((*self._row_col(), self._headings, self._done)))
        delayed = self._delays.next()
        planned = np.where(delayed, np.int8(WAIT), wanted)
        planned = np.where((self._done > 0) & (planned != WAIT), self._doing, planned)
        ahead = np.where(self._blind[self.states] & (planned == FORWARD), np.int8(WAIT), planned)
        driven = np.where(self._doing == FORWARD, self._done, 0)
        free = judge_tick(
            np.column_stack((*self._row_col(), self._headings, driven)).astype(np.int32),
            self.problem.grid.cols,
            np.array(DROW, dtype=np.int32),
            np.array(DCOL, dtype=np.int32),
            ahead,
            self._occupant,
            self.ticks.per_action,
            self.ticks.size * self.ticks.per_action,
        )
        done = np.where(free, ahead, np.int8(WAIT))
        self._log.moved(done, planned)
        ended = pass_tick(
            self._cells, self._headings, self._done, self._doing, done, self._steps, self.ticks.per_action
        )
        self.timestep += 1
        self._work()
        return ended

    def result(self, planner_times_s: FloatArray) -> LeagueResult:
        """What happened so far."""
        log = self._log
        known, release = self.ledger.known()
        return LeagueResult(
            problem=self.problem,
            actual=log.actions(log.actual),
            planned=log.actions(log.planned),
            planner_times_s=planner_times_s,
            n_finished=self.n_finished,
            makespan=self.timestep,
            n_timeouts=0,
            task_id=known,
            task_release=release,
            events=np.concatenate(log.events),
            schedule=np.concatenate(log.schedule),
            proposed=np.concatenate(log.proposed),
            planner_errors=(),
            schedule_errors=tuple(self.schedule_errors),
            ticked=TickedRun(
                poses=np.array(self._poses, dtype=np.int32).reshape(-1, len(self._cells), 4),
                delays=self._delays.drawn(),
            ),
        )

    def _work(self) -> None:
        """Errands and tasks at the end of a tick."""
        held = self.ledger.task_of != NO_TASK
        events = self.ledger.tick(self.timestep, self._cells)
        if len(events):
            self._log.events.append(events)
        self._proposed[held & (self.ledger.task_of == NO_TASK)] = NO_TASK
        self.ledger.reveal(self.timestep)

    def _row_col(self) -> tuple[Ints, Ints]:
        row, col = self.problem.grid.row_col(self._cells)
        return row.astype(np.int32), col.astype(np.int32)
