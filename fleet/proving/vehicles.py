"""Vehicles: each one alone, in physics and in its kinematic model, behind one interface."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from fleet.arrays import FloatArray
from fleet.proving.course import CURVES, CURVES_AND_TURNS, Course
from fleet.robots import CARS, CarModels
from fleet.robots.differential import LeggedChassis, TwistFollowerConfig
from fleet.robots.estimator import PoseEstimator
from fleet.robots.pursuit import Follower, PathBuffer
from fleet.robots.twist import TWIST_PROMISES, TWIST_ROBOTS
from fleet.robots.twist.follower import TwistFollower
from fleet.robots.twist.inertial import InertialEstimator
from fleet.robots.twist.motion import TwistMotion
from fleet.robots.twist.spec import TwistSpec
from fleet.world.bullet.cars import Cars, CarSteps
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.vehicles.floor import BareFloor, load_on_floor
from fleet.world.bullet.vehicles.legged import Legged
from fleet.world.bullet.vehicles.skid_steered import SkidSteered
from fleet.world.kinematic import TYRE_GRIP_MPS2, BicycleCars

TICK_S = 1 / 60
"""Of the fleet."""
_PARCEL_M = (0.2, 0.15, 0.1)
_PARCEL_FRICTION = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class VehicleState:
    """What is true of one vehicle."""

    pose: FloatArray
    """x, y, yaw, shape (3,)."""
    motion: FloatArray
    """Speeds ahead and to the left [m/s], yaw rate [rad/s], shape (3,)."""
    lean: FloatArray
    """Roll and pitch [rad], shape (2,)."""
    steering_rad: float = 0.0
    """Of an Ackermann vehicle."""


class VehicleBody(Protocol):
    """One vehicle in a world of its own."""

    def advance(self, command: FloatArray) -> VehicleState:
        """Drive a tick long by a command, shape (2,)."""

    def push(self, dvx_mps: float, dvy_mps: float) -> None:
        """Change its speed at once."""

    def close(self) -> None:
        """End its world."""


class PhysicalVehicle(VehicleBody, Protocol):
    """One in an engine."""

    def seen(self) -> tuple[Client, int]:
        """The connection and the body, to look at."""


class VehicleControl(Protocol):
    """What steers one vehicle by its sensors."""

    def command(self, state: VehicleState, paths: PathBuffer, stop_s: float, speed_cap: float) -> FloatArray:
        """Say what the vehicle does this tick, shape (2,)."""

    def standing(self) -> bool:
        """Whether the vehicle was told to stand at its stop."""

    def excess(self, command: FloatArray, before: FloatArray) -> float:
        """By what share of a limit a command, after the one before it, is beyond it; 0 = it is within all."""


@dataclass(frozen=True, kw_only=True)
class ProvenVehicle:
    """How a vehicle is put on the proving ground."""

    physics: Callable[[float, float, np.random.Generator], PhysicalVehicle]
    """In an engine of its own; takes a load [kg], the floor's friction and a source of the errors of sensors."""
    kinematic: Callable[[], VehicleBody]
    control: Callable[[np.random.Generator], VehicleControl]
    course: Course
    cross_track_m: float
    """What it may be off the course, as promised [m]."""
    steady: tuple[tuple[float, float], ...]
    """Commands that are held for a while to see how exactly they are answered."""

    @property
    def turns(self) -> bool:
        """Whether it can turn on the spot."""
        return any(leg.kind == "turn" for leg in self.course.legs)


class PhysicalTwist:
    """A robot that is told a speed and a yaw rate, in an engine.

    Args:
        spec: The model.
        load_kg: Of a parcel that lies in its tray; 0 for none.
        friction: Of the floor.
        rng: Source of the errors of sensors that it has itself.
    """

    def __init__(self, spec: TwistSpec, load_kg: float, friction: float, rng: np.random.Generator) -> None:
        self._floor = floor = BareFloor(friction=friction)
        self._n_steps = round(TICK_S / floor.step_s)
        start = np.zeros((1, 3))
        self.robots: Legged | SkidSteered
        if isinstance(spec.chassis, LeggedChassis):
            bodies = [load_on_floor(floor.client, spec.chassis.description, start[0])]
            self.robots = Legged(floor.client, spec.chassis, bodies, floor.step_s, TICK_S, rng)
        else:
            self.robots = SkidSteered(floor.client, spec.chassis, start)
        if load_kg:
            place = np.array([spec.tray_x_m, 0.0, spec.tray_floor_z_m + _PARCEL_M[2] / 2 + 0.002])
            floor.add_box(np.array(_PARCEL_M), load_kg, place, _PARCEL_FRICTION)

    def advance(self, command: FloatArray) -> VehicleState:
        """See `VehicleBody`."""
        self.robots.drive(command.reshape(1, 2))
        for _ in range(self._n_steps):
            self.robots.before_step()
            self._floor.step()
        poses, motions, leans = self.robots.reading()
        return VehicleState(pose=poses[0], motion=motions[0], lean=leans[0])

    def seen(self) -> tuple[Client, int]:
        """See `PhysicalVehicle`."""
        return self._floor.client, self.robots.bodies[0]

    def push(self, dvx_mps: float, dvy_mps: float) -> None:
        """See `VehicleBody`."""
        client, body = self._floor.client, self.robots.bodies[0]
        (vx, vy, vz), angular = client.getBaseVelocity(body)
        client.resetBaseVelocity(body, (vx + dvx_mps, vy + dvy_mps, vz), angular)

    def close(self) -> None:
        """See `VehicleBody`."""
        self._floor.close()


