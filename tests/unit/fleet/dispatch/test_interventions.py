"""Interventions: tasks are taken back, cars leave service and come back, and what lasts too long is ended."""

from __future__ import annotations

import pytest

from fleet.config import TimeoutConfig
from fleet.dispatch.interventions import CannotCancel, CannotRequeue
from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import Floor, delivery, visit

DROP_1_PLACE = 2


def late(floor: Floor, now_s: float) -> None:
    floor.interventions.end_overdue(now_s)
    assert floor.missions.faults() == []


def test_a_task_that_nobody_has_yet_is_cancelled_with_its_parcel() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.interventions.cancel(floor.ready("a"), 1.0, "by hand")
    assert floor.task("a").state is TaskState.CANCELLED
    assert (len(floor.world.poses), floor.stations[0].n_free) == (0, 4)


def test_the_car_of_a_cancelled_task_is_free() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.interventions.cancel(floor.assigned("a", car=1), 1.0, "by hand")
    assert floor.missions.phase[1] is CarPhase.IDLE
    assert floor.bookings.bound(0) == ()
    assert floor.missions.faults() == []


def test_a_visit_can_be_cancelled_until_its_end() -> None:
    floor = Floor(orders=[visit("v", "parking_4")])
    task = floor.visiting("v", car=1)
    floor.board.move(task, TaskState.VISITING, 0.0, "by hand")
    floor.missions.enter(1, CarPhase.STANDING)
    floor.interventions.cancel(task, 1.0, "by hand")
    assert (task.state, floor.missions.phase[1]) == (TaskState.CANCELLED, CarPhase.IDLE)
    assert floor.missions.faults() == []


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ("carried", "task a is carried; valid to cancel: ordered, backlog, ready, assigned"),
        ("done", "task v is done; valid to cancel: ordered, backlog, ready, assigned, visiting"),
    ],
)
def test_it_can_be_too_late_to_cancel(state: str, message: str) -> None:
    floor = Floor(orders=[delivery("a"), visit("v", "parking_4")])
    if state == "carried":
        task = floor.carried("a", car=0)
    else:
        task = floor.visiting("v", car=0)
        for following in (TaskState.VISITING, TaskState.DONE):
            floor.board.move(task, following, 0.0, "by hand")
    with pytest.raises(CannotCancel) as caught:
        floor.interventions.cancel(task, 1.0, "by hand")
    assert str(caught.value) == message


def test_a_task_is_taken_from_its_car_which_comes_last_for_it() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=1)
    floor.interventions.requeue(task, 1.0, "by hand")
    assert (task.state, task.car, task.shunned) == (TaskState.READY, None, {1})
    assert floor.missions.phase[1] is CarPhase.IDLE
    assert floor.missions.faults() == []


@pytest.mark.parametrize("is_visit", [False, True])
def test_a_task_without_a_car_cannot_be_taken_from_one(is_visit: bool) -> None:
    floor = Floor(orders=[visit("a", "parking_4") if is_visit else delivery("a")])
    valid = "assigned, visiting" if is_visit else "assigned"
    with pytest.raises(CannotRequeue, match=f"^task a is ready; valid to requeue: {valid}$"):
        floor.interventions.requeue(floor.ready("a"), 1.0, "by hand")


def test_a_car_that_dies_on_its_way_gives_its_task_back() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.interventions.retire(0, CarPhase.DEAD, 1.0, "car_0 broke down")
    assert (task.state, task.reason) == (TaskState.READY, "car_0 broke down")
    assert floor.missions.faults() == []


def test_a_parcel_in_a_car_that_dies_is_stranded_and_one_that_recovers_keeps_it() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")])
    for car, name in enumerate("ab"):
        floor.carried(name, car)
    floor.interventions.retire(0, CarPhase.DEAD, 1.0, "car_0 broke down")
    floor.interventions.retire(1, CarPhase.RECOVERING, 1.0, "car_1 left its lane")
    assert floor.task("a").reason == "parcel stranded: car_0 broke down"
    assert floor.task("b").state is TaskState.CARRIED
    assert floor.missions.faults() == []


def test_an_idle_car_just_leaves_service() -> None:
    floor = Floor()
    floor.interventions.retire(0, CarPhase.RECOVERING, 1.0, "by hand")
    assert floor.missions.phase == [CarPhase.RECOVERING, CarPhase.IDLE]


def test_a_recovered_car_goes_on_with_its_parcel() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.carried("a", car=0)
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.interventions.resume(0, 5, 0.5)
    assert floor.missions.phase[0] is CarPhase.TO_DROP
    assert floor.bookings.bound(DROP_1_PLACE) == (0,)


