"""Charging: which car goes to which charger, and which task it has the charge for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.config import BatteryConfig
from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import Floor, delivery, visit

NEAR, FAR = 4, 5
"""Places of charger_1, 3 moves from the second parking place, and of charger_2, 6 moves from it."""
SMALL = {"enabled": True, "capacity_wh": 1.0, "awake_w": 36.0}
"""3600 J: a second awake takes a hundredth."""


def floor_of(*charges: float, orders: Any = (), **battery: Any) -> Floor:
    """A floor whose cars have these charges."""
    floor = Floor(orders=orders, n_cars=len(charges), battery_config=BatteryConfig(**({"enabled": True} | battery)))
    floor.chargers.batteries.charge[:] = charges
    return floor


def test_a_car_with_a_low_battery_goes_to_the_nearest_charger() -> None:
    floor = floor_of(0.9, 0.2)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.IDLE, CarPhase.TO_CHARGER]
    assert floor.bookings.place_of.tolist() == [-1, NEAR]
    assert floor.ways.goals[1] == floor.places.chargers[0]
    assert floor.log.events == [("to_charger", {"car": "car_1", "charge": 0.2})]
    assert floor.missions.faults() == []


def test_the_emptiest_car_chooses_first_and_the_last_finds_no_room() -> None:
    floor = floor_of(0.25, 0.2, 0.28)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.bookings.place_of.tolist() == [FAR, NEAR, -1]
    assert floor.missions.phase[2] is CarPhase.IDLE


def test_a_charger_that_a_visit_wants_is_left_to_it() -> None:
    floor = floor_of(0.2)
    floor.chargers.send_low(0, 0.0, {NEAR})
    assert floor.bookings.place_of.tolist() == [FAR]


def test_a_car_without_a_way_to_any_charger_stays() -> None:
    floor = floor_of(0.2)
    floor.wall_in(0)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.IDLE]


def test_only_the_chargers_in_use_are_used() -> None:
    floor = floor_of(0.25, 0.2, chargers_n=1)
    assert list(floor.chargers.places) == [NEAR]
    floor.chargers.send_low(0, 0.0, set())
    assert floor.bookings.place_of.tolist() == [-1, NEAR]


def test_a_car_that_has_come_begins_to_charge() -> None:
    floor = floor_of(0.2)
    floor.chargers.send_low(0, 0.0, set())
    floor.chargers.plug_in()
    assert floor.missions.phase == [CarPhase.TO_CHARGER]
    floor.come(0)
    floor.chargers.plug_in()
    assert floor.missions.phase == [CarPhase.CHARGING]
    assert floor.missions.charges.tolist() == [True]
    assert floor.chargers.n_sessions == 1


def test_a_car_without_a_way_to_its_charger_any_more_is_free() -> None:
    floor = floor_of(0.2)
    floor.chargers.send_low(0, 0.0, set())
    floor.wall_in(0)
    floor.chargers.plug_in()
    assert floor.missions.phase == [CarPhase.IDLE]
    assert floor.bookings.room(NEAR) == 1


def test_a_car_with_a_parcel_without_a_way_to_its_charger_waits_with_its_task() -> None:
    floor = floor_of(0.2, orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.missions.hold(0, task, "by hand")
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.TO_CHARGER]
    assert task.reason == "car_0 charges meanwhile: car_0 is held: by hand"
    assert floor.missions.faults() == []
    floor.wall_in(0)
    floor.chargers.plug_in()
    assert floor.missions.phase == [CarPhase.HELD]
    assert task.reason == "car_0 is held: no way to its charger"
    assert floor.bookings.place_of.tolist() == [2]
    assert floor.missions.faults() == []


def test_a_car_that_is_full_leaves_the_charger() -> None:
    floor = floor_of(0.95)
    floor.missions.bind(0, NEAR)
    floor.missions.enter(0, CarPhase.CHARGING)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.IDLE]
    assert floor.log.events == [("charged", {"car": "car_0", "charge": 0.95})]


@pytest.mark.parametrize(("charge", "wanted", "stays"), [(0.6, False, True), (0.6, True, False), (0.59, True, True)])
def test_a_car_with_enough_makes_room_for_who_needs_the_charger(charge: float, wanted: bool, stays: bool) -> None:
    floor = floor_of(charge)
    floor.missions.bind(0, NEAR)
    floor.missions.enter(0, CarPhase.CHARGING)
    floor.chargers.send_low(0, 0.0, {NEAR} if wanted else set())
    assert (floor.missions.phase[0] is CarPhase.CHARGING) is stays


def test_a_car_with_enough_makes_room_for_a_low_one_that_found_none() -> None:
    floor = floor_of(0.7, 0.2, chargers_n=1)
    floor.missions.bind(0, NEAR)
    floor.bookings.book(0)
    floor.missions.enter(0, CarPhase.CHARGING)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.IDLE, CarPhase.IDLE]


def test_a_full_car_goes_on_with_its_parcel() -> None:
    floor = floor_of(0.99, orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.missions.bind(0, NEAR)
    floor.missions.enter(0, CarPhase.CHARGING)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.TO_DROP]
    assert task.reason == "car_0 may go on to drop_1"


def test_a_car_that_was_ordered_to_charge_stays_until_its_visit_ends() -> None:
    floor = floor_of(0.99, orders=[visit("v", "charger_1", until_full=True)])
    task = floor.visiting("v", car=0)
    floor.come(0)
    floor.board.move(task, TaskState.VISITING, 0.0, "by hand")
    floor.missions.enter(0, CarPhase.CHARGING)
    floor.chargers.send_low(0, 0.0, set())
    assert floor.missions.phase == [CarPhase.CHARGING]


@pytest.mark.parametrize(
    ("order", "gives_back"),
    [(delivery("a"), True), (visit("a", "parking_4"), True), (visit("a", "charger_1", until_full=True), False)],
    ids=["delivery", "visit", "visit to charge"],
)
def test_a_critical_car_gives_back_what_can_wait(order: Any, gives_back: bool) -> None:
    floor = floor_of(0.1, orders=[order])
    task = floor.assigned("a", car=0) if order.name == "a" and not hasattr(order, "errands") else floor.visiting("a", 0)
    floor.chargers.send_low(0, 0.0, set())
    assert (task.state is TaskState.READY) is gives_back
    assert (floor.missions.phase[0] is CarPhase.TO_CHARGER) is gives_back
    if gives_back:
        assert task.reason == "the battery of car_0 is at 10 %"
    assert floor.missions.faults() == []


def test_a_critical_car_with_a_parcel_goes_on() -> None:
    floor = floor_of(0.1, orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.chargers.send_low(0, 0.0, set())
    assert (task.state, floor.missions.phase[0]) == (TaskState.CARRIED, CarPhase.TO_DROP)


def test_parked_cars_charge_where_there_is_room() -> None:
    floor = floor_of(0.85, 0.7, 0.75)
    floor.driver.moving.add(2)
    floor.chargers.send_idle(0, set())
    assert floor.missions.phase == [CarPhase.IDLE, CarPhase.TO_CHARGER, CarPhase.IDLE]


@pytest.mark.parametrize(
    ("phase", "charge", "spares"),
    [
        (CarPhase.IDLE, 0.15, True),
        (CarPhase.IDLE, 0.14, False),
        (CarPhase.CHARGING, 0.6, True),
        (CarPhase.CHARGING, 0.59, False),
    ],
)
def test_a_car_may_take_a_task_above_critical_and_at_a_charger_with_enough(
    phase: CarPhase, charge: float, spares: bool
) -> None:
    floor = floor_of(charge)
    floor.missions.bind(0, NEAR)
    floor.missions.enter(0, phase)
    assert floor.chargers.spares(0) is spares


def test_a_way_takes_energy_for_time_and_for_distance() -> None:
    """10 m at 3.3 s each and 5 s of standing: 38 s of 36 W and 10 m of 2.472 N, 1392.7 J of 3600 J; 0.05 is left."""
    floor = floor_of(0.437, 0.436, **SMALL)
    allowed = floor.chargers.allows_way([0, 1], np.array([10.0, 10.0]), 5.0)
    assert allowed.tolist() == [True, False]


def test_what_is_spent_besides_counts_for_a_way() -> None:
    floor = floor_of(0.437, **SMALL)
    assert not floor.chargers.allows_way([0], np.array([10.0]), 5.0, more=0.01)[0]


def test_a_task_must_leave_the_charge_to_reach_a_charger() -> None:
    """Five moves to pick_1, 11 on with the parcel, and 10 from drop_1 home, 8 s at pick_1 and four times 8 s at drop_1.

    Empty: 15 m x (3.3 s x 36 W + 2.4721 N) = 1819.1 J. Loaded with 2 kg: 11 x 118.8 + 40 x 36 + 11 x 3.2569 = 2782.6 J.
    Together 4601.7 J of 36000 J = 0.12783, and the margin of 0.05.
    """
    floor = floor_of(0.178, 0.1775, **(SMALL | {"capacity_wh": 10.0}))
    stations = floor.stations[0], floor.stations[2]
    allowed = floor.chargers.allows([0, 1], np.array([5.0, 5.0]), *stations, 2.0)
    assert allowed.tolist() == [True, False]


def test_there_is_no_charge_for_a_task_without_a_way() -> None:
    floor = floor_of(1.0)
    floor.block(floor.places.cells[2])  # the dock of drop_1
    stations = floor.stations[0], floor.stations[2]
    assert floor.chargers.allows([0], np.array([5.0]), *stations, 0.1).tolist() == [False]


def test_the_way_home_is_that_to_the_nearest_charger() -> None:
    floor = floor_of(1.0)
    docks = floor.stations.dock_states
    assert floor.chargers.moves_home(docks).tolist() == [7.0, 7.0, 10.0, 7.0]
    floor.block(*(floor.places.cells[place] for place in (NEAR, FAR)))
    assert floor.chargers.moves_home(docks).tolist() == [np.inf] * 4
