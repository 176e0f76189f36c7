"""RollingHorizon and Solver: tasks, cars and arms as a problem, and what was planned as a proposal for the next."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import AllocationConfig
from fleet.dispatch.cost_model import CostMatrix
from planners.allocation.problem import NO_TASK, Assignment, assignment
from planners.allocation.shop import NO_STATION
from planners.status import Status
from tests.unit.fleet.missions.floor import Floor, delivery, fake, visit

BOTH = np.array([0, 1])


def priced(floor: Floor, *names: str, now_s: float = 0.0) -> CostMatrix:
    return floor.costs(*names, now_s=now_s, soon_s=np.inf)


def test_a_shop_has_stations_then_cars_then_visited_places() -> None:
    floor = Floor(orders=[delivery("a", "pick_1", "drop_2", due_s=90.0), visit("v", "parking_3", stand_s=4.0)])
    floor.ready("a")
    floor.ready("v")
    costs = priced(floor, "a", "v", now_s=30.0)
    shop = floor.horizon.shop(costs, list(range(len(costs.tasks))), BOTH)
    assert shop.travel_s.shape == (7, 7)  # four docks, two cars, one place
    assert shop.travel_s[4, :4].tolist() == [5.0, 8.0, 12.0, 15.0]  # car 0
    assert shop.travel_s[0, 2:4].tolist() == [11.0, 14.0]
    assert shop.travel_s[4:6, 6].tolist() == [13.0, 8.0]  # to the third parking place
    assert np.isinf(shop.travel_s[0, 4:6]).all()  # nobody drives to where a car was
    assert np.diagonal(shop.travel_s).tolist() == [0.0] * 7
    assert shop.start.tolist() == [4, 5]
    assert shop.first_errand.tolist() == [0, 2, 3]
    assert shop.place.tolist() == [0, 3, 6]
    assert shop.station.tolist() == [0, 3, NO_STATION]
    assert shop.service_s.tolist() == [7.0, 7.0, 4.0]
    assert shop.n_buffer_places.tolist() == [4, 4, 4, 4]
    assert shop.due_s is not None
    assert shop.due_s.tolist() == [60.0, np.inf]
    assert shop.weight is not None
    assert shop.weight.tolist() == (1.0 + costs.pressure_s / 150.0).tolist()


def planned(
    floor: Floor, costs: CostMatrix, sequence: tuple[tuple[int, ...], ...], start_s: list[float], soon: int = -1
) -> None:
    """The plan of somebody who plans ahead, as it is kept; one car may be free only later."""
    problem = floor.solver.problem(costs, list(range(len(costs.tasks))), BOTH, {}, floor.horizon)
    answer = Assignment(
        pairs=np.zeros((0, 2), dtype=np.int32),
        cost=0.0,
        status=Status.FEASIBLE,
        sequence=sequence,
        timetable=fake(start_s=np.repeat(start_s, 2)),
    )
    floor.horizon.keep(costs, problem, answer, list(range(len(costs.tasks))), BOTH, soon == BOTH)


def test_the_last_plan_is_proposed_in_the_order_of_its_starts() -> None:
    floor = Floor(orders=[delivery(name) for name in "abc"])
    for name in "abc":
        floor.ready(name)
    costs = priced(floor, "a", "b", "c", now_s=10.0)
    planned(floor, costs, ((0, 1), (2,)), [8.0, 30.0, 5.0])
    shop = floor.horizon.shop(costs, list(range(len(costs.tasks))), BOTH)
    assert shop.first_order is not None
    assert shop.first_vehicle is not None
    assert shop.first_order.tolist() == [2, 0, 1]
    assert shop.first_vehicle.tolist() == [0, 0, 1]


def test_of_the_last_plan_only_tasks_and_cars_count_that_are_there() -> None:
    floor = Floor(orders=[delivery(name) for name in "abc"])
    for name in "abc":
        floor.ready(name)
    planned(floor, priced(floor, "a", "b", "c"), ((0, 1), (2,)), [8.0, 30.0, 5.0])
    costs = priced(floor, "b", "c")
    shop = floor.horizon.shop(costs, list(range(len(costs.tasks))), BOTH[:1])
    assert shop.first_order is not None
    assert shop.first_vehicle is not None
    assert shop.first_order.tolist() == [0]
    assert shop.first_vehicle.tolist() == [0, -1]


def test_without_a_timetable_nothing_is_planned() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.ready("a")
    costs = priced(floor, "a")
    planned(floor, costs, ((0,), ()), [8.0])
    problem = floor.solver.problem(costs, [0], BOTH, {}, None)
    floor.horizon.keep(costs, problem, assignment(problem, [(0, 0)], Status.OPTIMAL), [0], BOTH, BOTH < 0)
    shop = floor.horizon.shop(costs, list(range(len(costs.tasks))), BOTH)
    assert shop.first_order is not None
    assert shop.first_order.tolist() == []


@pytest.mark.parametrize(("soon", "n_kept"), [(-1, 2), (0, 0)])
def test_a_shop_knows_trays_and_what_is_planned_together_is_kept_for_a_car_that_goes_for_it(
    soon: int, n_kept: int
) -> None:
    floor = Floor(orders=[delivery(name) for name in "abcd"], n_tray_places=3)
    first = floor.assigned("a", car=0)
    for name in "bcd":
        floor.ready(name)
    costs = priced(floor, "a", "b", "c", "d")
    shop = floor.horizon.shop(costs, list(range(4)), BOTH)
    assert shop.n_carried is not None
    assert shop.n_carried.tolist() == [3, 3]
    planned(floor, costs, ((0, 2, 3, 1), ()), [8.0, 90.0, 20.0, 30.0], soon)
    assert floor.missions.task_of[0] is first
    assert [task.order.name for task in floor.loads.of(0)] == ["c", "d"][:n_kept]


def test_a_problem_holds_the_columns_and_cars_that_were_asked_for() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", "pick_2"), delivery("c", "pick_2")])
    for name in "ab":
        floor.ready(name)
    held = floor.assigned("c", car=1)
    costs = priced(floor, "a", "b", "c")
    problem = floor.solver.problem(costs, [1, 2], np.array([1]), {1: held}, None)
    assert problem.cost[0] == pytest.approx(costs.cost_s[1, 1:])
    assert problem.class_of is not None
    assert problem.held is not None
    assert (problem.class_of.tolist(), problem.held.tolist(), problem.shop) == ([1, 1], [1], None)
    assert (problem.keep_gain, problem.keep_share) == (5.0, 0.1)
    assert floor.solver.problem(costs, [0], np.array([1]), {1: held}, None).held.tolist() == [NO_TASK]  # type: ignore[union-attr]


def test_a_solver_knows_what_its_allocator_wants() -> None:
    ahead = Floor(allocation_config=AllocationConfig(allocator="regret_lns")).solver
    assert (ahead.plans_ahead, ahead.soon_s) == (True, np.inf)
    greedy = Floor(allocation_config=AllocationConfig(allocator="greedy")).solver
    assert (greedy.plans_ahead, greedy.soon_s) == (False, 0.0)


def test_a_remark_of_the_allocator_is_logged_once() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.ready("a")
    costs = priced(floor, "a")
    problem = floor.solver.problem(costs, [0], BOTH, {}, None)
    answer = assignment(problem, [(0, 0)], Status.OPTIMAL, note="a remark")
    floor.solver._allocator = fake(allocate=lambda problem: answer)
    floor.log.events.clear()
    for _ in range(2):
        assert floor.solver.solve(problem) is answer
    assert floor.log.events == [("allocator_note", {"allocator": "hungarian", "note": "a remark"})]
