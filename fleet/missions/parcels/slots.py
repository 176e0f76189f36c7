"""Slots: parcels of released orders enter the warehouse at rack slots that are free."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable

from fleet.missions.parcels.inventory import Inventory
from fleet.stations.stations import Stations
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.reasons import ReasonBook, TaskReason


class Slots:
    """Gives slots to the tasks that wait for one.

    Work goes with what has changed: a task is looked at when it is released, when an order before it has ended, and
    when a station that it can be had from has a free slot.

    Args:
        board: The tasks.
        stations: The stations.
        inventory: Puts parcels on slots.
        backlog: Tells which tasks wait for others.
        reasons: Told why a task waits.
        source_cost: Called as ``source_cost(pick, task)``: what it costs to bring a task's parcel from a pick station.
        turn_s: Called as ``turn_s(task)``: when a task is planned to be picked [s], inf = that is not planned.
    """

    def __init__(
        self,
        board: TaskBoard,
        stations: Stations,
        inventory: Inventory,
        backlog: Backlog,
        reasons: ReasonBook,
        source_cost: Callable[[str, Task], float],
        turn_s: Callable[[Task], float],
    ) -> None:
        self._board = board
        self._stations = stations
        self._inventory = inventory
        self._backlog = backlog
        self._reasons = reasons
        self._source_cost = source_cost
        self._turn_s = turn_s
        self._loading = stations.loading()
        self._seen = (0, 0, 0)
        self._waiting: dict[str, dict[int, Task]] = {station.name: {} for station in stations}
        """Tasks that wait, by each station that they can be had from, in the order in which they were released."""
        self._several: dict[int, Task] = {}
        """Those that begin an order of several legs, for which slots are kept free."""
        self._after: dict[str, list[Task]] = {}
        for task in board.tasks:
            for name in task.order.after:
                self._after.setdefault(name, []).append(task)
        self._news: list[Task] = []
        self._order_of: dict[int, int] = {}
        board.subscribe(self._task_moved)

    def tick(self, now_s: float) -> bool:
        """Take out what is to be collected, and put the parcels of released orders on free pick slots.

        Returns:
            True when a task has become ready.
        """
        self._inventory.collect(now_s)
        if not self._board.count(TaskState.BACKLOG):
            return False
        state = (self._board.n_released, sum(station.n_free for station in self._loading), self._board.n_closed)
        if state == self._seen:
            return False
        # As it was before: what fails now may let others fail in the next round.
        self._seen = state
        return self._fill(now_s)

    def _fill(self, now_s: float) -> bool:
        """Put parcels on free pick slots: the most urgent class first, then as planned, then first come first.

        An order of several legs begins when it can have a slot of each of its stations at once, and the slots that are
        free are kept for it until then: if its car had to wait for a slot between two legs, it might wait for parcels
        that wait for this very car.
        """
        filled = False
        kept: Counter[str] = Counter()
        turns = _Turns(self._turn_of)
        news, self._news = self._news, []
        turns.add(news)
        turns.add(self._several.values())
        for station in self._loading:
            if station.n_free:
                turns.add(self._waiting[station.name].values())
        while (task := turns.next()) is not None:
            if not self._waits(task):
                continue
            if not self._backlog.may_begin(task, now_s):
                if task.pick_slot is not None and not self._waits(task):
                    # It has failed, as it can never begin.
                    self._stations.named(task.pick).free_slot(task.pick_slot)
                    turns.add(self._waiting[task.pick].values())
            elif task.pick_slot is not None or self._take_slots(task, kept, now_s):
                self._inventory.enter(task, now_s)
                filled = True
        return filled

    def _waits(self, task: Task) -> bool:
        return task.state is TaskState.BACKLOG

    def _turn_of(self, task: Task) -> tuple[int, float, int]:
        """What decides whose turn comes first."""
        return task.order.priority.rank, self._turn_s(task), self._order_of[task.index]

    def _take_slots(self, task: Task, kept: Counter[str], now_s: float) -> bool:
        """Take a slot for a task, and one of each other station that its order needs; False if they are not free."""
        named = self._stations.named
        legs = self._board.legs_after(task)
        free = [name for name in task.delivery.picks if named(name).n_free > kept[name]]
        others = {leg.pick: leg for leg in reversed(legs) if leg.pick != task.pick}
        if not free or any(named(name).n_free <= kept[name] for name in others):
            if legs:
                kept.update((task.pick, *others))
                cause = f"not every one of {', '.join((task.pick, *sorted(others)))} has a free slot for its order"
            elif self._reasons.present(task) is TaskReason.WAITS_FOR_SLOT:
                return False  # as most tasks of a long backlog have been told before
            else:
                cause = f"no slot of {' and '.join(task.delivery.picks)} is free"
            self._reasons.note(task, TaskReason.WAITS_FOR_SLOT, cause, now_s)
            return False
        # The cheapest source; of equal ones, the first that was named.
        task.pick = free[0] if len(free) == 1 else min(free, key=lambda name: self._source_cost(name, task))
        for leg in (task, *others.values()):
            leg.pick_slot = named(leg.pick).take_slot(leg.index)
        return True

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        """Note what has to be looked at in the next round."""
        del now_s
        if task.visit is None and task.state is TaskState.BACKLOG:
            self._order_of[task.index] = len(self._order_of)
            self._news.append(task)
            for name in task.delivery.picks:
                self._waiting[name][task.index] = task
            if self._board.legs_after(task):
                self._several[task.index] = task
        elif task.visit is None and before is TaskState.BACKLOG:
            for name in task.delivery.picks:
                self._waiting[name].pop(task.index, None)
            self._several.pop(task.index, None)
        # Whoever waited for it may begin, or never will.
        for other in self._after.get(task.order.name, ()):
            if other.visit is None and other.state is TaskState.BACKLOG:
                self._news.append(other)


class _Turns:
    """Tasks in turn; others may be added meanwhile, as far as their turn has not gone by."""

    def __init__(self, turn_of: Callable[[Task], tuple[int, float, int]]) -> None:
        self._turn_of = turn_of
        self._heap: list[tuple[tuple[int, float, int], Task]] = []
        self._known: set[int] = set()
        self._last: tuple[int, float, int] | None = None

    def add(self, tasks: Iterable[Task]) -> None:
        """Add tasks; those that are known, or whose turn has gone by, are left out."""
        for task in tasks:
            if task.index in self._known:
                continue
            turn = self._turn_of(task)
            if self._last is None or turn > self._last:
                self._known.add(task.index)
                heapq.heappush(self._heap, (turn, task))

    def next(self) -> Task | None:
        """The next one; None when all had their turn."""
        if not self._heap:
            return None
        self._last, task = heapq.heappop(self._heap)
        return task
