"""Cars: loads the cars, drives them by their wheel and steering motors, and reads their poses."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.robots.angle import rotation, rotation_into
from fleet.robots.cars.models import CarModels
from fleet.robots.differential import LeggedChassis, SkidChassis, TwistLimits
from fleet.robots.spec import HINGES, WHEELS, CarMotors
from fleet.robots.twist.follower import shared
from fleet.world.bullet.ackermann import Ackermann
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion, turned
from fleet.world.bullet.engine.sleep import let_sleep, wake
from fleet.world.bullet.vehicles.floor import load_on_floor
from fleet.world.bullet.vehicles.legged import Legged

# A brake that only holds zero wheel speed creeps (0.35 mm/s at 10 solver iterations: the contact solver has no static
# friction), and one that holds the wheels' angle turns a car with steered wheels by a radian a minute. A standing car
# is therefore held where it is by a force-limited constraint: the grip of its tyres (`CarMotors.hold_force_n`).
_STILL_MPS = 0.005
# Shoved away by more than this, the tyres have slipped: they hold at the new place.
_SLIPPED_M = 0.003
# Numbers of a car's state: place, quaternion, velocity, angles of the left and the right front wheel.
_N_STATE_NUMBERS = 12
# A person shoves for about half a second; the speed follows half a sine wave.
_PUSH_S = 0.5


@dataclass(kw_only=True)
class _Push:
    """A shove under way."""

    start: FloatArray  # (3,) x, y, yaw
    way: FloatArray  # (3,)
    step: int
    steps: int


class _Joints(NamedTuple):
    """Joints of a model, which are also the numbers of the links that they move."""

    wheels: list[int]
    """In the order of `WHEELS`, or the left and the right roller of a car that does not steer; none of one on legs."""
    hinges: list[int]
    """In the order of `HINGES`; none of a car that does not steer."""
    leans: list[int]
    """Links that it leans on beside the wheels."""
    legs: list[int]
    """In the order of `LeggedChassis.joints`; none of a car on wheels."""

    @property
    def all(self) -> list[int]:
        """Those that move."""
        return self.wheels + self.hinges + self.legs


class _Pack(NamedTuple):
    """The cars of one model on legs."""

    cars: IntArray
    limits: TwistLimits
    hip_z_m: float
    legged: Legged


class CarBodyMotion(NamedTuple):
    """All that a car takes along from one world to another."""

    numbers: list[float]
    """Place, quaternion, linear and angular velocity, then angle and speed of each wheel and hinge."""
    push: _Push | None
    """A shove under way."""


class CarReading(NamedTuple):
    """What the engine says of the cars at one moment; nobody changes it."""

    poses: FloatArray
    """Of the rear axles, x, y, yaw, shape (n, 3)."""
    speeds: FloatArray
    """Signed forward speeds [m/s], shape (n,)."""
    steering: FloatArray
    """Angles of equivalent bicycles [rad], or yaw rates of cars that do not steer [rad/s], shape (n,)."""
    centres: FloatArray
    """Centres of mass x, y, shape (n, 2)."""
    top_speed: float
    """Fastest motion of any car [m/s], sideways included."""
    frames: FloatArray
    """Of the rear axles, as they lean, shape (n, 3, 4)."""


@dataclass(kw_only=True)
class _Memory:
    """State of `Cars` beside that of the engine."""

    sent: FloatArray
    pushes: dict[int, _Push]
    parked: BoolArray
    parked_at: FloatArray
    aside: BoolArray
    gaits: list[Any]

    def copy(self) -> _Memory:
        """A copy of its own."""
        return _Memory(
            sent=self.sent.copy(),
            pushes=copy.deepcopy(self.pushes) if self.pushes else {},
            parked=self.parked.copy(),
            parked_at=self.parked_at.copy(),
            aside=self.aside.copy(),
            gaits=self.gaits,
        )


@dataclass(frozen=True, kw_only=True)
class CarSteps:
    """How the motors of cars are told what to do."""

    length_s: float
    """Length of a physics step [s]."""
    tick_s: float
    """Time between two commands [s]."""
    limit_share: float = 1.0
    """Part of their limits that motors are given; see `BulletConfig`."""


class Cars:
    """The cars of one world.

    Args:
        client: Connection.
        models: Models of the cars.
        start: Poses x, y, yaw, shape (n, 3).
        urdfs: Text of each model's description.
        steps: Physics steps, ticks and limits of motors.
        brakes: Standing cars are held where they are. Costs an eighth of a physics step, as the engine looks at all
            constraints, of moving cars too. Without it they creep (`BulletConfig.residual`).
    """

    def __init__(
        self,
        client: Client,
        models: CarModels,
        start: FloatArray,
        urdfs: Sequence[str],
        steps: CarSteps,
        *,
        brakes: bool = True,
    ) -> None:
        self._client = client
        self._substep_s = steps.length_s
        self._motors = [_limited(kind.motors, steps.limit_share) for kind in models.kinds]
        self._urdfs, self._has_brakes = urdfs, brakes
        kinds = models.kind_of.tolist()
        self.bodies: list[int] = [self._load(kind, pose) for kind, pose in zip(kinds, start, strict=True)]
        poses = np.array(start, dtype=np.float64).reshape(-1, 3)
        still = np.zeros(len(poses))
        frames = np.zeros((len(poses), 3, 4))
        frames[:, :, :3] = rotation(np.array([quaternion(yaw) for yaw in poses[:, 2]]).reshape(-1, 4))
        frames[:, :2, 3] = poses[:, :2]
        self.now = CarReading(
            poses=poses, speeds=still, steering=still, centres=poses[:, :2], top_speed=0.0, frames=frames
        )
        """What was read last."""
        self._sent = np.full((len(self.bodies), 2), np.nan)
        self._unset = np.ones(len(self.bodies), dtype=np.bool_)
        self._parked = np.zeros(len(self.bodies), dtype=np.bool_)
        self._parked_at = np.zeros((len(self.bodies), 7))
        self._pushes: dict[int, _Push] = {}
        self._aside = np.zeros(len(self.bodies), dtype=np.bool_)
        self._ride = (0.0, (0.0, 0.0, 0.0, 1.0))
        self._changed = np.empty(len(self.bodies), dtype=np.int64)
        self._fresh = np.empty((2, len(self.bodies)))
        self._joints_of: dict[int, _Joints] = {}
        self._coms = np.zeros((len(models.kinds), 3))
        self._brakes: list[int] = []
        self._packs: list[_Pack] = []
        self.models = models
        """Which model each car is."""
        for kind, body in zip(kinds, self.bodies, strict=True):
            self._equip(kind, body)
        self._know(models)
        self._packs = self._packs_of(models, steps.tick_s)

    def _know(self, models: CarModels) -> None:
        """Keep what the models say of each car."""
        self.models = models
        self._kinds: list[int] = models.kind_of.tolist()
        self._steers: BoolArray = models.each("turn_base_m") > 0.0
        self._ackermann = Ackermann(models)
        self._limit = np.stack((models.each("max_turn"), models.each("max_speed_mps")), axis=1)
        self._com = self._coms[models.kind_of]

    def _load(self, kind: int, pose: FloatArray) -> int:
        """Load a car of a kind, on the floor at a pose x, y, yaw, shape (3,); returns its body."""
        return load_on_floor(self._client, self._urdfs[kind], pose)

    def _equip(self, kind: int, body: int) -> None:
        """Say what a car's wheels touch, and give it a brake."""
        client = self._client
        if kind not in self._joints_of:
            self._joints_of[kind] = self._joints(kind, body)
        joints = self._joints_of[kind]
        # Bullet reports the pose of the centre of mass; this is where it lies in the rear-axle frame.
        self._coms[kind] = client.getDynamicsInfo(body, -1)[3]
        for link in joints.wheels + joints.leans:
            client.setCollisionFilterGroupMask(body, link, groups.MOVING, groups.WHEELS_MASK)
        if not self._has_brakes:
            return
        # Made once and switched by their force: constraints that come and go would make snapshots inexact.
        place, quat = client.getBasePositionAndOrientation(body)
        brake = client.createConstraint(
            body, -1, -1, -1, client.JOINT_FIXED, (0, 0, 0), (0, 0, 0), place, (0, 0, 0, 1), quat
        )
        client.changeConstraint(brake, maxForce=0.0)
        self._brakes.append(brake)

    def _joints(self, kind: int, body: int) -> _Joints:
        """Find the joints of a model in one of its bodies."""
        client, model = self._client, self.models.kinds[kind]
        infos = [client.getJointInfo(body, joint) for joint in range(client.getNumJoints(body))]
        names = {info[1].decode(): joint for joint, info in enumerate(infos)}
        if model.differential is None:
            return _Joints([names[f"{wheel}_spin"] for wheel in WHEELS], [names[hinge] for hinge in HINGES], [], [])
        links = {info[12].decode(): joint for joint, info in enumerate(infos)}
        chassis = model.differential.chassis
        if isinstance(chassis, LeggedChassis):
            return _Joints([], [], [], [names[name] for name in chassis.joints])
        rollers = [names[f"{roller}_spin"] for roller in chassis.rollers]
        return _Joints(rollers, [], [links[name] for name in chassis.supports], [])

    def _packs_of(self, models: CarModels, tick_s: float) -> list[_Pack]:
        """Let the cars on legs stand up, and give each model's the gait that they walk by."""
        packs = []
        for number, kind in enumerate(models.kinds):
            if kind.differential is None or not isinstance(kind.differential.chassis, LeggedChassis):
                continue
            drive, chassis, cars = kind.differential, kind.differential.chassis, models.cars_of(number)
            bodies = [self.bodies[car] for car in cars.tolist()]
            # Sensors in a gait have errors of their own, the same in every world: nothing in a world is drawn by lot.
            rng = np.random.default_rng(number)
            legged = Legged(self._client, chassis, bodies, self._substep_s, tick_s, rng)
            packs.append(_Pack(cars=cars, limits=drive.limits, hip_z_m=chassis.hip_z_m, legged=legged))
        return packs

    def links(self) -> list[tuple[int, int]]:
        """Bodies and links that touch other things than the floor; -1 is a base."""
        legs = [(body, link) for pack in self._packs for body in pack.legged.bodies for link in pack.legged.links]
        return [(body, -1) for body in self.bodies] + legs

    def drive(self, commands: FloatArray) -> None:
        """Set the motors; a command equal to the last one costs nothing.

        The steering angle is split between the hinges, and every wheel gets the speed of its own circle (Ackermann).
        A car that is told to stand still brakes.

        Args:
            commands: Steering angle [rad], or yaw rate [rad/s] of a car that does not steer, and speed [m/s]; limited
                to what the car can do, shape (n, 2).
        """
        if self._brakes:
            self._brake(commands)
        for pack in self._packs:
            turns, speeds = np.clip(commands[pack.cars], -self._limit[pack.cars], self._limit[pack.cars]).T
            pack.legged.drive(_within(pack.limits, turns, speeds))
        n_changed = _take(commands, self._limit, self._sent, self._unset, self._changed, self._fresh)
        if n_changed:
            self._set_motors(self._changed[:n_changed], *self._fresh[:, :n_changed])

    def hold_still(self, bodies: set[int]) -> None:
        """Set the motors of some cars that stand, after a `recall`, as they were told to stand."""
        known = ~np.isnan(self._sent).any(axis=1)
        cars = np.array([car for car, body in enumerate(self.bodies) if body in bodies and known[car]], dtype=np.int64)
        if len(cars):
            self._unset[cars] = False
            self._set_motors(cars, *self._sent[cars].T)

    def _set_motors(self, cars: IntArray, steering: FloatArray, speeds: FloatArray) -> None:
        spins, angles = self._ackermann.motions(cars, steering, speeds)
        client, kinds = self._client, self.models.kinds
        motor, motors = client.setJointMotorControl2, client.setJointMotorControlArray
        velocity, position = client.VELOCITY_CONTROL, client.POSITION_CONTROL
        for number, model in enumerate(kinds):
            drive = model.differential
            if drive is not None and isinstance(drive.chassis, SkidChassis):
                own_rows = np.flatnonzero(self.models.kind_of[cars] == number)
                spins[own_rows, :2] = _sides(drive.limits, drive.chassis, steering[own_rows], speeds[own_rows])
        rows = zip(cars.tolist(), speeds.tolist(), spins.tolist(), angles.tolist(), strict=True)
        for car, speed, spin, (left_rad, right_rad) in rows:
            kind = self._kinds[car]
            body, own, joints = self.bodies[car], self._motors[kind], self._joints_of[kind]
            if joints.legs:
                continue  # told above, in every tick
            torque, n_wheels = own.brake_nm if speed == 0.0 else own.drive_nm, len(joints.wheels)
            motors(body, joints.wheels, velocity, targetVelocities=spin[:n_wheels], forces=[torque] * n_wheels)
            if not joints.hinges:
                continue
            rate, (left, right) = kinds[kind].max_steering_rate_radps, joints.hinges
            motor(body, left, position, left_rad, 0.0, own.steer_nm, own.steer_gain, 1.0, rate)
            motor(body, right, position, right_rad, 0.0, own.steer_nm, own.steer_gain, 1.0, rate)

    def push(self, car: int, way: FloatArray) -> None:
        """Start a shove of half a second that displaces the car by about `way`, unless something stops it.

        Args:
            car: Index.
            way: x, y, yaw in the world's frame [m, m, rad], shape (3,).
        """
        steps = max(1, round(_PUSH_S / self._substep_s))
        self._pushes[car] = _Push(
            start=self.now.poses[car].copy(), way=np.array(way, dtype=np.float64), step=0, steps=steps
        )
        self._sent[car] = np.nan
        if self._parked[car]:
            self._release(np.array([car]))

    def before_step(self) -> None:
        """Move legs on, and give every pushed car its velocity for the coming physics step."""
        for pack in self._packs:
            pack.legged.before_step()
        for car, push in list(self._pushes.items()):
            push.step += 1
            share = (1.0 - math.cos(math.pi * push.step / push.steps)) / 2
            peak = np.abs(push.way) * math.pi / (2 * _PUSH_S)
            body = self.bodies[car]
            place, quat = self._client.getBasePositionAndOrientation(body)
            linear, angular = self._client.getBaseVelocity(body)
            turn = rotation(np.array(quat))
            arm = turn @ self._com[car]
            yaw = math.atan2(turn[1, 0], turn[0, 0])
            gap = push.start + share * push.way - np.array([place[0] - arm[0], place[1] - arm[1], yaw])
            gap[2] = math.remainder(gap[2], 2 * math.pi)
            # Friction eats a little in every step, which the next makes up for; an obstacle is not pushed ever harder.
            vx, vy, rate = np.clip(gap / self._substep_s, -2 * peak, 2 * peak)
            self._client.resetBaseVelocity(
                body, (vx - rate * arm[1], vy + rate * arm[0], linear[2]), (angular[0], angular[1], rate)
            )
            if push.step >= push.steps:
                del self._pushes[car]

    def reading(self) -> CarReading:
        """Ask the engine where the cars are, and how they move."""
        present = np.flatnonzero(~self._aside)
        n = len(present)
        if not n:
            return self.now
        client = self._client
        pose, velocity, joints = client.getBasePositionAndOrientation, client.getBaseVelocity, client.getJointStates
        numbers: list[float] = []
        for car in present.tolist():
            body = self.bodies[car]
            place, quat = pose(body)
            linear, angular = velocity(body)
            if self._steers[car]:
                left, right = joints(body, self._joints_of[self._kinds[car]].hinges)
                numbers += (*place, *quat, *linear, left[0], right[0])
            else:
                numbers += (*place, *quat, *linear, angular[2], 0.0)
        states = np.array(numbers).reshape(n, _N_STATE_NUMBERS)
        turns, angles, poses, speeds = np.empty((n, 3, 3)), np.empty((n, 2)), np.empty((n, 3)), np.empty(n)
        frames = np.empty((n, 3, 4))
        _turn(states, turns, angles)
        yaws = np.arctan2(turns[:, 1, 0], turns[:, 0, 0])
        offsets = np.empty((n, 3))
        for kind, com in enumerate(self._coms):
            own = self.models.kind_of[present] == kind
            offsets[own] = turns[own] @ com
        top_speed = _read(states, offsets, turns, yaws, poses, speeds, frames)
        for pack in self._packs:
            # Where a car on legs is, its hips tell: the floor point below it leans along with every step.
            own = np.isin(present, pack.cars)
            poses[own, :2] += pack.hip_z_m * turns[own, :2, 2]
        steering = self._ackermann.bicycles(present, angles)
        if not self._steers.all():
            steering = np.where(self._steers[present], steering, angles[:, 0])
        now = CarReading(
            poses=poses, speeds=speeds, steering=steering, centres=states[:, :2], top_speed=top_speed, frames=frames
        )
        return now if n == len(self.bodies) else self._with_asides(now, present)

    def _with_asides(self, now: CarReading, present: IntArray) -> CarReading:
        """Put what was read of the cars that are not aside between what is known of the others."""
        before = self.now
        poses, speeds, steering = before.poses.copy(), np.zeros(len(before.speeds)), np.zeros(len(before.steering))
        centres, frames = before.centres.copy(), before.frames.copy()
        poses[present], speeds[present], steering[present] = now.poses, now.speeds, now.steering
        centres[present], frames[present] = now.centres, now.frames
        return CarReading(
            poses=poses, speeds=speeds, steering=steering, centres=centres, top_speed=now.top_speed, frames=frames
        )

    def state(self) -> list[float]:
        """All positions and velocities of the cars, one after the other."""
        return [number for car in range(len(self.bodies)) for number in self._numbers(car)]

    def _numbers(self, car: int) -> list[float]:
        client, body = self._client, self.bodies[car]
        numbers: list[float] = []
        for part in (*client.getBasePositionAndOrientation(body), *client.getBaseVelocity(body)):
            numbers.extend(part)
        for joint in client.getJointStates(body, self._joints_of[self._kinds[car]].all):
            numbers.extend(joint[:2])
        return numbers

    def place(self, state: list[float]) -> None:
        """Set what `state` gives."""
        begin = 0
        for car, kind in enumerate(self._kinds):
            end = begin + 13 + 2 * len(self._joints_of[kind].all)
            self._set(car, state[begin:end])
            begin = end

    def _set(self, car: int, numbers: list[float]) -> None:
        client, body = self._client, self.bodies[car]
        client.resetBasePositionAndOrientation(body, numbers[:3], numbers[3:7])
        client.resetBaseVelocity(body, numbers[7:10], numbers[10:13])
        joints = self._joints_of[self._kinds[car]].all
        for joint, (position, velocity) in zip(joints, _split(numbers[13:], 2), strict=True):
            client.resetJointState(body, joint, position, velocity)

    def motion(self, car: int) -> CarBodyMotion:
        """Measure all that a car's body has, to the last bit, for `admit` of another world."""
        return CarBodyMotion(numbers=self._numbers(car), push=copy.deepcopy(self._pushes.get(car)))

    def admit(self, pose: FloatArray, motion: CarBodyMotion | None) -> None:
        """Load one more car of the first model, as the last one; none may be aside.

        Args:
            pose: Of its rear axle, x, y, yaw, shape (3,).
            motion: What it goes on from; None = it stands.
        """
        body = self._load(0, pose)
        self.bodies.append(body)
        self._equip(0, body)
        self._know(CarModels(kinds=self.models.kinds, kind_of=np.append(self.models.kind_of, 0)))
        self._list_anew(len(self.bodies), np.arange(len(self.bodies) - 1))
        if motion is not None:
            self._set(len(self.bodies) - 1, motion.numbers)
            if motion.push is not None:
                self._pushes[len(self.bodies) - 1] = copy.deepcopy(motion.push)
        self.now = self.reading()

    def dismiss(self, car: int) -> None:
        """Take a car out; those after it move up by one place."""
        client, body = self._client, self.bodies.pop(car)
        if self._has_brakes:
            client.removeConstraint(self._brakes.pop(car))
        client.removeBody(body)
        self._pushes = {other - (other > car): push for other, push in self._pushes.items() if other != car}
        kept = np.delete(np.arange(len(self.bodies) + 1), car)
        now = self.now
        self.now = now._replace(
            poses=now.poses[kept],
            speeds=now.speeds[kept],
            steering=now.steering[kept],
            centres=now.centres[kept],
            frames=now.frames[kept],
        )
        self._know(self.models.some(kept))
        self._list_anew(len(self.bodies), kept)

    def _list_anew(self, n: int, kept: IntArray) -> None:
        """Make what is known of each car `n` long, and keep of the cars that were there some."""
        fresh = {"_sent": np.nan, "_unset": True, "_parked": False, "_parked_at": 0.0, "_aside": False}
        for name, new in fresh.items():
            before = getattr(self, name)
            now = np.full((n, *before.shape[1:]), new, dtype=before.dtype)
            now[: len(kept)] = before[kept]
            setattr(self, name, now)
        self._changed, self._fresh = np.empty(n, dtype=np.int64), np.empty((2, n))

    def stand(self, poses: FloatArray) -> None:
        """Let the cars stand elsewhere, on their wheels as they do now.

        Args:
            poses: Of the rear axles, x, y, yaw, shape (n, 3).
        """
        for car, pose in enumerate(poses):
            if not self._aside[car]:
                self._stand(car, pose)
        self._release(np.flatnonzero(self._parked))
        self._pushes.clear()
        self._unset[:] = True
        self.now = self.reading()

    def put(self, car: int, pose: FloatArray) -> None:
        """Let one car stand elsewhere.

        Args:
            car: Index.
            pose: Of its rear axle, x, y, yaw, shape (3,).
        """
        self._stand(car, pose)
        if self._parked[car]:
            self._release(np.array([car]))
        self._pushes.pop(car, None)
        self._sent[car] = np.nan
        self.now = self.reading()

    def _stand(self, car: int, then: FloatArray) -> None:
        client, body, now = self._client, self.bodies[car], self.now.poses[car]
        place, quat = client.getBasePositionAndOrientation(body)
        turn = float(then[2] - now[2])
        x, y = place[0] - now[0], place[1] - now[1]
        cos, sin = math.cos(turn), math.sin(turn)
        there = (then[0] + cos * x - sin * y, then[1] + sin * x + cos * y, place[2])
        about = client.multiplyTransforms((0, 0, 0), quaternion(turn), (0, 0, 0), quat)[1]
        client.resetBasePositionAndOrientation(body, there, about)
        client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))
        joints = self._joints_of[self._kinds[car]]
        for joint in joints.wheels:
            client.resetJointState(body, joint, client.getJointState(body, joint)[0], 0.0)
        for joint in joints.hinges:
            client.resetJointState(body, joint, 0.0, 0.0)
        for pack in self._packs:
            if car in pack.cars:
                pack.legged.put(int(np.searchsorted(pack.cars, car)), then)

    def note_ride(self) -> None:
        """Remember how high the first car stands on its wheels, and how it leans, for `enter`; it must stand."""
        client = self._client
        place, quat = client.getBasePositionAndOrientation(self.bodies[0])
        turn = rotation(np.array(quat))
        yaw = math.atan2(turn[1, 0], turn[0, 0])
        self._ride = (place[2] - float((turn @ self._com[0])[2]), turned(-yaw, quat))

    def set_aside(self, car: int, pose: FloatArray) -> None:
        """Take a car out of all that happens: it sleeps at a place, which costs next to nothing.

        Args:
            car: Index.
            pose: Of its rear axle, x, y, yaw, shape (3,); nothing may come there.
        """
        if self._parked[car]:
            self._release(np.array([car]))
        self._pushes.pop(car, None)
        self._move(car, pose, 0.0, 0.0)
        self.now = self.reading()
        self._aside[car] = True
        let_sleep(self._client, self.bodies[car])

    def enter(self, car: int, pose: FloatArray, speed: float, steering: float) -> None:
        """Let a car that was set aside drive on from some motion, its wheels rolling as that asks for.

        The engine stands a body still in the first step after its sleep: one that is to move was roused before that.

        Args:
            car: Index.
            pose: Of its rear axle, x, y, yaw, shape (3,).
            speed: Of the middle of the rear axle [m/s].
            steering: Angle of the bicycle [rad].
        """
        self._aside[car] = False
        self.rouse(car)
        self._move(car, pose, speed, steering)
        self._sent[car] = np.nan
        self.now = self.reading()

    def rouse(self, car: int) -> None:
        """Wake a car that was set aside."""
        wake(self._client, self.bodies[car])

    @property
    def rest(self) -> bool:
        """Whether every car is held where it stands, or set aside."""
        return not self._pushes and bool((self._parked | self._aside).all())

    def parked(self, *, on: bool) -> list[int]:
        """Bodies of the cars that are held where they stand, or of the others; none that is set aside."""
        cars = zip(self.bodies, self._parked.tolist(), self._aside.tolist(), strict=True)
        return [body for body, parked, aside in cars if parked is on and not aside]

    def _move(self, car: int, pose: FloatArray, speed: float, steering: float) -> None:
        """Put a car at a pose, in motion."""
        client, body = self._client, self.bodies[car]
        height, lean = self._ride
        quat = turned(float(pose[2]), lean)
        turn = rotation(np.array(quat))
        arm = turn @ self._com[car]
        client.resetBasePositionAndOrientation(
            body, (float(pose[0] + arm[0]), float(pose[1] + arm[1]), float(height + arm[2])), quat
        )
        # About the body's own axis, so that the turn adds nothing to the forward speed of the centre of mass.
        rates = turn[:, 2] * (speed * math.tan(steering) / self.models[car].wheelbase_m)
        client.resetBaseVelocity(body, (turn[:, 0] * speed + np.cross(rates, arm)).tolist(), rates.tolist())
        spins, angles = self._ackermann.motions(np.array([car]), np.array([steering]), np.array([speed]))
        joints = self._joints_of[self._kinds[car]]
        for joint, spin in zip(joints.wheels, spins[0].tolist(), strict=True):
            client.resetJointState(body, joint, 0.0, spin)
        for joint, angle in zip(joints.hinges, angles[0].tolist(), strict=True):
            client.resetJointState(body, joint, angle, 0.0)

    def memory(self) -> _Memory:
        """What the engine's own snapshot does not hold."""
        memory = _Memory(
            sent=self._sent,
            pushes=self._pushes,
            parked=self._parked,
            parked_at=self._parked_at,
            aside=self._aside,
            gaits=[pack.legged.memory() for pack in self._packs],
        )
        return memory.copy()

    def recall(self, memory: _Memory) -> None:
        """Return to `memory`; every motor is set anew at the next command."""
        memory = memory.copy()
        self._sent, self._pushes = memory.sent, memory.pushes
        self._parked, self._parked_at = memory.parked, memory.parked_at
        for pack, gait in zip(self._packs, memory.gaits, strict=True):
            pack.legged.recall(gait)
        # The engine's snapshots do not hold who sleeps.
        for car in np.flatnonzero(memory.aside != self._aside).tolist():
            (let_sleep if memory.aside[car] else wake)(self._client, self.bodies[car])
        self._aside = memory.aside
        self._unset[:] = True
        for car, parked in enumerate(self._parked.tolist() if self._brakes else []):
            self._hold(car, on=parked)

    def _brake(self, commands: FloatArray) -> None:
        """Park the cars that stand and are told to, and let go of those that are not, or that were shoved away."""
        standing = (self._sent[:, 1] == 0.0) & (commands[:, 1] == 0.0) & ~self._aside
        standing &= self._steers | (commands[:, 0] == 0.0)  # a car that turns on the spot does not stand
        for pack in self._packs:
            standing[pack.cars] = False  # feet stand by themselves
        if self._parked.any():
            self._release(np.flatnonzero(self._parked & (~standing | self._slipped())))
        if standing.any():
            self._park(np.flatnonzero(standing & ~self._parked & (np.abs(self.now.speeds) < _STILL_MPS)))

    def _slipped(self) -> BoolArray:
        """Which cars are no longer where they were parked, shape (n,)."""
        away: BoolArray = np.hypot(*(self.now.centres - self._parked_at[:, :2]).T) > _SLIPPED_M
        return away

    def _park(self, cars: IntArray) -> None:
        """Hold cars where they stand."""
        for car in cars.tolist():
            if car in self._pushes:
                continue
            place, quat = self._client.getBasePositionAndOrientation(self.bodies[car])
            self._parked[car] = True
            self._parked_at[car] = (*place, *quat)
            self._hold(car, on=True)

    def _release(self, cars: IntArray) -> None:
        """Let cars roll."""
        for car in cars.tolist():
            self._parked[car] = False
            self._hold(car, on=False)

    def _hold(self, car: int, *, on: bool) -> None:
        """Hold a car at the place where it was parked, or let it go."""
        if not on:
            self._client.changeConstraint(self._brakes[car], maxForce=0.0)
            return
        place, quat = self._parked_at[car, :3].tolist(), self._parked_at[car, 3:].tolist()
        self._client.changeConstraint(
            self._brakes[car],
            jointChildPivot=place,
            jointChildFrameOrientation=quat,
            maxForce=self.models[car].motors.hold_force_n,
        )


