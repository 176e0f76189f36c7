"""Asynchronous motions: limits by finite differences, exact ends, nobody slower than the slowest joint must be."""

from __future__ import annotations

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.two_arms.asynchronous import asynchronous, least_times_s

VELOCITY = np.radians([85, 85, 100, 75, 130, 135, 135])
ACCELERATION = np.array((5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 8.0))
START = np.zeros(7)
GOAL = np.array([1.0, -0.05, 0.0, 2.0, -1e-7, 0.4, -2.5])


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("dt", [1 / 240, 0.01, 0.1])
def test_limits_ends_and_intervals(dt, late):  # type: ignore[no-untyped-def]
    motion = asynchronous(START, GOAL, VELOCITY, ACCELERATION, dt, late=late)
    rest = np.pad(motion.q, ((2, 2), (0, 0)), mode="edge")  # the arm rests before and after
    velocity = np.diff(rest, axis=0) / dt
    assert np.all(np.abs(velocity) <= VELOCITY * (1 + 1e-9))
    assert np.all(np.abs(np.diff(velocity, axis=0) / dt) <= ACCELERATION * (1 + 1e-6))
    np.testing.assert_array_equal(motion.q[[0, -1]], [START, GOAL])
    np.testing.assert_array_equal(motion.qd[[0, -1]], 0.0)
    low, high = np.minimum(START, GOAL), np.maximum(START, GOAL)
    assert np.all((motion.q >= low - 1e-12) & (motion.q <= high + 1e-12))
    np.testing.assert_allclose(np.gradient(motion.q, dt, axis=0)[1:-1], motion.qd[1:-1], atol=6.0 * dt)


def test_the_slowest_joint_takes_the_time_of_the_textbook():
    motion = asynchronous(START, GOAL, VELOCITY, ACCELERATION, 0.001)
    slowest_s = 2.0 / VELOCITY[3] + VELOCITY[3] / ACCELERATION[3]
    assert motion.duration_s == pytest.approx(slowest_s + 0.08, abs=0.001)


def test_joints_are_done_early_or_begin_late():
    early, late = (asynchronous(START, GOAL, VELOCITY, ACCELERATION, 0.01, late=late) for late in (False, True))
    # Joint 6 needs 0.53 s of 1.8 s.
    np.testing.assert_allclose(early.sample(0.6)[0][5], GOAL[5])
    np.testing.assert_allclose(late.sample(late.duration_s - 0.6)[0][5], START[5])
    assert late.duration_s == early.duration_s
    assert len(asynchronous(GOAL, GOAL, VELOCITY, ACCELERATION, 0.01).t) == 1


@pytest.mark.parametrize("late", [False, True])
def test_pushed_joints_lead_away_first_and_stay_inside_their_limits(late):  # type: ignore[no-untyped-def]
    push = np.array([-1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 1.0])
    motion = asynchronous(START, GOAL, VELOCITY, ACCELERATION, 0.01, late=late, push=push, push_s=0.25)
    rest = np.pad(motion.q, ((2, 2), (0, 0)), mode="edge")
    velocity = np.diff(rest, axis=0) / 0.01
    assert np.all(np.abs(velocity) <= VELOCITY * (1 + 1e-9))
    assert np.all(np.abs(np.diff(velocity, axis=0) / 0.01) <= ACCELERATION * (1 + 1e-6))
    np.testing.assert_array_equal(motion.q[[0, -1]], [START, GOAL])
    # Once the smoothing is over, a pushed joint is where its acceleration brings it.
    gone = (motion.q[::-1] - GOAL if late else motion.q - START)[20]
    np.testing.assert_allclose(gone[push != 0], (push * ACCELERATION * (0.16**2 + 0.08**2 / 12) / 2)[push != 0])
    # Joint 3 needs longest: it is pushed away from the goal, and, seen from there, to the start.
    plain_s = asynchronous(START, GOAL, VELOCITY, ACCELERATION, 0.01).duration_s
    assert motion.duration_s == plain_s if late else motion.duration_s > plain_s + 0.3


def test_least_times_agree_with_motions():
    rng = np.random.default_rng(0)
    q, others = rng.uniform(-2, 2, (20, 7)), rng.uniform(-2, 2, (15, 7))
    expected = [min(asynchronous(a, b, VELOCITY, ACCELERATION, 0.001).duration_s - 0.08 for b in others) for a in q]
    np.testing.assert_allclose(least_times_s(q, others, VELOCITY, ACCELERATION), expected, atol=1.1e-3)
    assert least_times_s(q[:1], q[:1], VELOCITY, ACCELERATION)[0] == 0.0


@pytest.mark.parametrize(
    "change",
    [
        {"goal": np.full(7, np.nan)},
        {"goal": np.zeros(6)},
        {"max_velocity": -VELOCITY},
        {"dt_s": 0.0},
        {"push": np.full(7, 0.5)},
    ],
)
def test_bad_input_is_named(change):  # type: ignore[no-untyped-def]
    arguments = {
        "start": START, "goal": GOAL, "max_velocity": VELOCITY, "max_acceleration": ACCELERATION, "dt_s": 0.01
    }  # fmt: skip
    with pytest.raises(PlanningError, match="asynchronous"):
        asynchronous(**(arguments | change))
