"""Path buffer and follower: closed loops on the bicycle model, judged by brute-force distance to the path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.estimator import PoseEstimator
from fleet.robots.pursuit import FIRST_CAPACITY, Follower, PathBuffer, PathError
from fleet.world.kinematic import BicycleCars

FloatArray = npt.NDArray[np.float64]

SPEC = racecar_spec()
LEFT, RIGHT = (0.4 * math.pi / 2, 2.5), (0.4 * math.pi / 2, -2.5)
LANES = {
    "straight": [(4.0, 0.0)],
    "short hop": [(0.3, 0.0)],
    "left": [(1.0, 0.0), LEFT, (1.0, 0.0)],
    "right": [(1.0, 0.0), RIGHT, (1.0, 0.0)],
    "hairpin": [(1.0, 0.0), LEFT, (0.2, 0.0), LEFT, (1.0, 0.0)],
    "s-bend": [(1.0, 0.0), LEFT, (0.2, 0.0), RIGHT, (1.0, 0.0)],
}


def piece(start: FloatArray, length_m: float, curvature: float, step_m: float = 0.05) -> tuple[FloatArray, FloatArray]:
    """Sample an arc from a pose; a negative length is driven in reverse."""
    n = max(1, math.ceil(abs(length_m) / step_m))
    poses = [np.array(start, dtype=np.float64)]
    for _ in range(n):
        x, y, yaw = poses[-1]
        d = length_m / n
        turn = curvature * d
        chord = d if turn == 0.0 else 2.0 * math.sin(turn / 2.0) / curvature
        poses.append(np.array([x + chord * math.cos(yaw + turn / 2), y + chord * math.sin(yaw + turn / 2), yaw + turn]))
    return np.array(poses), np.linspace(0.0, abs(length_m), n + 1)


def lay(paths: PathBuffer, car: int, parts: list[tuple[float, float]]) -> FloatArray:
    """Append parts (length, curvature) to a car's path; returns all poses finely sampled."""
    pose = paths.points[car, paths.count[car] - 1].copy()
    fine = [pose[None]]
    for length_m, curvature in parts:
        points, s = piece(pose, length_m, curvature)
        paths.append(car, points, s, 1 if length_m > 0 else -1)
        fine.append(piece(pose, length_m, curvature, 0.002)[0])
        pose = points[-1]
    return np.concatenate(fine)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What happened on a closed-loop drive; rows are ticks."""

    poses: FloatArray
    speeds: FloatArray
    steering: FloatArray
    commands: FloatArray
    cross_track_m: float
    end_error_m: FloatArray
    tick_s: float
    stood: bool


def drive(
    parts: list[tuple[float, float]], *, tick_s: float, cap_mps: float = 1.0, noisy: bool = True, n_cars: int = 6
) -> Drive:
    """Drive some cars, differing in their noise, along the same path until all stand."""
    paths, follower = PathBuffer(n_cars), Follower(CarModels.alike(SPEC, n_cars), tick_s)
    fine = np.array([lay(paths, car, parts) for car in range(n_cars)])[0]
    cars = BicycleCars(CarModels.alike(SPEC, n_cars), np.zeros((n_cars, 3)), tick_s, 0.0125)
    rng = np.random.default_rng(7)
    estimator = PoseEstimator(CarModels.alike(SPEC, n_cars), tick_s, rng=rng)
    if not noisy:
        estimator = PoseEstimator(
            CarModels.alike(SPEC, n_cars), tick_s, noise_m=0.0, noise_rad=0.0, latency_ticks=0, rng=rng
        )
    stop_s = np.array([paths.end_s(car) for car in range(n_cars)])
    log: list[tuple[FloatArray, ...]] = []
    for _ in range(int(30.0 / tick_s)):
        estimate = estimator.update(cars.poses.copy(), cars.speeds, cars.steering)
        commands = follower.commands(paths, estimate, cars.speeds, stop_s, np.full(n_cars, cap_mps))
        cars.step(commands)
        log.append((cars.poses.copy(), cars.speeds.copy(), cars.steering.copy(), commands))
        if follower.standing.all() and np.all(cars.speeds == 0.0):
            break
    poses, speeds, steering, commands = (np.array(rows) for rows in zip(*log, strict=True))
    flat = poses[:, :, :2].reshape(-1, 2)
    off = np.array([np.min(np.hypot(*(fine[:, :2] - point).T)) for point in flat[::2]])
    return Drive(
        poses=poses,
        speeds=speeds,
        steering=steering,
        commands=commands,
        cross_track_m=float(off.max()),
        end_error_m=np.hypot(*(cars.poses[:, :2] - fine[-1, :2]).T),
        tick_s=tick_s,
        stood=bool(follower.standing.all()),
    )


@pytest.mark.parametrize("tick_s", [1 / 60, 0.05])
@pytest.mark.parametrize("lane", LANES)
def test_noisy_car_keeps_its_lane_and_stops_at_its_end(lane: str, tick_s: float) -> None:
    result = drive(LANES[lane], tick_s=tick_s)
    assert result.stood
    assert result.cross_track_m <= 0.04
    assert result.end_error_m.max() <= 0.01
    assert np.all(result.commands[-1, :, 1] == 0.0)


@pytest.mark.parametrize("lane", ["straight", "hairpin", "s-bend"])
def test_exact_pose_gives_a_tight_track(lane: str) -> None:
    result = drive(LANES[lane], tick_s=0.05, noisy=False, n_cars=1)
    assert result.cross_track_m <= 0.015
    assert result.end_error_m[0] <= 0.004


def test_commands_respect_the_limits_of_the_car() -> None:
    result = drive(LANES["s-bend"], tick_s=0.05, cap_mps=1.5)
    assert np.abs(result.commands[:, :, 0]).max() <= SPEC.max_steering_rad
    assert np.abs(np.diff(result.commands[:, :, 0], axis=0)).max() <= SPEC.max_steering_rate_radps * 0.05 + 1e-9
    change = np.diff(result.speeds, axis=0) / 0.05
    assert change.max() <= SPEC.max_accel_mps2 + 1e-9
    assert change.min() >= -SPEC.max_brake_mps2 - 1e-9
    assert result.speeds.max() <= 1.5 + 1e-9
    assert result.speeds.min() >= 0.0


def test_curves_are_taken_slower_than_the_cap() -> None:
    result = drive(LANES["left"], tick_s=0.05, cap_mps=1.8, noisy=False, n_cars=1)
    turning = np.abs(result.steering[:, 0]) > 0.6
    assert result.speeds[turning, 0].max() == pytest.approx(math.sqrt(2.6 * 0.4), abs=0.05)
    assert result.speeds[:, 0].max() > 1.2


def test_straight_drive_is_nearly_as_fast_as_the_limits_allow() -> None:
    result = drive([(4.0, 0.0)], tick_s=0.05, noisy=False, n_cars=1)
    fastest_s = 4.0 / 1.0 + 0.5 / SPEC.max_accel_mps2 + 0.5 / SPEC.max_brake_mps2
    assert len(result.poses) * 0.05 <= fastest_s + 1.0


def test_reverse_piece_after_a_cusp() -> None:
    parts = [(0.8, 0.0), (-0.6, 2.0), (-0.4, 0.0), (0.5, -1.0)]
    result = drive(parts, tick_s=0.05)
    assert result.stood
    assert result.speeds.min() < -0.2
    assert result.cross_track_m <= 0.04
    assert result.end_error_m.max() <= 0.02


def test_stop_before_the_end_then_go_on() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(3.0, 0.0)])
    cars = BicycleCars(CarModels.alike(SPEC, 1), np.zeros((1, 3)), 0.05, 0.0125)
    for stop_m in (1.2, 3.0):
        for _ in range(120):
            commands = follower.commands(paths, cars.poses, cars.speeds, np.array([stop_m]), np.array([1.0]))
            cars.step(commands)
        assert cars.poses[0, 0] == pytest.approx(stop_m, abs=0.005)
        assert commands[0, 1] == 0.0
        assert follower.progress[0] == pytest.approx(stop_m, abs=0.005)


def test_a_braked_car_stands_though_it_is_measured_a_little_off_its_stop() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(1.0, 0.0)])

    def command_mps(x_m: float) -> float:
        poses, stop_m = np.array([[x_m, 0.0, 0.0]]), np.array([1.0])
        return float(follower.commands(paths, poses, np.zeros(1), stop_m, np.array([1.0]))[0, 1])

    assert command_mps(0.9) > 0.0
    follower.braked[:] = True
    assert command_mps(0.9) > 0.0, "it has not come to its stop yet"
    assert command_mps(1.0) == 0.0
    assert command_mps(0.9) == 0.0
    assert command_mps(0.7) > 0.0, "it was pushed"
    assert command_mps(1.0) == 0.0
    follower.braked[:] = False
    assert command_mps(0.9) > 0.0


def test_cap_of_zero_brakes_to_a_stand() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(5.0, 0.0)])
    cars = BicycleCars(CarModels.alike(SPEC, 1), np.zeros((1, 3)), 0.05, 0.0125)
    marks = []
    for cap_mps in (1.0, 0.0):
        for _ in range(40):
            cars.step(follower.commands(paths, cars.poses, cars.speeds, np.array([5.0]), np.array([cap_mps])))
        marks.append(cars.poses[0, 0])
    assert cars.speeds[0] == 0.0
    assert marks[1] - marks[0] <= 0.5 / SPEC.max_brake_mps2 + 0.06


def test_path_appended_while_driving_is_followed_without_a_stop() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(1.0, 0.0)])
    cars = BicycleCars(CarModels.alike(SPEC, 1), np.zeros((1, 3)), 0.05, 0.0125)
    slowest, laid = math.inf, 1
    for _ in range(600):
        if paths.end_s(0) - follower.progress[0] < 2.0 and laid < 20:
            lay(paths, 0, [LEFT if laid % 2 else (1.0, 0.0)])
            laid += 1
        cars.step(follower.commands(paths, cars.poses, cars.speeds, np.array([paths.end_s(0)]), np.array([1.0])))
        if 1.0 < follower.progress[0] < 10.0:
            slowest = min(slowest, cars.speeds[0])
    assert slowest > 0.9
    assert follower.progress[0] == pytest.approx(paths.end_s(0), abs=0.005)
    assert abs(follower.cross_track[0]) < 0.01


def test_offset_car_reports_signed_errors_and_returns() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(4.0, 0.0)])
    cars = BicycleCars(CarModels.alike(SPEC, 1), np.array([[0.0, 0.1, 0.2]]), 0.05, 0.0125)
    errors = []
    for _ in range(150):
        cars.step(follower.commands(paths, cars.poses, cars.speeds, np.array([4.0]), np.array([1.0])))
        errors.append((follower.cross_track[0], follower.heading_error[0]))
    assert errors[0] == pytest.approx((0.1, 0.2))
    assert np.abs(errors[-1]).max() < 0.01


def test_buffer_trims_by_itself_and_grows_for_one_long_path() -> None:
    paths = PathBuffer(2)
    lay(paths, 0, [(60.0, 0.0)])
    assert paths.points.shape[1] > FIRST_CAPACITY
    assert paths.end_s(0) == pytest.approx(60.0)
    assert paths.end_s(1) == 0.0

    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    for lap in range(20):
        lay(paths, 0, [(5.0, 0.0)])
        pose = np.array([[5.0 * lap + 4.5, 0.0, 0.0]])
        follower.commands(paths, pose, np.ones(1), np.array([1e3]), np.ones(1))
    assert paths.points.shape[1] == FIRST_CAPACITY
    assert paths.end_s(0) == pytest.approx(100.0)
    assert follower.progress[0] == pytest.approx(99.5)


def test_reset_goes_on_counting_from_the_progress_made() -> None:
    paths, follower = PathBuffer(1), Follower(CarModels.alike(SPEC, 1), 0.05)
    lay(paths, 0, [(3.0, 0.0)])
    follower.commands(paths, np.array([[2.0, 0.0, 0.0]]), np.ones(1), np.array([3.0]), np.ones(1))
    paths.reset(0, np.array([2.0, 0.5, 1.0]))
    follower.reset(0)
    assert paths.end_s(0) == pytest.approx(2.0)
    commands = follower.commands(paths, np.array([[2.0, 0.5, 1.0]]), np.zeros(1), np.array([2.0]), np.ones(1))
    assert commands[0, 1] == 0.0
    assert follower.cross_track[0] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("points", "s"),
    [([[1.0, 0, 0], [2.0, 0, 0]], [0.0, 1.0]), ([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]], [0.0, 1.0, 1.0])],
    ids=["gap", "no progress"],
)
def test_bad_piece_is_refused(points: list[list[float]], s: list[float]) -> None:
    with pytest.raises(PathError, match="path of car 0"):
        PathBuffer(1).append(0, np.array(points), np.array(s))
