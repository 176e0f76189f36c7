"""Short stories through several rules: after each step the phases and tasks of all cars go together."""

from __future__ import annotations

import pytest

from fleet.missions.phases import PHASES, STATES_IN, CarPhase
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def check(floor: Floor) -> None:
    """Nobody has a phase that does not go with its task."""
    assert floor.missions.faults() == []
    numbers = [PHASES[number] for number in floor.missions.phase_index]
    assert numbers == floor.missions.phase


def test_every_phase_has_its_states() -> None:
    assert set(STATES_IN) == set(CarPhase)


def test_a_delivery_from_its_release_to_its_end() -> None:
    floor = Floor(orders=[delivery("a")])
    steps = []
    assert floor.backlog.release(0.0)
    floor.assignments.give_out(0, 0.0, exchange=False)
    task = floor.task("a")
    steps.append((floor.missions.phase[0], task.state))
    check(floor)
    for tick, arm in ((10, 0), (20, 2)):
        floor.come(0)
        floor.admission.call(tick, tick / 10)
        floor.docks.tick(tick, tick / 10)
        steps.append((floor.missions.phase[0], task.state))
        check(floor)
        if arm == 0:
            floor.lay_in_tray(task, 0)
        else:
            floor.lay_on_slot(task, 0, "drop_1")
        floor.arms.come_home(arm)
        floor.docks.tick(tick + 5, tick / 10 + 0.5)
        steps.append((floor.missions.phase[0], task.state))
        check(floor)
    assert steps == [
        (CarPhase.TO_PICK, TaskState.ASSIGNED),
        (CarPhase.LOADING, TaskState.LOADING),
        (CarPhase.TO_DROP, TaskState.CARRIED),
        (CarPhase.UNLOADING, TaskState.UNLOADING),
        (CarPhase.IDLE, TaskState.DELIVERED),
    ]
    floor.slots.collect(7.5)
    assert floor.board.finished
    assert floor.inventory.balance() == 0
    floor.parking.send(80)
    check(floor)


@pytest.mark.parametrize("phase", [CarPhase.RECOVERING, CarPhase.DEAD])
@pytest.mark.parametrize("state", [None, "assigned", "loading", "carried", "unloading", "visiting"])
def test_a_car_that_leaves_service_with_any_task(phase: CarPhase, state: str | None) -> None:
    floor = Floor(orders=[visit("a", "parking_4") if state == "visiting" else delivery("a")])
    if state == "visiting":
        floor.visiting("a", car=0)
        floor.come(0)
    elif state in ("assigned", "loading"):
        floor.assigned("a", car=0)
    elif state is not None:
        floor.carried("a", car=0)
    if state in ("loading", "unloading"):
        floor.arrive(0)
    if state in ("carried", "unloading"):
        floor.lay_in_tray(floor.task("a"), 0)
    floor.docks.tick(0, 0.0)
    floor.visits._any = False  # the visit goes on standing
    check(floor)
    floor.interventions.retire(0, phase, 1.0, "by hand")
    check(floor)
    for arm in (0, 2):
        floor.arms.come_home(arm)
    floor.docks.tick(1, 1.0)
    check(floor)
    if phase is CarPhase.RECOVERING:
        floor.interventions.resume(0, 2, 2.0)
        check(floor)
