"""Visits: cars go to places, stand there, and go on."""

from __future__ import annotations

import pytest

from fleet.config import BatteryConfig
from fleet.missions.phases import CarPhase
from fleet.missions.visits import _visit
from fleet.tasks.board import TaskState
from fleet.tasks.order import Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit

PARKING_4 = 9
"""Its number: four stations, two chargers and three parking places come first."""


def test_a_car_books_where_it_goes_before_it_sets_off() -> None:
    floor = Floor(orders=[visit("v", "parking_4")])
    task = floor.visiting("v", car=1)
    assert floor.missions.phase[1] is CarPhase.TO_PLACE
    assert task.place == "parking_4"
    assert (floor.bookings.place_of[1], floor.bookings.has(1), floor.bookings.room(PARKING_4)) == (PARKING_4, True, 0)
    assert floor.ways.goals[1] == floor.places.parking[3]
    assert floor.missions.faults() == []


def test_a_place_in_a_lane_is_not_booked() -> None:
    floor = Floor(orders=[visit("v", "2,5")])
    floor.visiting("v", car=1)
    assert floor.bookings.place_of[1] == -1
    assert floor.ways.goals[1] in floor.places.named("2,5").states


def test_of_several_places_the_nearest_with_room_is_taken() -> None:
    """From the second parking place it is 3 moves to charger_1 and 6 to charger_2."""
    floor = Floor(orders=[visit(name, ("charger_2", "charger_1")) for name in "uvw"], n_cars=3)
    floor.visiting("u", car=1)
    floor.visiting("v", car=0)
    assert [floor.task(name).place for name in "uv"] == ["charger_1", "charger_2"]
    third = floor.ready("w")
    assert not floor.visits.book(2, third)
    assert third.place == ""


def test_a_visit_goes_from_errand_to_errand_and_ends() -> None:
    floor = Floor(orders=[visit("v", "parking_4", "parking_5", stand_s=2.0)])
    task = floor.visiting("v", car=0)
    floor.visits.tick(0, 0.0)
    assert floor.missions.phase[0] is CarPhase.TO_PLACE  # has not come yet
    floor.come(0)
    floor.visits.tick(1, 1.0)
    assert (task.state, floor.missions.phase[0]) == (TaskState.VISITING, CarPhase.STANDING)
    assert floor.visits.leave_s(0) == 3.0
    assert floor.missions.faults() == []
    floor.visits.tick(2, 2.9)
    assert task.n_errands_done == 0
    floor.visits.tick(3, 3.0)
    assert (task.n_errands_done, task.place, floor.missions.phase[0]) == (1, "parking_5", CarPhase.TO_PLACE)
    assert floor.missions.faults() == []
    floor.come(0)
    floor.visits.tick(4, 4.0)
    floor.visits.tick(5, 6.0)
    assert (task.state, floor.missions.phase[0]) == (TaskState.DONE, CarPhase.IDLE)
    assert floor.visits.progress_s == 6.0
    assert floor.log.kinds() == ["visited", "visited"]
    assert floor.missions.faults() == []


def test_an_inspection_tells_where_the_car_stands() -> None:
    floor = Floor(orders=[visit("v", "parking_4", inspects=True)])
    floor.visiting("v", car=0)
    floor.come(0)
    floor.visits.tick(0, 0.0)
    x, y, yaw = floor.car_poses()[0]
    pose = {"x": round(float(x), 3), "y": round(float(y), 3), "yaw": round(float(yaw), 3)}
    assert floor.log.events == [("inspected", {"task": "v", "car": "car_0", "place": "parking_4"} | pose)]


