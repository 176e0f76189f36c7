"""Lives: every step of every task of a board, for tests that look back."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from fleet.tasks.board import Task, TaskBoard, TaskState


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a life."""

    before: TaskState
    state: TaskState
    time_s: float
    cause: str


class Lives:
    """Steps of tasks, by the names of their orders.

    Args:
        board: Listened to from now on.
    """

    def __init__(self, board: TaskBoard) -> None:
        self.of: defaultdict[str, list[Step]] = defaultdict(list)
        board.subscribe(self._note)

    def all(self) -> list[Step]:
        """The steps of all tasks."""
        return [step for steps in self.of.values() for step in steps]

    def check(self) -> None:
        """Every life is unbroken, and every step has a cause."""
        for steps in self.of.values():
            assert all(step.cause for step in steps)
            assert [step.before for step in steps[1:]] == [step.state for step in steps[:-1]]
            assert [step.time_s for step in steps] == sorted(step.time_s for step in steps)

    def _note(self, task: Task, before: TaskState, now_s: float) -> None:
        self.of[task.order.name].append(Step(before=before, state=task.state, time_s=now_s, cause=task.reason))
