"""RunDrawing: a run seen from above, as a picture in an array."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.simulation import Simulation
from planners.motion.arm.kinematics import link_frames

Picture = npt.NDArray[np.uint8]

WIDTH_PX = 720
"""Longer side of the largest picture."""
MAX_SCALE_PX = 48
"""Pixels per metre of a small site."""
ARM_M = 0.05
"""Half width of an arm's links as drawn [m]."""

Colour = tuple[int, int, int]

FLOOR, PATH, GOAL = (244, 244, 240), (200, 200, 192), (120, 190, 120)
BOXES = {"wall": (90, 90, 96), "shelf": (150, 140, 128), "pedestal": (196, 186, 170), "stand": (196, 186, 170)}
CAR, TRAY, ARM, PARCEL = (40, 110, 190), (180, 210, 240), (225, 120, 30), (120, 80, 40)


class RunDrawing:
    """Draws a run; what never moves is drawn once.

    Args:
        simulation: The run.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        width_m, height_m = simulation.scene.size_m
        self._scale = max(8, min(MAX_SCALE_PX, int(WIDTH_PX / max(width_m, height_m))))
        shape = (math.ceil(height_m * self._scale), math.ceil(width_m * self._scale), 3)
        self._background = np.empty(shape, dtype=np.uint8)
        self._background[:] = FLOOR
        for box in simulation.scene.boxes:
            self._box(self._background, (*box.centre_m[:2], 0.0), box.half_m[:2], BOXES[box.kind])

    def picture(self) -> Picture:
        """The run now, north up, shape (height, width, 3)."""
        simulation = self._simulation
        world, models = simulation.world, simulation.scene.cars
        image = self._background.copy()
        poses = world.car_poses()
        for car, pose in enumerate(poses):
            spec = models[car]
            body = ((spec.front_m - spec.rear_m) / 2, (spec.front_m + spec.rear_m) / 2)
            self._dots(image, simulation.driver.remaining(car), 0.03, PATH)
            goal = int(simulation.traffic.goals[car])
            if goal >= 0:
                self._dots(image, simulation.graph.state_pose[goal, None, :2], 0.08, GOAL)
            self._box(image, _ahead(pose, body[0]), (body[1], spec.half_width_m), CAR)
            tray = (spec.tray_size_m[0] / 2, spec.tray_size_m[1] / 2)
            self._box(image, _ahead(pose, spec.tray_x_m), tray, TRAY)
        sizes = {task.parcel: task.delivery.size_m for task in simulation.board.tasks if task.visit is None}
        for parcel, pose in zip(world.parcel_ids().tolist(), world.parcel_poses(), strict=True):
            yaw = 2.0 * math.atan2(pose[5], pose[6])
            self._box(image, (pose[0], pose[1], yaw), (sizes[parcel][0] / 2, sizes[parcel][1] / 2), PARCEL)
        self._arms(image)
        return image

    def _arms(self, image: Picture) -> None:
        scene = self._simulation.scene
        joints = self._simulation.world.arm_positions()
        for base, spec, q in zip(scene.arm_base, scene.arms.specs, joints, strict=True):
            links = link_frames(spec.base_from_joint, q[: spec.n_joints])
            tip = links[-1, :3, 3] + spec.tool_length_m * links[-1, :3, 2]
            joints = np.vstack((links[:, :2, 3], tip[:2]))
            cos, sin = math.cos(base[3]), math.sin(base[3])
            joints = joints @ np.array([[cos, sin], [-sin, cos]]) + base[:2]
            parts = np.linspace(0.0, 1.0, 12)[:, None]
            for a, b in pairwise(joints):
                self._dots(image, a + parts * (b - a), ARM_M, ARM)

    def _dots(self, image: Picture, points: FloatArray, half_m: float, colour: Colour) -> None:
        for x, y in points:
            self._box(image, (x, y, 0.0), (half_m, half_m), colour)

    def _box(
        self,
        image: Picture,
        pose: tuple[float, float, float],
        half_m: tuple[float, ...],
        colour: Colour,
    ) -> None:
        """Fill a rectangle given by its centre and yaw; what lies outside the picture is cut off."""
        height, width = image.shape[:2]
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        reach_x = abs(cos) * half_m[0] + abs(sin) * half_m[1]
        reach_y = abs(sin) * half_m[0] + abs(cos) * half_m[1]
        left, right = (int(self._scale * (x + side * reach_x)) for side in (-1, 1))
        top, bottom = (height - 1 - int(self._scale * (y + side * reach_y)) for side in (1, -1))
        rows = np.arange(max(top, 0), min(bottom, height - 1) + 1)
        cols = np.arange(max(left, 0), min(right, width - 1) + 1)
        if not (len(rows) and len(cols)):
            return
        dx = (cols[None] + 0.5) / self._scale - x
        dy = (height - rows[:, None] - 0.5) / self._scale - y
        inside = (abs(cos * dx + sin * dy) <= half_m[0]) & (abs(cos * dy - sin * dx) <= half_m[1])
        image[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1][inside] = colour


def _ahead(pose: FloatArray, distance_m: float) -> tuple[float, float, float]:
    x, y, yaw = pose
    return x + distance_m * math.cos(yaw), y + distance_m * math.sin(yaw), yaw
