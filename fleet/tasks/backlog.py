"""Backlog: released tasks that wait for others."""

from __future__ import annotations

from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.reasons import ReasonBook, TaskReason


class Backlog:
    """Precedence among released tasks.

    Args:
        board: The tasks.
        reasons: Told why a task waits.
    """

    def __init__(self, board: TaskBoard, reasons: ReasonBook) -> None:
        self._board = board
        self._reasons = reasons

    def may_begin(self, task: Task, now_s: float) -> bool:
        """Whether all tasks before one are done; it fails if one of them never will be."""
        first = self._board.waits_for(task)
        if first is None:
            return True
        if first.state in (TaskState.FAILED, TaskState.CANCELLED):
            reason = f"{first.order.name}, which comes before it, is {first.state}"
            self._board.move(task, TaskState.FAILED, now_s, reason)
        else:
            reason = f"{first.order.name} must be {'done' if first.visit else 'delivered'} before it"
            self._reasons.note(task, TaskReason.WAITS_FOR_PREDECESSOR, reason, now_s)
        return False