def test_a_car_waits_while_its_next_place_is_full() -> None:
    floor = Floor(orders=[visit("u", "parking_5", stand_s=9.0), visit("v", "parking_4", "parking_5")])
    floor.visiting("u", car=1)
    task = floor.visiting("v", car=0)
    floor.come(0)
    floor.visits.tick(0, 0.0)
    assert floor.missions.phase[0] is CarPhase.HELD
    assert task.reason == "car_0 is held: parking_5 is full (car_1)"
    assert floor.missions.faults() == []
    floor.visits.call(1)
    assert floor.missions.phase[0] is CarPhase.HELD
    floor.missions.leave(1)
    floor.visits.call(2)
    assert floor.missions.phase[0] is CarPhase.TO_PLACE
    assert floor.log.events[-1] == ("called", {"car": "car_0", "task": "v", "place": "parking_5"})
    assert floor.missions.faults() == []


def test_a_car_gives_its_visit_back_if_it_has_no_way_on() -> None:
    floor = Floor(orders=[visit("v", "parking_4", "parking_5")])
    task = floor.visiting("v", car=0)
    floor.come(0)
    floor.block(floor.places.cells[PARKING_4 + 1])
    floor.visits.tick(0, 0.0)
    assert (task.state, task.n_errands_done, task.reason) == (TaskState.READY, 1, "car_0 has no way to parking_5")
    assert floor.missions.phase[0] is CarPhase.IDLE
    assert floor.missions.faults() == []


def test_a_visit_that_changed_hands_goes_on_at_the_next_errand() -> None:
    floor = Floor(orders=[visit("v", "parking_4", "parking_5")])
    task = floor.ready("v")
    task.n_errands_done = 1
    assert floor.visits.book(0, task)
    assert task.place == "parking_5"


def test_a_car_charges_until_it_is_full_if_its_visit_says_so() -> None:
    floor = Floor(orders=[visit("v", "charger_1", until_full=True)], battery_config=BatteryConfig(enabled=True))
    task = floor.visiting("v", car=0)
    floor.chargers.batteries.charge[0] = 0.5
    floor.come(0)
    floor.visits.tick(0, 0.0)
    assert floor.missions.phase[0] is CarPhase.CHARGING
    assert floor.visits.leave_s(0) is None
    assert floor.missions.faults() == []
    floor.visits.tick(1, 100.0)
    assert task.state is TaskState.VISITING
    floor.chargers.batteries.charge[0] = 0.96
    floor.visits.tick(2, 200.0)
    assert task.state is TaskState.DONE


def test_without_batteries_a_visit_to_charge_is_over_at_once() -> None:
    floor = Floor(orders=[visit("v", "charger_1", until_full=True)])
    task = floor.visiting("v", car=0)
    floor.come(0)
    floor.visits.tick(0, 0.0)
    assert task.state is TaskState.DONE


@pytest.mark.parametrize(("priority", "rank_s"), [(Priority.NORMAL, 0.0), (Priority.EMERGENCY, 60.0)])
def test_an_emergency_goes_first(priority: Priority, rank_s: float) -> None:
    floor = Floor(orders=[visit("v", "parking_4", priority=priority)])
    floor.visiting("v", car=0)
    assert floor.traffic.rank[0] == rank_s


def test_a_car_on_its_way_needs_a_way_to_its_goal_and_one_that_waits_to_its_place() -> None:
    floor = Floor(orders=[visit("v", "parking_4")])
    task = floor.visiting("v", car=0)
    assert floor.visits.has_way(0, task)
    floor.missions.hold(0, task, "by hand")
    assert floor.visits.has_way(0, task)
    floor.wall_in(0)
    assert not floor.visits.has_way(0, task)
    floor.missions.enter(0, CarPhase.TO_PLACE)
    assert not floor.visits.has_way(0, task)


def test_deliveries_are_none_of_its_business() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.assigned("a", car=0)
    floor.visits.call(0)
    floor.visits.tick(0, 0.0)
    assert floor.visits.leave_s(0) is None
    assert floor.missions.phase[0] is CarPhase.TO_PICK
    with pytest.raises(AssertionError, match="task a is no visit"):
        _visit(floor.task("a"))
