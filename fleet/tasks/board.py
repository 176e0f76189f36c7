"""TaskBoard: the life cycle of every task, each transition recorded with its cause."""

from __future__ import annotations

import difflib
import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

from fleet.errors import FleetError
from fleet.tasks.order import Delivery, Order, Visit


class TaskState(StrEnum):
    """Where a delivery or a visit stands."""

    ORDERED = "ordered"
    """Known to the generator or file, not yet released."""
    BACKLOG = "backlog"
    """Released; waits for those before it."""
    READY = "ready"
    """A car can be given it. The parcel of a delivery may lie on a slot already; it gets one when its car is near."""
    ASSIGNED = "assigned"
    """A car drives to the pick station, or to the first place of a visit."""
    LOADING = "loading"
    """The car stands at the pick dock; the arm works."""
    CARRIED = "carried"
    """The parcel rides in the car's tray."""
    UNLOADING = "unloading"
    """The car stands at the drop dock; the arm works."""
    DELIVERED = "delivered"
    """Measured on its drop slot."""
    COLLECTED = "collected"
    """Left the warehouse."""
    VISITING = "visiting"
    """The car of a visit is at the first place, or goes on from there."""
    DONE = "done"
    """The visit has ended at its last place."""
    FAILED = "failed"
    CANCELLED = "cancelled"
    """Taken back before its parcel was picked, or before the visit had ended."""


TASK_STATES = tuple(TaskState)
NUMBER_OF_STATE = {state: number for number, state in enumerate(TASK_STATES)}
"""Index of each state in `TASK_STATES`."""
UNDER_WAY = (TaskState.ASSIGNED, TaskState.LOADING, TaskState.CARRIED, TaskState.UNLOADING, TaskState.VISITING)
"""States in which a car works on a task."""
OPEN_STATES = frozenset(TaskState) - {TaskState.COLLECTED, TaskState.DONE, TaskState.FAILED, TaskState.CANCELLED}
DONE_STATES = (TaskState.DELIVERED, TaskState.COLLECTED, TaskState.DONE)
"""States of a task that has come to a good end, though its parcel may still be on its slot."""
_NEXT: dict[TaskState, frozenset[TaskState]] = {
    TaskState.ORDERED: frozenset({TaskState.BACKLOG, TaskState.CANCELLED}),
    TaskState.BACKLOG: frozenset({TaskState.READY, TaskState.FAILED, TaskState.CANCELLED}),
    TaskState.READY: frozenset({TaskState.ASSIGNED, TaskState.FAILED, TaskState.CANCELLED}),
    TaskState.ASSIGNED: frozenset(
        {TaskState.LOADING, TaskState.VISITING, TaskState.READY, TaskState.FAILED, TaskState.CANCELLED}
    ),
    TaskState.LOADING: frozenset({TaskState.CARRIED, TaskState.READY, TaskState.FAILED}),
    TaskState.CARRIED: frozenset({TaskState.UNLOADING, TaskState.FAILED}),
    TaskState.UNLOADING: frozenset({TaskState.DELIVERED, TaskState.CARRIED, TaskState.FAILED}),
    TaskState.DELIVERED: frozenset({TaskState.COLLECTED, TaskState.FAILED}),
    TaskState.COLLECTED: frozenset(),
    TaskState.VISITING: frozenset({TaskState.DONE, TaskState.READY, TaskState.FAILED, TaskState.CANCELLED}),
    TaskState.DONE: frozenset(),
    TaskState.FAILED: frozenset(),
    TaskState.CANCELLED: frozenset(),
}
CANCELLABLE = frozenset(state for state, following in _NEXT.items() if TaskState.CANCELLED in following)
"""States in which the fleet does not have a task's parcel yet."""
_GIVEN_UP = frozenset({TaskState.FAILED, TaskState.CANCELLED})
CLOSED_STATES = (*DONE_STATES, TaskState.FAILED, TaskState.CANCELLED)
"""States in which a task has ended, one way or another."""


