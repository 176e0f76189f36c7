"""Kinematic world: bicycle-model cars, rate-limited arms and riding parcels on the flat floor, without physics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.errors import ConfigError, FleetError
from fleet.robots.spec import ArmSpec, CarSpec
from fleet.world.parcels import Parcels, ParcelSnapshot
from fleet.world.protocol import Contacts, FloatArray, IntArray, ParcelBody
from fleet.world.scene import Scene
from planners.motion.kinematics import joint_rows, link_frames_into

LINK_RADIUS_M = 0.08
"""Arms are judged against cars as spheres of this radius on and between their joints [m]; iiwa links are 0.06-0.09."""
TIP_RADIUS_M = 0.03
"""Radius of the sphere at the tool tip [m]."""
BIN_M = 1.0
"""Edge of the square bins in which boxes are looked up [m]."""


class CommandError(FleetError):
    """A command does not fit the world's robots."""


class SnapshotError(FleetError):
    """A snapshot does not belong to the world that should return to it."""


class CarMotion(Protocol):
    """How a world moves its cars."""

    poses: FloatArray
    speeds: FloatArray
    steering: FloatArray

    def step(self, commands: FloatArray) -> None:
        """Advance all cars one tick."""

    def push(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Displace a car."""

    def save(self) -> tuple[npt.NDArray[np.generic], ...]:
        """Copies of all that decides how cars move on."""

    def load(self, snapshot: tuple[npt.NDArray[np.generic], ...]) -> None:
        """Return to a saved state."""


class BicycleCars:
    """Cars as bicycles: speed and steering go to their commands steadily over each tick, within the limits; no slip.

    Args:
        spec: Car model with the limits.
        start: Poses x, y, yaw, shape (n_cars, 3).
        tick_s: Length of a tick [s].
        substep_s: Greatest integration step [s].
    """

    def __init__(self, spec: CarSpec, start: FloatArray, tick_s: float, substep_s: float) -> None:
        self.poses = np.array(start, dtype=np.float64)
        self.speeds = np.zeros(len(start))
        self.steering = np.zeros(len(start))
        self._spec = spec
        self._n_substeps = max(1, math.ceil(tick_s / substep_s - 1e-9))
        self._substep_s = tick_s / self._n_substeps

    def step(self, commands: FloatArray) -> None:
        """See `CarMotion`."""
        spec = self._spec
        _drive(
            self.poses,
            self.speeds,
            self.steering,
            commands,
            self._n_substeps,
            self._substep_s,
            spec.wheelbase_m,
            spec.max_speed_mps,
            spec.max_accel_mps2,
            spec.max_brake_mps2,
            spec.max_steering_rad,
            spec.max_steering_rate_radps,
        )

    def push(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `CarMotion`."""
        self.poses[car] += (dx_m, dy_m, dyaw_rad)

    def save(self) -> tuple[npt.NDArray[np.generic], ...]:
        """See `CarMotion`."""
        return self.poses.copy(), self.speeds.copy(), self.steering.copy()

    def load(self, snapshot: tuple[npt.NDArray[np.generic], ...]) -> None:
        """See `CarMotion`."""
        self.poses[:], self.speeds[:], self.steering[:] = snapshot


class ServoArms:
    """Arms whose joints go straight to their targets, as fast as their velocity limits let them.

    Attributes:
        q: Joint positions [rad], shape (n_arms, n_joints).
        qd: Joint velocities over the last tick [rad/s], same shape.
        tips: World poses of the tool tips x, y, z, quat_xyzw, shape (n_arms, 7).
        points: Centres of spheres along each arm in the world, base to tip [m], shape (n_arms, n_points, 3).
        radii: Radii of those spheres [m], shape (n_points,).

    Args:
        spec: Arm model.
        base: Base poses x, y, z, yaw, shape (n_arms, 4).
        start: Joint positions [rad], shape (n_arms, n_joints).
        tick_s: Length of a tick [s].
    """

    def __init__(self, spec: ArmSpec, base: FloatArray, start: FloatArray, tick_s: float) -> None:
        self._spec, self._base, self._tick_s = spec, np.array(base, dtype=np.float64).reshape(-1, 4), tick_s
        n_arms, n_joints = len(self._base), spec.n_joints
        self._joints = joint_rows(spec.base_from_joint)
        self.q = np.array(start, dtype=np.float64).reshape(n_arms, n_joints)
        self.qd = np.zeros((n_arms, n_joints))
        self.tips = np.zeros((n_arms, 7))
        self.points = np.zeros((n_arms, 2 * n_joints + 2, 3))
        self.radii = np.full(2 * n_joints + 2, LINK_RADIUS_M)
        self.radii[-1] = TIP_RADIUS_M
        self.reach_m = float(np.linalg.norm(self._joints[:, :, 3], axis=1).sum()) + spec.tool_length_m + LINK_RADIUS_M
        self._follow(self.q, everything=True)

    def step(self, target_q: FloatArray) -> None:
        """Move towards joint targets [rad], shape (n_arms, n_joints), for one tick."""
        self._follow(target_q, everything=False)

    def save(self) -> tuple[FloatArray, FloatArray]:
        """Copies of positions and velocities."""
        return self.q.copy(), self.qd.copy()

    def load(self, snapshot: tuple[FloatArray, FloatArray]) -> None:
        """Return to a saved state."""
        self.q[:] = snapshot[0]
        self._follow(self.q, everything=True)
        self.qd[:] = snapshot[1]

    def _follow(self, target_q: FloatArray, *, everything: bool) -> None:
        spec = self._spec
        _servo(
            self.q,
            self.qd,
            target_q,
            spec.lower_rad,
            spec.upper_rad,
            spec.max_velocity_radps,
            self._tick_s,
            everything,
            self._joints,
            spec.tool_length_m,
            self._base,
            self.tips,
            self.points,
        )


@dataclass(frozen=True, kw_only=True)
class SurroundingsSnapshot:
    """State of `Surroundings` at one instant."""

    serving: IntArray
    robot_contacts_n: int
    static_contacts_n: int
    min_clearance_m: float
    touching: frozenset[int]
    added: dict[int, tuple[float, float, float, float]]


class Surroundings:
    """What touches what, how close robots came, and what rays hit; in the plane, except for arms above cars.

    Cars are oriented rectangles, boxes are their footprints (only boxes that begin below the cars' height), arms are
    spheres. Arms are not judged against boxes.

    Attributes:
        robot_contacts_n: Touches between robots so far; one that lasts counts once.
        static_contacts_n: Touches of cars with boxes so far.
        min_clearance_m: Smallest clearance so far [m]; infinite until two robots were compared.

    Args:
        scene: Boxes, floor and models.
        arms: The arms to judge.
    """

    def __init__(self, scene: Scene, arms: ServoArms) -> None:
        car = scene.car
        low = [b for b in scene.boxes if b.centre_m[2] - b.half_m[2] < car.height_m]
        self._fixed = [(*b.centre_m[:2], *b.half_m[:2]) for b in low]
        self._added: dict[int, tuple[float, float, float, float]] = {}
        self._n_bins = (max(1, math.ceil(scene.size_m[0] / BIN_M)), max(1, math.ceil(scene.size_m[1] / BIN_M)))
        self._body = np.array([(car.front_m - car.rear_m) / 2, (car.front_m + car.rear_m) / 2, car.half_width_m])
        self._height_m = car.height_m
        self._arms = arms
        self._arm_xy = np.array(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2].copy()
        self.serving = np.full(len(self._arm_xy), -1, dtype=np.int64)
        self.robot_contacts_n = 0
        self.static_contacts_n = 0
        self.min_clearance_m = math.inf
        self._touching: frozenset[int] = frozenset()
        self._codes = np.zeros(256, dtype=np.int64)
        self._sort_boxes()

    def add_box(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put up a box at run time, in place of an earlier one of the same id."""
        self._added[obstacle] = (float(centre_m[0]), float(centre_m[1]), float(half_m[0]), float(half_m[1]))
        self._sort_boxes()

    def remove_box(self, obstacle: int) -> None:
        """Take down such a box.

        Raises:
            FleetError: No such box.
        """
        if obstacle not in self._added:
            raise FleetError(f"obstacle {obstacle} does not exist; valid: {sorted(self._added)}")
        del self._added[obstacle]
        self._sort_boxes()

    def observe(self, car_poses: FloatArray) -> None:
        """Count new touches and note the smallest clearance."""
        while True:
            n_codes, clearance = _touches(
                car_poses,
                self._body,
                self._height_m,
                self._boxes,
                self._keys,
                self._bin_ptr,
                self._bin_box,
                self._n_bins,
                self._arms.points,
                self._arms.radii,
                self._arm_xy,
                self._arms.reach_m,
                self.serving,
                self.min_clearance_m,
                self._codes,
            )
            if n_codes <= len(self._codes):
                break
            self._codes = np.zeros(2 * n_codes, dtype=np.int64)
        self.min_clearance_m = clearance
        if n_codes or self._touching:
            now = frozenset(self._codes[:n_codes].tolist())
            new = now - self._touching
            static = sum(code >> _KIND_SHIFT == _STATIC for code in new)
            self.robot_contacts_n += len(new) - static
            self.static_contacts_n += static
            self._touching = now

    def rays(self, origins: FloatArray, ends: FloatArray, car_poses: FloatArray) -> FloatArray:
        """Hit fractions in the plane, shape (r,); a body that contains a ray's origin does not stop it."""
        out = np.ones(len(origins))
        _cast(origins, ends, car_poses, self._body, self._boxes, self._bin_ptr, self._bin_box, self._n_bins, out)
        return out

    def save(self) -> SurroundingsSnapshot:
        """Copy of everything that changes."""
        return SurroundingsSnapshot(
            serving=self.serving.copy(),
            robot_contacts_n=self.robot_contacts_n,
            static_contacts_n=self.static_contacts_n,
            min_clearance_m=self.min_clearance_m,
            touching=self._touching,
            added=self._added.copy(),
        )

    def load(self, snapshot: SurroundingsSnapshot) -> None:
        """Return to a saved state."""
        self.serving[:] = snapshot.serving
        self.robot_contacts_n = snapshot.robot_contacts_n
        self.static_contacts_n = snapshot.static_contacts_n
        self.min_clearance_m = snapshot.min_clearance_m
        self._touching = snapshot.touching
        if snapshot.added != self._added:
            self._added = snapshot.added.copy()
            self._sort_boxes()

    def _sort_boxes(self) -> None:
        """Put box numbers into the bins that their footprints touch (compressed rows, bins along x first)."""
        rows = self._fixed + [self._added[key] for key in sorted(self._added)]
        self._boxes = np.array(rows, dtype=np.float64).reshape(-1, 4)
        self._keys = np.array([*range(len(self._fixed)), *(_ADDED_KEY + key for key in sorted(self._added))], np.int64)
        limit = np.array(self._n_bins) - 1
        low = np.clip(np.floor((self._boxes[:, :2] - self._boxes[:, 2:]) / BIN_M).astype(np.int64), 0, limit)
        high = np.clip(np.floor((self._boxes[:, :2] + self._boxes[:, 2:]) / BIN_M).astype(np.int64), 0, limit)
        pairs = [
            (iy * self._n_bins[0] + ix, box)
            for box, ((x0, y0), (x1, y1)) in enumerate(zip(low.tolist(), high.tolist(), strict=True))
            for iy in range(y0, y1 + 1)
            for ix in range(x0, x1 + 1)
        ]
        entries = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
        self._bin_ptr = np.searchsorted(entries[:, 0], np.arange(self._n_bins[0] * self._n_bins[1] + 1))
        self._bin_box = entries[:, 1].copy()


@dataclass(frozen=True, kw_only=True)
class PlanarSnapshot:
    """State of a `PlanarWorld` at one instant."""

    cars: tuple[npt.NDArray[np.generic], ...]
    arms: tuple[FloatArray, FloatArray]
    parcels: ParcelSnapshot
    surroundings: SurroundingsSnapshot


class PlanarWorld:
    """A `World` without physics; only the way its cars move is left open.

    Contacts and clearances are judged at the end of each tick, by geometry; nothing is stopped by them.

    Args:
        scene: The world at the start.
        cars: Moves the cars.
        tick_s: Length of one tick [s].
    """

    def __init__(self, scene: Scene, cars: CarMotion, tick_s: float) -> None:
        self.tick_s = tick_s
        self.n_cars = len(scene.car_start)
        self.n_arms = len(scene.arm_base)
        self._cars = cars
        self._arms = ServoArms(scene.arm, scene.arm_base, scene.arm_start, tick_s)
        self._parcels = Parcels(scene.boxes, scene.car, self.n_arms)
        self._surroundings = Surroundings(scene, self._arms)

    def step(
        self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: npt.NDArray[np.bool_]
    ) -> None:
        """See `World`; joints are moved by position alone, `arm_qd` is not used.

        Raises:
            CommandError: An array has the wrong shape.
        """
        shapes = (car_commands.shape, arm_q.shape, grip.shape)
        valid = ((self.n_cars, 2), self._arms.q.shape, (self.n_arms,))
        if shapes != valid:
            raise CommandError(f"step: car_commands, arm_q, grip have shapes {shapes}; valid: {valid}")
        self._cars.step(car_commands)
        self._arms.step(arm_q)
        self._parcels.update(self._cars.poses, self._arms.tips, grip)
        self._surroundings.observe(self._cars.poses)

    def car_poses(self) -> FloatArray:
        """See `World`."""
        return self._cars.poses.copy()

    def car_speeds(self) -> FloatArray:
        """See `World`."""
        return self._cars.speeds.copy()

    def car_steering(self) -> FloatArray:
        """See `World`."""
        return self._cars.steering.copy()

    def arm_positions(self) -> FloatArray:
        """See `World`."""
        return self._arms.q.copy()

    def arm_velocities(self) -> FloatArray:
        """See `World`."""
        return self._arms.qd.copy()

    def held(self) -> IntArray:
        """See `World`."""
        return self._parcels.held.copy()

    def parcel_ids(self) -> IntArray:
        """See `World`."""
        return self._parcels.ids.copy()

    def parcel_poses(self) -> FloatArray:
        """See `World`."""
        return self._parcels.poses.copy()

    def add_parcel(self, body: ParcelBody) -> None:
        """See `World`."""
        self._parcels.add(body, self._cars.poses)

    def remove_parcel(self, parcel: int) -> None:
        """See `World`."""
        self._parcels.remove(parcel)

    def set_serving(self, arm: int, car: int) -> None:
        """See `World`."""
        self._surroundings.serving[arm] = car

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """See `World`."""
        self._surroundings.add_box(obstacle, centre_m, half_m)

    def remove_obstacle(self, obstacle: int) -> None:
        """See `World`."""
        self._surroundings.remove_box(obstacle)

    def push_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `World`."""
        self._cars.push(car, dx_m, dy_m, dyaw_rad)

    def contacts(self) -> Contacts:
        """See `World`."""
        return Contacts(robot=self._surroundings.robot_contacts_n, static=self._surroundings.static_contacts_n)

    def min_clearance_m(self) -> float:
        """See `World`; arms are spheres here, so theirs is a coarse figure."""
        return self._surroundings.min_clearance_m

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """See `World`; in the plane: z is ignored, a body that contains a ray's origin does not stop it."""
        return self._surroundings.rays(origins, ends, self._cars.poses)

    def save(self) -> PlanarSnapshot:
        """See `World`."""
        return PlanarSnapshot(
            cars=self._cars.save(),
            arms=self._arms.save(),
            parcels=self._parcels.save(),
            surroundings=self._surroundings.save(),
        )

    def load(self, snapshot: object) -> None:
        """See `World`.

        Raises:
            SnapshotError: The snapshot is not one of this kind of world.
        """
        if not isinstance(snapshot, PlanarSnapshot):
            raise SnapshotError(f"load: snapshot is a {type(snapshot).__name__}; valid: what `save` of this world gave")
        self._cars.load(snapshot.cars)
        self._arms.load(snapshot.arms)
        self._parcels.load(snapshot.parcels)
        self._surroundings.load(snapshot.surroundings)

    def state_bytes(self) -> bytes:
        """See `World`."""
        parcels = self._parcels
        arrays = (*self._cars.save(), *self._arms.save(), parcels.ids, parcels.poses, parcels.held)
        return b"".join(array.tobytes() for array in arrays)

    def close(self) -> None:
        """See `World`; there is nothing to free."""


@dataclass(frozen=True, kw_only=True)
class KinematicConfig:
    """Time steps of the kinematic world."""

    tick_s: float = 0.05
    substep_s: float = 0.0125
    """Greatest integration step of the car model [s]."""

    def __post_init__(self) -> None:
        for name in ("tick_s", "substep_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"kinematic world: {name} is {value!r}; valid: a number > 0")


class KinematicWorld(PlanarWorld):
    """A `World` of bicycle-model cars.

    Args:
        scene: The world at the start.
        config: Time steps.
    """

    def __init__(self, scene: Scene, config: KinematicConfig | None = None) -> None:
        config = config or KinematicConfig()
        cars = BicycleCars(scene.car, scene.car_start, config.tick_s, config.substep_s)
        super().__init__(scene, cars, config.tick_s)


_KIND_SHIFT = 40
_CAR_CAR, _CAR_ARM, _ARM_ARM, _STATIC = 0, 1, 2, 3
_ADDED_KEY = 1 << 18
"""Keys of run-time boxes begin here, so that they do not depend on how many there are."""


@njit(cache=True)
def _towards(value: float, target: float, step: float) -> float:
    return min(max(target, value - step), value + step)


@njit(cache=True)
def _drive(  # one kernel for all cars, on flat arrays
    poses, speeds, steering, commands, n_substeps, dt, wheelbase, max_speed, accel, brake, max_steering, steering_rate
):  # fmt: skip
    """Bicycle model by the midpoint rule; speed and steering reach what they can of the command at the tick's end."""
    tick = n_substeps * dt
    for i in range(len(poses)):
        goal_speed = min(max(commands[i, 1], -max_speed), max_speed)
        goal_steering = min(max(commands[i, 0], -max_steering), max_steering)
        old_speed, old_steering = speeds[i], steering[i]
        # Slowing down is braking, at most to a stand within a tick; the rest is accelerating.
        if goal_speed * old_speed < 0.0:
            goal_speed = 0.0
        rate = brake if abs(goal_speed) < abs(old_speed) else accel
        speeds[i] = _towards(old_speed, goal_speed, rate * tick)
        steering[i] = _towards(old_steering, goal_steering, steering_rate * tick)
        for step in range(n_substeps):
            part = (step + 0.5) / n_substeps
            way = (old_speed + part * (speeds[i] - old_speed)) * dt
            turn = way * math.tan(old_steering + part * (steering[i] - old_steering)) / wheelbase
            middle = poses[i, 2] + 0.5 * turn
            poses[i, 0] += way * math.cos(middle)
            poses[i, 1] += way * math.sin(middle)
            poses[i, 2] += turn
        poses[i, 2] = (poses[i, 2] + math.pi) % (2.0 * math.pi) - math.pi


@njit(cache=True)
def _servo(  # one kernel for all arms, on flat arrays
    q, qd, target, lower, upper, max_velocity, dt, everything, joints, tool_length, base, tips, points
):  # fmt: skip
    """Move joints, then place tips and spheres of the arms that moved (of all arms if `everything`)."""
    n_joints = q.shape[1]
    frames = np.zeros((n_joints + 1, 3, 4))
    for i in range(len(q)):
        moved = everything
        for j in range(n_joints):
            goal = min(max(target[i, j], lower[j]), upper[j])
            new = _towards(q[i, j], goal, max_velocity[j] * dt)
            qd[i, j] = (new - q[i, j]) / dt
            moved = moved or new != q[i, j]
            q[i, j] = new
        if not moved:
            continue
        link_frames_into(joints, q[i], frames)
        cos, sin = math.cos(base[i, 3]), math.sin(base[i, 3])
        for k in range(2 * n_joints + 2):
            # Even spheres sit on frames, odd ones half-way to the next frame; the last one is the tool tip.
            a, b = k // 2, min((k + 1) // 2, n_joints)
            ahead = tool_length if k > 2 * n_joints else 0.0
            x = 0.5 * (frames[a, 0, 3] + frames[b, 0, 3]) + ahead * frames[b, 0, 2]
            y = 0.5 * (frames[a, 1, 3] + frames[b, 1, 3]) + ahead * frames[b, 1, 2]
            z = 0.5 * (frames[a, 2, 3] + frames[b, 2, 3]) + ahead * frames[b, 2, 2]
            points[i, k, 0] = base[i, 0] + cos * x - sin * y
            points[i, k, 1] = base[i, 1] + sin * x + cos * y
            points[i, k, 2] = base[i, 2] + z
        for axis in range(3):
            tips[i, axis] = points[i, 2 * n_joints + 1, axis]
        _quaternion(frames[n_joints], base[i, 3], tips[i])


@njit(cache=True)
def _quaternion(m, yaw, out):
    """Fill `out[3:7]` with the quaternion x, y, z, w of a rotation about z by `yaw` times the rotation matrix in `m`.

    Source: S. W. Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace >= max(m[0, 0], m[1, 1], m[2, 2]):
        x, y, z, w = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace
    elif m[0, 0] >= max(m[1, 1], m[2, 2]):
        x, y, z, w = 1.0 + 2.0 * m[0, 0] - trace, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]
    elif m[1, 1] >= m[2, 2]:
        x, y, z, w = m[0, 1] + m[1, 0], 1.0 + 2.0 * m[1, 1] - trace, m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]
    else:
        x, y, z, w = m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1.0 + 2.0 * m[2, 2] - trace, m[1, 0] - m[0, 1]
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    c, s = math.cos(yaw / 2.0) / norm, math.sin(yaw / 2.0) / norm
    out[3], out[4], out[5], out[6] = c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z


@njit(cache=True)
def _corner_gap(ax, ay, ac, as_, al, aw, bx, by, bc, bs, bl, bw):
    """Smallest distance from the corners of rectangle a to rectangle b, and whether an axis of b parts them."""
    best, low_u, high_u, low_v, high_v = math.inf, math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        du = al if k < 2 else -al
        dv = aw if k % 2 == 0 else -aw
        x, y = ax + ac * du - as_ * dv - bx, ay + as_ * du + ac * dv - by
        u, v = bc * x + bs * y, bc * y - bs * x
        low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
        best = min(best, math.hypot(max(abs(u) - bl, 0.0), max(abs(v) - bw, 0.0)))
    parted = low_u > bl or high_u < -bl or low_v > bw or high_v < -bw
    return best, parted


@njit(cache=True)
def _rectangle_gap(ax, ay, ac, as_, al, aw, bx, by, bc, bs, bl, bw):
    """Distance of two oriented rectangles (centre, cos, sin, half length, half width), 0 if they overlap.

    Rectangles that no side of either parts overlap (separating axes); else a corner of one is nearest to the other.
    """
    gap_a, parted_a = _corner_gap(ax, ay, ac, as_, al, aw, bx, by, bc, bs, bl, bw)
    gap_b, parted_b = _corner_gap(bx, by, bc, bs, bl, bw, ax, ay, ac, as_, al, aw)
    return min(gap_a, gap_b) if parted_a or parted_b else 0.0


@njit(cache=True)
def _note(codes, n_codes, kind, a, b):
    if n_codes < len(codes):
        codes[n_codes] = (kind << _KIND_SHIFT) + (a << 20) + b
    return n_codes + 1


@njit(cache=True)
def _touches(  # one kernel for all pairs, on flat arrays
    cars, body, height, boxes, keys, bin_ptr, bin_box, n_bins, points, radii, arm_xy, reach, serving, clearance, codes
):  # fmt: skip
    """Codes of all pairs that touch now, and the smallest clearance so far."""
    n_cars, n_arms, n_codes = len(cars), len(points), 0
    shift, length, width = body
    circle = math.hypot(length, width)
    frame = np.empty((n_cars, 4))
    for i in range(n_cars):
        cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
        frame[i, 0], frame[i, 1] = cars[i, 0] + shift * cos, cars[i, 1] + shift * sin
        frame[i, 2], frame[i, 3] = cos, sin

    for i in range(n_cars):
        x, y, cos, sin = frame[i, 0], frame[i, 1], frame[i, 2], frame[i, 3]
        for j in range(i + 1, n_cars):
            dx, dy = frame[j, 0] - x, frame[j, 1] - y
            near = 2.0 * circle + clearance
            if dx * dx + dy * dy > near * near:
                continue
            gap = _rectangle_gap(
                x, y, cos, sin, length, width, frame[j, 0], frame[j, 1], frame[j, 2], frame[j, 3], length, width
            )
            clearance = min(clearance, gap)
            if gap == 0.0:
                n_codes = _note(codes, n_codes, _CAR_CAR, i, j)
        x0, x1 = max(int((x - circle) / BIN_M), 0), min(int((x + circle) / BIN_M), n_bins[0] - 1)
        y0, y1 = max(int((y - circle) / BIN_M), 0), min(int((y + circle) / BIN_M), n_bins[1] - 1)
        for iy in range(y0, y1 + 1):
            for ix in range(x0, x1 + 1):
                for entry in range(bin_ptr[iy * n_bins[0] + ix], bin_ptr[iy * n_bins[0] + ix + 1]):
                    b = bin_box[entry]
                    if abs(boxes[b, 0] - x) > circle + boxes[b, 2] or abs(boxes[b, 1] - y) > circle + boxes[b, 3]:
                        continue
                    gap = _rectangle_gap(
                        x, y, cos, sin, length, width, boxes[b, 0], boxes[b, 1], 1.0, 0.0, boxes[b, 2], boxes[b, 3]
                    )
                    if gap == 0.0:
                        n_codes = _note(codes, n_codes, _STATIC, i, keys[b])

    for a in range(n_arms):
        for i in range(n_cars):
            dx, dy = frame[i, 0] - arm_xy[a, 0], frame[i, 1] - arm_xy[a, 1]
            near = reach + circle + clearance
            if i == serving[a] or dx * dx + dy * dy > near * near:
                continue
            gap = math.inf
            for k in range(len(radii)):
                px, py = points[a, k, 0] - frame[i, 0], points[a, k, 1] - frame[i, 1]
                u = max(abs(frame[i, 2] * px + frame[i, 3] * py) - length, 0.0)
                v = max(abs(frame[i, 2] * py - frame[i, 3] * px) - width, 0.0)
                w = max(points[a, k, 2] - height, 0.0)
                gap = min(gap, max(math.sqrt(u * u + v * v + w * w) - radii[k], 0.0))
            clearance = min(clearance, gap)
            if gap == 0.0:
                n_codes = _note(codes, n_codes, _CAR_ARM, i, a)
        for b in range(a + 1, n_arms):
            if math.hypot(arm_xy[a, 0] - arm_xy[b, 0], arm_xy[a, 1] - arm_xy[b, 1]) > 2.0 * reach:
                continue
            touch = False
            for k in range(len(radii)):
                for m in range(len(radii)):
                    dx, dy = points[a, k, 0] - points[b, m, 0], points[a, k, 1] - points[b, m, 1]
                    dz = points[a, k, 2] - points[b, m, 2]
                    touch = touch or dx * dx + dy * dy + dz * dz < (radii[k] + radii[m]) ** 2
            if touch:
                n_codes = _note(codes, n_codes, _ARM_ARM, a, b)
    return n_codes, clearance


@njit(cache=True)
def _enter(ox, oy, dx, dy, half_x, half_y, best):
    """Fraction at which a ray enters an axis-aligned box round the origin, `best` if later, never, or from inside."""
    first, last = 0.0, best
    inside = True
    for axis in range(2):
        o, d, half = (ox, dx, half_x) if axis == 0 else (oy, dy, half_y)
        inside = inside and abs(o) < half
        if abs(d) < 1e-12:
            if abs(o) > half:
                return best
            continue
        t0, t1 = (-half - o) / d, (half - o) / d
        first, last = max(first, min(t0, t1)), min(last, max(t0, t1))
    return best if inside or first > last else first


@njit(cache=True)
def _cast(origins, ends, cars, body, boxes, bin_ptr, bin_box, n_bins, out):
    """Walk each ray through the bins it crosses; cars are tried one by one.

    Source: J. Amanatides, A. Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987.
    """
    shift, length, width = body
    circle2 = length * length + width * width
    for r in range(len(origins)):
        ox, oy = origins[r, 0], origins[r, 1]
        dx, dy = ends[r, 0] - ox, ends[r, 1] - oy
        best = 1.0
        for i in range(len(cars)):
            cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
            px, py = ox - cars[i, 0] - shift * cos, oy - cars[i, 1] - shift * sin
            t = min(max(-(px * dx + py * dy) / max(dx * dx + dy * dy, 1e-12), 0.0), 1.0)
            if (px + t * dx) ** 2 + (py + t * dy) ** 2 <= circle2:
                ahead, left = cos * px + sin * py, cos * py - sin * px
                best = _enter(ahead, left, cos * dx + sin * dy, cos * dy - sin * dx, length, width, best)
        ix, iy = math.floor(ox / BIN_M), math.floor(oy / BIN_M)
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        next_x = ((ix + (dx > 0.0)) * BIN_M - ox) / dx if dx != 0.0 else math.inf
        next_y = ((iy + (dy > 0.0)) * BIN_M - oy) / dy if dy != 0.0 else math.inf
        while True:
            if 0 <= ix < n_bins[0] and 0 <= iy < n_bins[1]:
                for entry in range(bin_ptr[iy * n_bins[0] + ix], bin_ptr[iy * n_bins[0] + ix + 1]):
                    b = bin_box[entry]
                    best = _enter(ox - boxes[b, 0], oy - boxes[b, 1], dx, dy, boxes[b, 2], boxes[b, 3], best)
            if min(next_x, next_y) > best:
                break
            if next_x < next_y:
                ix += step_x
                next_x += BIN_M / abs(dx)
            else:
                iy += step_y
                next_y += BIN_M / abs(dy)
        out[r] = best
