"""Backlog: tasks are released, wait for those before them, and fail with them."""

from __future__ import annotations

from typing import Any

import pytest

from fleet.tasks.backlog import Backlog
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.order import Delivery, Order, Visit
from fleet.tasks.reasons import ReasonBook, TaskReason

TO_THE_END = (TaskState.ASSIGNED, TaskState.LOADING, TaskState.CARRIED, TaskState.UNLOADING, TaskState.DELIVERED)


def order(name: str, *after: str, **own: Any) -> Delivery:
    facts: dict[str, Any] = {"release_s": 0.0, "mass_kg": 0.2, "size_m": (0.05, 0.05, 0.05)} | own
    return Delivery(name=name, pick="pick_1", drop="drop_1", after=after, **facts)


class Tasks:
    """Tasks, and what the backlog checks and says of them."""

    def __init__(self, *orders: Order) -> None:
        self.board = TaskBoard(orders)
        self.reasons = ReasonBook(lambda kind, **facts: None)
        self.checked: list[str] = []
        self.backlog = Backlog(self.board, self.reasons, self._check)

    def _check(self, task: Task) -> None:
        self.checked.append(f"{task.order.name} {task.state}")

    def states(self) -> list[TaskState]:
        return [task.state for task in self.board.tasks]

    def go(self, name: str, *states: TaskState) -> None:
        for state in states:
            self.board.move(self.board.named(name), state, 1.0, "by hand")


def test_a_task_is_ready_as_soon_as_it_is_released() -> None:
    tasks = Tasks(order("a"), order("b", release_s=5.0))
    assert tasks.backlog.release(0.0)
    assert tasks.states() == [TaskState.READY, TaskState.ORDERED]
    assert tasks.board.named("a").reason == "nothing comes before it"
    assert not tasks.backlog.release(4.9)
    assert tasks.backlog.release(5.0)
    assert tasks.states() == [TaskState.READY] * 2
    assert tasks.board.named("b").since_s[TaskState.READY] == 5.0


def test_every_task_is_checked_once_when_it_is_released() -> None:
    tasks = Tasks(order("a"), order("b", "a"), order("c", release_s=5.0))
    for now_s in (0.0, 1.0, 5.0, 6.0):
        tasks.backlog.release(now_s)
    assert tasks.checked == ["a backlog", "b backlog", "c backlog"]


def test_a_task_waits_until_all_before_it_are_delivered() -> None:
    tasks = Tasks(order("a"), order("b"), order("c", "a", "b"))
    tasks.backlog.release(0.0)
    task = tasks.board.named("c")
    report = tasks.reasons.report(task)
    assert (report.reason, report.cause) == (TaskReason.WAITS_FOR_PREDECESSOR, "a must be delivered before it")
    tasks.go("a", *TO_THE_END)
    assert not tasks.backlog.release(1.0)
    assert (task.state, tasks.reasons.report(task).cause) == (TaskState.BACKLOG, "b must be delivered before it")
    tasks.go("b", *TO_THE_END[:-1])
    assert not tasks.backlog.release(2.0)
    tasks.go("b", TO_THE_END[-1])
    assert tasks.backlog.release(3.0)
    assert task.state is TaskState.READY


def test_a_visit_must_be_done() -> None:
    tasks = Tasks(Visit(name="v", errands=(("parking_1",),), release_s=0.0, kind="patrol"), order("a", "v"))
    assert tasks.backlog.release(0.0)
    assert tasks.states() == [TaskState.READY, TaskState.BACKLOG]
    assert tasks.reasons.report(tasks.board.named("a")).cause == "v must be done before it"
    tasks.go("v", TaskState.ASSIGNED, TaskState.VISITING, TaskState.DONE)
    assert tasks.backlog.release(1.0)
    assert tasks.states()[1] is TaskState.READY


def test_a_task_that_is_released_after_its_predecessor_has_ended_is_ready_at_once() -> None:
    tasks = Tasks(order("a"), order("b", "a", release_s=5.0))
    tasks.backlog.release(0.0)
    tasks.go("a", *TO_THE_END, TaskState.COLLECTED)
    assert not tasks.backlog.release(1.0)
    assert tasks.backlog.release(5.0)


@pytest.mark.parametrize("end", [TaskState.FAILED, TaskState.CANCELLED])
def test_those_that_follow_fail_with_the_one_before_in_the_same_call(end: TaskState) -> None:
    tasks = Tasks(order("a"), order("b", "a"), order("c", "b"), order("d", "x", "c"), order("x"))
    tasks.backlog.release(0.0)
    tasks.go("a", end)
    assert not tasks.backlog.release(1.0)
    assert tasks.states() == [end, *[TaskState.FAILED] * 3, TaskState.READY]
    assert tasks.board.named("b").reason == f"a, which comes before it, is {end}"
    assert tasks.board.named("d").reason == "c, which comes before it, is failed"


def test_what_is_released_after_the_one_before_has_failed_fails() -> None:
    tasks = Tasks(order("a"), order("b", "a", release_s=5.0))
    tasks.backlog.release(0.0)
    tasks.go("a", TaskState.FAILED)
    tasks.backlog.release(5.0)
    assert tasks.states() == [TaskState.FAILED] * 2


def test_what_was_cancelled_before_its_turn_stays_so() -> None:
    tasks = Tasks(order("a"), order("b", "a"))
    tasks.backlog.release(0.0)
    tasks.go("b", TaskState.CANCELLED)
    tasks.go("a", *TO_THE_END)
    assert not tasks.backlog.release(1.0)
    assert tasks.states()[1] is TaskState.CANCELLED


def test_a_task_that_is_ready_no_longer_waits_for_its_predecessor() -> None:
    tasks = Tasks(order("a"), order("b", "a"))
    tasks.backlog.release(0.0)
    tasks.go("a", *TO_THE_END)
    tasks.backlog.release(1.0)
    assert tasks.reasons.report(tasks.board.named("b")).reason is not TaskReason.WAITS_FOR_PREDECESSOR
