"""Docks: a car that has come is served, and what became of its parcel is judged by where it lies."""

from __future__ import annotations

import pytest

from fleet.missions.phases import CarPhase
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.tasks.board import Task, TaskState
from tests.unit.fleet.missions.floor import Floor, delivery

PICK, DROP = 0, 2
"""Arms of pick_1 and drop_1."""


def loading() -> tuple[Floor, Task]:
    """Car 0 stands at pick_1, and the arm is at work."""
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.arrive(0)
    floor.docks.tick(0, 0.0)
    return floor, task


def unloading() -> tuple[Floor, Task]:
    """Car 0 stands at drop_1 with the parcel in its tray, and the arm is at work."""
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.arrive(0)
    floor.lay_in_tray(task, 0)
    floor.docks.tick(0, 0.0)
    return floor, task


def fail_three_times(floor: Floor, arm: int, cause: str = "arm_0 missed the parcel") -> None:
    """The arm comes home without success, three times."""
    for tick in range(1, 4):
        floor.arms.reasons[arm] = cause
        floor.arms.come_home(arm)
        floor.docks.tick(tick, float(tick))


def test_a_car_that_has_come_is_served() -> None:
    floor, task = loading()
    assert floor.missions.phase[0] is CarPhase.LOADING
    assert task.state is TaskState.LOADING
    assert floor.services.under_way == [(PICK, 0)]
    assert len(floor.arms.requests) == 1
    assert floor.missions.faults() == []
    assert floor.driver.braked == {0}


@pytest.mark.parametrize("what", ["on its way", "not booked", "still moving", "arm busy"])
def test_a_car_is_not_served_before_it_can_be(what: str) -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    if what == "not booked":
        floor.come(0)
    elif what != "on its way":
        floor.arrive(0)
    if what == "still moving":
        floor.driver.moving.add(0)
    if what == "arm busy":
        floor.arms.begin(PICK)
    floor.docks.tick(0, 0.0)
    assert task.state is TaskState.ASSIGNED


def test_a_car_at_a_charger_is_not_served() -> None:
    floor = Floor()
    floor.missions.bind(0, 4)
    floor.missions.enter(0, CarPhase.TO_CHARGER)
    floor.ways.send(0, int(floor.ways.tails[0]), rank_s=0.0, stay=True, tick=0)
    floor.docks.tick(0, 0.0)
    assert floor.services.under_way == []


def test_a_car_waits_for_a_slot_at_its_drop_station() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.arrive(0)
    for _ in range(4):
        floor.stations[DROP].take_slot(99)
    floor.docks.tick(0, 0.0)
    assert task.state is TaskState.CARRIED
    floor.stations[DROP].free_slot(3)
    floor.docks.tick(1, 0.1)
    assert (task.state, task.drop_slot) == (TaskState.UNLOADING, 3)