@pytest.mark.parametrize(("loaded", "phase"), [(False, CarPhase.IDLE), (True, CarPhase.RETIRED)])
def test_a_recovered_car_takes_tasks_if_its_tray_is_empty(loaded: bool, phase: CarPhase) -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.ready("a")
    if loaded:
        floor.lay_in_tray(task, 0)
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.missions.changed = False
    floor.interventions.resume(0, 5, 0.5)
    assert floor.missions.phase[0] is phase
    assert floor.missions.changed


def test_what_waits_too_long_is_cancelled() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")], timeouts=TimeoutConfig(waiting_s=10.0))
    floor.ready("a")
    late(floor, 10.0)
    assert floor.board.count(TaskState.CANCELLED) == 0
    late(floor, 10.1)
    assert [task.reason for task in floor.board.tasks] == ["no car had it 10 s after its release"] * 2


def test_a_car_that_does_not_come_to_pick_loses_its_task() -> None:
    floor = Floor(orders=[delivery("a")], timeouts=TimeoutConfig(assigned_s=10.0))
    task = floor.assigned("a", car=0)
    late(floor, 10.1)
    assert (task.state, task.reason) == (TaskState.READY, "car_0 was not at pick_1 after 10 s")
    assert task.shunned == {0}


def test_a_service_that_takes_too_long_fails_and_the_car_stays_under_the_arm() -> None:
    floor = Floor(orders=[delivery("a")], timeouts=TimeoutConfig(service_s=10.0))
    task = floor.assigned("a", car=0)
    floor.arrive(0)
    floor.docks.tick(0, 0.0)
    late(floor, 10.1)
    assert (task.state, task.reason) == (TaskState.FAILED, "was loading for 10 s")
    assert floor.missions.phase[0] is CarPhase.LOADING


def test_a_visit_that_takes_too_long_fails() -> None:
    floor = Floor(orders=[visit("v", "parking_4")], timeouts=TimeoutConfig(visiting_s=10.0))
    task = floor.visiting("v", car=0)
    floor.board.move(task, TaskState.VISITING, 0.0, "by hand")
    late(floor, 10.1)
    assert (task.state, floor.missions.phase[0]) == (TaskState.FAILED, CarPhase.IDLE)


def test_a_car_that_does_not_come_to_drop_is_retired_with_its_parcel() -> None:
    floor = Floor(orders=[delivery("a")], timeouts=TimeoutConfig(carried_s=10.0))
    task = floor.carried("a", car=0)
    late(floor, 10.1)
    assert (task.state, task.reason) == (TaskState.FAILED, "car_0 was not at drop_1 after 10 s")
    assert floor.missions.phase[0] is CarPhase.RETIRED


def test_nothing_is_taken_back_while_nothing_is_blocked() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.assigned("a", car=0)
    floor.interventions.take_back(1.0)
    assert floor.task("a").state is TaskState.ASSIGNED


def test_a_car_without_a_way_to_pick_gives_its_task_back_and_one_with_a_way_does_not() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")])
    for car, name in enumerate("ab"):
        floor.assigned(name, car)
    floor.wall_in(0)
    floor.interventions.take_back(1.0)
    assert [floor.task(name).state for name in "ab"] == [TaskState.READY, TaskState.ASSIGNED]
    assert floor.task("a").reason == "car_0 has no way to pick_1"
    assert floor.missions.faults() == []


def test_a_car_with_a_parcel_waits_until_it_is_known_that_there_will_be_no_way() -> None:
    floor = Floor(orders=[delivery("a")], n_cars=2)
    task = floor.carried("a", car=0)
    floor.block(floor.places.cells[DROP_1_PLACE])
    floor.interventions.take_back(1.0)
    assert task.state is TaskState.CARRIED
    floor.traffic.set_blocked(floor.places.cells[DROP_1_PLACE], False)
    floor.traffic.set_dead(1, [floor.places.cells[DROP_1_PLACE]])
    floor.interventions.take_back(2.0)
    assert (task.state, floor.missions.phase[0]) == (TaskState.FAILED, CarPhase.RETIRED)
    assert task.reason == "car_0 has no way to drop_1; its parcel stays in the tray"
    assert floor.missions.faults() == []


def test_a_visit_without_a_way_goes_back_to_the_pool() -> None:
    floor = Floor(orders=[visit("v", "parking_4"), visit("w", "parking_5")])
    for car, name in enumerate("vw"):
        floor.visiting(name, car)
    floor.wall_in(0)
    floor.interventions.take_back(1.0)
    assert [floor.task(name).state for name in "vw"] == [TaskState.READY, TaskState.ASSIGNED]
    assert floor.missions.faults() == []
