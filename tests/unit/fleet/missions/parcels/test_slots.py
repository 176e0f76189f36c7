"""Slots: parcels enter at free slots, in turn, and as a full look at all waiting tasks would let them."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority
from fleet.tasks.reasons import TaskReason
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def slots_of(floor: Floor) -> list[tuple[str, str, int | None]]:
    """State, pick station and slot of every task."""
    return [(task.state, task.pick, task.pick_slot) for task in floor.board.tasks]


def fill(floor: Floor, now_s: float = 0.0) -> bool:
    """One tick in which orders are released and slots are filled."""
    slots = floor.slots  # listens from the begin on
    floor.release(now_s)
    return slots.tick(now_s)


def empty(floor: Floor, name: str, now_s: float = 0.0) -> None:
    """A car takes a parcel from its slot."""
    task = floor.task(name)
    for state in (TaskState.ASSIGNED, TaskState.LOADING, TaskState.CARRIED):
        floor.board.move(task, state, now_s, "by hand")
    floor.inventory.vacate(task)


def test_first_come_first_served_as_far_as_there_are_slots() -> None:
    floor = Floor(orders=[delivery(f"o{k}") for k in range(5)])
    assert fill(floor)
    assert [task.pick_slot for task in floor.board.tasks] == [0, 1, 2, 3, None]
    assert floor.reasons.present(floor.task("o4")) is TaskReason.WAITS_FOR_SLOT
    assert floor.reasons.report(floor.task("o4")).cause == "no slot of pick_1 is free"
    assert not fill(floor, 1.0)
    empty(floor, "o2")
    assert fill(floor, 2.0)
    assert floor.task("o4").pick_slot == 2


def test_the_most_urgent_class_comes_first() -> None:
    urgent = [Priority.IDLE, *[Priority.NORMAL] * 4, Priority.EMERGENCY]
    floor = Floor(orders=[delivery(f"o{k}", priority=priority) for k, priority in enumerate(urgent)])
    fill(floor)
    assert [task.pick_slot for task in floor.board.tasks] == [None, 1, 2, 3, None, 0]


def test_within_a_class_what_is_planned_first_comes_first() -> None:
    floor = Floor(orders=[delivery(f"o{k}") for k in range(5)])
    floor.filling._turn_s[4] = 3.0
    fill(floor)
    assert [task.pick_slot for task in floor.board.tasks] == [1, 2, 3, None, 0]


def test_of_several_stations_the_cheapest_is_taken() -> None:
    """Cars stand nearer to pick_1, from where it is 11 moves to drop_1 and 14 to drop_2."""
    both = {"picks": ("pick_2", "pick_1")}
    floor = Floor(orders=[delivery("a", "pick_2", "drop_1", **both), delivery("b", "pick_2", "drop_2", **both)])
    fill(floor)
    # a: 5 + 11 from pick_1, 7 + 14 from pick_2; b: 5 + 14 and 7 + 11.
    assert [task.pick for task in floor.board.tasks] == ["pick_1", "pick_2"]


def test_of_several_stations_only_those_with_a_free_slot_count() -> None:
    floor = Floor(orders=[delivery("a", picks=("pick_1", "pick_2"))])
    for _ in range(4):
        floor.stations[0].take_slot(99)
    fill(floor)
    assert floor.task("a").pick == "pick_2"


def test_a_task_waits_for_those_before_it() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", after=("a",))])
    fill(floor)
    assert floor.task("b").state is TaskState.BACKLOG
    assert floor.reasons.present(floor.task("b")) is TaskReason.WAITS_FOR_PREDECESSOR
    empty(floor, "a")
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(floor.task("a"), state, 1.0, "by hand")
    assert fill(floor, 1.0)
    assert floor.task("b").state is TaskState.READY


def test_a_task_fails_with_the_one_before_it_and_gives_back_its_slot() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_2", after=("a",), same_car_as="a"), delivery("c")])
    fill(floor)
    assert floor.task("b").pick_slot == 0
    floor.board.move(floor.task("a"), TaskState.FAILED, 1.0, "by hand")
    assert not fill(floor, 1.0)
    assert floor.task("b").state is TaskState.FAILED
    assert floor.stations[1].n_free == 4


def test_the_slot_of_a_task_that_fails_goes_to_the_next_at_once() -> None:
    orders = [delivery("a"), delivery("b", "pick_2", after=("a",), same_car_as="a")]
    floor = Floor(orders=[*orders, *(delivery(f"o{k}", "pick_2") for k in range(4))])
    fill(floor)
    assert floor.task("o3").state is TaskState.BACKLOG
    floor.board.move(floor.task("a"), TaskState.FAILED, 1.0, "by hand")
    assert fill(floor, 1.0)
    assert floor.task("o3").pick_slot == 0


def test_an_order_of_several_legs_begins_with_a_slot_of_each_station_and_slots_are_kept_for_it() -> None:
    orders = [delivery("a"), delivery("b", "pick_2", after=("a",), same_car_as="a"), delivery("c"), delivery("d")]
    floor = Floor(orders=orders)
    for _ in range(4):
        floor.stations[1].take_slot(99)
    for _ in range(2):
        floor.stations[0].take_slot(99)
    fill(floor)
    # One of the two free slots of pick_1 is kept for the order that waits for pick_2.
    assert [task.pick_slot for task in floor.board.tasks] == [None, None, 2, None]
    cause = "not every one of pick_1, pick_2 has a free slot for its order"
    assert floor.reasons.report(floor.task("a")).cause == cause
    fill(floor, 0.5)  # what a round has changed is counted in the next
    floor.stations[1].free_slot(1)
    fill(floor, 1.0)
    assert [task.pick_slot for task in floor.board.tasks] == [3, 1, 2, None]


def test_visits_need_no_slot() -> None:
    floor = Floor(orders=[visit("v", "parking_4")])
    assert not fill(floor)


def fill_naively(floor: Floor, now_s: float) -> None:
    """What `Slots._fill` says it does, with a look at all released deliveries and nothing remembered."""
    floor.inventory.collect(now_s)
    board, named = floor.board, floor.stations.named
    released = [task for task in board.tasks if task.visit is None and task.state is TaskState.BACKLOG]
    kept: Counter[str] = Counter()
    for task in sorted(released, key=lambda task: (task.order.priority.rank, task.index)):
        if task.state is not TaskState.BACKLOG:
            continue
        before = [board.named(name).state for name in task.order.after]
        if any(state in (TaskState.FAILED, TaskState.CANCELLED) for state in before):
            board.move(task, TaskState.FAILED, now_s, "naively")
            if task.pick_slot is not None:
                named(task.pick).free_slot(task.pick_slot)
            continue
        if any(state not in (TaskState.DELIVERED, TaskState.COLLECTED, TaskState.DONE) for state in before):
            continue
        if task.pick_slot is None:
            legs = board.legs_after(task)
            others = {leg.pick for leg in legs} - {task.pick}
            free = [name for name in task.delivery.picks if named(name).n_free > kept[name]]
            if not free or any(named(name).n_free <= kept[name] for name in others):
                if legs:
                    kept.update([task.pick, *others])
                continue
            costs = [(floor.cost_model.source_cost(name, task), k) for k, name in enumerate(free)]
            task.pick = free[min(costs)[1]]
            task.pick_slot = named(task.pick).take_slot(task.index)
            for name in others:
                first = next(leg for leg in legs if leg.pick == name)
                first.pick_slot = named(name).take_slot(first.index)
        floor.inventory.enter(task, now_s)


def story_orders(rng: np.random.Generator) -> list[Any]:
    """Twenty deliveries: of any class, from one or two stations, some after others, some with the car of another."""
    orders: list[Any] = []
    followed: set[str] = set()
    for k in range(20):
        pick = str(rng.choice(["pick_1", "pick_2"]))
        own: dict[str, Any] = {"priority": Priority(rng.choice(list(Priority))), "release_s": float(k // 4)}
        chance = rng.random()
        free = [order.name for order in orders if order.name not in followed]
        if chance < 0.25 and free:
            own["after"] = (str(rng.choice(free)),)
            own["same_car_as"] = own["after"][0]
            followed.add(own["after"][0])
        elif chance < 0.4 and orders:
            own["after"] = tuple({str(rng.choice([order.name for order in orders])) for _ in range(2)})
        elif chance < 0.7:
            own["picks"] = (pick, "pick_2" if pick == "pick_1" else "pick_1")
        orders.append(delivery(f"o{k}", pick, str(rng.choice(["drop_1", "drop_2"])), **own))
    return orders


def go_on(task: Task, floor: Floor, end: TaskState, now_s: float) -> None:
    """A task that is ready comes to an end."""
    if end is TaskState.CANCELLED:
        floor.inventory.withdraw(task, now_s, "by hand")
        return
    if task.state is TaskState.READY:
        empty(floor, task.order.name, now_s)
        if end is TaskState.FAILED:
            floor.board.move(task, end, now_s, "by hand")
        return
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(task, state, now_s, "by hand")


@pytest.mark.parametrize("seed", range(25))
def test_slots_are_filled_as_by_a_full_look_at_all_tasks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    orders = story_orders(rng)
    floor, naive = Floor(orders=orders), Floor(orders=orders)
    for tick in range(60):
        now_s = 0.5 * tick
        # Twice, because what a round has changed is only counted in the next: who empties a slot then is seen.
        for _ in range(2):
            fill(floor, now_s)
            naive.release(now_s)
            fill_naively(naive, now_s)
        assert slots_of(floor) == slots_of(naive)
        for task in floor.board.in_state(TaskState.READY, TaskState.CARRIED, TaskState.BACKLOG):
            chance = rng.random()
            waits = task.state is TaskState.BACKLOG
            if chance > (0.03 if waits else 0.2):
                continue
            end = (
                TaskState.CANCELLED if waits or chance < 0.03 else TaskState.FAILED if chance < 0.05 else TaskState.DONE
            )
            if end is TaskState.CANCELLED and task.state is TaskState.CARRIED:
                continue
            for each in (floor, naive):
                go_on(each.board.tasks[task.index], each, end, now_s)
    assert floor.board.count(TaskState.ORDERED) == 0
    assert floor.inventory.n_entered > 10
