"""Backlog: tasks are released, and are ready when nothing comes before them any more."""

from __future__ import annotations

from collections.abc import Callable

from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.reasons import ReasonBook, TaskReason


class Backlog:
    """Release and precedence of tasks.

    Work goes with what has changed: a task is looked at when it is released, and when one before it has ended.

    Args:
        board: The tasks.
        reasons: Told why a task waits.
        check: Called with every task that is released.
    """

    def __init__(self, board: TaskBoard, reasons: ReasonBook, check: Callable[[Task], None]) -> None:
        self._board = board
        self._reasons = reasons
        self._check = check
        self._after: dict[str, list[Task]] = {}
        for task in board.tasks:
            for name in task.order.after:
                self._after.setdefault(name, []).append(task)
        self._news: list[Task] = []
        board.subscribe(self._task_moved)

    def release(self, now_s: float) -> bool:
        """Release tasks whose time has come, and make those ready that wait for nobody.

        Those fail whose turn can never come.

        Returns:
            True when a task has become ready.
        """
        for task in self._board.release_due(now_s):
            self._check(task)
        any_ready = False
        while self._news:
            news, self._news = self._news, []
            for task in news:
                if task.state is TaskState.BACKLOG and self._may_begin(task, now_s):
                    self._reasons.forget(task)
                    self._board.move(task, TaskState.READY, now_s, "nothing comes before it")
                    any_ready = True
        return any_ready

    def _may_begin(self, task: Task, now_s: float) -> bool:
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

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        del before, now_s
        if task.state is TaskState.BACKLOG:
            self._news.append(task)
        # Whoever waited for it may begin, or never will.
        self._news += [other for other in self._after.get(task.order.name, ()) if other.state is TaskState.BACKLOG]
