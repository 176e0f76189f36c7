"""Missions: phases, tasks and bookings change together."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.phases import CarPhase
from fleet.missions.state import NOBODY
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import Floor, delivery, visit

DROP_1, CHARGER_1 = 2, 4
"""Numbers of places: four stations come first."""


def test_a_floor_at_the_start_has_idle_cars_without_faults() -> None:
    missions = Floor(n_cars=3).missions
    assert missions.n_cars == 3
    assert missions.phase == [CarPhase.IDLE] * 3
    assert missions.served.tolist() == [NOBODY] * 4
    assert missions.parked().tolist() == [0, 1, 2]
    assert missions.faults() == []


def test_arrays_follow_the_phase_of_a_car() -> None:
    floor = Floor(orders=[delivery("a", mass_kg=1.5)])
    floor.carried("a", car=1)
    missions = floor.missions
    assert missions.cars_in(CarPhase.TO_DROP) == [1]
    assert missions.cars_in(CarPhase.IDLE, CarPhase.TO_DROP) == [0, 1]
    assert missions.loaded.tolist() == [0, 1]
    assert missions.load_kg.tolist() == [0.0, 1.5]
    assert missions.awake.tolist() == [False, True]
    assert missions.bound.tolist() == [False, True]
    assert missions.parked().tolist() == [0]


def test_a_car_that_is_held_with_its_parcel_is_loaded_and_parked() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.missions.hold(0, task, "drop_1 is full")
    assert floor.missions.loaded[0] == 1
    assert not floor.missions.awake[0]
    assert task.reason == "car_0 is held: drop_1 is full"
    assert floor.missions.faults() == []


def test_a_dead_car_is_not_awake_and_one_that_charges_charges() -> None:
    missions = Floor().missions
    missions.enter(0, CarPhase.DEAD)
    missions.bind(1, CHARGER_1)
    missions.enter(1, CarPhase.CHARGING)
    assert missions.awake.tolist() == [False, True]
    assert missions.charges.tolist() == [False, True]


def test_to_assign_and_to_unassign_undo_each_other() -> None:
    floor = Floor(orders=[delivery("a", "pick_2", "drop_1")])
    task, missions = floor.ready("a"), floor.missions
    missions.assign(1, task, 2.0)
    assert (missions.pick_of[1], missions.drop_of[1]) == (1, 2)
    assert missions.under_way().tolist() == [-1, 0]
    missions.changed = False
    missions.unassign(task, 3.0, "by hand")
    assert (missions.pick_of[1], missions.drop_of[1], missions.task_index[1], missions.task_state[1]) == (-1,) * 4
    assert (task.state, task.car, task.place) == (TaskState.READY, None, "")
    assert missions.changed


def test_a_phase_without_a_place_gives_up_the_booking() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.assigned("a", car=0)
    assert floor.bookings.bound(0) == (0,)
    floor.missions.enter(0, CarPhase.RECOVERING)
    assert floor.bookings.bound(0) == ()


def test_nobody_takes_the_place_of_a_car_that_still_stands_there() -> None:
    floor = Floor(n_cars=1)
    missions, bookings = floor.missions, floor.bookings
    missions.bind(0, DROP_1)
    bookings.book(0)
    floor.stand(0, floor.dock_of("drop_1"))
    missions.changed = False
    missions.leave(0)
    assert bookings.room(DROP_1) == 3  # of four
    missions.clear_left()
    assert (bookings.room(DROP_1), missions.changed) == (3, False)
    floor.stand(0, floor.state(0, 5))
    missions.clear_left()
    assert (bookings.room(DROP_1), missions.changed) == (4, True)


def test_a_car_in_a_parking_place_frees_it_at_once() -> None:
    floor = Floor(n_cars=1)
    parking_1 = CHARGER_1 + 2
    floor.missions.bind(0, parking_1)
    floor.bookings.book(0)
    floor.missions.leave(0)  # it stands there, but makes room
    assert floor.bookings.room(parking_1) == 1


@pytest.mark.parametrize(
    ("phase", "after"),
    [
        (CarPhase.TO_PICK, CarPhase.IDLE),
        (CarPhase.HELD, CarPhase.IDLE),
        (CarPhase.DEAD, CarPhase.DEAD),
        (CarPhase.RECOVERING, CarPhase.RECOVERING),
    ],
)
def test_a_car_stands_down_only_if_it_can_take_another_task(phase: CarPhase, after: CarPhase) -> None:
    floor = Floor(orders=[delivery("a")])
    floor.assigned("a", car=0)
    floor.traffic.rank[0] = 30.0
    floor.missions.enter(0, phase)
    floor.missions.stand_down(0)
    assert floor.missions.phase[0] is after
    assert floor.missions.task_of[0] is None
    assert floor.traffic.rank[0] == 0.0


def test_a_released_car_may_move_again() -> None:
    floor = Floor()
    floor.traffic.set_fixed(0, True)
    floor.missions.release(0, CarPhase.RETIRED)
    assert floor.missions.phase[0] is CarPhase.RETIRED
    assert not floor.traffic.fixed[0]


def test_a_released_car_that_recovers_goes_on_recovering() -> None:
    floor = Floor()
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.traffic.set_fixed(0, True)
    floor.missions.release(0)
    assert floor.missions.phase[0] is CarPhase.RECOVERING
    assert floor.traffic.fixed[0]


def test_a_car_is_kept_for_the_next_leg_of_its_order() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", after=("a",), same_car_as="a")])
    first = floor.carried("a", car=1)
    assert floor.task("b").state is TaskState.BACKLOG
    assert floor.missions.kept() == {}
    floor.board.move(first, TaskState.UNLOADING, 1.0, "by hand")
    floor.board.move(first, TaskState.DELIVERED, 1.0, "by hand")
    floor.missions.release(1)
    assert floor.missions.kept() == {1: floor.task("b")}
    floor.task("b").shunned.add(1)
    assert floor.missions.kept() == {}


@pytest.mark.parametrize("phase", [CarPhase.RETIRED, CarPhase.DEAD])
def test_a_leg_whose_car_is_gone_is_any_cars(phase: CarPhase) -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", after=("a",), same_car_as="a")])
    first = floor.carried("a", car=1)
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(first, state, 1.0, "by hand")
    floor.missions.release(1, phase)
    assert floor.missions.kept() == {}


def test_faults_name_a_phase_that_does_not_go_with_its_task() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.missions.enter(0, CarPhase.TO_DROP)
    assert floor.missions.faults() == ["car_0 is to_drop with a task that is assigned"]
    floor.missions.enter(0, CarPhase.TO_PICK)
    task.car = 1
    assert floor.missions.faults() == ["car_0 has a, which has car 1"]


def test_a_visit_has_no_stations() -> None:
    floor = Floor(orders=[visit("v", "parking_3")])
    floor.visiting("v", car=0)
    assert floor.missions.pick_of.tolist() == [-1, -1]
    np.testing.assert_array_equal(floor.missions.under_way(), [0, -1])