def _limited(motors: CarMotors, share: float) -> CarMotors:
    """Motors with a part of their torques; a brake that holds keeps its force."""
    torques = {name: getattr(motors, name) * share for name in ("drive_nm", "brake_nm", "steer_nm")}
    return replace(motors, **torques)


def _within(limits: TwistLimits, yaw_rates: FloatArray, speeds: FloatArray) -> FloatArray:
    """Speeds and yaw rates of commands, within what rims or feet can do, shape (n, 2)."""
    share = _shares(speeds, yaw_rates, limits.max_yaw_rate_radps, limits.max_rim_mps, limits.lever_m)
    return np.stack((share * speeds, share * yaw_rates), axis=1)


def _sides(limits: TwistLimits, chassis: SkidChassis, yaw_rates: FloatArray, speeds: FloatArray) -> FloatArray:
    """Speeds of the left and the right roller for commands [rad/s], shape (n, 2)."""
    return chassis.skid.contacts(chassis.skid.rims(_within(limits, yaw_rates, speeds))) / chassis.radius_m


@njit(cache=True)
def _shares(speeds: FloatArray, yaw_rates: FloatArray, max_yaw_rate: float, max_rim: float, lever: float) -> FloatArray:
    """`shared` of each command, shape (n,)."""
    shares = np.empty(len(speeds))
    for k in range(len(speeds)):
        shares[k] = shared(speeds[k], yaw_rates[k], max_yaw_rate, max_rim, lever)
    return shares


