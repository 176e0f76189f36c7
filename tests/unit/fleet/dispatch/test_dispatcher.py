"""Dispatcher: what happens in which order at each tick, and how often."""

from __future__ import annotations

from typing import Any

import pytest

from fleet.config import BatteryConfig
from fleet.dispatch.dispatcher import Dispatcher, DispatchRules
from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import TICK_S, Floor, delivery, fake

OTHERS = (
    *("backlog", "slots", "visit_queue", "assignments", "interventions"),
    *("admission", "docks", "prefetch", "visits", "parking"),
)
EVERY_TICK = ["slots.collect", "backlog.release", "clear_left"]
CALLS = ["charging.plug_in", "admission.call", "slots.fill", "visits.call"]
REVIEW = [
    "interventions.take_back",
    "containment.tick",
    "interventions.end_overdue",
    "visit_queue.chargers_wanted",
    "charging.send_low",
]
END = ["docks.tick", "prefetch.tick", "visits.tick"]
LAST = ["charging.send_idle", "parking.send"]
GIVEN = ["assignments.give_out", "visit_queue.chargers_wanted"]


class Names:
    """Rules that note by which name they were called."""

    def __init__(self) -> None:
        self.called: list[str] = []
        self.exchanges: list[bool] = []
        self.released = False

    def rule(self, name: str) -> Any:
        names = self

        class Rule:
            def __getattr__(self, verb: str) -> Any:
                def call(*args: object, **facts: bool) -> Any:
                    names.called.append(f"{name}.{verb}")
                    names.exchanges.extend(facts.values())
                    return set() if verb == "chargers_wanted" else names.released and verb == "release"

                return call

        return Rule()


def dispatcher_of(names: Names, *, changed: bool = False, charges: bool = True) -> Any:
    missions = fake(
        changed=changed,
        clear_left=lambda: names.called.append("clear_left"),
    )
    rules: Any = {name: names.rule(name) for name in OTHERS}
    return Dispatcher(
        DispatchRules(missions=missions, charging=names.rule("charging") if charges else None, **rules),
        names.rule("containment"),
        TICK_S,
    )


def test_most_ticks_only_slots_docks_and_visits_are_looked_at() -> None:
    names = Names()
    dispatcher_of(names).tick(3, 0.3)
    assert names.called == EVERY_TICK + END


def test_cars_that_wait_are_called_every_quarter_of_a_second() -> None:
    """A quarter of a second is two and a half ticks of 0.1 s, of which two are made."""
    names = Names()
    dispatcher_of(names).tick(2, 0.2)
    assert names.called == EVERY_TICK + CALLS + END


def test_who_was_served_makes_room_before_there_is_a_task_for_it() -> None:
    names = Names()
    dispatcher_of(names, changed=True).tick(2, 0.2)
    assert names.called == [*EVERY_TICK, *CALLS, "parking.send", *END]


@pytest.mark.parametrize(("changed", "given"), [(True, GIVEN), (False, [])])
def test_every_half_second_tasks_are_given_out_if_anything_has_changed(changed: bool, given: list[str]) -> None:
    names = Names()
    dispatcher_of(names, changed=changed).tick(5, 0.5)
    assert names.called == EVERY_TICK + REVIEW + given + LAST + END
    assert names.exchanges == [False] * changed


def test_every_five_seconds_tasks_are_priced_anew() -> None:
    names = Names()
    dispatcher_of(names).tick(50, 5.0)
    assert names.called == EVERY_TICK + CALLS + REVIEW + GIVEN + LAST + END
    assert names.exchanges == [True]


def test_cars_without_batteries_do_not_charge() -> None:
    names = Names()
    dispatcher_of(names, charges=False).tick(50, 5.0)
    assert not [name for name in names.called if name.startswith("charging")]


@pytest.mark.parametrize(("changed", "released"), [(False, False), (True, False), (False, True)])
def test_a_task_that_is_ready_is_a_change_and_what_had_changed_before_stays_so(changed: bool, released: bool) -> None:
    names = Names()
    names.released = released
    dispatcher = dispatcher_of(names, changed=changed)
    dispatcher.tick(3, 0.3)
    assert dispatcher.rules.missions.changed is (changed or released)


def real(floor: Floor) -> Dispatcher:
    rules = DispatchRules(
        missions=floor.missions,
        backlog=floor.backlog,
        slots=floor.slots,
        visit_queue=floor.visit_queue,
        assignments=floor.assignments,
        interventions=floor.interventions,
        admission=floor.admission,
        docks=floor.docks,
        prefetch=floor.prefetch,
        visits=floor.visits,
        parking=floor.parking,
        charging=floor.charging,
    )
    return Dispatcher(rules, floor.containment, TICK_S)


@pytest.mark.parametrize("battery", [None, BatteryConfig(enabled=True)])
def test_a_floor_delivers_all_by_its_rules_alone(battery: BatteryConfig | None) -> None:
    """Cars are where they were sent in the next tick if nobody stands there; arms take a second, and fetch at once."""
    orders = [delivery(f"o{k}", f"pick_{1 + k % 2}", f"drop_{1 + k // 2 % 2}", release_s=2.0 * k) for k in range(8)]
    floor = Floor(orders=orders, n_cars=3, battery_config=battery)
    dispatcher, begun = real(floor), [0] * 4
    for tick in range(1500):
        dispatcher.tick(tick, TICK_S * tick)
        assert floor.missions.faults() == []
        taken = floor.graph.state_cell[floor.ways.tails].tolist()
        for car, goal in enumerate(floor.ways.goals.tolist()):
            if goal >= 0 and not floor.traffic.fixed[car] and int(floor.graph.state_cell[goal]) not in taken:
                floor.come(car)
                taken = floor.graph.state_cell[floor.ways.tails].tolist()
        while floor.arms.fetched:
            request = floor.arms.fetched.pop()
            floor.arms.hold(request.arm, request.parcel)
        while floor.arms.returned:
            floor.arms.come_home(floor.arms.returned.pop())
        for arm, car in floor.services.under_way:
            task = floor.missions.task_of[car]
            begun[arm] = begun[arm] + 1 if not floor.arms.is_idle(arm) else 0
            if begun[arm] == 10 and task is not None:
                if task.state is TaskState.LOADING:
                    floor.lay_in_tray(task, car)
                elif task.drop_slot is not None:
                    floor.lay_on_slot(task, task.drop_slot, task.delivery.drop)
                floor.arms.come_home(arm)
                begun[arm] = 0
        for car, task in enumerate(floor.missions.task_of):
            if task is not None and task.state is TaskState.CARRIED:
                floor.lay_in_tray(task, car)
    assert floor.board.finished
    assert floor.board.count(TaskState.COLLECTED) == 8
    assert (floor.inventory.n_entered, floor.inventory.n_left, floor.inventory.misplaced()) == (8, 8, [])
    assert floor.missions.phase == [CarPhase.IDLE] * 3
    assert floor.services.under_way == []
    assert not floor.executor.closed.any()


def test_a_task_that_is_ready_is_given_out_at_the_next_review() -> None:
    floor = Floor(orders=[delivery("a", release_s=0.5)])
    dispatcher = real(floor)
    floor.missions.changed = False
    dispatcher.tick(5, 0.5)
    assert floor.task("a").state is TaskState.ASSIGNED
