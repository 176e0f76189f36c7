"""TaskLedger: which tasks of the League are known, which robot has which, and which errands are done."""

from __future__ import annotations

from copy import copy

import numpy as np
import numpy.typing as npt

from fleet.league.rules import (
    NO_TASK,
    UNKNOWN,
    WAITING,
    Lives,
    Tasks,
    judge_schedule,
    tick_errands,
    tick_errands_on_way,
)
from maps.formats.lorr import Ints, LeagueProblem


class TaskLedger:
    """Tasks become known, are given to robots and done errand by errand, as the problem's edition has it.

    Args:
        problem: The problem; the first tasks are known at timestep 0.
    """

    def __init__(self, problem: LeagueProblem) -> None:
        n = problem.n_robots
        self.problem = problem
        self.n_finished = 0
        """Tasks done."""
        self.task_of: Tasks = np.full(n, NO_TASK, dtype=np.int64)
        """Task that each robot holds, or `NO_TASK`, shape (n,)."""
        self.errand_of: Ints = np.zeros(n, dtype=np.int32)
        """Errands of it that are done, shape (n,)."""
        self.life: Lives = np.full(1024, UNKNOWN, dtype=np.int8)
        self.holder: Ints = np.full(1024, -1, dtype=np.int32)
        """Room for judges of schedules: all -1."""
        self._release = np.zeros(1024, dtype=np.int32)
        self._pool: Tasks = np.empty(0, dtype=np.int64)
        self._given = np.zeros(n, dtype=np.int64)
        self._n_revealed = 0
        self.reveal(0)

    def ahead(self, ptr: Ints, cells: Ints) -> TaskLedger:
        """A ledger of its own that goes on when the robots have come through some cells under the present schedule.

        Args:
            ptr: With `cells`, the ways of the robots as CSR, shape (n + 1,).
            cells: Cells in order, shape (k,).
        """
        ahead = copy(self)
        ahead.task_of, ahead.errand_of, ahead.life = self.task_of.copy(), self.errand_of.copy(), self.life.copy()
        errands = self.problem.errand_ptr, self.problem.errand_cell
        tick_errands_on_way(ptr, cells, *errands, ahead.task_of, ahead.errand_of, ahead.life)
        ahead._pool = self._pool[ahead.life[self._pool] == WAITING]
        return ahead

    def pool(self) -> Tasks:
        """Tasks that are known and not opened by anybody, ascending, those included that a robot is on its way to."""
        return self._pool.copy()

    def known(self) -> tuple[npt.NDArray[np.int64], Ints]:
        """Every task that ever was known, and when it became so, shape (k,) each."""
        known = np.flatnonzero(self.life != UNKNOWN)
        return known, self._release[known]

    def next_cell(self, task_of: Tasks) -> Ints:
        """Cell of the next errand of each robot under a schedule, -1 without a task, shape (n,)."""
        problem = self.problem
        row = task_of % problem.n_tasks
        place = np.minimum(problem.errand_ptr[row] + self.errand_of, len(problem.errand_cell) - 1)
        cells: Ints = np.where(task_of == NO_TASK, np.int32(-1), problem.errand_cell[place])
        return cells

    def judge(self, wanted: Tasks) -> tuple[int, int, int]:
        """The first error of a schedule: its kind, the robot, the other robot."""
        verdict: tuple[int, int, int] = judge_schedule(self.task_of, self.errand_of, wanted, self.life, self.holder)
        return verdict

    def give(self, task_of: Tasks) -> None:
        """Let a schedule come into force."""
        self.task_of[:] = task_of

    def tick(self, timestep: int, cells: Ints) -> Ints:
        """Errands that are reached are done; robots at the end of a task are free.

        Args:
            timestep: When.
            cells: Where the robots are, shape (n,).

        Returns:
            Timestep, robot, task, errands of it done by then; shape (k, 4).
        """
        events = np.empty((len(cells), 4), dtype=np.int32)
        n_events, n_finished = tick_errands(
            timestep,
            cells,
            self.problem.errand_ptr,
            self.problem.errand_cell,
            self.task_of,
            self.errand_of,
            self.life,
            events,
        )
        self.n_finished += n_finished
        if n_events:
            self._pool = self._pool[self.life[self._pool] == WAITING]
        return events[:n_events].copy()

    def reveal(self, timestep: int) -> None:
        """Make tasks known until the pool is full, or every robot has one."""
        if self.problem.round_robin:
            free = np.flatnonzero(self.task_of == NO_TASK)
            fresh = self._given[free] * len(self.task_of) + free
            self._given[free] += 1
            self.task_of[free] = fresh
        else:
            missing = self.problem.pool_size - (self._n_revealed - self.n_finished)
            fresh = np.arange(self._n_revealed, self._n_revealed + missing)
        if not fresh.size:
            return
        self._n_revealed += len(fresh)
        while fresh.max() >= len(self.life):
            self.life = np.append(self.life, np.full_like(self.life, UNKNOWN))
            self.holder = np.append(self.holder, np.full_like(self.holder, -1))
            self._release = np.append(self._release, np.zeros_like(self._release))
        self.life[fresh] = WAITING
        self._release[fresh] = timestep
        self._pool = np.concatenate((self._pool, fresh))
        if self.problem.round_robin:
            self._pool.sort()
