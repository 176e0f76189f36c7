"""OpenDeliveries: deliveries that are ready, station by station, the most urgent first."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.open_deliveries import OpenDeliveries
from fleet.tasks.order import Delivery, Order, Priority, Visit


def order(name: str, pick: str = "pick_1", drop: str = "drop_1", **own: Any) -> Delivery:
    facts: dict[str, Any] = {"release_s": 0.0, "mass_kg": 0.2, "size_m": (0.05, 0.05, 0.05)} | own
    return Delivery(name=name, pick=pick, drop=drop, **facts)


class Open:
    """Deliveries whose kind is where they go; all are ready."""

    def __init__(self, *orders: Order, until_s: float = 99.0) -> None:
        self.board = TaskBoard(orders)
        self.open = OpenDeliveries(self.board, lambda task: task.delivery.drop)
        for task in self.board.tasks:
            if task.order.release_s <= until_s:
                self.board.release_due(task.order.release_s)
                self.move(task.order.name, TaskState.READY)

    def move(self, name: str, state: TaskState) -> None:
        self.board.move(self.board.named(name), state, 50.0, "by hand")

    def names(self, pick: str = "pick_1", without: str = "") -> str:
        """Names of what can begin at a station; those to one drop station may not go."""
        urgent = self.open.urgent(pick, lambda task: task.delivery.drop != without)
        return "".join(task.order.name for task in urgent)


def test_the_class_decides_and_then_the_age() -> None:
    found = Open(
        order("a", priority=Priority.IDLE),
        order("b", drop="drop_2"),
        order("c", release_s=1.0),
        order("d", drop="drop_2", release_s=2.0, priority=Priority.EMERGENCY),
        order("e", drop="drop_2", release_s=3.0),
    )
    assert found.names() == "dbcea"


def test_of_equal_age_the_first_ordered_comes_first() -> None:
    assert Open(order("a"), order("b", drop="drop_2"), order("c")).names() == "abc"


def test_age_counts_from_the_release_also_for_what_was_taken_back() -> None:
    found = Open(order("a"), order("b", release_s=1.0))
    found.move("a", TaskState.ASSIGNED)
    assert found.names() == "b"
    found.move("a", TaskState.READY)
    assert found.names() == "ab"


def test_a_kind_that_may_not_go_keeps_back_nobody_else() -> None:
    found = Open(*(order(name) for name in "abcdef"), order("g", drop="drop_2"))
    assert found.names(without="drop_1") == "ag"  # only the most urgent of them is told


def test_each_kind_is_asked_for_once_with_its_most_urgent_task() -> None:
    found = Open(*(order(name, drop=f"drop_{1 + k % 2}", release_s=float(k)) for k, name in enumerate("abcd")))
    asked: list[str] = []

    def may_go(task: Task) -> bool:
        asked.append(task.order.name)
        return True

    assert len(list(found.open.urgent("pick_1", may_go))) == 4
    assert asked == ["a", "b"]


def test_what_is_due_first_and_the_oldest_take_turns() -> None:
    found = Open(
        *(order(name, release_s=float(k)) for k, name in enumerate("abc")),
        order("d", release_s=4.0, due_s=90.0),
        order("e", release_s=5.0, due_s=60.0),
        order("f", release_s=6.0, due_s=70.0),
    )
    assert found.names() == "eafbdc"


def test_what_is_due_first_and_is_the_oldest_comes_once() -> None:
    assert Open(order("a", due_s=60.0), order("b", due_s=70.0), order("c")).names() == "abc"


def test_what_is_due_counts_as_old_as_the_oldest_of_its_kind_against_others() -> None:
    found = Open(
        order("a"),
        order("b", drop="drop_2", release_s=1.0),
        order("c", release_s=2.0, due_s=60.0),
        order("d", "pick_2"),
    )
    assert found.names() == "cab"


def test_the_class_comes_before_what_is_due() -> None:
    urgent = [order(name, priority=Priority.EMERGENCY) for name in "bc"]
    assert Open(order("a", due_s=60.0, priority=Priority.IDLE), *urgent).names() == "bca"


def test_a_task_of_several_sources_is_told_at_each_and_one_with_a_slot_only_there() -> None:
    found = Open(order("a", picks=("pick_1", "pick_2")), order("b", "pick_2"), order("c"))
    assert (found.names("pick_1"), found.names("pick_2"), found.names("pick_3")) == ("ac", "ab", "")
    found.board.named("a").pick, found.board.named("a").pick_slot = "pick_2", 0
    assert (found.names("pick_1"), found.names("pick_2")) == ("c", "ab")


@pytest.mark.parametrize("state", [TaskState.ASSIGNED, TaskState.FAILED, TaskState.CANCELLED])
def test_who_is_no_longer_ready_goes_everywhere(state: TaskState) -> None:
    picks = ("pick_1", "pick_2")
    found = Open(order("a", picks=picks, due_s=60.0), order("b", picks=picks, due_s=61.0), order("c", picks=picks))
    assert found.open.n_changes == 3
    found.move("a", state)
    assert (found.names("pick_1"), found.names("pick_2"), found.open.n_changes) == ("bc", "bc", 4)
    for name in "bc":
        found.move(name, state)
    assert (found.names("pick_1"), found.names("pick_2"), found.open.n_changes) == ("", "", 6)


def test_visits_and_what_is_not_ready_are_not_told() -> None:
    found = Open(order("a"), Visit(name="v", errands=(("pick_1",),), release_s=0.0, kind="patrol"))
    assert (found.names(), found.open.n_changes) == ("a", 1)
    waits = Open(order("a", release_s=5.0), until_s=1.0)
    waits.board.release_due(9.0)
    assert (waits.names(), waits.open.n_changes) == ("", 0)


@pytest.mark.parametrize("seed", range(20))
def test_without_due_dates_all_are_sorted_whatever_came_and_went(seed: int) -> None:
    rng = np.random.default_rng(seed)
    orders = [
        order(
            f"o{k}", f"pick_{rng.integers(1, 3)}", f"drop_{rng.integers(1, 4)}", release_s=float(k // 3),
            priority=Priority(rng.choice(list(Priority))),
        )
        for k in range(20)
    ]  # fmt: skip
    found = Open(*orders)
    for _ in range(30):
        task = found.board.tasks[int(rng.integers(20))]
        found.move(task.order.name, TaskState.ASSIGNED if task.state is TaskState.READY else TaskState.READY)
    for pick in ("pick_1", "pick_2"):
        ready = [task for task in found.board.in_state(TaskState.READY) if task.pick == pick]
        expected = sorted(ready, key=lambda task: (task.order.priority.rank, task.order.release_s, task.index))
        assert list(found.open.urgent(pick)) == expected