def test_a_loaded_car_goes_on_while_the_arm_still_goes_home() -> None:
    floor, task = loading()
    floor.lay_in_tray(task, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(1, 5.0)
    assert (task.state, task.reason) == (TaskState.CARRIED, "measured in the tray of car_0")
    assert floor.missions.phase[0] is CarPhase.TO_DROP
    assert floor.ways.goals[0] == floor.dock_of("drop_1")
    assert not floor.traffic.fixed[0]
    assert not floor.driver.braked
    assert floor.stations[PICK].n_free == 4
    assert floor.services.is_served(0)  # the dock is not open yet
    floor.arms.come_home(PICK)
    floor.docks.tick(2, 6.0)
    assert floor.services.under_way == []
    assert floor.stations.time(floor.stations[PICK]).mean_s == 6.0
    assert floor.missions.faults() == []


def test_a_delivered_parcel_frees_the_car_and_is_collected_later() -> None:
    floor, task = unloading()
    floor.lay_on_slot(task, 0, "drop_1")
    floor.arms.leave_car(DROP)
    floor.docks.tick(1, 5.0)
    assert (task.state, task.reason) == (TaskState.DELIVERED, "measured on slot 0 of drop_1")
    assert floor.missions.phase[0] is CarPhase.IDLE
    assert floor.stations[DROP].next_collect_s == 10.0
    assert floor.missions.faults() == []


def test_nothing_is_judged_while_the_arm_is_over_the_car() -> None:
    floor, task = loading()
    floor.lay_in_tray(task, 0)
    floor.docks.tick(1, 5.0)
    assert task.state is TaskState.LOADING


def test_a_parcel_that_is_on_its_way_home_with_the_arm_is_judged_when_it_is_home() -> None:
    floor, task = loading()
    floor.arms.leave_car(PICK)
    floor.docks.tick(1, 5.0)
    assert task.state is TaskState.LOADING
    assert len(floor.arms.requests) == 1


def test_a_transfer_that_failed_is_repeated() -> None:
    floor, task = loading()
    floor.arms.reasons[PICK] = "arm_0 missed the parcel"
    floor.arms.come_home(PICK)
    floor.docks.tick(1, 1.0)
    assert len(floor.arms.requests) == 2
    assert floor.log.events[-1] == (
        "transfer_repeated",
        {"task": "a", "station": "pick_1", "cause": "arm_0 missed the parcel"},
    )
    assert task.state is TaskState.LOADING


def test_a_repeated_transfer_tells_where_the_parcel_lies_if_it_was_lost() -> None:
    floor, task = loading()
    floor.lay_on_floor(task)
    floor.arms.come_home(PICK)
    floor.docks.tick(1, 1.0)
    assert floor.log.events[-1][1] == {
        "task": "a",
        "station": "pick_1",
        "cause": "the parcel is not where it was set down",
        "x_m": 6.0,
        "y_m": 3.0,
        "z_m": 0.02,
    }


def test_a_task_fails_after_three_attempts_and_its_slot_stays_taken_while_the_parcel_is_there() -> None:
    floor, task = loading()
    fail_three_times(floor, PICK)
    assert task.state is TaskState.FAILED
    assert task.reason.startswith("arm_0 missed the parcel at pick_1; parcel lies at (")
    assert floor.missions.phase[0] is CarPhase.IDLE
    assert floor.stations[PICK].n_free == 3
    assert floor.services.under_way == []
    assert floor.missions.faults() == []


def test_the_slot_is_free_if_the_parcel_lies_elsewhere() -> None:
    floor, task = loading()
    floor.lay_on_floor(task)
    fail_three_times(floor, PICK)
    assert task.state is TaskState.FAILED
    assert floor.stations[PICK].n_free == 4


def test_a_car_is_retired_with_a_parcel_that_could_not_be_unloaded() -> None:
    floor, task = unloading()
    fail_three_times(floor, DROP)
    assert task.state is TaskState.FAILED
    assert floor.missions.phase[0] is CarPhase.RETIRED
    assert floor.stations[DROP].n_free == 4
    assert floor.missions.faults() == []


def test_another_car_comes_for_the_parcel_of_one_that_was_pushed_from_under_the_arm() -> None:
    floor, task = loading()
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.arms.come_home(PICK)
    floor.docks.tick(1, 1.0)
    assert (task.state, task.car) == (TaskState.READY, None)
    assert floor.missions.phase[0] is CarPhase.RECOVERING
    assert floor.missions.faults() == []


def test_a_car_that_was_pushed_from_under_the_arm_with_its_parcel_comes_back() -> None:
    floor, task = unloading()
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.arms.come_home(DROP)
    floor.docks.tick(1, 1.0)
    assert (task.state, task.car) == (TaskState.CARRIED, 0)
    assert floor.missions.faults() == []


def test_a_car_that_recovers_when_it_is_loaded_is_not_sent_on_yet() -> None:
    floor, task = loading()
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.lay_in_tray(task, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(1, 1.0)
    assert task.state is TaskState.CARRIED
    assert floor.missions.phase[0] is CarPhase.RECOVERING
    assert floor.missions.faults() == []


def test_a_parcel_in_a_dead_car_is_stranded() -> None:
    floor, task = loading()
    floor.missions.enter(0, CarPhase.DEAD)
    floor.lay_in_tray(task, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(1, 1.0)
    assert (task.state, task.reason) == (TaskState.FAILED, "parcel stranded: car_0 is dead")
    assert floor.missions.task_of[0] is None
    assert floor.missions.faults() == []


def test_a_task_that_is_given_up_gives_back_the_slot_that_waits_for_it() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    task.drop_slot = floor.stations[DROP].take_slot(task.index)
    floor.docks.give_up(task, 3.0, "by hand")
    assert (task.state, floor.stations[DROP].n_free) == (TaskState.FAILED, 4)


@pytest.mark.parametrize(("in_tray", "phase"), [(True, CarPhase.RETIRED), (False, CarPhase.IDLE)])
def test_a_car_whose_task_failed_under_the_arm_is_free_when_the_arm_is_home(in_tray: bool, phase: CarPhase) -> None:
    floor, task = loading()
    floor.board.move(task, TaskState.FAILED, 1.0, "was loading for 1 s")
    floor.docks.tick(1, 1.0)
    assert floor.missions.phase[0] is CarPhase.LOADING
    assert floor.missions.faults() == []
    if in_tray:
        floor.lay_in_tray(task, 0)
    floor.arms.come_home(PICK)
    floor.docks.tick(2, 2.0)
    assert floor.missions.phase[0] is phase
    assert floor.stations[PICK].n_free == (4 if in_tray else 3)
    assert floor.services.under_way == []
    assert floor.missions.faults() == []


def test_an_arm_that_holds_the_parcel_already_can_begin() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.arrive(0)
    floor.arms.services[PICK].state, floor.arms.services[PICK].parcel = ArmPhase.HOLDING, task.parcel
    floor.docks.tick(0, 0.0)
    assert task.state is TaskState.LOADING
