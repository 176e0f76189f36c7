"""Bin cell: an iiwa with a cup, a bin of scattered parcels under a camera, and a table, in physics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.tools import TOOLS
from fleet.sensors.boxes import SeenBox
from fleet.sensors.camera import Camera, CameraImage
from fleet.stations.arms.arm_motions import backwards
from fleet.stations.arms.arm_spheres import arm_spheres
from fleet.world.bullet.world import BulletWorld
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene, StaticBox
from planners.motion import RrtConnectNative
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.path.lines import straight_line
from planners.motion.path.route import RoutePlanner, RouteProblem
from planners.motion.path.trajectory import Trajectory, retime

FloatArray = npt.NDArray[np.float64]

EDGE_M, MASS_KG = (0.05, 0.08), (0.1, 0.5)
FLOOR_Z_M = 0.20
"""Height of the bin's floor and of the table [m]."""
BIN_M, BIN_HALF_M, WALL_M = (0.55, 0.0), (0.18, 0.15), 0.08
"""Centre of the bin, half of its inside, height and half thickness of its walls [m]."""
WALL_HALF_M = 0.005
TABLE_M, TABLE_HALF_M = (0.10, -0.60), (0.16, 0.16)
CAMERA_Z_M, PIXEL_M = 1.6, 0.001
"""Height of the camera, and what a pixel covers on the bin's floor [m]."""
SETTLE_S = 1.0
"""Time given to parcels that fall [s]."""
FALL_M = 0.09
"""Each parcel is dropped so much higher than the one before [m]."""
CUP_GAP_M, RELEASE_M, LIFT_M = 0.003, 0.004, 0.16
"""Cup above the parcel when it sticks, parcel above the table when it is let go, straight way of every pick [m]."""
ASIDE_M = 0.006
"""If there is no way to the middle of a face, as near a wall, the cup may stick so far beside it [m]."""
N_YAWS = 8
"""Turns of the tool about its axis that are tried."""
LINE_SPEED = 0.6
"""Share of the limits used on straight ways."""
TRAVEL_MARGIN_M, LINE_MARGIN_M = 0.010, 0.002
GRIP_S = 0.5
"""A cup that holds nothing after this time has missed [s]."""


@dataclass(frozen=True, kw_only=True)
class Pick:
    """What became of one attempt."""

    picked: bool
    """The parcel lies on the table."""
    reason: str
    """Why it does not; empty if it does."""
    sim_s: float
    """Simulated time that it took [s]."""


