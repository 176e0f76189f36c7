"""The referee finds what is wrong with plans that were broken by hand, and nothing in one that is sound."""

from dataclasses import replace

import numpy as np
import pytest

from planners.open_floor import BENCHMARK_CAR, CarWay, OpenFloorPlan, OpenFloorProblem, breaches, illegal_poses
from planners.open_floor.referee import BreachKind
from planners.status import Status

QUARTER = 3.0 * np.pi / 2
"""Length of a quarter of the tightest circle [m]."""


def problem_of(starts: list[list[float]], goals: list[list[float]], discs: list[list[float]] | None = None):
    return OpenFloorProblem(
        size_m=(40.0, 30.0),
        car=BENCHMARK_CAR,
        starts=np.array(starts),
        goals=np.array(goals),
        discs=np.array(discs or []).reshape(-1, 3),
    )


def plan_of(problem: OpenFloorProblem, *legs: list[list[float]]) -> OpenFloorPlan:
    ways = tuple(
        CarWay(start=start, legs=np.array(way, dtype=np.float64).reshape(-1, 3))
        for start, way in zip(problem.starts, legs, strict=True)
    )
    return OpenFloorPlan(ways=ways, status=Status.FEASIBLE, step_s=2.0, iterations=0, repairs=0)


def kinds(problem: OpenFloorProblem, plan: OpenFloorPlan) -> list[BreachKind]:
    return [breach.kind for breach in breaches(problem, plan)]


# One car goes ahead, turns to the left, and backs out; another stands beside its way.
PROBLEM = problem_of([[5, 5, 0], [5, 15, 0]], [[18, 6, np.pi / 2], [5, 15, 0]])
LEGS = [[10, 10, 0], [QUARTER, QUARTER, 1 / 3], [2, 0, 0], [2, -2, 0]]


def test_a_sound_plan_has_no_breach() -> None:
    assert breaches(PROBLEM, plan_of(PROBLEM, LEGS, [])) == []


@pytest.mark.parametrize(
    ("legs", "kind"),
    [
        ([[9, 10, 0], *LEGS[1:]], BreachKind.MOTION),
        ([LEGS[0], [QUARTER, QUARTER, 1 / 2.9], *LEGS[2:]], BreachKind.MOTION),
        ([*LEGS, [-1, 0, 0]], BreachKind.MOTION),
        ([*LEGS, [np.nan, 0, 0]], BreachKind.MOTION),
        (LEGS[:3], BreachKind.GOAL),
        ([*LEGS, [1, 1, 0.01]], BreachKind.GOAL),
    ],
)
def test_legs_that_no_car_drives_and_wrong_ends(legs: list[list[float]], kind: BreachKind) -> None:
    assert kinds(PROBLEM, plan_of(PROBLEM, legs, [])) == [kind]


def test_a_way_that_begins_elsewhere() -> None:
    plan = plan_of(PROBLEM, LEGS, [])
    moved = replace(plan.ways[1], start=PROBLEM.starts[1] + [0.1, 0, 0])
    assert kinds(PROBLEM, replace(plan, ways=(plan.ways[0], moved))) == [BreachKind.START, BreachKind.GOAL]


def test_a_missing_way() -> None:
    assert kinds(PROBLEM, replace(plan_of(PROBLEM, LEGS, []), ways=(None, None))) == [BreachKind.MISSING] * 2


def test_an_obstacle_on_the_way_is_told_with_its_time() -> None:
    # The front of the car, 2 m ahead of the axle, comes to the disc after 4.2 m; 0.1 m of its corner is enough.
    problem = problem_of(PROBLEM.starts.tolist(), PROBLEM.goals.tolist(), [[12, 5, 0.8]])
    (breach,) = breaches(problem, plan_of(problem, LEGS, []))
    assert (breach.kind, breach.cars) == (BreachKind.OBSTACLE, (0,))
    assert breach.time_s == pytest.approx(4.2, abs=2.0 / 32 + 1e-9)
    beside = replace(problem, discs=np.array([[10, 3.21, 0.8]]))
    assert kinds(beside, plan_of(beside, LEGS, [])) == [BreachKind.OBSTACLE]
    clear = replace(problem, discs=np.array([[10, 3.19, 0.8]]))
    assert breaches(clear, plan_of(clear, LEGS, [])) == []


def test_a_car_that_leaves_the_floor() -> None:
    problem = problem_of([[5, 5, 0]], [[5, 5, 0]])
    out_and_back = [[6, -6, 0], [6, 6, 0]]
    assert kinds(problem, plan_of(problem, out_and_back)) == [BreachKind.OFF_FLOOR]
    to_the_edge = [[4.5, -4.5, 0], [4.5, 4.5, 0]]
    assert breaches(problem, plan_of(problem, to_the_edge)) == []
    walled = replace(problem, walled=True)
    assert kinds(walled, plan_of(walled, to_the_edge)) == [BreachKind.OFF_FLOOR]


def test_cars_that_meet_on_the_way_and_one_that_is_parked() -> None:
    head_on = problem_of([[5, 5, 0], [25, 5, np.pi]], [[25, 5, 0], [5, 5, np.pi]])
    (breach,) = breaches(head_on, plan_of(head_on, [[20, 20, 0]], [[20, 20, 0]]))
    assert (breach.kind, breach.cars) == (BreachKind.OVERLAP, (0, 1))
    assert breach.time_s == pytest.approx(8.0, abs=2.0 / 32 + 1e-9)
    # One arrives and stays where the other comes by later.
    parked = problem_of([[5, 5, 0], [10, 20, -np.pi / 2]], [[10, 5, 0], [10, 3, -np.pi / 2]])
    (breach,) = breaches(parked, plan_of(parked, [[5, 5, 0]], [[17, 17, 0]]))
    assert (breach.kind, breach.cars) == (BreachKind.OVERLAP, (0, 1))


def test_a_short_overlap_between_steps_is_seen() -> None:
    """Corners that pass each other: at whole steps of 2 s nothing is to be seen."""
    problem = problem_of([[5, 5, 0], [14.9, 6.9, np.pi]], [[20, 5, 0], [0.5, 6.9, np.pi]])
    plan = plan_of(problem, [[15, 15, 0]], [[14.4, 14.4, 0]])
    assert kinds(problem, plan) == [BreachKind.OVERLAP]


def test_why_a_problem_cannot_be_solved() -> None:
    problem = problem_of([[5, 5, 0], [7, 5, 1], [41, 5, 0]], [[20, 20, 0], [30, 20, 0], [30, 10, 0]], [[20, 21.7, 0.8]])
    assert illegal_poses(problem) == [
        "starts of cars 0 and 1 overlap",
        "start of car 2 is off the floor",
        "goal of car 0 is in an obstacle",
    ]
    assert illegal_poses(PROBLEM) == []
