"""CostModel and DueDates: what tasks cost, counted by hand on the floor of 12 x 6 cells.

Car 0 has 5 moves to pick_1 and 8 to pick_2, car 1 has 10 and 7. From pick_1 it is 11 moves to drop_1 and 14 to drop_2.
A move takes 1.1 s. An arm takes 7 s before it has served, and begins every 10 s while cars wait.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fleet.config import AllocationConfig, BatteryConfig
from fleet.dispatch.cost_model import FULL_S, CostMatrix
from fleet.dispatch.pair_times import LONG_WAIT_COST
from fleet.dispatch.situation import CAN_TAKE
from fleet.missions.admission import CALL_EARLY_S
from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import PAIR_REASONS, PairReason
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def priced(floor: Floor, *names: str, now_s: float = 0.0, soon_s: float = 0.0) -> CostMatrix:
    """The costs of some tasks, which are made ready first."""
    for name in names:
        if floor.task(name).state is TaskState.ORDERED:
            floor.ready(name)
    return floor.costs(*names, now_s=now_s, soon_s=soon_s)


def verdicts(costs: CostMatrix, column: int = 0) -> list[PairReason | None]:
    """Why each car cannot take a task; None for those that can."""
    return [None if code == CAN_TAKE else PAIR_REASONS[code] for code in costs.codes[:, column].tolist()]


def test_a_task_costs_the_way_to_it() -> None:
    costs = priced(Floor(orders=[delivery("a"), delivery("b", "pick_2", "drop_2")]), "a", "b")
    assert costs.cost_s == pytest.approx(np.array([[5.5, 8.8], [11.0, 7.7]]))
    assert costs.pressure_s.tolist() == [0.0, 0.0]
    assert costs.wanted[0]


def test_a_tenth_of_its_age_comes_off() -> None:
    costs = priced(Floor(orders=[delivery("a")]), "a", now_s=10.0)
    assert costs.cost_s[:, 0] == pytest.approx([4.5, 10.0])
    assert costs.pressure_s.tolist() == [1.0]


def test_a_task_that_would_be_late_presses_for_being_served() -> None:
    """With car 0 it ends after 5.5 + 12.1 + 14 = 31.6 s, too late, with car 1 5.5 s after that."""
    costs = priced(Floor(orders=[delivery("a", due_s=20.0)]), "a")
    assert costs.pressure_s == pytest.approx([4 * 31.6])
    assert costs.cost_s[:, 0] == pytest.approx([5.5 - 4 * 31.6, 11.0 + 2 * 5.5 - 4 * 31.6])


def test_a_visit_costs_the_way_to_its_first_errand() -> None:
    costs = priced(Floor(orders=[visit("v", ("charger_1", "charger_2"), "parking_3")]), "v")
    assert costs.cost_s[:, 0] == pytest.approx([8.8, 3.3])


def test_to_charge_a_full_car_costs_300_s_more() -> None:
    floor = Floor(orders=[visit("v", "charger_1", until_full=True)], battery_config=BatteryConfig(enabled=True))
    floor.chargers.batteries.charge[:] = (0.5, 0.25)
    assert priced(floor, "v").cost_s[:, 0] == pytest.approx([8.8 + 0.5 * FULL_S, 3.3 + 0.25 * FULL_S])


def test_a_busy_car_counts_from_where_and_when_it_will_be_free() -> None:
    """Car 0 has 12 moves to drop_1 and is unloaded in 7 s: free after 19 s, 11 moves from pick_1."""
    floor = Floor(orders=[delivery("a"), delivery("b")])
    floor.carried("a", car=0)
    assert verdicts(priced(floor, "b", soon_s=18.9))[0] is PairReason.CAR_BUSY
    costs = priced(floor, "b", soon_s=19.0)
    assert verdicts(costs) == [None, None]
    back = floor.ways.between(floor.dock_of("drop_1"), floor.dock_of("pick_1"))
    assert back == 11
    assert costs.cost_s[:, 0] == pytest.approx([19.0 + 12.1, 11.0])
    assert costs.free_s.tolist() == [19.0, 0.0]
    assert costs.states[0] == floor.dock_of("drop_1")


@pytest.mark.parametrize(
    ("phase", "reason"),
    [
        (CarPhase.RECOVERING, PairReason.CAR_OUT),
        (CarPhase.RETIRED, PairReason.CAR_OUT),
        (CarPhase.DEAD, PairReason.CAR_OUT),
    ],
)
def test_a_car_out_of_service_takes_nothing(phase: CarPhase, reason: PairReason) -> None:
    floor = Floor(orders=[delivery("a")])
    floor.missions.enter(0, phase)
    costs = priced(floor, "a")
    assert verdicts(costs) == [reason, None]
    assert costs.of_pair(0, 0) == np.inf


def test_a_car_without_a_way_takes_nothing_and_nobody_a_task_without_a_way_on() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.wall_in(0)
    assert verdicts(priced(floor, "a")) == [PairReason.NO_WAY, None]
    floor.block(floor.places.cells[2])
    costs = priced(floor, "a")
    assert verdicts(costs) == [PairReason.NO_WAY] * 2
    assert not costs.wanted[0]


def test_a_car_must_carry_the_weight_and_have_what_is_needed() -> None:
    abilities = [
        Ability(max_payload_kg=0.4, capabilities=frozenset({"cold"})),
        Ability(max_payload_kg=1.0),
        Ability(max_payload_kg=1.0, capabilities=frozenset({"cold"})),
    ]
    floor = Floor(orders=[delivery("a", needs=("cold",))], n_cars=3, abilities=abilities)
    expected = [PairReason.TOO_HEAVY, PairReason.LACKS_CAPABILITY, None]
    assert verdicts(priced(floor, "a")) == expected
    assert verdicts(priced(floor, "a")) == expected  # is remembered


def test_a_slow_car_is_later_at_both_ends() -> None:
    """Car 0 needs 11 s instead of 5.5 s to the pick station, and 12.1 s more from there on."""
    abilities = [Ability(max_payload_kg=1.0, slowness=2.0), Ability(max_payload_kg=1.0)]
    costs = priced(Floor(orders=[delivery("a")], abilities=abilities), "a")
    assert costs.cost_s[:, 0] == pytest.approx([11.0 + 12.1, 11.0])


def test_a_car_that_did_not_get_there_comes_last() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.task("a").shunned.add(0)
    assert verdicts(priced(floor, "a")) == [PairReason.SHUNNED, None]
    floor.task("a").shunned.add(1)
    assert verdicts(priced(floor, "a")) == [None, None]  # better one that failed than nobody


def test_a_leg_is_for_its_car_and_its_car_for_the_leg() -> None:
    orders = [delivery("a"), delivery("b", after=("a",), same_car_as="a"), delivery("c")]
    floor = Floor(orders=orders)
    first = floor.carried("a", car=1)
    for state in (TaskState.UNLOADING, TaskState.DELIVERED):
        floor.board.move(first, state, 0.0, "by hand")
    floor.missions.release(1)
    costs = priced(floor, "b", "c")
    assert verdicts(costs, 0) == [PairReason.OTHER_CAR, None]
    assert verdicts(costs, 1) == [None, PairReason.KEPT_FOR_LEG]


@pytest.mark.parametrize(
    ("order", "low"),
    [(delivery("a"), True), (visit("a", "parking_4"), True), (visit("a", "charger_1", until_full=True), False)],
    ids=["delivery", "visit", "visit to charge"],
)
def test_a_car_with_too_little_charge_takes_nothing_but_a_charge(order: Any, low: bool) -> None:
    battery = BatteryConfig(enabled=True, capacity_wh=1.0, awake_w=36.0, critical=0.05)
    floor = Floor(orders=[order], battery_config=battery)
    floor.chargers.batteries.charge[:] = 0.055
    assert verdicts(priced(floor, "a")) == ([PairReason.LOW_CHARGE] * 2 if low else [None, None])


def test_the_least_time_is_that_from_the_best_pick_station() -> None:
    floor = Floor(orders=[delivery("a", "pick_2", picks=("pick_2", "pick_1")), visit("v", "parking_1", "parking_2")])
    assert floor.cost_model.least_s(floor.task("a"), move_s=0.5) == 11 * 0.5 + 14.0
    assert floor.cost_model.least_s(floor.task("v"), move_s=0.5) == 11 * 0.5
    floor.block(floor.places.cells[2], floor.places.cells[7])
    assert floor.cost_model.least_s(floor.task("a"), move_s=0.5) == math.inf
    assert floor.cost_model.least_s(floor.task("v"), move_s=0.5) == math.inf


@pytest.mark.parametrize(("due_s", "warned"), [(19.4, True), (19.5, False), (math.inf, False)])
def test_what_nobody_can_do_in_time_is_told_at_once(due_s: float, warned: bool) -> None:
    floor = Floor(orders=[delivery("a", due_s=due_s)])
    floor.due_dates.check(floor.task("a"))
    assert (floor.log.kinds() == ["impossible_due"]) is warned
    if warned:
        assert floor.log.events[0][1]["cause"] == "it is due 19.4 s after its release, and takes 19.5 s from pick_1"


def test_what_has_no_way_on_is_told_too() -> None:
    floor = Floor(orders=[delivery("a", due_s=99.0)])
    floor.block(floor.places.cells[2])
    floor.due_dates.check(floor.task("a"))
    assert floor.log.events[0][1]["cause"].endswith("and there is no way on from pick_1")


def test_the_weights_are_those_of_the_configuration() -> None:
    config = AllocationConfig(ageing=0.5, lateness=3.0, due=2.0)
    costs = priced(Floor(orders=[delivery("a", due_s=40.0)], allocation_config=config), "a", now_s=20.0)
    # Car 0 ends at 51.6 s, after 31.6 s, too late already; car 1 ends 5.5 s later.
    assert costs.pressure_s == pytest.approx([2 * 31.6])
    assert costs.cost_s[:, 0] == pytest.approx([5.5 - 2 * 31.6, 11.0 + 3 * 5.5 - 2 * 31.6])
    older = priced(Floor(orders=[delivery("a")], allocation_config=config), "a", now_s=20.0)
    assert older.pressure_s == pytest.approx([10.0])


def test_that_a_car_is_out_of_service_counts_before_that_it_has_no_way() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.wall_in(0)
    floor.missions.enter(0, CarPhase.DEAD)
    assert verdicts(priced(floor, "a")) == [PairReason.CAR_OUT, None]


def test_the_wait_for_an_arm_that_is_taken_counts() -> None:
    """Car 0 is at pick_1 from 5.5 s to 15.5 s, and car 1 comes there after 11 s."""
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_1", "drop_2"), visit("v", "pick_1")])
    floor.assigned("a", car=0)
    for name in "bv":
        floor.ready(name)
    costs = floor.costs("b", "v", exchange=False)
    assert costs.cars.tolist() == [1]
    assert costs.cost_s[0] == pytest.approx([15.5, 11.0])  # nobody waits on a visit


def test_the_wait_at_the_drop_station_counts() -> None:
    """Car 1 is at drop_1 from 7.7 s on, for 33 s. Car 0 would come there after 5.5 + 10 + 12.1 = 27.6 s."""
    floor = Floor(orders=[delivery("a"), delivery("b")])
    floor.stations.time(floor.stations.named("drop_1")).add(30.0)
    floor.carried("a", car=1)
    wait_s = 40.7 - 27.6
    assert priced(floor, "b").cost_s[0, 0] == pytest.approx(5.5 + wait_s + LONG_WAIT_COST * (wait_s - CALL_EARLY_S))


def test_a_task_costs_the_wait_for_those_before_it() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_2")])
    for name in "ab":
        floor.ready(name)
    costs = floor.costs("a", "b", not_before_s=(20.0, 8.0))
    # Car 0 would be there after 5.5 s, and of its 14.5 s of waiting the last 2.5 s are long.
    assert costs.cost_s == pytest.approx(np.array([[20.0 + 2.5 * LONG_WAIT_COST, 8.8], [20.0, 8.0]]))


def test_a_car_does_not_wait_for_its_own_turn_but_for_those_before_it() -> None:
    """Car 0 is at pick_1 from 5.5 s on and car 1, which comes after 11 s, from 15.5 s on."""
    floor = Floor(orders=[delivery("a"), delivery("b")])
    floor.assigned("a", car=0)
    floor.assigned("b", car=1)
    costs = floor.costs("a", "b")
    assert np.diagonal(costs.cost_s) == pytest.approx([5.5, 15.5])
