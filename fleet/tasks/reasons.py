"""Reasons: why a task has the car it has, or none, and why each car that was considered did not get it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fleet.tasks.board import UNDER_WAY, Task, TaskState


class PairReason(StrEnum):
    """What became of a car for a task."""

    CHOSEN = "chosen"
    CAR_BUSY = "car_busy"
    """It has a parcel in its tray, or an arm is at work on it."""
    CAR_OUT = "car_out"
    """Dead, off its lane, or with a parcel that nobody can unload."""
    CAR_CHARGES = "car_charges"
    """It charges, or is about to."""
    LOW_CHARGE = "low_charge"
    """After the task it might not reach a charger."""
    TOO_HEAVY = "too_heavy"
    LACKS_CAPABILITY = "lacks_capability"
    NO_WAY = "no_way"
    """It cannot reach the pick station, or the place to visit, past what is blocked."""
    SHUNNED = "shunned"
    """The task was taken from it because it did not get there."""
    OTHER_CAR = "other_car"
    """The car that did the leg before is to do this one too."""
    KEPT_FOR_LEG = "kept_for_leg"
    """It is kept for the next leg of its order."""
    CLASS_FIRST = "class_first"
    """It was given a task of a more urgent class."""
    CAR_GOT_BETTER = "car_got_better"
    """It was given another task, which costs it less."""
    TASK_GOT_BETTER = "task_got_better"
    """Another car was given the task, which costs that one less."""
    BETTER_FOR_ALL = "better_for_all"
    """It would cost this car less, but then others would pay more, or have nothing to do."""
    KEPT = "kept"
    """Too little would be gained for what is under way to change hands."""
    PLANNED_LATER = "planned_later"
    """It is to take the task after its next one."""
    NOT_OFFERED = "not_offered"
    """The visit has to wait for room at its place."""
    LEFT_OVER = "left_over"
    """Nothing forbids it, and the allocator took neither: it is not exact, or gave up."""
    NOT_ASKED = "not_asked"
    """More cars could take tasks than are asked in a round, and others were."""


class TaskReason(StrEnum):
    """Why a task is where it is."""

    NOT_RELEASED = "not_released"
    WAITS_FOR_PREDECESSOR = "waits_for_predecessor"
    STATION_FULL = "station_full"
    """As many cars as it has room for are bound for the place to visit."""
    UNREACHABLE = "unreachable"
    NO_CAPABLE_CAR = "no_capable_car"
    """Every car that could carry it is out of service."""
    PLANNED = "planned"
    """A car that is busy is to take it when it is free."""
    CARS_CHARGE = "cars_charge"
    """Every car that could take it has to charge before."""
    WAITS_FOR_ITS_CAR = "waits_for_its_car"
    """The car that did the leg before cannot go on at present."""
    NO_FREE_CAR = "no_free_car"
    """Every car that could take it has another task."""
    LEFT_OVER = "left_over"
    """There is a free car for it, and the allocator took neither."""
    ASSIGNED = "assigned"
    ENDED = "ended"


@dataclass(frozen=True, kw_only=True)
class PairVerdict:
    """What became of one car for a task, when it was last decided."""

    car: int
    reason: PairReason
    cost_s: float | None
    """Travel, lateness and ageing as the allocator saw them [s]; None = was not allowed."""
    detail: str

    def __str__(self) -> str:
        cost = "" if self.cost_s is None else f", cost {self.cost_s:.1f} s"
        return f"car_{self.car} {self.detail}{cost}"


@dataclass(frozen=True, kw_only=True)
class AssignmentReport:
    """Who got a task, who did not, and why; its `str` says it in a sentence."""

    task: str
    state: TaskState
    car: int | None
    """The car that has, or had, the task."""
    reason: TaskReason
    cause: str
    """The reason in words."""
    since_s: float
    """Since when this is the reason [s]."""
    warning: str
    """Why it cannot be delivered in time, whoever takes it; empty if it can."""
    decided_s: float | None
    """When the allocator last considered the task [s]; None = never."""
    pairs: tuple[PairVerdict, ...]
    """One for each car, as it was then; empty if the task was never considered."""

    def __str__(self) -> str:
        words = [f"{self.task} has been {self.state} since {self.since_s:.1f} s: {self.cause}"]
        if self.warning:
            words.append(self.warning)
        if self.pairs:
            words.append(f"at {self.decided_s:.1f} s: " + ", ".join(map(str, self.pairs)))
        return "; ".join(words)


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """How an allocation judged the cars for one task."""

    time_s: float
    codes: npt.NDArray[np.int8]
    """Index into `PAIR_REASONS` for each car, shape (n_cars,)."""
    cars: npt.NDArray[np.intp]
    """Cars that could take a task at all, ascending, shape (n_able,)."""
    cost_s: npt.NDArray[np.float64]
    """Cost of each of these, inf = not allowed, shape (n_able,)."""
    took: npt.NDArray[np.int64]
    """Task that each car has after the allocation, -1 = none, shape (n_cars,)."""
    name_of: Callable[[int], str]
    """Names a task."""
    taker: int
    """The car that got the task, -1 = none."""

    def pairs(self) -> tuple[PairVerdict, ...]:
        """The verdict on each car."""
        found = []
        cost_of = dict(zip(self.cars.tolist(), self.cost_s.tolist(), strict=True))
        for car, code in enumerate(self.codes.tolist()):
            reason, cost_s = PAIR_REASONS[code], cost_of.get(car, math.inf)
            took = self.name_of(int(self.took[car])) if self.took[car] >= 0 else ""
            detail = _DETAILS[reason].format(took=took, taker=self.taker)
            cost = cost_s if math.isfinite(cost_s) else None
            found.append(PairVerdict(car=car, reason=reason, cost_s=cost, detail=detail))
        return tuple(found)


class DecisionRound(Protocol):
    """One look of the allocator at several tasks."""

    @property
    def tasks(self) -> Sequence[Task]:
        """The tasks that it considered."""

    def decisions(self, columns: list[int]) -> list[Decision]:
        """How the cars were judged for some of the tasks, by their places among them."""


MOST_DECISIONS = 1_000
"""How cars were judged is kept for so many tasks: a day of 400 orders an hour took 9 MB."""
_PLACE_OF = {reason: place for place, reason in enumerate(TaskReason)}
_NOT_CONSIDERED = "every car has another task, and others come before it"
PAIR_REASONS = tuple(PairReason)
CODE_OF_REASON = {reason: code for code, reason in enumerate(PAIR_REASONS)}
"""Index of each reason in `PAIR_REASONS`."""
_DETAILS = {
    PairReason.CHOSEN: "has it",
    PairReason.CAR_BUSY: "was busy with {took}",
    PairReason.CAR_OUT: "was out of service",
    PairReason.CAR_CHARGES: "had to charge",
    PairReason.LOW_CHARGE: "has too little charge for it",
    PairReason.TOO_HEAVY: "cannot carry its weight",
    PairReason.LACKS_CAPABILITY: "lacks a capability",
    PairReason.NO_WAY: "has no way there",
    PairReason.SHUNNED: "did not get there before",
    PairReason.OTHER_CAR: "did not do the leg before",
    PairReason.KEPT_FOR_LEG: "is kept for the next leg of its order",
    PairReason.CLASS_FIRST: "serves {took}, which is more urgent",
    PairReason.CAR_GOT_BETTER: "takes {took} instead, at a lower cost",
    PairReason.TASK_GOT_BETTER: "leaves it to car_{taker}, which has a lower cost",
    PairReason.BETTER_FOR_ALL: "would, but others would have to pay more",
    PairReason.KEPT: "would, but too little is gained for it to change hands",
    PairReason.PLANNED_LATER: "is to take it after {took}",
    PairReason.LEFT_OVER: "was left without a task by the allocator",
    PairReason.NOT_OFFERED: "was not asked",
    PairReason.NOT_ASKED: "will be asked in its turn",
}


class _KeptRound:
    """A round, and where each task stands in it."""

    def __init__(self, judged: DecisionRound) -> None:
        self._round = judged
        self.column_of = {task.index: column for column, task in enumerate(judged.tasks)}

    def without(self, *others: Mapping[int, object]) -> list[int]:
        """Its tasks that are in none of some others, in ascending order."""
        return sorted(self.column_of.keys() - set().union(*others))

    def judged(self, tasks: Sequence[int]) -> dict[int, Decision]:
        """How the cars were judged for some of its tasks."""
        decisions = self._round.decisions([self.column_of[index] for index in tasks])
        return dict(zip(tasks, decisions, strict=True))


class ReasonBook:
    """The present reason of every task, and the last decision about it.

    Args:
        log: Called as ``log(kind, **facts)`` when an open task waits for a reason that it had not before.
    """

    def __init__(self, log: Callable[..., None]) -> None:
        self._log = log
        self._reason: dict[int, tuple[TaskReason, str, float]] = {}
        self._kept: list[_KeptRound] = []
        """The last round, and one before it: two at most."""
        self._decision: dict[int, Decision] = {}
        """How tasks were judged that were asked about, or that are in no kept round any more, the latest last."""
        self._told: dict[int, int] = {}
        """Which reasons of each task the log was told, bit by bit."""
        self._warning: dict[int, str] = {}

    def note(self, task: Task, reason: TaskReason, cause: str, now_s: float) -> None:
        """Say why a task has no car; the log is told of each reason of a task once."""
        before = self._reason.get(task.index)
        since_s = before[2] if before is not None and before[0] is reason else now_s
        self._reason[task.index] = (reason, cause, since_s)
        told, bit = self._told.get(task.index, 0), 1 << _PLACE_OF[reason]
        if not told & bit:
            self._told[task.index] = told | bit
            self._log("task_waits", task=task.order.name, reason=str(reason), cause=cause)

    def present(self, task: Task) -> TaskReason | None:
        """Why a task has no car, if that is known."""
        known = self._reason.get(task.index)
        return known[0] if known is not None else None

    def decision(self, task: Task) -> Decision | None:
        """How the cars were judged for a task when the allocator last considered it."""
        if task.index not in self._decision:
            for kept in self._kept:
                if task.index in kept.column_of:
                    self._decision |= kept.judged([task.index])
                    break
        return self._decision.get(task.index)

    def keep(self, latest: DecisionRound) -> None:
        """Keep how the cars were judged for tasks.

        Few tasks are ever asked about, and pairs are judged when they are. So two rounds are kept whole, and of the one
        that goes only what no other tells: between two rounds of many tasks those of few come and go at little cost.
        """
        new = _KeptRound(latest)
        for index in new.column_of:
            self._decision.pop(index, None)
        if len(self._kept) == 2:
            middle, oldest = self._kept
            told = (new.column_of, self._decision)
            only_middle = middle.without(*told)
            only_oldest = oldest.without(*told, middle.column_of)
            if len(only_middle) < len(only_oldest):
                self._kept.remove(middle)
                self._decision |= middle.judged(only_middle)
            else:
                self._kept.remove(oldest)
                self._decision |= oldest.judged(only_oldest)
            # Open tasks are judged again and again: those judged longest ago have long ended.
            while len(self._decision) > max(MOST_DECISIONS, 2 * len(new.column_of)):
                del self._decision[next(iter(self._decision))]
        self._kept.insert(0, new)

    def forget(self, task: Task) -> None:
        """A task does not wait any more for what it waited for."""
        self._reason.pop(task.index, None)

    def warn(self, task: Task, text: str) -> None:
        """Say, once, that a task cannot be delivered in time."""
        if task.index not in self._warning:
            self._warning[task.index] = text
            self._log("impossible_due", task=task.order.name, cause=text)

    def report(self, task: Task) -> AssignmentReport:
        """All that is known about a task."""
        decision = self.decision(task)
        reason, cause, since_s = self._present_cause(task)
        return AssignmentReport(
            task=task.order.name,
            state=task.state,
            car=task.car,
            reason=reason,
            cause=cause,
            since_s=since_s,
            warning=self._warning.get(task.index, ""),
            decided_s=decision.time_s if decision is not None else None,
            pairs=decision.pairs() if decision is not None else (),
        )

    def _present_cause(self, task: Task) -> tuple[TaskReason, str, float]:
        since_s = task.since_s.get(task.state, 0.0)
        if task.state is TaskState.ORDERED:
            return TaskReason.NOT_RELEASED, f"will be released at {task.order.release_s:g} s", 0.0
        if task.state in (TaskState.BACKLOG, TaskState.READY):
            return self._reason.get(task.index, (TaskReason.NO_FREE_CAR, _NOT_CONSIDERED, since_s))
        ended = task.state not in UNDER_WAY
        return (TaskReason.ENDED if ended else TaskReason.ASSIGNED), task.reason, since_s
