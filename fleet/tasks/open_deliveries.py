"""OpenDeliveries: deliveries that no car has yet, station by station, the most urgent first."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Callable, Hashable, Iterator
from heapq import heapify, heappop, heapreplace
from itertools import groupby, islice
from operator import itemgetter

from fleet.tasks.board import Task, TaskBoard, TaskState

Key = tuple[int, float, int]
"""Class, time and index of a task: of two the smaller is more urgent."""


class OpenDeliveries:
    """Deliveries that are ready.

    They line up by where they begin and by kind: what one task of a kind has to wait for, all of that kind have to wait
    for, and nothing else has. So whoever looks for tasks looks at the most urgent of each kind, however many there are.

    Args:
        board: The tasks.
        kind_of: Says of which kind a task is.
    """

    def __init__(self, board: TaskBoard, kind_of: Callable[[Task], Hashable]) -> None:
        self.n_changes = 0
        """How often a task came or went."""
        self._tasks = board.tasks
        self._kind_of = kind_of
        self._kinds: dict[int, Hashable] = {}
        self._lines: dict[str, dict[Hashable, _Line]] = {}
        board.subscribe(self._task_moved)

    def urgent(self, pick: str, may_go: Callable[[Task], bool] = lambda task: True) -> Iterator[Task]:
        """Deliveries that can begin at a pick station, the most urgent first.

        Of each kind the one that is due first and the oldest take turns; across kinds the class decides, and then the
        time since the release.

        Args:
            pick: Its name.
            may_go: Asked once for each kind, with its most urgent task; of a kind that may not go only that is told.
        """
        ready: list[tuple[Key, int, Iterator[Key]]] = []
        for n, line in enumerate(self._lines.get(pick, {}).values()):
            keys = line.urgent()
            if (key := next(keys, None)) is not None:
                ready.append((key, n, keys if may_go(self._tasks[key[2]]) else iter(())))
        heapify(ready)
        while ready:
            key, n, keys = ready[0]
            task = self._tasks[key[2]]
            following = next(keys, None)
            if following is None:
                heappop(ready)
            else:
                heapreplace(ready, (following, n, keys))
            if task.pick_slot is None or task.pick == pick:
                yield task

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        del now_s
        if task.visit is not None:
            return
        if task.state is TaskState.READY:
            self.n_changes += 1
            kind = self._kinds[task.index] = self._kind_of(task)
            for pick in task.delivery.picks:
                self._lines.setdefault(pick, {}).setdefault(kind, _Line()).add(task)
        elif before is TaskState.READY:
            self.n_changes += 1
            kind = self._kinds.pop(task.index)
            for pick in task.delivery.picks:
                lines = self._lines[pick]
                if lines[kind].remove(task):
                    del lines[kind]


class _Line:
    """Tasks of one kind."""

    def __init__(self) -> None:
        self._by_age: list[Key] = []
        self._by_due: list[Key] = []

    def add(self, task: Task) -> None:
        """Take a task in."""
        insort(self._by_age, _age(task))
        if task.order.due_s < math.inf:
            insort(self._by_due, by_due(task))

    def remove(self, task: Task) -> bool:
        """Let a task go; True when none is left."""
        del self._by_age[bisect_left(self._by_age, _age(task))]
        if task.order.due_s < math.inf:
            del self._by_due[bisect_left(self._by_due, by_due(task))]
        return not self._by_age

    def urgent(self) -> Iterator[Key]:
        """Class by class, the one that is due first and the oldest in turn, each task once."""
        if not self._by_due:
            yield from self._by_age
            return
        dues = {rank: iter(list(keys)) for rank, keys in groupby(self._by_due, itemgetter(0))}
        told: set[int] = set()
        for oldest in self._by_age:
            # Against other kinds, what is due soon counts as old as the oldest that it goes along with.
            for _, _, index in (*islice(dues.get(oldest[0], iter(())), 1), oldest):
                if index not in told:
                    told.add(index)
                    yield oldest[0], oldest[1], index


def _age(task: Task) -> Key:
    return task.order.rank, task.since_s[TaskState.BACKLOG], task.index


def by_due(task: Task) -> Key:
    """Key by which tasks of a class are begun in the order of their due dates."""
    return task.order.rank, task.order.due_s, task.index
