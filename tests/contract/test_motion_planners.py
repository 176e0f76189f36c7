"""What every arm planner in MOTION_PLANNERS promises."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion import MOTION_PLANNERS, MotionProblem, MotionStatus
from planners.motion.arm.arm_model import ArmModel
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes

LOW = np.array([-0.9, 0.9, -1.0])
ACROSS = np.array([0.9, 0.9, -1.0])


def reach_arm() -> ArmModel:
    """A 3-joint arm (turn, lift, elbow) with links of 0.5 m: small enough to see what the planner must do."""
    turn, lift, elbow = np.eye(4), np.eye(4), np.eye(4)
    turn[2, 3] = 0.4
    lift[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]  # local x up, local z along y: positive angles lean forward
    elbow[0, 3] = 0.5
    along = np.linspace(0.05, 0.45, 6)
    centre = np.concatenate([[[0, 0, -0.2]], np.tile([[a, 0, 0] for a in along], (2, 1))])
    return ArmModel(
        base_from_joint=np.stack([turn, lift, elbow]),
        lower=np.array([-2.5, -1.2, -2.5]),
        upper=np.array([2.5, 1.6, 2.5]),
        sphere_centre=centre.astype(np.float64),
        sphere_radius=np.full(13, 0.05),
        sphere_frame=np.array([1] + [2] * 6 + [3] * 6),
        self_pairs=np.empty((0, 2), dtype=np.int64),
        tool_length=0.0,
    )


def wall() -> Boxes:
    """A wall ahead of the arm, in the way of turning low, free above."""
    return Boxes.one((0.7, 0.0, 0.3), (0.45, 0.02, 0.3))


@pytest.fixture(params=sorted(MOTION_PLANNERS))
def planner(request):  # type: ignore[no-untyped-def]
    return MOTION_PLANNERS[request.param]()


@pytest.fixture
def checker() -> CollisionChecker:
    return CollisionChecker(reach_arm(), wall())


def problem(checker, **change):  # type: ignore[no-untyped-def]
    return MotionProblem(**({"checker": checker, "start": LOW, "goals": ACROSS[None], "seed": 1} | change))


def test_the_wall_is_in_the_way(checker):  # type: ignore[no-untyped-def]
    assert checker.free(LOW)
    assert checker.free(ACROSS)
    assert not checker.edge(LOW, ACROSS)


def test_free_path_within_limits_for_many_seeds(planner, checker):  # type: ignore[no-untyped-def]
    for seed in range(20):
        result = planner.plan(problem(checker, seed=seed))
        assert result.status is MotionStatus.SOLVED
        np.testing.assert_allclose(result.path[0], LOW, atol=1e-12)
        np.testing.assert_allclose(result.path[-1], ACROSS, atol=1e-12)
        assert checker.path_free(result.path)
        assert checker.model.within_limits(result.path).all()
        assert 0 < result.iterations <= 20000
        assert result.length_rad < 3 * np.linalg.norm(ACROSS - LOW)


def test_straight_line_costs_no_iterations(planner):  # type: ignore[no-untyped-def]
    result = planner.plan(problem(CollisionChecker(reach_arm(), Boxes())))
    np.testing.assert_array_equal(result.path, [LOW, ACROSS])
    assert result.iterations == 0


def test_any_goal_will_do_and_invalid_ones_are_dropped(planner, checker):  # type: ignore[no-untyped-def]
    inside_wall = np.array([0.0, 0.9, -1.0])
    goals = np.stack([inside_wall, ACROSS, ACROSS + np.array([0.3, 0, 0])])
    result = planner.plan(problem(checker, goals=goals))
    assert result.solved
    assert np.linalg.norm(goals[1:] - result.path[-1], axis=1).min() < 1e-12


def test_start_is_a_goal(planner, checker):  # type: ignore[no-untyped-def]
    result = planner.plan(problem(checker, goals=LOW[None]))
    assert result.solved
    assert result.length_rad == 0.0


@pytest.mark.parametrize("bad", [np.array([0.0, 0.9, -1.0]), np.array([9.0, 0.0, 0.0])])
def test_invalid_ends_are_statuses(planner, checker, bad):  # type: ignore[no-untyped-def]
    start, goal = planner.plan(problem(checker, start=bad)), planner.plan(problem(checker, goals=bad[None]))
    assert start.status is MotionStatus.INVALID_START
    assert goal.status is MotionStatus.INVALID_GOAL
    assert start.path.shape == goal.path.shape == (0, 3)


def test_spent_budget_is_a_status(planner, checker):  # type: ignore[no-untyped-def]
    # A plane with a hole around the shoulder that is too small for the folded arm.
    sides = [Boxes.one((x, 0.0, 2.0), (0.7, 0.02, 2.0)) for x in (-1.0, 1.0)]
    closed = CollisionChecker(reach_arm(), Boxes.join(*sides, Boxes.one((0.0, 0.0, 2.6), (0.3, 0.02, 2.0))))
    result = planner.plan(problem(closed, max_iterations=300))
    assert result.status is MotionStatus.NO_SOLUTION
    assert result.iterations == 300
    assert planner.plan(problem(checker, max_iterations=0)).status is MotionStatus.NO_SOLUTION


def test_input_is_not_changed(planner, checker):  # type: ignore[no-untyped-def]
    start, goals = LOW.copy(), np.stack([ACROSS, LOW])
    planner.plan(problem(checker, start=start, goals=goals))
    np.testing.assert_array_equal(start, LOW)
    np.testing.assert_array_equal(goals, [ACROSS, LOW])


def test_same_seed_same_bytes_after_other_queries(planner, checker):  # type: ignore[no-untyped-def]
    first = planner.plan(problem(checker, seed=7)).path.tobytes()
    others = {planner.plan(problem(checker, seed=s)).path.tobytes() for s in range(4)}
    assert planner.plan(problem(checker, seed=7)).path.tobytes() == first
    assert len(others) > 1


@pytest.mark.parametrize("name", sorted(MOTION_PLANNERS))
def test_same_seed_same_bytes_in_another_process_and_silent(name, checker):  # type: ignore[no-untyped-def]
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r});"
        "from test_motion_planners import *; c = CollisionChecker(reach_arm(), wall());"
        f"print(MOTION_PLANNERS[{name!r}]().plan(problem(c, seed=7)).path.tobytes().hex(), flush=True)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout.strip() == MOTION_PLANNERS[name]().plan(problem(checker, seed=7)).path.tobytes().hex()
    assert [line for line in run.stderr.splitlines() if "nanobind" not in line and "leaked" not in line] == []


def test_malformed_problems_are_refused(checker):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="goals"):
        problem(checker, goals=np.empty((0, 3)))
    with pytest.raises(PlanningError, match="seed"):
        problem(checker, seed=-1)
    with pytest.raises(PlanningError, match="finite"):
        problem(checker, start=np.full(3, np.nan))
