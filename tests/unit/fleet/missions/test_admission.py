"""Admission: who sets off to its station, who is held back where it is in nobody's way, and who may come near.

Cars 0 to 5 have 5, 10, 12, 8, 13 and 15 moves of 1.1 s to pick_1. Its arm begins every 10 s while cars wait.
"""

from __future__ import annotations

from typing import Any

import pytest

from fleet.missions.admission import NEAR_S
from fleet.missions.phases import CarPhase
from fleet.missions.ways import MOVE_S
from fleet.tasks.order import Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit

PICK_1 = 0
TO_PICK, HELD = CarPhase.TO_PICK, CarPhase.HELD
AT = {3: (0, 3), 5: (3, 2)}
"""Cells from which it is so many moves to pick_1."""


def ready(n: int, n_cars: int = 6, **own: Any) -> Floor:
    """A floor with `n` deliveries from pick_1, none of which has a slot."""
    floor = Floor(orders=[delivery(f"o{k}", **own) for k in range(n)], n_cars=n_cars)
    for k in range(n):
        floor.ready(f"o{k}")
    return floor


def set_off(floor: Floor, name: str, car: int) -> None:
    """A car gets a task, as the allocation does it."""
    floor.missions.assign(car, floor.task(name), 0.0)
    floor.admission.set_off(car, floor.task(name), 0, 0.0)


def hold(floor: Floor, **cars: int) -> None:
    """Cars have tasks, by name, and are held back with them."""
    for name, car in cars.items():
        floor.missions.assign(car, floor.task(name), 0.0)
        floor.admission.wait(car, floor.task(name), "by hand")


def stand_near(floor: Floor, car: int, n_moves: int) -> None:
    """A car has come near pick_1."""
    floor.stand(car, floor.state(*AT[n_moves]))
    assert floor.moves(car, "pick_1") == n_moves


def fill_slots(floor: Floor, n: int = 4) -> None:
    """So many slots of pick_1 are taken, by what cars come for: the task of a car stands for all of them."""
    for _ in range(n):
        assert floor.stations[PICK_1].take_slot(0) is not None


def fill_room(floor: Floor, *cars: int) -> None:
    """Cars have booked pick_1."""
    for car in cars:
        floor.missions.bind(car, PICK_1)
        assert floor.bookings.book(car)


def last_cause(floor: Floor) -> str:
    kind, facts = floor.log.events[-1]
    assert kind == "held"
    return str(facts["cause"])


def test_a_car_sets_off_and_books_when_it_is_near() -> None:
    floor = ready(2)
    set_off(floor, "o0", 0)
    set_off(floor, "o1", 2)  # 13.2 s are not near
    assert [floor.missions.phase[car] for car in (0, 2)] == [TO_PICK, TO_PICK]
    assert floor.bookings.booked.nonzero()[0].tolist() == [0]
    assert [task.pick_slot for task in floor.board.tasks] == [0, None]
    assert floor.ways.goals[0] == floor.dock_of("pick_1")
    assert floor.missions.faults() == []


def busy() -> Floor:
    """Cars 0, 1 and 4 are under way. The next turn of pick_1 begins at 35.5 s, and car 3 would be there in 8.8 s."""
    floor = ready(4)
    for name, car in (("o0", 0), ("o1", 1), ("o2", 4)):
        set_off(floor, name, car)
        assert floor.missions.phase[car] is TO_PICK
    return floor


def test_a_near_car_that_would_come_much_too_early_is_held() -> None:
    floor = busy()
    set_off(floor, "o3", 3)
    assert floor.missions.phase[3] is HELD
    cause = "pick_1 is busy and it would come 27 s too early"
    assert floor.log.events[-1] == ("held", {"car": "car_3", "task": "o3", "cause": cause})
    assert floor.bookings.place_of[3] == PICK_1
    assert floor.missions.faults() == []


def test_a_car_that_is_far_sets_off_however_early_it_would_come() -> None:
    floor = busy()
    set_off(floor, "o3", 2)
    assert floor.missions.phase[2] is TO_PICK
    assert not floor.bookings.has(2)


