"""TaskAllocation and Assignments: who gets which task, who loses one, and why the others did not get it."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from fleet.config import AllocationConfig, BatteryConfig
from fleet.dispatch import allocation
from fleet.dispatch.allocation import _why_given
from fleet.dispatch.cost_model import CostMatrix
from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import PairReason, TaskReason
from planners.allocation.problem import assignment
from planners.status import Status
from tests.lives import Lives
from tests.unit.fleet.missions.floor import Floor, delivery, fake, visit

GREEDY = AllocationConfig(allocator="greedy")
AHEAD = AllocationConfig(allocator="auction")


CHARGER_1 = 4


def give_out(floor: Floor, now_s: float = 0.0, *, exchange: bool = True) -> None:
    floor.assignments.give_out(0, now_s, exchange=exchange)
    assert floor.missions.faults() == []


def reasons_of(floor: Floor, name: str) -> list[PairReason]:
    """What became of each car for a task."""
    return [verdict.reason for verdict in floor.reasons.report(floor.task(name)).pairs]


def test_the_nearest_car_gets_the_task() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.ready("a")
    give_out(floor)
    assert floor.task("a").car == 0
    assert floor.missions.phase == [CarPhase.TO_PICK, CarPhase.IDLE]
    assert reasons_of(floor, "a") == [PairReason.CHOSEN, PairReason.TASK_GOT_BETTER]
    assert floor.assignments.n_allocations == 1
    assert not floor.missions.changed


def test_two_tasks_go_to_two_cars_so_that_their_sum_is_small() -> None:
    """To pick_1 and pick_2 car 0 has 5 and 8 moves, and car 1 has 10 and 7."""
    floor = Floor(orders=[delivery("a", "pick_2"), delivery("b", "pick_1")])
    for name in "ab":
        floor.ready(name)
    give_out(floor)
    assert [floor.task(name).car for name in "ab"] == [1, 0]


def test_a_load_is_planned_and_kept_from_its_station_on() -> None:
    """Car 1 may carry nothing, so that car 0 is to take all three; in its dock they are its own."""
    abilities = [Ability(max_payload_kg=2.0), Ability(max_payload_kg=0.1)]
    config = AllocationConfig(allocator="regret_lns")
    orders = [delivery(name) for name in "abc"]
    floor = Floor(orders=orders, allocation_config=config, n_tray_places=3, abilities=abilities)
    for name in "abc":
        floor.ready(name)
    give_out(floor)
    first = floor.missions.task_of[0]
    assert first is not None
    others = {floor.task(name).index for name in "abc"} - {first.index}
    assert floor.loads.spoken_for(()) == others
    assert floor.loads.spoken_for(floor.situation().held) == set()
    floor.arrive(0)
    assert floor.loads.spoken_for(floor.situation().held) == others
    give_out(floor)
    assert floor.loads.spoken_for(()) == others


def test_costs_of_the_choice_and_of_the_next_cars_are_told() -> None:
    """A friction of the first hour: why this car, and at what cost, was nowhere to be seen."""
    floor = Floor(orders=[delivery("a")], n_cars=4)
    floor.ready("a")
    ((car, _, why),) = floor.allocation.choose(floor.situation(), 0.0).given
    found = re.fullmatch(
        rf"car_{car} was the allocator's choice, its cost is (\S+) s \(others: car_\d (\S+) s, car_\d (\S+) s\)", why
    )
    assert found is not None, why
    own, *others = map(float, found.groups())
    assert own <= others[0] <= others[1]


@pytest.mark.parametrize(
    ("cost_s", "told"),
    [
        ([5.0, 3.0, 4.0, 4.0], " (others: car_2 4.0 s, car_3 4.0 s)"),
        ([4.0, 4.0, 3.0, 4.0], " (others: car_2 3.0 s, car_0 4.0 s)"),
        ([np.inf, 3.0, np.inf, 9.0], " (others: car_3 9.0 s)"),
        ([np.inf, 3.0, np.inf, np.inf], ""),
    ],
)
def test_of_others_the_cheapest_are_told_and_of_equal_ones_the_first(cost_s: list[float], told: str) -> None:
    costs = CostMatrix(
        now_s=0.0,
        tasks=[],
        cars=np.arange(4),
        cost_s=np.array(cost_s)[:, None],
        codes=np.zeros((4, 1), dtype=np.int8),
        pressure_s=np.zeros(1),
        states=np.zeros(4, dtype=np.int32),
        free_s=np.zeros(4),
    )
    own = f"{cost_s[1]:.1f}"
    assert _why_given(costs, 1, 0) == f"car_1 was the allocator's choice, its cost is {own} s{told}"
    assert costs.cost_s[:, 0].tolist() == cost_s, "what tasks cost stays as it is"


def test_without_tasks_nothing_is_given_out() -> None:
    floor = Floor(orders=[delivery("a")])
    assert floor.allocation.choose(floor.situation(), 0.0).given == []
    floor.assigned("a", car=1)  # alone, it cannot change hands
    assert floor.allocation.choose(floor.situation(), 0.0).taken == []


def test_of_more_cars_than_are_asked_the_others_are_asked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(allocation, "MOST_ASKED", 1)
    floor = Floor(orders=[delivery("a"), delivery("b")])
    for name in "ab":
        floor.ready(name)
    give_out(floor, exchange=False)
    assert [car is None for car in floor.missions.task_of] == [False, True]
    assert floor.missions.changed, "car 1 was not asked"
    give_out(floor, exchange=False)
    assert None not in floor.missions.task_of


def far_away() -> Floor:
    """Car 5 is on its 15 moves to pick_1; car 0 has 5 moves, so that it is gone from there before car 5 comes. Car 4
    has a task so that there is something to exchange."""
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_2", "drop_2")], n_cars=6)
    floor.assigned("a", car=5)
    floor.assigned("b", car=4)
    return floor


def test_tasks_change_hands_where_much_is_gained() -> None:
    floor = far_away()
    lives = Lives(floor.missions.board)
    give_out(floor)
    assert [floor.task(name).car for name in "ab"] == [0, 4]
    causes = [step.cause for step in lives.of["a"] if step.state is TaskState.READY]
    assert causes[-1] == "re-assigned: cost car_5 16.5 s, costs car_0 5.5 s now"


def test_tasks_change_hands_only_when_they_are_priced_anew() -> None:
    floor = far_away()
    give_out(floor, exchange=False)
    assert floor.task("a").car == 5


def test_tasks_do_not_change_hands_for_little() -> None:
    floor = Floor(orders=[delivery("a", "pick_2"), delivery("b", "pick_1")])
    floor.assigned("a", car=0)
    floor.assigned("b", car=1)
    give_out(floor)
    assert [floor.task(name).car for name in "ab"] == [0, 1]


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("busy", TaskReason.NO_FREE_CAR),
        ("out", TaskReason.NO_CAPABLE_CAR),
        ("walled in", TaskReason.UNREACHABLE),
        ("low", TaskReason.CARS_CHARGE),
    ],
)
def test_a_task_that_nobody_gets_says_why(what: str, reason: TaskReason) -> None:
    battery = BatteryConfig(enabled=True) if what == "low" else None
    floor = Floor(orders=[delivery("a"), delivery("b")], n_cars=1, battery_config=battery, allocation_config=GREEDY)
    floor.ready("a")
    if what == "busy":
        floor.carried("b", car=0)
    elif what == "out":
        floor.missions.enter(0, CarPhase.DEAD)
    elif what == "walled in":
        floor.wall_in(0)
    elif what == "low":
        floor.chargers.batteries.charge[:] = 0.1
    give_out(floor)
    assert floor.task("a").state is TaskState.READY
    assert floor.reasons.present(floor.task("a")) is reason


def test_a_visit_to_a_full_place_waits() -> None:
    floor = Floor(orders=[visit("v", "charger_1")])
    floor.missions.bind(1, CHARGER_1)
    floor.bookings.book(1)
    floor.ready("v")
    give_out(floor)
    assert floor.task("v").state is TaskState.READY
    report = floor.reasons.report(floor.task("v"))
    assert (report.reason, report.cause) == (TaskReason.STATION_FULL, "charger_1 has no room for one more car")


def test_a_leg_waits_for_its_car() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", after=("a",), same_car_as="a")], allocation_config=GREEDY)
    first = floor.carried("a", car=1)
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(first, state, 0.0, "by hand")
    floor.missions.release(1, CarPhase.RECOVERING)
    floor.missions.enter(1, CarPhase.RECOVERING)
    floor.ready("b")
    give_out(floor)
    assert floor.reasons.present(floor.task("b")) is TaskReason.WAITS_FOR_ITS_CAR


def test_a_task_without_a_capable_car_in_service_is_said_to_be_so() -> None:
    abilities = [Ability(max_payload_kg=0.1), Ability(max_payload_kg=2.0)]
    floor = Floor(orders=[delivery("a")], abilities=abilities)
    floor.missions.enter(1, CarPhase.RETIRED)
    floor.ready("a")
    give_out(floor)
    assert reasons_of(floor, "a") == [PairReason.TOO_HEAVY, PairReason.CAR_OUT]
    assert floor.reasons.present(floor.task("a")) is TaskReason.NO_CAPABLE_CAR


def test_the_allocator_may_leave_a_task_over() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.ready("a")
    solver: Any = floor.solver
    solver._allocator = fake(allocate=lambda problem: assignment(problem, [], Status.FEASIBLE))
    give_out(floor)
    assert floor.reasons.present(floor.task("a")) is TaskReason.LEFT_OVER


def test_a_busy_car_is_planned_for_a_task_that_it_can_take_soon() -> None:
    """Car 0 is unloaded in 7 s at drop_1, and the other car is out: the task is kept for it."""
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_2", "drop_1")], allocation_config=AHEAD)
    floor.carried("a", car=0)
    floor.missions.enter(1, CarPhase.RETIRED)
    floor.ready("b")
    give_out(floor)
    assert floor.task("b").state is TaskState.READY
    report = floor.reasons.report(floor.task("b"))
    assert report.reason is TaskReason.PLANNED
    assert report.cause == "car_0 is to take it, and will be free in 19 s"
    assert reasons_of(floor, "b") == [PairReason.PLANNED_LATER, PairReason.CAR_OUT]


def test_who_plans_ahead_gives_one_car_several_tasks() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")], n_cars=1, allocation_config=AHEAD)
    for name in "ab":
        floor.ready(name)
    give_out(floor, exchange=False)
    assert floor.board.count(TaskState.ASSIGNED) == 1
    (later,) = floor.board.in_state(TaskState.READY)
    assert reasons_of(floor, later.order.name) == [PairReason.PLANNED_LATER]


def test_a_visit_is_sent_to_its_place() -> None:
    floor = Floor(orders=[visit("v", "parking_3")])
    floor.ready("v")
    give_out(floor)
    assert floor.task("v").car == 1
    assert floor.missions.phase == [CarPhase.IDLE, CarPhase.TO_PLACE]


def test_of_two_visits_that_want_one_place_the_second_waits() -> None:
    """Offers see room for both, as either could go to another place; when one has it, no way leads to the other."""
    floor = Floor(orders=[visit("u", ("charger_1", "charger_2")), visit("v", ("charger_1", "charger_2"))])
    floor.block(floor.places.cells[5])
    for name in "uv":
        floor.ready(name)
    give_out(floor)
    assert floor.board.count(TaskState.ASSIGNED) == 1
    (task,) = floor.board.in_state(TaskState.READY)
    assert floor.reasons.present(task) is TaskReason.STATION_FULL
    assert floor.missions.changed