def _split(numbers: list[float], length: int) -> list[list[float]]:
    return [numbers[first : first + length] for first in range(0, len(numbers), length)]


@njit(cache=True)
def _take(
    commands: FloatArray,
    limits: FloatArray,
    sent: FloatArray,
    unset: BoolArray,
    changed: IntArray,
    fresh: FloatArray,
) -> int:
    """Note in `sent` the commands, limited, that differ from it or have to be set anew, and list them; returns of how
    many cars: which these are, and their steering and speeds."""
    n = 0
    for car in range(len(commands)):
        steering = min(max(commands[car, 0], -limits[car, 0]), limits[car, 0])
        speed = min(max(commands[car, 1], -limits[car, 1]), limits[car, 1])
        if unset[car] or steering != sent[car, 0] or speed != sent[car, 1]:
            sent[car, 0], sent[car, 1] = steering, speed
            changed[n], fresh[0, n], fresh[1, n] = car, steering, speed
            n += 1
    if n:
        unset[:] = False
    return n


@njit(cache=True)
def _turn(states: FloatArray, turns: FloatArray, angles: FloatArray) -> None:
    """Fill in the bodies' rotations and the angles of their front wheels."""
    for car in range(len(states)):
        rotation_into(states[car, 3:7], turns[car])
        angles[car, 0], angles[car, 1] = states[car, 10], states[car, 11]


@njit(cache=True)
def _read(
    states: FloatArray,
    offsets: FloatArray,
    turns: FloatArray,
    yaws: FloatArray,
    poses: FloatArray,
    speeds: FloatArray,
    frames: FloatArray,
) -> float:
    """Fill in the poses and frames of the rear axles and their forward speeds; returns the fastest motion [m/s]."""
    fastest = 0.0
    for car in range(len(states)):
        poses[car, 0], poses[car, 1] = states[car, 0] - offsets[car, 0], states[car, 1] - offsets[car, 1]
        poses[car, 2] = yaws[car]
        # A yaw rate moves the centre of mass sideways only: its forward speed is that of the rear axle.
        v = states[car, 7:10]
        speeds[car] = 0.0 + v[0] * turns[car, 0, 0] + v[1] * turns[car, 1, 0] + v[2] * turns[car, 2, 0]  # no -0.0
        fastest = max(fastest, np.hypot(v[0], v[1]))
        for axis in range(3):
            frames[car, axis, :3] = turns[car, axis]
            frames[car, axis, 3] = states[car, axis] - offsets[car, axis]
    return fastest