def test_a_car_that_is_held_goes_on_later_than_it_could_have_set_off() -> None:
    """Without car 4 it would come 16.7 s too early: soon enough to set off, and too soon to be called. Without car 1
    too it would come 6.7 s too early."""
    floor = busy()
    floor.missions.leave(4)
    set_off(floor, "o3", 3)
    assert floor.missions.phase[3] is TO_PICK
    floor = busy()
    set_off(floor, "o3", 3)
    floor.missions.leave(4)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[3] is HELD
    floor.missions.leave(1)
    floor.admission.call(2, 0.2)
    assert floor.missions.phase[3] is TO_PICK
    assert floor.log.events[-1] == ("called", {"car": "car_3", "task": "o3", "station": "pick_1"})
    assert floor.task("o3").reason == "car_3 may go on to pick_1"
    assert floor.bookings.has(3)


@pytest.mark.parametrize(("now_s", "phase"), [(4.1, HELD), (4.3, TO_PICK)])
def test_a_car_counts_the_service_under_way(now_s: float, phase: CarPhase) -> None:
    """The arm began at 0 s; it takes 30 s and 3 s for the change. Car 3 has 8.8 s to go and may come 20 s early."""
    floor = ready(2)
    floor.stations.time(floor.stations[PICK_1]).add(30.0)
    set_off(floor, "o0", 0)
    floor.come(0)
    floor.services.begin(floor.stations[PICK_1], 0, floor.task("o0"), 0.0)
    floor.missions.assign(3, floor.task("o1"), now_s)
    floor.admission.set_off(3, floor.task("o1"), 0, now_s)
    assert floor.missions.phase[3] is phase


def test_a_car_that_is_near_sets_off_only_with_a_slot() -> None:
    floor = ready(1)
    fill_slots(floor)
    set_off(floor, "o0", 0)
    assert floor.missions.phase[0] is HELD
    assert last_cause(floor) == "no slot of pick_1 is free for o0"
    assert not floor.bookings.has(0)


def test_a_car_that_is_far_needs_no_slot_and_no_room() -> None:
    floor = ready(1)
    fill_slots(floor)
    set_off(floor, "o0", 2)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[2] is TO_PICK


def test_a_car_that_waits_near_sets_off_with_a_booking_or_not_at_all() -> None:
    """Else it could only be turned back."""
    floor = ready(1)
    fill_slots(floor)
    hold(floor, o0=3)
    floor.log.events.clear()
    floor.admission.call(1, 0.1)
    assert (floor.missions.phase[3], floor.log.events) == (HELD, [])
    floor.stations[PICK_1].free_slot(0)
    floor.admission.call(2, 0.2)
    assert floor.missions.phase[3] is TO_PICK
    assert floor.bookings.has(3)


def test_a_car_that_comes_near_without_a_free_slot_is_held_until_there_is_one() -> None:
    floor = ready(1)
    set_off(floor, "o0", 2)
    fill_slots(floor)
    stand_near(floor, 2, 5)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[2] is HELD
    assert last_cause(floor) == "no slot of pick_1 is free for o0"
    floor.log.events.clear()
    floor.admission.call(2, 0.2)
    assert floor.log.events == []  # is told once
    floor.stations[PICK_1].free_slot(2)
    floor.admission.call(3, 0.3)
    assert (floor.missions.phase[2], floor.task("o0").pick_slot) == (TO_PICK, 2)
    assert floor.bookings.has(2)
    assert floor.log.kinds() == ["parcel_entered", "called"]


def test_a_car_that_found_its_station_full_comes_back_with_a_booking_only() -> None:
    """Wherever it waits then: it is not to be turned back twice."""
    floor = ready(1)
    set_off(floor, "o0", 2)
    fill_room(floor, 0, 1, 3, 4)
    stand_near(floor, 2, 5)
    floor.admission.call(1, 0.1)
    floor.stand(2, int(floor.places.parking[2]))
    assert floor.moves(2, "pick_1") * MOVE_S > NEAR_S
    for car in (0, 1, 3, 4):  # they have been served, and stand there still
        floor.bookings.leave(car, stands_there=True)
    floor.admission.call(2, 0.2)
    assert floor.missions.phase[2] is HELD
    floor.bookings.clear(lambda car, place: False)
    floor.admission.call(3, 0.3)
    assert floor.missions.phase[2] is TO_PICK
    assert floor.bookings.has(2)


def test_a_car_that_comes_near_a_full_station_is_held() -> None:
    floor = ready(1)
    set_off(floor, "o0", 2)
    fill_room(floor, 0, 1, 3, 4)
    stand_near(floor, 2, 5)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[2] is HELD
    assert last_cause(floor) == "pick_1 is full (car_0, car_1, car_3, car_4)"
    assert (floor.task("o0").pick_slot, floor.stations[PICK_1].n_free) == (None, 4)