class KinematicTwist:
    """The kinematic model of such a robot."""

    def __init__(self, spec: TwistSpec) -> None:
        self._motion = TwistMotion(spec, np.zeros((1, 3)), TICK_S)

    def advance(self, command: FloatArray) -> VehicleState:
        """See `VehicleBody`."""
        motion = self._motion
        motion.step(command.reshape(1, 2))
        moves = np.array([motion.speeds[0], 0.0, motion.yaw_rates[0]])
        return VehicleState(pose=motion.poses[0].copy(), motion=moves, lean=np.zeros(2))

    def push(self, dvx_mps: float, dvy_mps: float) -> None:
        """A model without mass is moved by what a second of that speed, less and less, comes to."""
        self._motion.push(0, 0.5 * dvx_mps, 0.5 * dvy_mps, 0.0)

    def close(self) -> None:
        """See `VehicleBody`."""


class PhysicalCar:
    """A car of `CARS` in an engine; see `PhysicalTwist`."""

    def __init__(self, name: str, load_kg: float, friction: float, rng: np.random.Generator) -> None:
        entry = CARS[name]
        self._floor = floor = BareFloor(friction=friction)
        spec = entry.spec()
        self._n_steps = round(TICK_S / floor.step_s)
        models = CarModels.alike(spec, 1)
        steps = CarSteps(length_s=floor.step_s, tick_s=TICK_S)
        self._cars = Cars(floor.client, models, np.zeros((1, 3)), (entry.urdf("sphere"),), steps)
        if load_kg:
            place = np.array([spec.tray_x_m, 0.0, spec.tray_floor_z_m + _PARCEL_M[2] / 2 + 0.002])
            floor.add_box(np.array(_PARCEL_M), load_kg, place, _PARCEL_FRICTION)

    def advance(self, command: FloatArray) -> VehicleState:
        """See `VehicleBody`."""
        self._cars.drive(command.reshape(1, 2))
        for _ in range(self._n_steps):
            self._cars.before_step()
            self._floor.step()
        now = self._cars.now = self._cars.reading()
        _, (_, _, rate) = self._floor.client.getBaseVelocity(self._cars.bodies[0])
        moves = np.array([now.speeds[0], 0.0, rate])
        return VehicleState(pose=now.poses[0], motion=moves, lean=np.zeros(2), steering_rad=float(now.steering[0]))

    def seen(self) -> tuple[Client, int]:
        """See `PhysicalVehicle`."""
        return self._floor.client, self._cars.bodies[0]

    def push(self, dvx_mps: float, dvy_mps: float) -> None:
        """See `VehicleBody`."""
        self._cars.push(0, np.array([0.5 * dvx_mps, 0.5 * dvy_mps, 0.0]))

    def close(self) -> None:
        """See `VehicleBody`."""
        self._floor.close()


class KinematicCar:
    """The same car without an engine."""

    def __init__(self, name: str) -> None:
        spec = CARS[name].spec()
        self._cars = BicycleCars(CarModels.alike(spec, 1), np.zeros((1, 3)), TICK_S, TICK_S / 2, TYRE_GRIP_MPS2)
        self._wheelbase_m = spec.wheelbase_m

    def advance(self, command: FloatArray) -> VehicleState:
        """See `VehicleBody`."""
        cars = self._cars
        cars.step(command.reshape(1, 2))
        rate = cars.speeds[0] * math.tan(cars.steering[0]) / self._wheelbase_m
        moves = np.array([cars.speeds[0], 0.0, rate])
        return VehicleState(
            pose=cars.poses[0].copy(), motion=moves, lean=np.zeros(2), steering_rad=float(cars.steering[0])
        )

    def push(self, dvx_mps: float, dvy_mps: float) -> None:
        """As `KinematicTwist.push`."""
        self._cars.push(0, 0.5 * dvx_mps, 0.5 * dvy_mps, 0.0)

    def close(self) -> None:
        """See `VehicleBody`."""