class BinCell:
    """The cell; one bin after the other is filled, looked at and emptied.

    The arm rests over the table, where it hides nothing of the bin.
    """

    def __init__(self) -> None:
        spec = ARMS["iiwa"].spec(TOOLS["suction"])
        tool = spec.tool
        boxes = _boxes()
        scene = Scene(
            size_m=(2.0, 2.0),
            boxes=tuple(boxes),
            car_kinds=(racecar_spec(),),
            car_start=np.zeros((0, 3)),
            arms=ArmTeam.alike(spec, 1),
            arm_base=np.zeros((1, 4)),
            arm_start=spec.home_rad[None],
        )
        model = arm_spheres(spec)
        solid = Boxes.join(
            Boxes.one((0.0, 0.0, -0.05), (3.0, 3.0, 0.05), min_frame=2),
            *(Boxes.one(box.centre_m, box.half_m) for box in boxes),
        )
        joints = spec.base_from_joint, spec.lower_rad, spec.upper_rad
        self._inverse, self._descent = inverse_kinematics(*joints), NumericInverse.from_joints(*joints)
        self._tool_m, self._limits = tool.length_m, (spec.max_velocity_radps, spec.max_acceleration_radps2)
        self._line = CollisionChecker(model, solid, margin=LINE_MARGIN_M)
        held = box_spheres((EDGE_M[1] / 2,) * 3)
        below = np.array([0.0, 0.0, tool.length_m + EDGE_M[1] / 2])
        empty = CollisionChecker(model, solid, margin=TRAVEL_MARGIN_M)
        loaded = CollisionChecker(model, solid, held_spheres=(held[0] + below, held[1]), margin=TRAVEL_MARGIN_M)
        self._to_bin, self._to_table = (
            RoutePlanner(self._inverse, travel, self._line, RrtConnectNative(), *self._limits)
            for travel in (empty, loaded)
        )
        self.camera = Camera.looking_at(
            "bin_camera",
            eye_m=(*BIN_M, CAMERA_Z_M),
            target_m=(*BIN_M, FLOOR_Z_M),
            up=(1.0, 0.0, 0.0),
            width_px=round(2 * (BIN_HALF_M[1] + 0.04) / PIXEL_M),
            height_px=round(2 * (BIN_HALF_M[0] + 0.04) / PIXEL_M),
            fov_rad=2 * math.atan((BIN_HALF_M[0] + 0.04) / (CAMERA_Z_M - FLOOR_Z_M)),
        )
        self.world = BulletWorld(scene)
        self.q = spec.home_rad.copy()
        self.n_ticks = 0
        self._sizes: dict[int, tuple[float, float, float]] = {}
        over = self._tips(np.array([*TABLE_M, FLOOR_Z_M + 0.25]), np.array([0.0, 0.0, 1.0]))
        route = self._to_bin.plan(RouteProblem(start=self.q, tips=over, leave=np.zeros(3), arrive=np.zeros(3)))
        for segment in route.segments:
            self._play(segment, grip=False)

    def fill(self, rng: np.random.Generator, n: int) -> None:
        """Take all parcels out and drop new ones into the bin, anyhow; they may touch, lean and lie on each other."""
        for parcel in self.world.parcel_ids().tolist():
            self.world.remove_parcel(parcel)
        self._sizes = {}
        for parcel in range(n):
            a, b, c = rng.uniform(*EDGE_M, 3).tolist()
            x, y = (centre + rng.uniform(-1, 1) * (half - 0.06) for centre, half in zip(BIN_M, BIN_HALF_M, strict=True))
            half_yaw = rng.uniform(-math.pi, math.pi) / 2
            pose = np.array(
                [x, y, FLOOR_Z_M + 0.06 + FALL_M * parcel, 0.0, 0.0, math.sin(half_yaw), math.cos(half_yaw)]
            )
            mass_kg = float(rng.uniform(*MASS_KG))
            self.world.add_parcel(ParcelBody(parcel=parcel, size_m=(a, b, c), mass_kg=mass_kg, pose=pose))
            self._sizes[parcel] = (a, b, c)
        self._wait(SETTLE_S)

    def look(self) -> CameraImage:
        """Take an image."""
        return self.world.image(self.camera)

    def in_bin(self) -> list[int]:
        """Parcels that truly are in the bin."""
        poses = dict(zip(self.world.parcel_ids().tolist(), self.world.parcel_poses(), strict=True))
        return [parcel for parcel, pose in poses.items() if _within(pose, BIN_M, BIN_HALF_M)]

    def error(self, box: SeenBox) -> tuple[float, float]:
        """Distance of a located upper face from the true one [m], and the angle between their sides [rad]."""
        index = self.world.parcel_ids().tolist().index(box.label)
        x, y, z, *quat = self.world.parcel_poses()[index].tolist()
        turn = _matrix(quat)
        half = np.array(self._sizes[box.label]) / 2
        axes, normal = turn * half, box.world_from_top[:3, 2]
        up = int(np.argmax(np.abs(turn.T @ normal)))
        top = np.array([x, y, z]) + axes[:, up] * math.copysign(1.0, float(turn[:, up] @ normal))
        along = max(abs(float(turn[:, k] @ box.world_from_top[:3, 0])) for k in range(3) if k != up)
        return float(np.linalg.norm(box.world_from_top[:3, 3] - top)), math.acos(min(1.0, along))

    def pick(self, box: SeenBox, seed: int) -> Pick:
        """Take a located parcel out of the bin and put it on the table.

        Args:
            box: Where the camera sees it.
            seed: Of the searches.
        """
        begin = self.n_ticks
        reason = self._attempt(box, seed)
        if not reason:
            self._wait(0.3)
            index = self.world.parcel_ids().tolist().index(box.label)
            on_table = _within(self.world.parcel_poses()[index], TABLE_M, (0.3, 0.3))
            reason = "" if on_table else "the parcel is not on the table"
            if on_table:
                self.world.remove_parcel(box.label)
        return Pick(picked=not reason, reason=reason, sim_s=(self.n_ticks - begin) * self.world.tick_s)

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def _attempt(self, box: SeenBox, seed: int) -> str:
        """Pick and place; returns what went wrong, empty if nothing."""
        normal, top = box.world_from_top[:3, 2], box.world_from_top[:3, 3]
        up, no_way = np.array([0.0, 0.0, LIFT_M]), np.zeros(3)
        middle = top + CUP_GAP_M * normal
        aside = [middle + sign * ASIDE_M * box.world_from_top[:3, k] for k in (0, 1) for sign in (-1, 1)]
        for places in ([middle], aside):
            tips = np.concatenate([self._tips(place, normal) for place in places])
            there = self._to_bin.plan(RouteProblem(start=self.q, tips=tips, leave=no_way, arrive=up, seed=seed))
            if there.solved:
                break
        if not there.solved:
            return f"no route to the parcel ({there.status.value})"
        for segment in there.segments:
            self._play(segment, grip=False)
        self._wait(GRIP_S, grip=True)
        if self.world.held()[0] != box.label:
            self._play(backwards(there.segments[-1]), grip=False)
            return "the cup holds nothing" if self.world.held()[0] < 0 else "the cup holds another parcel"
        self._play(backwards(there.segments[-1]), grip=True)
        # The tool points down on the table, whatever the parcel leaned like: its own tilt stays in the grip.
        height_m = min(box.size_m[2], math.sqrt(3) * EDGE_M[1]) + CUP_GAP_M + RELEASE_M
        down = self._tips(np.array([*TABLE_M, FLOOR_Z_M + height_m]), np.array([0.0, 0.0, 1.0]))
        over = down + np.pad(up[:, None], ((0, 1), (3, 0)))
        back = self._to_table.plan(RouteProblem(start=self.q, tips=over, leave=no_way, arrive=no_way, seed=seed))
        if not back.solved:
            self._wait(0.2)
            return f"no route to the table ({back.status.value})"
        for segment in back.segments:
            self._play(segment, grip=True)
        lower = self._straight(-up)
        if lower is None:
            self._wait(0.2)
            return "no straight way down to the table"
        self._play(lower, grip=True)
        dropped = self.world.held()[0] != box.label
        self._wait(0.2)
        self._play(backwards(lower), grip=False)
        return "the parcel was dropped on the way" if dropped else ""

    def _tips(self, at_m: FloatArray, normal: FloatArray) -> FloatArray:
        """Tool poses that look against a normal, turned about it, shape (N_YAWS, 4, 4)."""
        first = np.cross(normal, (0.0, 1.0, 0.0))
        first /= np.linalg.norm(first)
        tips = np.tile(np.eye(4), (N_YAWS, 1, 1))
        for tip, yaw in zip(tips, np.linspace(0, 2 * math.pi, N_YAWS, endpoint=False), strict=True):
            x = math.cos(yaw) * first + math.sin(yaw) * np.cross(normal, first)
            tip[:3, 0], tip[:3, 1], tip[:3, 2], tip[:3, 3] = x, np.cross(-normal, x), -normal, at_m
        return tips

    def _straight(self, way_m: FloatArray) -> Trajectory | None:
        """The timed straight motion of the tip by that much from where it is; None if there is none."""
        tip = self._to_bin.tip(self.q)
        tip[:3, 3] += way_m
        path = straight_line(self._inverse, self._descent, self.q, tip, self._tool_m)
        if path is None or not self._line.path_free(path):
            return None
        velocity, acceleration = self._limits
        return retime(path, LINE_SPEED * velocity, LINE_SPEED * acceleration, 0.01, max_deviation_rad=0.01)

    def _play(self, segment: Trajectory, *, grip: bool) -> None:
        for tick in range(1, math.ceil(segment.duration_s / self.world.tick_s) + 1):
            q, qd = segment.sample(min(tick * self.world.tick_s, segment.duration_s))
            self._step(q, qd, grip)
        self.q = segment.q[-1].copy()

    def _wait(self, time_s: float, *, grip: bool = False) -> None:
        for _ in range(round(time_s / self.world.tick_s)):
            self._step(self.q, np.zeros_like(self.q), grip)

    def _step(self, q: FloatArray, qd: FloatArray, grip: bool) -> None:
        self.world.step(np.zeros((0, 2)), q[None], qd[None], np.array([grip]))
        self.n_ticks += 1


