"""A made-up site, stand-in robots with the stock meshes, and frames of cars that drive circles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from fleet.recording.frame import FloorPlan, Frame, LogLine
from fleet.robots.spec import ArmSpec, CarSpec, Visual
from fleet.world.scene import Scene, StaticBox

DATA = Path(pybullet_data.getDataPath())
WHITE, BLUE, ORANGE, DARK = (0.9, 0.9, 0.9, 1.0), (0.35, 0.45, 0.6, 1.0), (0.95, 0.5, 0.15, 1.0), (0.12, 0.12, 0.13, 1.0)


def _turned(axis: int, angle: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """A transform that turns about a coordinate axis and shifts."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(4)
    matrix[i, i] = matrix[j, j] = math.cos(angle)
    matrix[j, i], matrix[i, j] = math.sin(angle), -math.sin(angle)
    matrix[:3, 3] = offset
    return matrix


def _visual(link: str, mesh: str | None, matrix: np.ndarray, rgba: tuple[float, ...], size: tuple = (0, 0, 0)) -> Visual:
    return Visual(link=link, mesh=None if mesh is None else DATA / mesh, size_m=size, link_from_visual=matrix, rgba=rgba)


def stand_in_car() -> CarSpec:
    """The stock racecar's meshes with a tray of five boxes."""
    wheel = _turned(0, math.pi / 2)
    visuals = [_visual("chassis", "racecar/meshes/chassis.STL", _turned(0, 0, (0, 0, 0.05)), BLUE)]
    for link, mesh in (("rear_left", "left_rear"), ("rear_right", "right_rear"), ("front_left", "left_front"), ("front_right", "right_front")):
        visuals.append(_visual(link, f"racecar/meshes/{mesh}_wheel.obj", wheel, DARK))
    visuals.append(_visual("tray", None, _turned(0, 0, (0.16, 0, 0.175)), DARK, (0.31, 0.23, 0.005)))
    for x, y, size in ((0.3125, 0, (0.005, 0.23, 0.07)), (0.0075, 0, (0.005, 0.23, 0.07)), (0.16, 0.1125, (0.31, 0.005, 0.07)), (0.16, -0.1125, (0.31, 0.005, 0.07))):
        visuals.append(_visual("tray", None, _turned(0, 0, (x, y, 0.21)), WHITE, size))
    return CarSpec(
        name="racecar", wheelbase_m=0.325, track_m=0.2, wheel_radius_m=0.05, front_m=0.41, rear_m=0.09,
        half_width_m=0.14, height_m=0.25, max_speed_mps=1.5, max_accel_mps2=1.0, max_brake_mps2=2.0,
        max_steering_rad=0.6, max_steering_rate_radps=3.0, tray_x_m=0.16, tray_floor_z_m=0.18,
        tray_size_m=(0.3, 0.22, 0.07), tray_wall_m=0.005, max_payload_kg=2.0, visuals=tuple(visuals),
    )  # fmt: skip


def stand_in_arm() -> ArmSpec:
    """The iiwa of pybullet_data (kuka_iiwa/model.urdf) with a rod as its tool."""
    half, pi = math.pi / 2, math.pi
    fixed = [
        _turned(0, 0, (0, 0, 0.1575)),
        _turned(0, half, (0, 0, 0.2025)) @ _turned(1, pi),
        _turned(0, half, (0, 0.2045, 0)) @ _turned(1, pi),
        _turned(0, half, (0, 0, 0.2155)),
        _turned(1, pi, (0, 0.1845, 0)) @ _turned(0, -half),
        _turned(0, half, (0, 0, 0.2155)),
        _turned(1, pi, (0, 0.081, 0)) @ _turned(0, -half),
    ]
    fixed[1] = _rpy(half, 0, pi, (0, 0, 0.2025))
    fixed[2] = _rpy(half, 0, pi, (0, 0.2045, 0))
    fixed[4] = _rpy(-half, pi, 0, (0, 0.1845, 0))
    fixed[6] = _rpy(-half, pi, 0, (0, 0.081, 0))
    visuals = [
        _visual(f"link_{k}", f"kuka_iiwa/meshes/link_{k}.obj", np.eye(4), ORANGE if k in (3, 5) else WHITE)
        for k in range(8)
    ]
    visuals.append(_visual("tool", None, _turned(0, 0, (0, 0, 0.12)), DARK, (0.03, 0.03, 0.15)))
    limit = np.full(7, 2.0)
    return ArmSpec(
        name="iiwa14", n_joints=7, urdf=DATA / "kuka_iiwa/model.urdf", base_from_joint=np.array(fixed),
        lower_rad=-limit, upper_rad=limit, max_velocity_radps=limit, max_acceleration_radps2=limit, max_torque_nm=limit,
        tool_length_m=0.2, home_rad=np.zeros(7), visuals=tuple(visuals),
    )  # fmt: skip


