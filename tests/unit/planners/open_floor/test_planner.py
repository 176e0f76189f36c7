"""Plans on open floors are legal, repeatable, and end with a status where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.open_floor import (
    BENCHMARK_CAR,
    CarOutline,
    OpenFloorConfig,
    OpenFloorError,
    OpenFloorPlan,
    OpenFloorPlanner,
    OpenFloorProblem,
    breaches,
    generate_open_floor,
    illegal_poses,
)
from planners.status import Status


def problem_of(starts: list[list[float]], goals: list[list[float]], **more) -> OpenFloorProblem:
    given = {"size_m": (40.0, 30.0), "car": BENCHMARK_CAR, "discs": np.empty((0, 3)), **more}
    return OpenFloorProblem(starts=np.array(starts, dtype=np.float64), goals=np.array(goals, dtype=np.float64), **given)


HEAD_ON = problem_of([[5, 15, 0], [35, 15, np.pi]], [[35, 15, 0], [5, 15, np.pi]])
SAME_SPOT_LATER = problem_of([[5, 15, 0], [20, 15, 0]], [[20, 15, 0], [35, 15, 0]])
# A wall of discs with one gap, which both have to take, in opposite directions.
GAP = problem_of(
    [[8, 15, 0], [32, 15, np.pi], [8, 22, 0]],
    [[32, 20, 0], [8, 10, np.pi], [32, 10, 0]],
    discs=np.array([[20.0, y, 0.8] for y in (*range(0, 13), *range(18, 31))]),
)
# The goal of one is in the way of the other, which has no other.
ALLEY = problem_of(
    [[5, 15, 0], [12, 15, 0]],
    [[25, 15, 0], [36, 15, 0]],
    discs=np.array([[x, y, 0.8] for x in range(10, 31) for y in (12.5, 17.5)]),
)


def plan(problem: OpenFloorProblem, **more) -> OpenFloorPlan:
    return OpenFloorPlanner(OpenFloorConfig(**more)).plan(problem)


@pytest.mark.parametrize("problem", [HEAD_ON, SAME_SPOT_LATER, GAP, ALLEY], ids=["head on", "same", "gap", "alley"])
def test_cars_that_are_in_each_other_s_way_arrive(problem: OpenFloorProblem) -> None:
    found = plan(problem)
    assert found.status is Status.FEASIBLE
    assert breaches(problem, found) == []


@pytest.mark.parametrize("seed", range(3))
def test_a_crowd_arrives_and_the_same_problem_has_the_same_plan(seed: int) -> None:
    problem = generate_open_floor(50.0, 15, 20, seed=seed)
    assert illegal_poses(problem) == []
    before = [array.copy() for array in (problem.starts, problem.goals, problem.discs)]
    first, again = plan(problem), plan(problem)
    assert first.status is Status.FEASIBLE
    assert breaches(problem, first) == []
    for one, other in zip(first.ways, again.ways, strict=True):
        assert one.legs.tobytes() == other.legs.tobytes()
    assert [array.tobytes() for array in (problem.starts, problem.goals, problem.discs)] == [
        array.tobytes() for array in before
    ]


def test_cars_of_another_size_stay_within_walls() -> None:
    car = CarOutline(front_m=0.41, rear_m=0.09, half_width_m=0.14, turning_radius_m=0.5)
    problem = problem_of(
        [[0.3, 0.3, 0], [3.5, 2.6, np.pi]], [[3.5, 2.6, 0], [0.5, 2.6, 0]], size_m=(4.0, 3.0), car=car, walled=True
    )
    found = plan(problem)
    assert found.status is Status.FEASIBLE
    assert breaches(problem, found) == []


def test_a_car_that_is_there_already_does_not_move() -> None:
    found = plan(problem_of([[5, 5, 1]], [[5, 5, 1]]))
    assert found.makespan_s == pytest.approx(0.0, abs=1e-9)


def test_starts_that_touch_part() -> None:
    """With 1 cm between them no margin of 5 cm can be kept where they stand."""
    problem = problem_of([[5, 5, 0], [5, 7.01, 0]], [[25, 20, 0], [25, 10, 0]])
    found = plan(problem)
    assert found.status is Status.FEASIBLE
    assert breaches(problem, found) == []


def test_what_cannot_be_solved_is_a_status() -> None:
    overlapping = problem_of([[5, 5, 0], [6, 5, 0]], [[25, 20, 0], [25, 10, 0]])
    assert plan(overlapping).status is Status.INFEASIBLE
    ring = np.array([[20.5 + 4 * np.cos(a), 15 + 4 * np.sin(a), 0.8] for a in np.linspace(0, 2 * np.pi, 40)])
    walled_in = problem_of([[20, 15, 0]], [[5, 5, 0]], discs=ring)
    found = plan(walled_in)
    assert (found.status, found.ways) == (Status.INFEASIBLE, (None,))


def test_a_car_between_two_obstacles_shuffles_out() -> None:
    """There are 90 cm ahead and behind: less than a step, which has 2.1 m."""
    problem = problem_of([[20, 15, 0]], [[5, 5, 0]], discs=np.array([[23.7, 15, 0.8], [17.3, 15, 0.8]]))
    found = plan(problem)
    assert found.status is Status.FEASIBLE
    assert breaches(problem, found) == []


def test_a_budget_ends_the_search() -> None:
    problem = generate_open_floor(50.0, 15, 20, seed=0)
    found = OpenFloorPlanner().plan(problem, Deadline(10))
    assert found.status is Status.TIMEOUT
    assert None in found.ways


def test_poses_of_a_way_are_where_its_legs_lead() -> None:
    found = plan(HEAD_ON)
    for way, goal in zip(found.ways, HEAD_ON.goals, strict=True):
        first, last, later = way.poses(np.array([-1.0, way.duration_s, 1e6]))
        assert first == pytest.approx(way.start)
        assert last[:2] == pytest.approx(goal[:2], abs=1e-9)
        assert later == pytest.approx(last)
        assert np.cos(last[2] - goal[2]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"starts": np.zeros((2, 2))}, r"starts has shape \(2, 2\); valid: \(2, 3\)"),
        ({"goals": np.zeros((3, 3))}, r"goals has shape \(3, 3\); valid: \(2, 3\)"),
        ({"goals": np.array([[0, 0, np.nan], [0, 0, 0]])}, r"goals\[0, 2\] = nan; valid: a number"),
        ({"size_m": (0.0, 3.0)}, "size_m = .*; valid: two lengths > 0"),
        ({"discs": np.array([[1.0, 1.0, 0.0]])}, r"discs\[0\] has radius 0.0; valid: > 0"),
    ],
)
def test_malformed_problems_are_refused(change: dict[str, object], said: str) -> None:
    with pytest.raises(OpenFloorError, match=said):
        replace(HEAD_ON, **change)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ({"checks": 0}, "checks = 0; valid: an integer >= 1"),
        ({"weight": 0.0}, "weight = 0.0; valid: a number > 0"),
        ({"cusp_cost": -1.0}, "cusp_cost = -1.0; valid: a number >= 0"),
    ],
)
def test_settings_out_of_range_are_refused(setting: dict[str, float], said: str) -> None:
    with pytest.raises(PlanningError, match=said):
        OpenFloorConfig(**setting)


def test_a_floor_that_is_too_full_is_refused() -> None:
    with pytest.raises(OpenFloorError, match=r"200 cars on 30\.0 m x 30\.0 m; valid: fewer"):
        generate_open_floor(30.0, 200, 5, seed=0)