class IllegalTransition(FleetError):
    """A task was asked to make a step its life cycle does not have."""


class UnknownTask(FleetError):
    """No task has that name."""


class NameTaken(FleetError):
    """An order comes while the run goes on, and has the name of another one."""


@dataclass(kw_only=True)
class Task:
    """One delivery or visit in progress."""

    index: int
    """Identity in the run; also the parcel's."""
    order: Order
    state: TaskState = TaskState.ORDERED
    car: int | None = None
    pick: str = ""
    """The pick station its parcel comes from: the one that would do best at present until a car has it or it lies on a
    slot; empty for a visit."""
    place: str = ""
    """The place that the car of a visit goes to, stands at, or waits for."""
    n_errands_done: int = 0
    """Errands of a visit that have been done, by whatever car."""
    lifted: bool = False
    """Whether its car has lifted the pod of a visit: no other car can go on with it."""
    shunned: set[int] = field(default_factory=set)
    """Cars it was taken from because they did not get there, which come last."""
    pick_slot: int | None = None
    """Slot its parcel lies on; None before it has entered the warehouse."""
    drop_slot: int | None = None
    reason: str = ""
    """Cause of the last transition."""
    since_s: dict[TaskState, float] = field(default_factory=dict)
    """Time of the last entry into each state [s]."""

    def __post_init__(self) -> None:
        if isinstance(self.order, Delivery):
            self.pick = self.pick or self.order.pick

    @cached_property
    def visit(self) -> Visit | None:
        """Its order, if that is a visit."""
        return self.order if isinstance(self.order, Visit) else None

    @property
    def delivery(self) -> Delivery:
        """Its order, which must be a delivery."""
        if not isinstance(self.order, Delivery):
            raise AssertionError(f"task {self.order.name} is no delivery")
        return self.order

    @property
    def next_errand(self) -> tuple[str, ...]:
        """Places of which its car has to go to one next: a station, or what a visit names."""
        if isinstance(self.order, Visit):
            return self.order.errands[self.n_errands_done]
        return (self.delivery.drop if self.state is TaskState.CARRIED else self.pick,)

    @property
    def next_words(self) -> str:
        """The same in words."""
        if isinstance(self.order, Visit) and self.order.pod and not self.lifted:
            return self.order.pod
        names = self.next_errand
        return " or ".join(names) if len(names) <= 3 else f"one of {names[0]} to {names[-1]}"

    @property
    def done_s(self) -> float | None:
        """When it was delivered, or the visit ended [s]; None if that has not happened."""
        return self.since_s.get(TaskState.DELIVERED, self.since_s.get(TaskState.DONE))

    @property
    def parcel(self) -> int:
        """Identity of the task's parcel in the world."""
        return self.index


Listener = Callable[[Task, TaskState, float], None]


