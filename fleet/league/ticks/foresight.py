"""Foresight: what a controller sees that plans while robots still carry out the plan before."""

from __future__ import annotations

import numpy as np

from fleet.league.rules import Tasks
from fleet.league.ticks.plan_executor import PlanExecutor
from fleet.league.ticks.tick_arena import TickArena
from maps.formats.lorr import Ints


class Foresight:
    """The run as it will be when all that waits in the executor is done, and with each `advance` a timestep beyond.

    Nothing here reaches the arena: errands ahead are done on a copy. Tasks that are not known yet are not foreseen.

    Args:
        arena: The arena.
        executor: The executor.
    """

    allow_rotation = False
    """Squares that follow each other round a corner overlap, so no ring ever closes."""

    def __init__(self, arena: TickArena, executor: PlanExecutor) -> None:
        self.problem, self.graph = arena.problem, arena.graph
        self.states: Ints = executor.tail_states()
        """State of each robot, shape (n,)."""
        self.proposal: Tasks = arena.ledger.task_of.copy()
        """Task of each robot from when the plan comes into force: the one it opens in it or has opened before."""
        self._ledger = arena.ledger.ahead(*executor.cells_ahead())
        self._settled = (self._ledger.errand_of > 0) | (self._ledger.task_of != self.proposal)
        self._publish()

    @property
    def errand_ptr(self) -> Ints:
        """With `errand_cell`, the tasks of the problem's file as CSR."""
        return self.problem.errand_ptr

    @property
    def errand_cell(self) -> Ints:
        """Cells of all errands."""
        return self.problem.errand_cell

    def pool(self) -> Tasks:
        """Tasks that are known and not going to be opened by anybody, ascending."""
        return self._ledger.pool()

    def next_cell(self, task_of: Tasks) -> Ints:
        """Cell of the next errand of each robot under a schedule, -1 without a task, shape (n,)."""
        return self._ledger.next_cell(task_of)

    def advance(self, states: Ints, task_of: Tasks) -> None:
        """Look a timestep of the plan further ahead.

        Args:
            states: State of each robot after it, shape (n,).
            task_of: Task of each robot from then on, shape (n,).
        """
        self.states = states
        self.proposal = np.where(self._settled, self.proposal, task_of)
        self._ledger.give(task_of)
        events = self._ledger.tick(0, self.graph.state_cell[states])
        self._settled[events[:, 1]] = True
        self._publish()

    def _publish(self) -> None:
        self.task_of: Tasks = self._ledger.task_of.copy()
        """Task that each robot holds, or `NO_TASK`, shape (n,)."""
        self.errand_of: Ints = self._ledger.errand_of.copy()
        """Errands of it that are done, shape (n,)."""