def _boxes() -> list[StaticBox]:
    (x, y), (half_x, half_y) = BIN_M, BIN_HALF_M
    wall_z, top = FLOOR_Z_M + WALL_M / 2, FLOOR_Z_M / 2
    outer_x, outer_y = half_x + 2 * WALL_HALF_M, half_y + 2 * WALL_HALF_M
    boxes = [
        StaticBox(kind="pedestal", centre_m=(x, y, top), half_m=(outer_x, outer_y, top)),
        StaticBox(kind="pedestal", centre_m=(*TABLE_M, top), half_m=(*TABLE_HALF_M, top)),
    ]
    for side in (-1, 1):
        across = StaticBox(
            kind="shelf",
            centre_m=(x + side * (half_x + WALL_HALF_M), y, wall_z),
            half_m=(WALL_HALF_M, outer_y, WALL_M / 2),
        )
        along = StaticBox(
            kind="shelf",
            centre_m=(x, y + side * (half_y + WALL_HALF_M), wall_z),
            half_m=(half_x, WALL_HALF_M, WALL_M / 2),
        )
        boxes += [across, along]
    return boxes


def _within(pose: FloatArray, centre: tuple[float, float], half: tuple[float, float]) -> bool:
    inside = np.abs(pose[:2] - centre) <= half
    return bool(inside.all() and pose[2] > FLOOR_Z_M)


def _matrix(quat_xyzw: list[float]) -> FloatArray:
    matrix: FloatArray = Rotation.from_quat(quat_xyzw).as_matrix()
    return matrix
