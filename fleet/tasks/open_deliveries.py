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
        self._queues: dict[str, _Queue] = {}
        board.subscribe(self._task_moved)

    def urgent(self, pick: str, may_go: Callable[[Task], bool] = lambda task: True) -> Iterator[Task]:
        """Deliveries that can begin at a pick station, the most urgent first.

        Of each kind the one that is due first and the oldest take turns; across kinds the class decides, and then the
        time since the release.

        Args:
            pick: Its name.
            may_go: Asked once for each kind, with its most urgent task; of a kind that may not go only that is told.
        """
        queue = self._queues.get(pick)
        if queue is None:
            return
        for key in self._in_turn(queue, may_go) if queue.n_due else self._by_age(queue, may_go):
            task = self._tasks[key[2]]
            if task.pick_slot is None or task.pick == pick:
                yield task

    def _by_age(self, queue: _Queue, may_go: Callable[[Task], bool]) -> Iterator[Key]:
        """Where nothing is due, all kinds stand in one line, however many there are."""
        goes: dict[Hashable, bool] = {}
        for key in queue.by_age:
            kind = self._kinds[key[2]]
            if kind not in goes:
                goes[kind] = may_go(self._tasks[key[2]])
            elif not goes[kind]:
                continue
            yield key

    def _in_turn(self, queue: _Queue, may_go: Callable[[Task], bool]) -> Iterator[Key]:
        ready: list[tuple[Key, int, Iterator[Key]]] = []
        for n, line in enumerate(queue.lines.values()):
            keys = line.urgent()
            if (key := next(keys, None)) is not None:
                ready.append((key, n, keys if may_go(self._tasks[key[2]]) else iter(())))
        heapify(ready)
        while ready:
            key, n, keys = ready[0]
            following = next(keys, None)
            if following is None:
                heappop(ready)
            else:
                heapreplace(ready, (following, n, keys))
            yield key

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        del now_s
        if task.visit is not None:
            return
        if task.state is TaskState.READY:
            self.n_changes += 1
            kind = self._kinds[task.index] = self._kind_of(task)
            for pick in task.delivery.picks:
                self._queues.setdefault(pick, _Queue()).add(task, kind)
        elif before is TaskState.READY:
            self.n_changes += 1
            kind = self._kinds.pop(task.index)
            for pick in task.delivery.picks:
                self._queues[pick].remove(task, kind)


class _Queue:
    """Tasks that can begin at one station: of all kinds together, and kind by kind."""

    def __init__(self) -> None:
        self.by_age: list[Key] = []
        self.lines: dict[Hashable, _Line] = {}
        self.n_due = 0
        """How many have a due date."""

    def add(self, task: Task, kind: Hashable) -> None:
        """Take a task in."""
        insort(self.by_age, _age(task))
        self.lines.setdefault(kind, _Line()).add(task)
        self.n_due += task.order.due_s < math.inf

    def remove(self, task: Task, kind: Hashable) -> None:
        """Let a task go."""
        del self.by_age[bisect_left(self.by_age, _age(task))]
        if self.lines[kind].remove(task):
            del self.lines[kind]
        self.n_due -= task.order.due_s < math.inf


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
