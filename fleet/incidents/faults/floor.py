"""What happens to the floor: lanes are blocked or closed, and people walk across."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.config import ScenarioEvent, require
from fleet.incidents.faults.incident import Once
from fleet.run.view import RunView

OBSTACLE_HALF_M = (0.25, 0.25, 0.2)
"""Half size of the box that blocks a lane [m]."""
PATIENCE_S = 3.0
"""A person who has waited for a car for so long walks around it [s]."""
HUMAN_HALF_M = (0.2, 0.2, 0.9)
"""Half size of a person [m]."""


class LaneClosed:
    """Nobody is sent into a cell any more, as soon as nobody is there."""

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._for_good: dict[int, bool] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, (cell,) = self._run, targets
        if not run.executor.close_if_free(cell):
            return False
        self._for_good[cell] = event.is_for_good
        run.traffic.set_blocked(cell, True, for_good=self._for_good[cell])
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        run, (cell,) = self._run, targets
        run.traffic.set_blocked(cell, False, for_good=self._for_good.pop(cell))
        run.executor.open(cell)


class LaneBlocked(LaneClosed):
    """A box stands in a cell, as soon as no car and no pod is there."""

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, (cell,) = self._run, targets
        if run.visits.pod_stands_in(cell) or not super().begin(event, targets):
            return False
        run.world.add_obstacle(cell, _middle(run, cell, OBSTACLE_HALF_M[2]), np.array(OBSTACLE_HALF_M))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        self._run.world.remove_obstacle(targets[0])
        super().end(targets)


@dataclass(kw_only=True)
class _Walk:
    cells: list[int]
    goal: int
    obstacle: int
    speed_mps: float
    waited_s: float = 0.0
    """For a car to be out of the way."""
    at: int = 0
    """Index of the cell that was left last."""
    gone_m: float = 0.0
    """Since its middle."""
    closed: tuple[int, ...] = ()


class HumanWalks(Once):
    """A person walks from one cell to another, from middle to middle, and lets cars pass that are about to enter.

    The cells that the person is in are closed to cars; the person enters one only when no car holds it or lies dead in
    it. A person whom a car keeps waiting walks around it, steps aside, or leaves the floor where there is no room for
    both.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._walks: list[_Walk] = []
        self._n_walks = 0

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, (cell,) = self._run, targets
        goal = self.goal(event)
        if not self._enter(cell):
            return False
        cells = _walk(run, cell, goal)
        self._n_walks += 1
        obstacle = run.site.grid.n_cells + self._n_walks
        run.world.add_obstacle(obstacle, _middle(run, cell, HUMAN_HALF_M[2]), np.array(HUMAN_HALF_M))
        self._walks.append(
            _Walk(cells=cells, goal=goal, obstacle=obstacle, speed_mps=event.value("speed_mps"), closed=(cell,))
        )
        return True

    def goal(self, event: ScenarioEvent) -> int:
        """The cell where the person goes.

        Raises:
            ConfigError: It is no free cell.
        """
        grid = self._run.site.grid
        row, col = int(event.value("to_row")), int(event.value("to_col"))
        ok = row < grid.rows and col < grid.cols and bool(grid.free[row, col])
        require(
            ok,
            f"event at {event.time_s:g} s: to_row, to_col of {event.kind}",
            f"{row}, {col}",
            "row and col of a free cell",
        )
        return int(grid.index(row, col))

    def tick(self) -> None:
        """Let everybody walk on."""
        for walk in list(self._walks):
            self._step(walk)

    def _step(self, walk: _Walk) -> None:
        run = self._run
        if walk.at == len(walk.cells) - 1 and walk.cells[-1] != walk.goal:
            walk.cells, walk.at = _walk(run, walk.cells[-1], walk.goal), 0
        if walk.at == len(walk.cells) - 1:
            run.world.remove_obstacle(walk.obstacle)
            for cell in walk.closed:
                self._leave(cell)
            self._walks.remove(walk)
            return
        here, there = walk.cells[walk.at : walk.at + 2]
        if there not in walk.closed:
            if not self._enter(there):
                self._wait(walk, here)
                return
            walk.closed, walk.waited_s = (here, there), 0.0
        cell_m = run.site.grid.cell_m
        walk.gone_m += walk.speed_mps * run.tick_s
        if walk.gone_m >= cell_m:
            walk.at, walk.gone_m, walk.closed = walk.at + 1, 0.0, (there,)
            self._leave(here)
        a, b = (_middle(run, cell, HUMAN_HALF_M[2]) for cell in (here, there))
        share = 1.0 if walk.gone_m == 0.0 else walk.gone_m / cell_m
        run.world.remove_obstacle(walk.obstacle)
        run.world.add_obstacle(walk.obstacle, a + share * (b - a), np.array(HUMAN_HALF_M))

    def _enter(self, cell: int) -> bool:
        """Keep cars out of a cell, unless there is one in it."""
        executor = self._run.executor
        # A wreck may lie in cells that it does not hold: others did when it came to rest.
        if self._run.traffic.blocked[cell] or not executor.close_if_free(cell, for_a_moment=True):
            return False
        executor.n_walkers[cell] += 1
        return True

    def _leave(self, cell: int) -> None:
        self._run.executor.open(cell)
        self._run.executor.n_walkers[cell] -= 1

    def _wait(self, walk: _Walk, here: int) -> None:
        """A car is in the way."""
        run = self._run
        walk.waited_s += run.tick_s
        if walk.waited_s < PATIENCE_S:
            return
        taken = (run.executor.dependencies.holders() >= 0) | run.traffic.blocked
        around = _walk(run, here, walk.goal, taken=taken)
        aside = [cell for cell in _neighbours(run, here) if not taken[cell]]
        if len(around) == 1:
            around = [here, *aside[:1]]
        walk.cells, walk.at, walk.waited_s = around, 0, 0.0
        if len(around) == 1:
            walk.goal = here


def _neighbours(run: RunView, cell: int) -> list[int]:
    """Free cells beside one."""
    grid = run.site.grid
    found = (int(grid.neighbour(cell, heading)) for heading in range(4))
    return [there for there in found if there >= 0 and grid.free.ravel()[there]]


def _middle(run: RunView, cell: int, height_m: float) -> FloatArray:
    return np.append(run.site.grid.cell_xy(cell), height_m)


def _walk(run: RunView, cell: int, goal: int, taken: BoolArray | None = None) -> list[int]:
    """Cells of a shortest walk over free cells that are not taken; the first one alone if there is none."""
    before = {cell: cell}
    queue = [cell]
    for here in queue:
        if here == goal:
            break
        for there in _neighbours(run, here):
            if there not in before and (taken is None or not taken[there]):
                before[there] = here
                queue.append(there)
    if goal not in before:
        return [cell]
    cells = [goal]
    while cells[-1] != cell:
        cells.append(before[cells[-1]])
    return cells[::-1]