class TwistControl:
    """Follower and inertial estimate of one robot.

    Args:
        spec: The model.
        rng: Source of the sensors' errors.
        config: Gains of the follower.
    """

    def __init__(self, spec: TwistSpec, rng: np.random.Generator, config: TwistFollowerConfig | None = None) -> None:
        self._limits = spec.limits
        self._follower = TwistFollower(spec.limits, 1, TICK_S, config)
        self._estimator = InertialEstimator(np.zeros((1, 3)), TICK_S, rng=rng)

    def command(self, state: VehicleState, paths: PathBuffer, stop_s: float, speed_cap: float) -> FloatArray:
        """See `VehicleControl`."""
        pose, motion, lean = (row.reshape(1, -1) for row in (state.pose, state.motion, state.lean))
        poses = self._estimator.update(pose, motion, lean)
        speeds = self._estimator.motions[:, 0]
        told = self._follower.commands(paths, poses, speeds, np.array([stop_s]), np.array([speed_cap]))
        return told[0]

    def standing(self) -> bool:
        """See `VehicleControl`."""
        return bool(self._follower.standing[0])

    def excess(self, command: FloatArray, before: FloatArray) -> float:
        """See `VehicleControl`."""
        limits = self._limits
        speed, rate = (abs(float(number)) for number in command)
        faster = speed - abs(float(before[0]))
        shares = (
            speed / limits.max_speed_mps,
            rate / limits.max_yaw_rate_radps,
            (speed + limits.lever_m * rate) / limits.max_rim_mps,
            faster / (limits.max_accel_mps2 * TICK_S),
            -faster / (limits.max_brake_mps2 * TICK_S),
            abs(float(command[1] - before[1])) / (limits.max_yaw_accel_radps2 * TICK_S),
        )
        return max(max(shares) - 1.0, 0.0)


class CarControl:
    """Follower and estimate of one car, as in the fleet."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self._spec = spec = CARS[name].spec()
        self._follower = Follower(CarModels.alike(spec, 1), TICK_S)
        self._estimator = PoseEstimator(CarModels.alike(spec, 1), TICK_S, rng=rng)

    def command(self, state: VehicleState, paths: PathBuffer, stop_s: float, speed_cap: float) -> FloatArray:
        """See `VehicleControl`."""
        speeds, steering = np.array([state.motion[0]]), np.array([state.steering_rad])
        poses = self._estimator.update(state.pose.reshape(1, 3), speeds, steering)
        return self._follower.commands(paths, poses, speeds, np.array([stop_s]), np.array([speed_cap]))[0]

    def standing(self) -> bool:
        """See `VehicleControl`."""
        return bool(self._follower.standing[0])

    def excess(self, command: FloatArray, before: FloatArray) -> float:
        """See `VehicleControl`."""
        spec = self._spec
        faster = abs(float(command[1])) - abs(float(before[1]))
        shares = (
            abs(float(command[0])) / spec.max_steering_rad,
            abs(float(command[1])) / spec.max_speed_mps,
            abs(float(command[0] - before[0])) / (spec.max_steering_rate_radps * TICK_S),
            faster / (spec.max_accel_mps2 * TICK_S),
            # A standing car's brake is told at once.
            -faster / (spec.max_brake_mps2 * TICK_S) if command[1] != 0.0 else 0.0,
        )
        return max(max(shares) - 1.0, 0.0)


def _twist(name: str) -> ProvenVehicle:
    spec, promise = TWIST_ROBOTS[name](), TWIST_PROMISES[name]
    return ProvenVehicle(
        physics=lambda load, friction, rng: PhysicalTwist(spec, load, friction, rng),
        kinematic=lambda: KinematicTwist(spec),
        control=lambda rng: TwistControl(spec, rng, promise.follower),
        course=CURVES_AND_TURNS,
        cross_track_m=promise.cross_track_m,
        steady=promise.steady,
    )


def _car(name: str) -> ProvenVehicle:
    return ProvenVehicle(
        physics=partial(PhysicalCar, name),
        kinematic=partial(KinematicCar, name),
        control=partial(CarControl, name),
        course=CURVES,
        cross_track_m=0.03,
        steady=(),
    )


VEHICLES: dict[str, ProvenVehicle] = {
    **{name: _car(name) for name in CARS if name not in TWIST_ROBOTS},
    **{name: _twist(name) for name in TWIST_ROBOTS},
}
"""Vehicles that can be driven alone."""
