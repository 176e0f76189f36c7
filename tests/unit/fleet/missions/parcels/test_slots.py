"""Slots: parcels get them when their cars come near, and else while more than half of the slots are free."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from fleet.tasks.order import Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def ready(*orders: Any, n_slots: int = 4, n_cars: int = 4) -> Floor:
    """All is ready, and each station has so many slots."""
    floor = Floor(orders=orders, n_cars=n_cars)
    for station in floor.stations:
        station.contents, station.n_free = [None] * n_slots, n_slots
    for order in orders:
        floor.ready(order.name)
    return floor


def many(n: int, **own: Any) -> list[Any]:
    return [delivery(f"o{k}", **own) for k in range(n)]


def on_slots(floor: Floor) -> list[str]:
    """Names of those whose parcels are there."""
    there = floor.world.parcel_ids().tolist()
    assert there == [task.index for task in floor.board.tasks if task.pick_slot is not None]
    return [floor.board.tasks[index].order.name for index in there]


def bind(floor: Floor, name: str, car: int) -> None:
    """A car has a task whose parcel has no slot yet, and is bound for where it begins."""
    floor.missions.assign(car, floor.task(name), 0.0)
    floor.missions.bind(car, floor.stations.named(floor.task(name).pick).arm)
    floor.missions.enter(car, CarPhase.TO_PICK)


def test_a_parcel_enters_on_the_first_free_slot_once() -> None:
    floor = ready(*many(2))
    assert floor.slots.take(floor.task("o1"), 3.0)
    assert floor.slots.take(floor.task("o1"), 4.0)
    assert (floor.task("o1").pick_slot, floor.stations[0].contents) == (0, [1, None, None, None])
    assert (floor.inventory.n_entered, on_slots(floor)) == (1, ["o1"])


def test_a_car_that_is_near_may_get_the_last_slot_but_no_more() -> None:
    floor = ready(*many(5), n_cars=5)
    taken = []
    for car, task in enumerate(floor.board.tasks):
        bind(floor, task.order.name, car)
        taken.append(floor.slots.take(task, 0.0))
    assert taken == [True] * 4 + [False]
    assert floor.task("o4").pick_slot is None
    assert on_slots(floor) == ["o0", "o1", "o2", "o3"]


def test_the_least_urgent_parcel_that_nobody_comes_for_makes_room() -> None:
    floor = ready(delivery("a"), delivery("b", priority=Priority.IDLE), delivery("c"), delivery("d"), delivery("e"))
    for name in "abcd":
        floor.slots.take(floor.task(name), 0.0)
    bind(floor, "e", 0)
    assert floor.slots.take(floor.task("e"), 1.0)
    assert on_slots(floor) == ["a", "c", "d", "e"]
    assert (floor.task("b").state, floor.task("b").pick_slot, floor.task("e").pick_slot) == (TaskState.READY, None, 1)
    assert (floor.inventory.balance(), floor.inventory.misplaced()) == (0, [])


def test_a_parcel_that_was_put_back_enters_again() -> None:
    floor = ready(*many(2), n_slots=1)
    assert floor.slots.take(floor.task("o0"), 0.0)
    assert floor.slots.take(floor.task("o1"), 1.0)
    assert floor.slots.take(floor.task("o0"), 2.0)
    assert on_slots(floor) == ["o0"]


def test_a_parcel_in_a_grip_makes_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    floor = ready(*many(2), n_slots=1)
    floor.slots.take(floor.task("o0"), 0.0)
    monkeypatch.setattr(floor.world, "held", lambda: np.array([floor.task("o0").parcel, -1]))
    assert not floor.slots.take(floor.task("o1"), 1.0)
    assert on_slots(floor) == ["o0"]


def test_a_parcel_that_has_fallen_makes_no_room() -> None:
    floor = ready(*many(2), n_slots=1)
    floor.slots.take(floor.task("o0"), 0.0)
    floor.world.poses[floor.task("o0").parcel][2] = 0.03
    assert not floor.slots.take(floor.task("o1"), 1.0)
    assert on_slots(floor) == ["o0"]


@pytest.mark.parametrize(
    ("phase", "booked", "makes_room"),
    [
        (CarPhase.HELD, False, True),  # it waits for its turn, and those before it for the slot that its parcel has
        (CarPhase.HELD, True, False),  # who has booked will come and leave its slot
        (CarPhase.TO_PICK, False, False),
    ],
)
def test_a_parcel_whose_car_is_held_back_makes_room_while_nobody_has_booked(
    phase: CarPhase, booked: bool, makes_room: bool
) -> None:
    floor = ready(*many(3), n_slots=1)
    floor.slots.take(floor.task("o0"), 0.0)
    for car in range(2):
        bind(floor, f"o{car}", car)
    floor.missions.enter(0, phase)
    if booked:
        assert floor.missions.bookings.book(1)
    assert floor.slots.take(floor.task("o1"), 1.0) == makes_room
    assert on_slots(floor) == (["o1"] if makes_room else ["o0"])


@pytest.mark.parametrize(("n_slots", "n_filled"), [(1, 0), (2, 1), (3, 1), (4, 2), (5, 2), (8, 4)])
def test_at_most_half_of_the_slots_are_filled_ahead(n_slots: int, n_filled: int) -> None:
    floor = ready(*many(9), n_slots=n_slots)
    for _ in range(3):
        floor.slots.fill(0.0)
    assert len(on_slots(floor)) == n_filled


def test_slots_of_cars_that_are_near_count() -> None:
    floor = ready(*many(4))
    floor.slots.take(floor.task("o3"), 0.0)
    floor.slots.fill(0.0)
    assert on_slots(floor) == ["o0", "o3"]


def test_the_most_urgent_open_task_comes_first() -> None:
    floor = ready(
        delivery("a", priority=Priority.IDLE), delivery("b"), delivery("c", priority=Priority.EMERGENCY), delivery("d")
    )
    floor.slots.fill(0.0)
    assert on_slots(floor) == ["b", "c"]


def test_who_comes_soonest_comes_before_all_that_nobody_comes_for() -> None:
    """Cars 0, 1, 2 and 3 have 5, 10, 12 and 8 moves to pick_1."""
    floor = ready(*many(4), delivery("x", priority=Priority.EMERGENCY))
    for car in range(3, -1, -1):
        bind(floor, f"o{car}", car)
    floor.slots.fill(0.0)
    assert on_slots(floor) == ["o0", "o3"]


def test_a_car_whose_parcel_is_there_needs_no_other_slot() -> None:
    floor = ready(*many(3))
    floor.slots.take(floor.task("o0"), 0.0)
    bind(floor, "o0", 0)
    floor.slots.fill(0.0)
    assert on_slots(floor) == ["o0", "o1"]


def test_cars_with_parcels_and_visits_need_no_slot_of_a_pick_station() -> None:
    floor = Floor(orders=[delivery("a"), visit("v", "pick_1"), delivery("b")], n_cars=3)
    floor.carried("a", car=0)
    floor.missions.bind(0, 0)  # as if it went back there
    floor.visiting("v", car=1)
    floor.ready("b")
    floor.slots.fill(0.0)
    assert floor.task("b").pick_slot == 0
    assert floor.stations[0].n_free == 3


def test_each_pick_station_is_filled_and_no_drop_station() -> None:
    floor = ready(*many(3), *(delivery(f"p{k}", "pick_2") for k in range(3)))
    floor.slots.fill(0.0)
    assert on_slots(floor) == ["o0", "o1", "p0", "p1"]
    assert [station.n_free for station in floor.stations] == [2, 2, 4, 4]


def test_a_task_of_several_sources_gets_a_slot_of_one() -> None:
    floor = ready(delivery("a", "pick_2", picks=("pick_2", "pick_1")), delivery("b", "pick_2"))
    floor.slots.fill(0.0)
    assert [(task.pick, task.pick_slot) for task in floor.board.tasks] == [("pick_1", 0), ("pick_2", 0)]


def test_a_slot_that_gets_free_is_filled() -> None:
    floor = ready(*many(4))
    floor.slots.fill(0.0)
    for state in (TaskState.ASSIGNED, TaskState.LOADING, TaskState.CARRIED):
        floor.board.move(floor.task("o0"), state, 0.0, "by hand")
    floor.slots.fill(1.0)
    assert floor.stations[0].contents == [0, 1, None, None]
    floor.inventory.vacate(floor.task("o0"))
    floor.slots.fill(2.0)
    assert floor.stations[0].contents == [2, 1, None, None]


def test_what_comes_later_is_filled_in() -> None:
    floor = Floor(orders=many(2))
    floor.slots.fill(0.0)
    floor.ready("o0")
    floor.slots.fill(1.0)
    bind(floor, "o0", 0)
    floor.ready("o1")
    floor.slots.fill(2.0)
    assert [task.pick_slot for task in floor.board.tasks] == [0, 1]


def test_a_car_that_is_newly_bound_is_seen() -> None:
    """Its task was given out before anybody had looked, so that only its booking tells."""
    floor = ready(*many(1))
    floor.missions.assign(0, floor.task("o0"), 0.0)
    floor.slots.fill(0.0)
    assert on_slots(floor) == []
    floor.missions.bind(0, 0)
    floor.slots.fill(1.0)
    assert on_slots(floor) == ["o0"]


def test_delivered_parcels_are_taken_out() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    task.drop_slot = floor.stations[2].take_slot(task.index)
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(task, state, 1.0, "by hand")
    floor.inventory.collect_later(floor.stations[2], 0, 1.0)
    floor.slots.collect(5.9)
    assert task.state is TaskState.DELIVERED
    floor.slots.collect(6.0)
    assert (task.state, floor.stations[2].n_free) == (TaskState.COLLECTED, 4)
