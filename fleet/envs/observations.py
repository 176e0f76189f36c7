"""Observer: what agents are told, a row of numbers in [-1, 1] per robot (layout: see `fleet.envs.warehouse`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fleet.envs.agent_simulation import AgentSimulation
from fleet.roster import CarPhase
from fleet.stations.transfer import TRAY, TransferRequest
from fleet.world.protocol import FloatArray
from planners.motion.kinematics import link_frames

WAY_POINTS_M = (0.4, 0.8, 1.2, 2.0)
"""Distances ahead, along the granted path, at which a car is told where to go [m]."""
NEAR_M = 3.0
"""Range of the offsets to way-points and to the nearest other car [m]."""
REACH_M = 1.5
"""Range of the offsets in an arm's base frame [m]: an iiwa with its tool reaches 1.1 m."""
EDGE_M = 0.1
"""Greatest edge of a parcel [m]."""
MISSIONS = (CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.TO_DROP, CarPhase.UNLOADING)
CAR_N = 6 + 4 + len(MISSIONS) + 2 + 2 * len(WAY_POINTS_M) + 5
"""Numbers in a car's observation."""


def arm_n(n_joints: int) -> int:
    """Numbers in an arm's observation."""
    return 2 * n_joints + 18


class Observer:
    """Looks at a run.

    Args:
        simulation: The run.
    """

    def __init__(self, simulation: AgentSimulation) -> None:
        self._simulation = simulation
        self._size = np.asarray(simulation.scene.size_m)
        self._parcel_size = {
            task.parcel: np.asarray(task.delivery.size_m) for task in simulation.board.tasks if task.visit is None
        }

    def cars(self) -> npt.NDArray[np.float32]:
        """Observations of all cars, shape (n_cars, CAR_N)."""
        simulation = self._simulation
        spec, world = simulation.scene.car, simulation.world
        poses = simulation.driver.poses_now(world)
        speeds, steering = world.car_speeds(), world.car_steering()
        diagonal_m = float(np.hypot(*self._size))
        rows = np.empty((world.n_cars, CAR_N))
        for car, pose in enumerate(poses):
            line = simulation.driver.remaining(car)
            ahead_m, points = _way_points(line, pose)
            goal = int(simulation.traffic.goals[car])
            goal_pose = simulation.graph.state_pose[goal] if goal >= 0 else pose
            turn = goal_pose[2] - pose[2]
            phase = simulation.dispatcher.roster.phase[car]
            rows[car] = np.concatenate(
                (
                    2.0 * pose[:2] / self._size - 1.0,
                    (math.cos(pose[2]), math.sin(pose[2])),
                    (speeds[car] / spec.max_speed_mps, steering[car] / spec.max_steering_rad),
                    _in_frame(goal_pose[:2], pose) / diagonal_m,
                    (math.cos(turn), math.sin(turn)),
                    [phase is mission for mission in MISSIONS],
                    (simulation.dispatcher.roster.loaded[car], ahead_m / NEAR_M),
                    _in_frame(points, pose).ravel() / NEAR_M,
                    _nearest_other(car, poses),
                )
            )
        return _bounded(rows)

    def arms(self) -> npt.NDArray[np.float32]:
        """Observations of all arms, shape (n_arms, arm_n(n_joints))."""
        simulation = self._simulation
        spec, world = simulation.scene.arm, simulation.world
        q, qd, held = world.arm_positions(), world.arm_velocities(), world.held()
        parcels = dict(zip(world.parcel_ids().tolist(), world.parcel_poses(), strict=True))
        flanges = self._flanges(q)
        middle, half = (spec.upper_rad + spec.lower_rad) / 2, (spec.upper_rad - spec.lower_rad) / 2
        rows = np.zeros((world.n_arms, arm_n(spec.n_joints)))
        for arm, flange in enumerate(flanges):
            base = simulation.scene.arm_base[arm]
            axis = flange[:3, 2]
            tip = flange[:3, 3] + spec.tool_length_m * axis
            transfer = simulation.desk.transfer(arm)
            parcel = self._parcel_of(arm, transfer, int(held[arm]), parcels)
            grasp, onward, size = np.zeros(3), np.zeros(3), np.zeros(3)
            if parcel >= 0:
                centre, size = parcels[parcel][:3], self._parcel_size[parcel]
                grasp = _in_base(top_of(centre, size), base) - tip
                if transfer is not None:
                    onward = _in_base(self.place(transfer), base) - _in_base(centre, base)
            rows[arm] = np.concatenate(
                (
                    (q[arm] - middle) / half,
                    qd[arm] / spec.max_velocity_radps,
                    tip / REACH_M,
                    axis,
                    grasp / REACH_M,
                    onward / REACH_M,
                    size / EDGE_M,
                    (_direction(transfer), held[arm] >= 0, parcel >= 0),
                )
            )
        return _bounded(rows)

    def tips(self) -> FloatArray:
        """Tool tips of all arms in the world [m], shape (n_arms, 3)."""
        scene = self._simulation.scene
        flanges = self._flanges(self._simulation.world.arm_positions())
        tips = flanges[:, :3, 3] + scene.arm.tool_length_m * flanges[:, :3, 2]
        return np.array([_in_world(tip, base) for tip, base in zip(tips, scene.arm_base, strict=True)]).reshape(-1, 3)

    def place(self, transfer: TransferRequest) -> FloatArray:
        """Where the centre of a transfer's parcel should come to rest, in the world [m], shape (3,)."""
        simulation = self._simulation
        if transfer.place_via == TRAY:
            car = simulation.scene.car
            x, y, yaw = transfer.car_pose
            top = np.array([x + car.tray_x_m * math.cos(yaw), y + car.tray_x_m * math.sin(yaw), car.tray_floor_z_m])
        else:
            top = np.asarray(simulation.stations[transfer.arm].place.slots[transfer.place_via], dtype=np.float64)
        return top_of(top, transfer.size_m)

    def _flanges(self, q: FloatArray) -> FloatArray:
        """Last link frames in the arms' bases, shape (n_arms, 4, 4)."""
        return link_frames(self._simulation.scene.arm.base_from_joint, q)[:, -1]

    def _parcel_of(self, arm: int, transfer: TransferRequest | None, held: int, parcels: dict[int, FloatArray]) -> int:
        """The parcel to move; else the one in the grip; else the nearest in reach; -1 for none."""
        if transfer is not None:
            return transfer.parcel
        if held >= 0:
            return held
        base = self._simulation.scene.arm_base[arm]
        gaps = {parcel: math.hypot(*(pose[:2] - base[:2])) for parcel, pose in parcels.items()}
        nearest = min(gaps, key=lambda parcel: (gaps[parcel], parcel), default=-1)
        return nearest if nearest >= 0 and gaps[nearest] < REACH_M else -1


