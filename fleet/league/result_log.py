"""ResultLog: what a result file tells of a run, as it happens."""

from __future__ import annotations

import numpy as np

from fleet.league.rules import NO_TASK, Tasks
from maps.formats.lorr import Actions, Ints


class ResultLog:
    """One array per timestep or change.

    Args:
        n: Number of robots.
    """

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


def _changes(timestep: int, before: Tasks, after: Tasks) -> Ints:
    robots = np.flatnonzero(before != after)
    return np.column_stack((np.full(len(robots), timestep), robots, after[robots])).astype(np.int32)