def test_a_car_that_has_booked_is_not_asked_again() -> None:
    floor = ready(1)
    set_off(floor, "o0", 0)
    fill_slots(floor, 3)
    floor.log.events.clear()
    floor.admission.call(1, 0.1)
    assert (floor.missions.phase[0], floor.log.events) == (TO_PICK, [])


@pytest.mark.parametrize("what", ["slot", "room"])
def test_the_nearest_books_first(what: str) -> None:
    """Car 4 set off first, but car 2 is nearer; there is one slot, or room for one."""
    floor = ready(2)
    set_off(floor, "o0", 4)
    set_off(floor, "o1", 2)
    if what == "slot":
        fill_slots(floor, 3)
    else:
        fill_room(floor, 0, 1, 3)
        for car in (0, 1, 3):  # they have been served, and stand there still
            floor.bookings.leave(car, stands_there=True)
    stand_near(floor, 4, 5)
    stand_near(floor, 2, 3)
    floor.admission.call(1, 0.1)
    assert [floor.missions.phase[car] for car in (2, 4)] == [TO_PICK, HELD]
    assert floor.bookings.booked.nonzero()[0].tolist() == [2]
    assert [task.pick_slot is not None for task in floor.board.tasks] == [False, True]


def test_a_loaded_car_needs_room_at_its_drop_station_and_no_slot() -> None:
    floor = Floor(orders=[delivery("a", drop="drop_2")], n_cars=6)
    task = floor.carried("a", car=5)  # 5 moves to drop_2
    for _ in range(4):
        floor.stations[3].take_slot(99)
    floor.admission.set_off(5, task, 0, 0.0)
    assert floor.missions.phase[5] is CarPhase.TO_DROP
    assert floor.bookings.has(5)


def test_a_loaded_car_is_held_before_a_full_drop_station() -> None:
    floor = Floor(orders=[delivery("a", drop="drop_2")], n_cars=6)
    task = floor.carried("a", car=5)
    for car in range(4):
        floor.missions.bind(car, 3)
        floor.bookings.book(car)
        floor.bookings.leave(car, stands_there=True)
    floor.admission.set_off(5, task, 0, 0.0)
    assert floor.missions.phase[5] is HELD
    assert last_cause(floor) == "drop_2 is full (car_0, car_1, car_2, car_3)"


@pytest.mark.parametrize(
    ("priority", "loaded", "rank_s"),
    [
        (Priority.NORMAL, False, 0.0),
        (Priority.NORMAL, True, 30.0),
        (Priority.EMERGENCY, False, 60.0),
        (Priority.EMERGENCY, True, 90.0),
    ],
)
def test_loaded_cars_and_emergencies_go_first(priority: Priority, loaded: bool, rank_s: float) -> None:
    floor = Floor(orders=[delivery("a", priority=priority)])
    task = floor.carried("a", car=0) if loaded else floor.assigned("a", car=0)
    floor.missions.leave(0)
    floor.admission.set_off(0, task, 0, 0.0)
    assert floor.traffic.rank[0] == rank_s
    assert floor.missions.phase[0] is (CarPhase.TO_DROP if loaded else TO_PICK)


def test_a_car_that_must_wait_is_bound_and_held() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=1)
    floor.admission.wait(1, task, "by hand")
    assert (floor.bookings.place_of[1], floor.missions.phase[1]) == (2, HELD)
    assert floor.log.events[-1] == ("held", {"car": "car_1", "task": "a", "cause": "by hand"})


def test_visits_to_docks_and_an_empty_floor_are_none_of_its_business() -> None:
    floor = Floor(orders=[visit("v", "pick_1")])
    floor.admission.call(0, 0.0)
    task = floor.visiting("v", car=0)
    floor.missions.hold(0, task, "by hand")
    floor.missions.bind(0, PICK_1)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[0] is HELD


def test_several_are_called_at_once_the_nearest_first() -> None:
    floor = ready(2)
    hold(floor, o0=5, o1=0)
    floor.admission.call(0, 0.0)
    assert [facts["car"] for kind, facts in floor.log.events if kind == "called"] == ["car_0", "car_5"]


def test_who_is_called_takes_no_turn_of_one_that_was_bound_before_it() -> None:
    """Car 3 has its turn after 8.8 s. Car 0 could come before, but not be gone by then: it would be 13.3 s early."""
    floor = ready(2)
    hold(floor, o0=3, o1=0)
    floor.admission.call(0, 0.0)
    assert [floor.missions.phase[car] for car in (0, 3)] == [HELD, TO_PICK]
