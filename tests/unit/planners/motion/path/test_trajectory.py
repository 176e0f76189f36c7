"""Retiming: limits by finite differences, ends exact, corners cut by no more than stated."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.path.trajectory import retime

VELOCITY = np.radians([85, 85, 100, 75, 130, 135, 135])
ACCELERATION = np.full(7, 5.0)


def _random_path(k):  # type: ignore[no-untyped-def]
    return np.random.default_rng(k).uniform(-1.5, 1.5, (k, 7))


PATHS = {
    "line": np.stack([np.zeros(7), np.linspace(0.2, 1.5, 7)]),
    "one joint": np.stack([np.zeros(7), np.eye(7)[3]]),
    "three corners": _random_path(3),
    "ten corners": _random_path(10),
    "there and back": np.stack([np.zeros(7), np.ones(7), np.zeros(7)]),
    "tiny": np.stack([np.zeros(7), np.full(7, 1e-4)]),
    "short middle piece": np.stack([np.zeros(7), np.full(7, 0.5), np.full(7, 0.501), np.full(7, 0.6) - np.eye(7)[0]]),
    "dense": np.stack([np.sin(np.linspace(0, 2, 40) * f) for f in range(1, 8)], axis=1),
}


def _distance_to_path(points, path):  # type: ignore[no-untyped-def]
    best = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        u = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - u[:, None] * (b - a), axis=1))
    return best


@pytest.mark.parametrize("dt", [1 / 240, 1 / 60, 0.1])
@pytest.mark.parametrize("name", PATHS)
def test_limits_ends_and_deviation(name, dt):  # type: ignore[no-untyped-def]
    path = PATHS[name]
    motion = retime(path, VELOCITY, ACCELERATION, dt, max_deviation_rad=0.05, smoothing_s=0.08)
    rest = np.pad(motion.q, ((2, 2), (0, 0)), mode="edge")  # the arm rests before and after
    velocity = np.diff(rest, axis=0) / dt
    acceleration = np.diff(velocity, axis=0) / dt
    assert np.all(np.abs(velocity) <= VELOCITY * 1.001)
    assert np.all(np.abs(motion.qd) <= VELOCITY * 1.001)
    assert np.all(np.abs(acceleration) <= ACCELERATION * 1.01)
    np.testing.assert_array_equal(motion.q[[0, -1]], path[[0, -1]])
    np.testing.assert_array_equal(motion.qd[[0, -1]], 0.0)
    np.testing.assert_allclose(np.diff(motion.t), dt, rtol=1e-9)
    # the arcs, plus the averaging's a t^2 / 24 for seven joints
    assert _distance_to_path(motion.q, path).max() <= 0.05 + np.sqrt(7) * 5.0 * 0.08**2 / 24


@pytest.mark.parametrize("smoothing", [0.0, 0.08])
@pytest.mark.parametrize("deviation", [0.05, 0.5])
def test_joints_that_are_slow_but_strong_keep_their_limits_in_corners(deviation, smoothing):  # type: ignore[no-untyped-def]
    """Limits were kept where cells of an arc meet, and exceeded by up to 61 % inside them."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        path = np.cumsum(rng.normal(0.0, 0.4, (int(rng.integers(3, 7)), 3)), axis=0)
        velocity, acceleration = rng.uniform(0.1, 1.0, 3), rng.uniform(2.0, 10.0, 3)
        limits = {"max_deviation_rad": deviation, "smoothing_s": smoothing}
        motion = retime(path, velocity, acceleration, 1 / 240, **limits)
        assert np.all(np.abs(np.diff(motion.q, axis=0)) * 240 <= velocity * 1.001)
        assert np.all(np.abs(motion.qd) <= velocity * 1.001)
        # A joint that may be ten times as fast is never kept by its velocity: what is slower is slower for a reason.
        assert motion.duration_s >= retime(path, 10.0 * velocity, acceleration, 1 / 240, **limits).duration_s


def test_velocities_are_the_slope_of_the_positions():
    motion = retime(PATHS["three corners"], VELOCITY, ACCELERATION, 0.004)
    slope = (motion.q[2:] - motion.q[:-2]) / 0.008
    np.testing.assert_allclose(motion.qd[1:-1], slope, atol=0.01)