def _rpy(roll: float, pitch: float, yaw: float, offset: tuple[float, float, float]) -> np.ndarray:
    matrix = _turned(2, yaw) @ _turned(1, pitch) @ _turned(0, roll)
    matrix[:3, 3] = offset
    return matrix


def made_up_scene(n_cars: int, n_arms: int, size_m: tuple[float, float]) -> tuple[Scene, FloorPlan]:
    """Walls around the floor, rows of shelves, arms along the lower and upper wall."""
    width, depth = size_m
    boxes = [
        StaticBox(kind="wall", centre_m=(width / 2, y, 0.25), half_m=(width / 2, 0.1, 0.25)) for y in (0.1, depth - 0.1)
    ] + [StaticBox(kind="wall", centre_m=(x, depth / 2, 0.25), half_m=(0.1, depth / 2, 0.25)) for x in (0.1, width - 0.1)]
    for x in np.arange(3.0, width - 4.0, 4.0):
        for y in np.arange(4.0, depth - 3.5, 2.0):
            boxes.append(StaticBox(kind="shelf", centre_m=(x + 1.5, y + 0.5, 0.4), half_m=(1.5, 0.5, 0.4)))
    arm_base = np.array(
        [
            (x, 1.1 if k % 2 == 0 else depth - 1.1, 0.0, math.pi / 2 if k % 2 == 0 else -math.pi / 2)
            for k, x in enumerate(np.repeat(np.linspace(3.0, width - 3.0, (n_arms + 1) // 2), 2)[:n_arms])
        ]
    )
    for x, y, _, yaw in arm_base:
        for angle in (115, 155, -155, -115):
            at = yaw + math.radians(angle)
            centre = (x + 0.45 * math.cos(at), y + 0.45 * math.sin(at), 0.125)
            boxes.append(StaticBox(kind="pedestal", centre_m=centre, half_m=(0.08, 0.08, 0.125)))
    rows = np.arange(2.5, depth - 2.0, 1.0)
    lanes = np.array([[(x, y), (x + 1, y)] for k, y in enumerate(rows) for x in np.arange(0.5, width - 1.5)])
    names = tuple(f"{'pick' if k % 2 == 0 else 'drop'}_{k // 2 + 1}" for k in range(n_arms))
    docks = arm_base[:, :2] + np.column_stack([np.zeros(n_arms), 0.6 * np.sin(arm_base[:, 3])])
    floor = FloorPlan(
        name="made_up", lanes=lanes, station_names=names, station_xy=arm_base[:, :2], dock_xy=docks,
        parking_xy=np.array([(0.7, y) for y in np.arange(3.5, depth - 3.0)]),
    )  # fmt: skip
    start = np.column_stack([np.linspace(1, width - 1, n_cars), np.full(n_cars, 2.5), np.zeros(n_cars)])
    arm = stand_in_arm()
    scene = Scene(
        size_m=size_m, boxes=tuple(boxes), car=stand_in_car(), car_start=start, arm=arm, arm_base=arm_base,
        arm_start=np.zeros((n_arms, 7)),
    )  # fmt: skip
    return scene, floor


def made_up_frames(scene: Scene, n_frames: int, *, rate_hz: float = 30.0) -> Iterator[Frame]:
    """Cars lap between the shelves; every car carries a parcel, and one more lies on a pedestal every 2 s."""
    n_cars, n_arms = len(scene.car_start), len(scene.arm_base)
    width, depth = scene.size_m
    phase = 2 * math.pi * np.arange(n_cars) / n_cars
    words = ("driving", "waiting", "docked", "idle")
    jobs = ("idle", "planning", "moving")
    for k in range(n_frames):
        t = k / rate_hz
        turn = 0.15 * t + phase
        a, b = width / 2 - 1.5, depth / 2 - 2.3
        poses = np.column_stack(
            [width / 2 + a * np.cos(turn), depth / 2 + b * np.sin(turn), np.arctan2(b * np.cos(turn), -a * np.sin(turn))]
        )
        n_parcels = n_cars + 1 + int(t / 2) % 3
        lying = scene.arm_base[np.arange(n_parcels - n_cars) % n_arms, :2] + (0.0, 0.45)
        parcels = np.zeros((n_parcels, 7))
        parcels[:n_cars, 0] = poses[:, 0] + 0.16 * np.cos(poses[:, 2])
        parcels[:n_cars, 1] = poses[:, 1] + 0.16 * np.sin(poses[:, 2])
        parcels[:n_cars, 2] = 0.22
        parcels[n_cars:, :2], parcels[n_cars:, 2], parcels[:, 6] = lying, 0.29, 1.0
        changed = k % 15 == 0
        ahead = [np.column_stack([width / 2 + a * np.cos(x + s), depth / 2 + b * np.sin(x + s)]) for x in turn for s in (np.linspace(0, 0.15, 10),)]
        beyond = [np.column_stack([width / 2 + a * np.cos(x + s), depth / 2 + b * np.sin(x + s)]) for x in turn for s in (np.linspace(0.15, 0.5, 10),)]
        done = int(t / 3)
        yield Frame(
            tick=2 * k, sim_s=t, car_poses=poses, car_steering=0.3 * np.sin(t + phase), wheel_angle=np.full(n_cars, 20 * t),
            arm_q=0.8 * np.sin(0.7 * t + np.arange(n_arms)[:, None] + np.arange(7)), parcel_ids=np.arange(n_parcels),
            parcel_poses=parcels, parcel_size_m=np.full((n_parcels, 3), 0.08),
            car_state=tuple(words[(int(t / 2) + i) % 4] for i in range(n_cars)),
            arm_state=tuple(jobs[(int(t) + i) % 3] for i in range(n_arms)),
            task_state={f"order_{i + 1}": ("ready", "assigned", "loading", "carried", "unloading", "delivered")[min(5, max(0, int(t / 1.5) - i))] for i in range(2 * n_cars)},
            task_counts={"ready": max(0, 2 * n_cars - done - 2), "carried": min(2, done), "delivered": done},
            paths=tuple(ahead) if changed else None, plans=tuple(beyond) if changed else None, plan_epoch=k // 15,
            metrics={"cars waiting": float(int(t) % 3), "arms busy": float(int(t * 0.7) % 3), "cars moving": 3.0 + math.sin(t)},
        )  # fmt: skip


def lines_of(frame: Frame) -> list[LogLine]:
    """A log line every two seconds."""
    if frame.tick % 120:
        return []
    return [LogLine(tick=frame.tick, sim_s=frame.sim_s, text=f"order_{frame.tick // 120 + 1} released", level="INFO")]


@pytest.fixture
def site() -> tuple[Scene, FloorPlan]:
    """Three cars and four arms on 16 x 12 m."""
    return made_up_scene(3, 4, (16.0, 12.0))


@pytest.fixture
def frames(site: tuple[Scene, FloorPlan]) -> Callable[[int], Iterator[Frame]]:
    """Frames at 30 Hz for that site."""
    return lambda n_frames: made_up_frames(site[0], n_frames)
