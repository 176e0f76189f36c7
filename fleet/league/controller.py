"""Controllers: what plays by the League's rules, and a plain one."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from fleet.league.rules import NO_TASK, Tasks
from fleet.league.view import LeagueView
from maps.formats.lorr import Ints
from maps.grid import EAST
from planners.mapf.distance_table import DistanceTable
from planners.mapf.pibt import Pibt
from planners.mapf.problem import NO_GOAL, Instance


class Controller(Protocol):
    """Says what every robot does next, and on which task it works."""

    def prepare(self, arena: LeagueView, budget_s: float) -> None:
        """Get ready before the first timestep, with what is known by then: the map, the robots, the first tasks.

        Args:
            arena: The arena, at timestep 0.
            budget_s: Wall time that each call of `step` should keep to [s].
        """

    def step(self, arena: LeagueView) -> tuple[Ints, Tasks]:
        """Decide a timestep.

        Returns:
            State of each robot after it and task of each robot from then on, shape (n,) each, as `Arena.apply` takes
            them.
        """


class PibtController:
    """Gives each free robot the task that begins nearest, and moves all by PIBT. Keeps to no budget.

    Args:
        seed: Seed of the tie-breaking.
    """

    def __init__(self, *, seed: int = 0) -> None:
        self._pibt = Pibt(seed=seed)

    def prepare(self, arena: LeagueView, budget_s: float) -> None:
        """Make room for the distances, and decide a timestep in vain, which loads the kernels."""
        del budget_s
        graph, n = arena.graph, len(arena.states)
        self._nowhere = np.zeros(graph.n_cells, dtype=np.bool_)
        self._nobody = np.zeros(n, dtype=np.bool_)
        self._tables = DistanceTable(graph, self._nowhere)
        self._waited = np.zeros(n)
        self._goals = np.full(n, NO_GOAL, dtype=np.int32)
        self.step(arena)

    def step(self, arena: LeagueView) -> tuple[Ints, Tasks]:
        """Decide a timestep."""
        graph = arena.graph
        task_of = _with_nearest(arena)
        cells = arena.next_cell(task_of)
        # An errand is done in any heading, so which one the goal has hardly matters.
        goals = np.where(cells < 0, np.int32(NO_GOAL), graph.state_index[cells, EAST])
        self._waited = np.where(goals == self._goals, self._waited + 1.0, 0.0)
        self._goals = goals
        plan = self._pibt.plan(
            Instance(
                graph=graph,
                starts=arena.states,
                goals=goals,
                priorities=self._waited,
                stay=self._nobody,
                fixed=self._nobody,
                blocked=self._nowhere,
                allow_rotation=arena.allow_rotation,
                horizon=1,
            ),
            self._tables,
        )
        return plan.states[-1], task_of


def _with_nearest(arena: LeagueView) -> Tasks:
    """The schedule, with a task for each free robot as long as there are some, the lowest robot first."""
    task_of = arena.task_of.copy()
    open_tasks = np.setdiff1d(arena.pool(), task_of, assume_unique=False)
    grid = arena.problem.grid
    rows, cols = grid.row_col(arena.errand_cell[arena.errand_ptr[open_tasks % arena.problem.n_tasks]])
    for robot in np.flatnonzero(task_of == NO_TASK)[: len(open_tasks)].tolist():
        row, col = grid.row_col(int(arena.graph.state_cell[arena.states[robot]]))
        nearest = int(np.argmin(np.abs(rows - row) + np.abs(cols - col)))
        task_of[robot] = open_tasks[nearest]
        rows[nearest] = 2**20  # taken: far from everybody
    return task_of
