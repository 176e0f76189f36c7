"""The follower of speed and yaw rate: closed loops on the kinematic model with exact poses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fleet.robots.pursuit import PathBuffer
from fleet.robots.twist.follower import TwistFollower, shared
from fleet.robots.twist.husky import husky_spec
from fleet.robots.twist.motion import TwistMotion
from fleet.robots.twist.path import TURN_M_PER_RAD, Piece, arc, straight, turn

SPEC = husky_spec()
TICK_S = 1 / 60
Trace = tuple[np.ndarray, np.ndarray, TwistFollower, PathBuffer]


def follow(
    pieces: list[tuple[Piece, int]],
    *,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    stop_s: float = math.inf,
    cap: float = math.inf,
    time_s: float = 20.0,
) -> Trace:
    """Poses and commands tick by tick."""
    paths = PathBuffer(1)
    paths.reset(0, pieces[0][0][0][0])
    for (points, s), direction in pieces:
        paths.append(0, points, s, direction)
    motion = TwistMotion(SPEC, np.array([start]), TICK_S)
    follower = TwistFollower(SPEC.limits, 1, TICK_S)
    poses, commands = [], []
    for _ in range(round(time_s / TICK_S)):
        told = follower.commands(paths, motion.poses, motion.speeds, np.array([stop_s]), np.array([cap]))
        motion.step(told)
        poses.append(motion.poses[0].copy())
        commands.append(told[0])
    return np.array(poses), np.array(commands), follower, paths


def chain(*parts: tuple[str, float]) -> list[tuple[Piece, int]]:
    pose, pieces = np.zeros(3), []
    for kind, size in parts:
        piece = straight(pose, size) if kind == "go" else turn(pose, size) if kind == "turn" else arc(pose, 0.5, size)
        pieces.append((piece, 1))
        pose = piece[0][-1]
    return pieces


def test_it_stops_at_the_end_of_a_straight_and_keeps_the_limits() -> None:
    poses, commands, follower, _ = follow(chain(("go", 3.0)), time_s=8.0)
    np.testing.assert_allclose(poses[-1], [3.0, 0.0, 0.0], atol=0.004)
    assert follower.standing[0]
    assert commands[-1].tolist() == [0.0, 0.0]
    limits = SPEC.limits
    assert commands[:, 0].max() == pytest.approx(limits.max_speed_mps)
    assert np.diff(commands[:, 0]).max() <= limits.max_accel_mps2 * TICK_S + 1e-9
    assert np.diff(commands[:, 0]).min() >= -limits.max_brake_mps2 * TICK_S - 1e-9


def test_curves_are_driven_as_fast_as_the_outer_wheels_can() -> None:
    poses, commands, _, _ = follow(chain(("go", 2.0), ("arc", math.pi), ("go", 2.0)))
    middle = (poses[:, 0] > 2.1) & (poses[:, 1] > 0.2) & (poses[:, 1] < 0.8)
    # |v| (1 + lever / radius) = 1 m/s
    assert commands[middle, 0].mean() == pytest.approx(1.0 / (1.0 + SPEC.limits.lever_m / 0.5), rel=0.05)
    centre = np.array([2.0, 0.5])
    np.testing.assert_allclose(np.hypot(*(poses[middle, :2] - centre).T), 0.5, atol=0.01)


def test_no_command_asks_rims_for_more_than_they_can() -> None:
    _, commands, _, _ = follow(
        chain(("go", 1.0), ("arc", 1.5), ("arc", -1.5), ("turn", 2.0), ("go", 0.5), ("turn", -3.0))
    )
    limits = SPEC.limits
    rims = np.abs(commands[:, 0]) + limits.lever_m * np.abs(commands[:, 1])
    assert rims.max() <= limits.max_rim_mps + 1e-9
    assert rims.max() > 0.95 * limits.max_rim_mps
    assert np.abs(np.diff(commands[:, 1])).max() <= limits.max_yaw_accel_radps2 * TICK_S + 1e-9


@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi / 2, 3.0, -3.1, math.pi, -4.0])
def test_it_turns_on_the_spot_the_way_the_path_says(angle: float) -> None:
    poses, _, follower, paths = follow(chain(("go", 1.0), ("turn", angle), ("go", 1.0)), time_s=12.0)
    np.testing.assert_allclose(poses[-1], [1.0 + math.cos(angle), math.sin(angle), angle], atol=0.02)
    turned = poses[:, 2]
    assert (turned.min() >= -0.05) if angle > 0 else (turned.max() <= 0.05)
    assert follower.progress[0] == pytest.approx(paths.end_s(0), abs=0.003)


def test_a_stop_may_lie_in_a_turn() -> None:
    stop_s = 1.0 + TURN_M_PER_RAD * 1.0
    poses, commands, follower, _ = follow(chain(("go", 1.0), ("turn", 2.0), ("go", 1.0)), stop_s=stop_s, time_s=8.0)
    assert poses[-1, 2] == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(poses[-1, :2], [1.0, 0.0], atol=0.01)
    assert follower.standing[0]
    assert commands[-1].tolist() == [0.0, 0.0]


def test_a_robot_that_is_pushed_while_it_turns_is_off_its_path_by_how_far_it_is_from_the_spot() -> None:
    _, _, follower, _ = follow(chain(("turn", 2.0)), start=(0.3, 0.4, 0.0), time_s=TICK_S)
    assert follower.cross_track[0] == pytest.approx(0.5)


def test_a_robot_beside_its_spot_that_is_told_to_stand_stands() -> None:
    poses, commands, _, _ = follow(chain(("turn", 2.0)), start=(0.3, 0.0, 0.0), cap=0.0, time_s=1.0)
    assert not commands.any()
    np.testing.assert_array_equal(poses[-1], [0.3, 0.0, 0.0])


def test_it_drives_in_reverse_and_errors_die_out_there_too() -> None:
    points, s = straight(np.zeros(3), 3.0)
    back = points.copy()
    back[:, :2] *= -1.0
    poses, _, _, _ = follow([((back, s), -1)], start=(0.0, 0.08, 0.1), time_s=10.0)
    np.testing.assert_allclose(poses[-1], [-3.0, 0.0, 0.0], atol=0.01)


def test_an_error_of_place_dies_out_without_overshoot() -> None:
    poses, _, _, _ = follow(chain(("go", 4.0)), start=(0.0, 0.1, 0.0), time_s=3.5)
    assert poses[:, 1].min() > -0.01
    assert abs(poses[poses[:, 0] > 1.5, 1]).max() < 0.01


def test_the_cap_is_kept_and_a_path_of_one_point_is_stood_on() -> None:
    _, commands, _, _ = follow(chain(("go", 2.0)), cap=0.3, time_s=4.0)
    assert commands[:, 0].max() == pytest.approx(0.3)
    paths = PathBuffer(1)
    paths.reset(0, np.zeros(3))
    follower = TwistFollower(SPEC.limits, 1, TICK_S)
    one = np.ones(1)
    assert not follower.commands(paths, np.zeros((1, 3)), np.zeros(1), 9 * one, one).any()
    assert follower.standing[0]


def test_a_command_beyond_the_limits_keeps_its_curve() -> None:
    factor = shared(1.0, 2.0, 2.0, 1.0, 0.5)
    assert factor == pytest.approx(0.5)
    assert shared(0.2, -4.0, 2.0, 9.0, 0.5) == pytest.approx(0.5)
    assert shared(0.2, 0.1, 2.0, 1.0, 0.5) == 1.0


def test_the_model_goes_round_a_circle_exactly() -> None:
    exact = replace(SPEC, response=replace(SPEC.response, speed_gain=1.0, speed_lag_s=0.0, yaw_gain=1.0, yaw_lag_s=0.0))
    motion = TwistMotion(exact, np.zeros((1, 3)), TICK_S)
    for _ in range(60):  # it has come to speed
        motion.step(np.array([[0.4, 0.8]]))
    start = motion.poses[0].copy()
    for _ in range(round(2 * math.pi / 0.8 / TICK_S)):
        motion.step(np.array([[0.4, 0.8]]))
    np.testing.assert_allclose(motion.poses[0, :2], start[:2], atol=0.01)
    assert motion.poses[0, 2] - start[2] == pytest.approx(2 * math.pi, abs=0.02)
    saved = motion.save()
    motion.push(0, 1.0, 0.0, 0.5)
    motion.put(0, np.array([5.0, 5.0, 0.0]))
    assert motion.speeds[0] == 0.0
    motion.load(saved)
    np.testing.assert_array_equal(motion.poses, saved[0])


def test_the_model_cuts_commands_and_changes_no_faster_than_its_limits() -> None:
    motion = TwistMotion(SPEC, np.zeros((1, 3)), TICK_S)
    before = 0.0
    for _ in range(120):
        motion.step(np.array([[5.0, 0.0]]))
        assert motion.speeds[0] - before <= SPEC.limits.max_accel_mps2 * TICK_S + 1e-12
        before = motion.speeds[0]
    assert motion.speeds[0] == pytest.approx(SPEC.limits.max_speed_mps * SPEC.response.speed_gain, rel=1e-3)