def top_of(centre: FloatArray, size_m: Sequence[float] | FloatArray) -> FloatArray:
    """The point half a box's height above another point [m], shape (3,)."""
    return centre + np.array([0.0, 0.0, size_m[2] / 2])


def _bounded(rows: FloatArray) -> npt.NDArray[np.float32]:
    return np.clip(rows, -1.0, 1.0).astype(np.float32)


def _in_frame(points: FloatArray, pose: FloatArray) -> FloatArray:
    """World points (..., 2) in the frame of a car's pose: ahead, left."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def _in_base(point: FloatArray, base: FloatArray) -> FloatArray:
    """World point (3,) in the frame of a base x, y, z, yaw."""
    cos, sin = math.cos(base[3]), math.sin(base[3])
    dx, dy, dz = point - base[:3]
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, dz])


def _in_world(point: FloatArray, base: FloatArray) -> FloatArray:
    """Point (3,) of a base's frame in the world."""
    cos, sin = math.cos(base[3]), math.sin(base[3])
    return base[:3] + np.array([cos * point[0] - sin * point[1], sin * point[0] + cos * point[1], point[2]])


def _way_points(line: FloatArray, pose: FloatArray) -> tuple[float, FloatArray]:
    """Length of a path ahead of the point nearest to a car, and the points at `WAY_POINTS_M` on it, shape (k, 2)."""
    nearest = int(np.argmin(np.hypot(line[:, 0] - pose[0], line[:, 1] - pose[1])))
    ahead = line[nearest:]
    s_m = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(ahead[:, 0]), np.diff(ahead[:, 1])))))
    points = np.column_stack([np.interp(WAY_POINTS_M, s_m, ahead[:, axis]) for axis in range(2)])
    return float(s_m[-1]), points


def _nearest_other(car: int, poses: FloatArray) -> FloatArray:
    """Whether a car is near, its offset, and cos and sin of its heading, in the frame of the car that looks."""
    out = np.zeros(5)
    gaps = np.hypot(poses[:, 0] - poses[car, 0], poses[:, 1] - poses[car, 1])
    gaps[car] = np.inf
    other = int(np.argmin(gaps))
    if gaps[other] < NEAR_M:
        turn = poses[other, 2] - poses[car, 2]
        out[0] = 1.0
        out[1:3] = _in_frame(poses[other, :2], poses[car]) / NEAR_M
        out[3:] = math.cos(turn), math.sin(turn)
    return out


def _direction(transfer: TransferRequest | None) -> float:
    if transfer is None:
        return 0.0
    return 1.0 if transfer.place_via == TRAY else -1.0
