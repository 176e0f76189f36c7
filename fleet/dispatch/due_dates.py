"""DueDates: says at once which tasks cannot be done in time, unless arms are faster than usual."""

from __future__ import annotations

import math

from fleet.dispatch.cost_model import CostModel
from fleet.tasks.board import Task
from fleet.tasks.reasons import ReasonBook


class DueDates:
    """Due dates of the tasks that are released.

    Args:
        cost_model: Knows the least time a task takes.
        reasons: Told of tasks that cannot be done in time.
        fastest_move_s: Time of one move at full speed [s].
    """

    def __init__(self, cost_model: CostModel, reasons: ReasonBook, fastest_move_s: float) -> None:
        self._cost_model = cost_model
        self._reasons = reasons
        self._fastest_move_s = fastest_move_s

    def check(self, task: Task) -> None:
        """Warn when not even a car that stands at the pick dock could bring a task in time."""
        if task.order.due_s == math.inf:
            return
        least_s = self._cost_model.least_s(task, self._fastest_move_s)
        if task.order.release_s + least_s > task.order.due_s:
            left_s = task.order.due_s - task.order.release_s
            takes = f"takes {least_s:.1f} s from" if math.isfinite(least_s) else "there is no way on from"
            text = f"it is due {left_s:.1f} s after its release, and {takes} {task.next_words}"
            self._reasons.warn(task, text)
