"""Any of OMPL's planners by name; what would hang or crash is a named error at once."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from planners.motion import MOTION_PLANNERS, OMPL_PLANNERS, MotionProblem, OmplPlanner, motion_planner
from planners.motion.arm.arm_model import ArmModel
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.search import ompl_planner
from planners.motion.search.ompl_planner import (
    HangingPlannerError,
    InfiniteLimitsError,
    StuckPlannerError,
    UnknownPlannerError,
)


def turntable() -> ArmModel:
    """Two joints about one vertical axis and one sphere, so that a wall has a way around it."""
    lean = np.eye(4)
    lean[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    return ArmModel(
        base_from_joint=np.stack([np.eye(4), lean]),
        lower=np.full(2, -2.5),
        upper=np.full(2, 2.5),
        sphere_centre=np.array([[0.5, 0.0, 0.0]]),
        sphere_radius=np.array([0.05]),
        sphere_frame=np.array([2]),
        self_pairs=np.empty((0, 2), dtype=np.int64),
        tool_length=0.0,
    )


def around_the_wall() -> MotionProblem:
    checker = CollisionChecker(turntable(), Boxes.one((0.5, 0.0, 0.0), (0.2, 0.02, 0.2)))
    return MotionProblem(
        checker=checker, start=np.array([-0.8, 0.0]), goals=np.array([[0.8, 0.0]]), seed=3, max_iterations=2000
    )


@pytest.mark.parametrize("name", OMPL_PLANNERS)
def test_every_planner_that_is_offered_solves_and_repeats(name: str) -> None:
    problem = around_the_wall()
    first, again = (motion_planner(name).plan(problem) for _ in range(2))
    assert first.solved
    assert problem.checker.path_free(first.path)
    assert first.path.tobytes() == again.path.tobytes()


def test_names() -> None:
    assert {"RRTConnect", "AORRTC", "BITstar"} <= set(OMPL_PLANNERS)
    assert all(isinstance(motion_planner(name), MOTION_PLANNERS[name]) for name in MOTION_PLANNERS)
    with pytest.raises(UnknownPlannerError, match="'STRRTstar'; valid: rrt_connect, "):
        motion_planner("STRRTstar")
    with pytest.raises(UnknownPlannerError, match="'EST' is not bound"):
        OmplPlanner("EST")


@pytest.mark.parametrize("name", ["PRM", "PRMstar"])
def test_planners_that_hang_are_refused(name: str) -> None:
    begin_s = time.monotonic()
    with pytest.raises(HangingPlannerError, match="second thread"):
        motion_planner(name)
    assert time.monotonic() - begin_s < 1.0


def test_a_planner_that_no_longer_asks_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ompl_planner, "MOST_MOTIONS", 0)
    with pytest.raises(StuckPlannerError, match="RRTConnect: 0 motions"):
        OmplPlanner().plan(around_the_wall())


def test_limits_must_be_finite() -> None:
    problem = around_the_wall()
    free = replace(turntable(), upper=np.array([2.5, np.inf]))
    with pytest.raises(InfiniteLimitsError, match="joint 1"):
        OmplPlanner().plan(replace(problem, checker=CollisionChecker(free, problem.checker.boxes)))


def test_an_error_in_the_check_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = around_the_wall()
    settle = ompl_planner.settle_early

    def broken(*_: object) -> bool:
        raise KeyboardInterrupt

    def settle_then_break(query: MotionProblem) -> object:
        result = settle(query)
        monkeypatch.setattr(CollisionChecker, "edge", broken)
        return result

    monkeypatch.setattr(ompl_planner, "settle_early", settle_then_break)
    with pytest.raises(KeyboardInterrupt):
        OmplPlanner().plan(problem)


@pytest.mark.parametrize("name", ["RRTConnect", "RRT", "KPIECE1"])
def test_trees_are_kept_on_request_and_change_nothing(name: str) -> None:
    problem = around_the_wall()
    watched = OmplPlanner(name)
    watched.trees = []
    found, alone = watched.plan(problem), OmplPlanner(name).plan(problem)
    np.testing.assert_array_equal(found.path, alone.path)
    (tree,) = watched.trees
    assert (tree.vertices == problem.start).all(axis=1).any()
    assert len(tree.edges) >= len(found.path) - 1
    assert all(problem.checker.edge(*tree.vertices[edge]) for edge in tree.edges)