class TaskBoard:
    """All tasks of a run and their states.

    Args:
        orders: Ascending in release time.
    """

    def __init__(self, orders: Iterable[Order]) -> None:
        self.tasks = [Task(index=k, order=order) for k, order in enumerate(orders)]
        self._by_name = {task.order.name: task for task in self.tasks}
        self._unreleased = deque(self.tasks)
        self._open = len(self.tasks)
        self.n_moves = 0
        """Transitions of all tasks so far."""
        self._listeners: list[Listener] = []
        self.legs = [task for task in self.tasks if task.order.same_car_as]
        """Tasks that are kept for the car of the task before."""
        self.has_visits = any(task.visit is not None for task in self.tasks)
        """Whether any task is a visit."""
        self._by_state: dict[TaskState, dict[int, Task]] = {state: {} for state in TaskState}
        for task in self.tasks:
            self._by_state[TaskState.ORDERED][task.index] = task

    def add(self, order: Order) -> Task:
        """Take in an order whose release time has come, while the run goes on; it is released with the next ones.

        Raises:
            NameTaken: There is one of that name already.
        """
        if order.name in self._by_name:
            raise NameTaken(f"order {order.name!r} is there already; valid: a name that no order has")
        task = Task(index=len(self.tasks), order=order)
        self.tasks.append(task)
        self._by_name[order.name] = task
        self._by_state[TaskState.ORDERED][task.index] = task
        self._unreleased.appendleft(task)
        self._open += 1
        self.has_visits |= task.visit is not None
        return task

    def subscribe(self, listener: Listener) -> None:
        """Call a listener after every transition, with the task, its former state and the time [s]."""
        self._listeners.append(listener)

    @property
    def finished(self) -> bool:
        """True when no task is open any more."""
        return self._open == 0

    @property
    def n_closed(self) -> int:
        """Number of tasks that nobody has to wait for any more: done, failed or cancelled."""
        return sum(len(self._by_state[state]) for state in CLOSED_STATES)

    def named(self, name: str) -> Task:
        """The task of an order.

        Raises:
            UnknownTask: There is none.
        """
        if name not in self._by_name:
            near = difflib.get_close_matches(name, self._by_name, n=3) or list(self._by_name)[:3]
            raise UnknownTask(f"task is {name!r}; valid: the id of an order, such as {', '.join(near) or 'none'}")
        return self._by_name[name]

    def name_of(self, index: int) -> str:
        """Name of a task's order."""
        return self.tasks[index].order.name

    def waits_for(self, task: Task) -> Task | None:
        """An order before this one that is not done yet; one that never will be goes first."""
        first = [self._by_name[name] for name in task.order.after if name in self._by_name]
        missing = [other for other in first if other.state not in DONE_STATES]
        return min(missing, key=lambda other: other.state not in _GIVEN_UP, default=None)

    def in_state(self, *states: TaskState) -> list[Task]:
        """Tasks in any of the given states, in the order they entered them."""
        return [task for state in states for task in self._by_state[state].values()]

    def longer_than(
        self, limit_s: float, now_s: float, state: TaskState, *, since: TaskState | None = None
    ) -> list[Task]:
        """Tasks that have been in a state, or by default since they entered another, for longer than a limit.

        Args:
            limit_s: The limit [s]; inf = none is.
            now_s: Simulated time [s].
            state: The state they are in.
            since: The state whose last entry counts; None = the same.
        """
        if limit_s == math.inf:
            return []
        begin = since or state
        return [task for task in self._by_state[state].values() if now_s - task.since_s[begin] > limit_s]

    def first_in(self, state: TaskState) -> Task | None:
        """The task that has been in a state longest."""
        return next(iter(self._by_state[state].values()), None)

    def count(self, state: TaskState) -> int:
        """Number of tasks in a state."""
        return len(self._by_state[state])

    def release_due(self, now_s: float) -> list[Task]:
        """Move every order whose release time has come to the backlog; returns them."""
        released = []
        while self._unreleased and self._unreleased[0].order.release_s <= now_s:
            task = self._unreleased.popleft()
            if task.state is TaskState.ORDERED:
                self.move(task, TaskState.BACKLOG, now_s, "release time reached")
                released.append(task)
        return released

    def move(self, task: Task, state: TaskState, now_s: float, reason: str) -> None:
        """Take a task to its next state.

        Args:
            task: The task.
            state: The state to enter.
            now_s: Simulated time [s].
            reason: Why, in a few words; kept with the task.

        Raises:
            IllegalTransition: The life cycle has no such step.
        """
        if state not in _NEXT[task.state]:
            valid = ", ".join(sorted(_NEXT[task.state])) or "none"
            raise IllegalTransition(f"task {task.order.name}: {task.state} -> {state}; valid next states: {valid}")
        self.n_moves += 1
        before = task.state
        del self._by_state[before][task.index]
        self._by_state[state][task.index] = task
        task.state, task.reason = state, reason
        task.since_s[state] = now_s
        if state not in OPEN_STATES:
            self._open -= 1
        for listener in self._listeners:
            listener(task, before, now_s)
