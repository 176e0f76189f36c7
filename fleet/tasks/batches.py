"""Batches: orders that belong together, and when the last of them is done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fleet.tasks.board import CLOSED_STATES, DONE_STATES, Task, TaskBoard, TaskState


@dataclass(kw_only=True)
class _Batch:
    tasks: list[Task]
    n_open: int


class Batches:
    """All batches of a run.

    Args:
        board: All tasks; those of a batch are released at the same time.
        log: Called as ``log("batch_ended", **facts)`` when nothing of a batch is left to do.
    """

    def __init__(self, board: TaskBoard, log: Callable[..., None]) -> None:
        self.spans_s: list[float] = []
        """Times from the release of a batch until the last of it was done, of all that are done [s]."""
        self._log = log
        self._batches: dict[str, _Batch] = {}
        for task in board.tasks:
            if task.order.batch:
                batch = self._batches.setdefault(task.order.batch, _Batch(tasks=[], n_open=0))
                batch.tasks.append(task)
                batch.n_open += 1
        board.subscribe(self._moved)

    @property
    def n(self) -> int:
        """Number of batches."""
        return len(self._batches)

    def _moved(self, task: Task, before: TaskState, now_s: float) -> None:
        """Take note of a step of a task."""
        if not task.order.batch or before in DONE_STATES or task.state not in CLOSED_STATES:
            return
        batch = self._batches[task.order.batch]
        batch.n_open -= 1
        if batch.n_open:
            return
        n_done = sum(other.done_s is not None for other in batch.tasks)
        span_s = now_s - task.order.release_s
        if n_done == len(batch.tasks):
            self.spans_s.append(span_s)
        self._log("batch_ended", batch=task.order.batch, done=n_done, of=len(batch.tasks), span_s=round(span_s, 2))