def test_jerk_is_bounded():
    dt = 1 / 250
    motion = retime(PATHS["ten corners"], VELOCITY, ACCELERATION, dt, smoothing_s=0.08)
    jerk = np.diff(np.pad(motion.q, ((3, 3), (0, 0)), mode="edge"), n=3, axis=0) / dt**3
    assert np.abs(jerk).max() <= 2 * 5.0 / 0.08 * 1.05


def test_a_line_takes_the_time_of_the_textbook():
    # One joint, 1 rad, 75 deg/s, 5 rad/s^2: d/v + v/a, plus the averaging window.
    motion = retime(PATHS["one joint"], VELOCITY, ACCELERATION, 0.001)
    speed = np.radians(75)
    assert motion.duration_s == pytest.approx(1 / speed + speed / 5.0 + 0.08, abs=0.01)


def test_corners_are_passed_without_stopping():
    path = np.stack([np.zeros(7), np.eye(7)[0], np.eye(7)[0] + np.eye(7)[1]])
    motion = retime(path, VELOCITY, ACCELERATION, 0.01)
    speed = np.linalg.norm(motion.qd, axis=1)
    assert speed[10:-10].min() > 0.3


def test_sample_interpolates_and_rests_outside():
    motion = retime(PATHS["line"], VELOCITY, ACCELERATION, 0.02)
    fine = retime(PATHS["line"], VELOCITY, ACCELERATION, 0.02)
    q, qd = motion.sample(float(motion.t[7]))
    np.testing.assert_allclose(q, fine.q[7], atol=1e-12)
    np.testing.assert_allclose(qd, fine.qd[7], atol=1e-9)
    before, after = motion.sample(-1.0), motion.sample(99.0)
    np.testing.assert_array_equal(before[0], PATHS["line"][0])
    np.testing.assert_array_equal(after[0], PATHS["line"][-1])
    np.testing.assert_array_equal(after[1], 0.0)
    middle = motion.sample(0.5 * float(motion.t[7] + motion.t[8]))[0]
    assert np.all((middle >= fine.q[7]) & (middle <= fine.q[8]))


def test_no_motion_is_one_sample():
    motion = retime(np.ones((3, 7)), VELOCITY, ACCELERATION, 0.01)
    assert motion.duration_s == 0.0
    np.testing.assert_array_equal(motion.sample(1.0)[0], np.ones(7))


def test_same_input_same_bytes():
    first, second = (retime(PATHS["ten corners"], VELOCITY, ACCELERATION, 0.01) for _ in range(2))
    assert first.q.tobytes() == second.q.tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_velocity": np.zeros(7)}, "max_velocity"),
        ({"max_acceleration": np.ones(6)}, "max_acceleration"),
        ({"dt_s": 0.0}, "dt_s"),
        ({"path": np.full((2, 7), np.nan)}, "finite"),
    ],
)
def test_malformed_input_is_named(change, message):  # type: ignore[no-untyped-def]
    arguments = {"path": PATHS["line"], "max_velocity": VELOCITY, "max_acceleration": ACCELERATION, "dt_s": 0.01}
    with pytest.raises(PlanningError, match=message):
        retime(**(arguments | change))


def test_pieces_of_rounding_errors_do_not_end_a_motion():
    """Lines to a tip end in pieces of 1e-8 rad at times; the speed there was found as zero, and a run broke off."""
    rng = np.random.default_rng(0)
    limits = np.full(7, 0.9), np.full(7, 3.0)
    for size in (1e-6, 1e-7, 2.4e-8, 3e-9):
        path = np.cumsum(rng.normal(size=(8, 7)) * 0.01, axis=0)
        pieces = path[-1] + np.cumsum(rng.normal(size=(2, 7)) * size / np.sqrt(7), axis=0)
        long = np.vstack((path, pieces))
        assert retime(long, *limits, 0.01).t[-1] == pytest.approx(retime(path, *limits, 0.01).t[-1], abs=0.05)
        assert retime(long[::-1], *limits, 0.01).t[-1] < 2.0
