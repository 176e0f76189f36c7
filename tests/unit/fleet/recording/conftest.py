"""A made-up site, and frames of cars that drive circles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from fleet.recording.frame import Frame, LogLine
from fleet.recording.header import DrawnFloor
from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.scene import Scene, StaticBox


def made_up_scene(n_cars: int, n_arms: int, size_m: tuple[float, float]) -> tuple[Scene, DrawnFloor]:
    """Walls around the floor, rows of shelves, arms along the lower and upper wall."""
    width, depth = size_m
    boxes = [
        StaticBox(kind="wall", centre_m=(width / 2, y, 0.25), half_m=(width / 2, 0.1, 0.25)) for y in (0.1, depth - 0.1)
    ] + [
        StaticBox(kind="wall", centre_m=(x, depth / 2, 0.25), half_m=(0.1, depth / 2, 0.25)) for x in (0.1, width - 0.1)
    ]
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
    floor = DrawnFloor(
        name="made_up", lanes=lanes, station_names=names, station_xy=arm_base[:, :2], dock_xy=docks,
        parking_xy=np.array([(0.7, y) for y in np.arange(3.5, depth - 3.0)]),
    )  # fmt: skip
    start = np.column_stack([np.linspace(1, width - 1, n_cars), np.full(n_cars, 2.5), np.zeros(n_cars)])
    arm = ARMS["iiwa"].spec()
    scene = Scene(
        size_m=size_m, boxes=tuple(boxes), car_kinds=(racecar_spec(),), car_start=start,
        arms=ArmTeam.alike(arm, n_arms), arm_base=arm_base, arm_start=np.tile(arm.home_rad, (n_arms, 1)),
    )  # fmt: skip
    return scene, floor


def made_up_frames(scene: Scene, n_frames: int, *, rate_hz: float = 30.0) -> Iterator[Frame]:
    """Car 0 stands at the first dock, the others lap; all carry a parcel, and one to three lie on pedestals."""
    n_cars, n_arms = len(scene.car_start), len(scene.arm_base)
    phase = 2 * math.pi * np.arange(n_cars) / n_cars
    for k in range(n_frames):
        t = k / rate_hz
        turn = 0.15 * t + phase
        poses = np.column_stack([_lap(scene, turn), _lap_heading(scene, turn)])
        poses[0] = scene.arm_base[0, 0] - scene.car.tray_x_m, scene.arm_base[0, 1] + 0.6, 0.0
        n_lying = 1 + int(t / 2) % 3
        parcels = np.zeros((n_cars + n_lying, 7))
        parcels[:n_cars, 0] = poses[:, 0] + scene.car.tray_x_m * np.cos(poses[:, 2])
        parcels[:n_cars, 1] = poses[:, 1] + scene.car.tray_x_m * np.sin(poses[:, 2])
        parcels[:n_cars, 2] = scene.car.tray_floor_z_m + 0.04
        pedestals = [box.centre_m for box in scene.boxes if box.kind == "pedestal"]
        parcels[n_cars:, :3] = np.add(pedestals[:n_lying], (0.0, 0.0, 0.165))
        parcels[:, 6] = 1.0
        replanned = k % 15 == 0
        done = int(t / 3)
        yield Frame(
            tick=2 * k,
            sim_s=t,
            car_poses=poses,
            car_steering=0.3 * np.sin(t + phase),
            car_speeds=np.full(n_cars, 1.0),
            arm_q=scene.arm_start + 0.3 * np.sin(0.7 * t + np.arange(n_arms)[:, None] + np.arange(7)),
            parcel_ids=np.arange(n_cars + n_lying),
            parcel_poses=parcels,
            parcel_size_m=np.full((n_cars + n_lying, 3), 0.08),
            car_state=tuple(CAR_WORDS[(int(t / 4) + i) % len(CAR_WORDS)] for i in range(n_cars)),
            arm_state=tuple(ARM_WORDS[(int(t / 3) + i) % len(ARM_WORDS)] for i in range(n_arms)),
            task_state={f"order_{i + 1}": TASK_WORDS[min(5, max(0, int(t / 1.5) - i))] for i in range(2 * n_cars)},
            task_counts={"ready": max(0, 2 * n_cars - done - 2), "carried": min(2, done), "delivered": done},
            paths=tuple(_lap(scene, x + np.linspace(0.0, 0.15, 10)) for x in turn) if replanned else None,
            plans=tuple(_lap(scene, x + np.linspace(0.15, 0.5, 10)) for x in turn) if replanned else None,
            plan_epoch=k // 15,
            metrics={"cars waiting": float(int(t) % 3), "arms busy": float(int(t * 0.7) % 3)},
        )


CAR_WORDS = ("driving empty", "traffic", "served", "idle")
ARM_WORDS = ("idle", "planning", "moving")
TASK_WORDS = ("ready", "assigned", "loading", "carried", "unloading", "delivered")


def _lap(scene: Scene, angle: np.ndarray) -> np.ndarray:
    width, depth = scene.size_m
    return np.column_stack(
        [width / 2 + (width / 2 - 1.5) * np.cos(angle), depth / 2 + (depth / 2 - 2.3) * np.sin(angle)]
    )


def _lap_heading(scene: Scene, angle: np.ndarray) -> np.ndarray:
    width, depth = scene.size_m
    return np.arctan2((depth / 2 - 2.3) * np.cos(angle), -(width / 2 - 1.5) * np.sin(angle))


def lines_of(frame: Frame) -> list[LogLine]:
    """A log line every two seconds."""
    if frame.tick % 120:
        return []
    return [LogLine(tick=frame.tick, sim_s=frame.sim_s, text=f"order_{frame.tick // 120 + 1} released", level="INFO")]


@pytest.fixture
def site() -> tuple[Scene, DrawnFloor]:
    """Three cars and four arms on 16 x 12 m."""
    return made_up_scene(3, 4, (16.0, 12.0))


@pytest.fixture
def frames(site: tuple[Scene, DrawnFloor]) -> Callable[[int], Iterator[Frame]]:
    """Frames at 30 Hz for that site."""
    return lambda n_frames: made_up_frames(site[0], n_frames)
