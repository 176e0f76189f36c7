"""Kinematic world: cars, rate-limited arms and riding parcels on the flat floor, without physics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.errors import ConfigError, FleetError
from fleet.robots.angle import wrapped, wrapped_all
from fleet.robots.cars.models import CarModels
from fleet.robots.twist.motion import TwistMotion
from fleet.sensors.camera import Camera, CameraImage
from fleet.sensors.errors import SensorError
from fleet.world.arms import ServoArms
from fleet.world.collisions import NOT_HELD
from fleet.world.parcels import ParcelSnapshot, PlanarParcels
from fleet.world.pods import PlanarPods, PlanarPodsSnapshot
from fleet.world.protocol import TOOL_FAILED, Contacts, ParcelBody
from fleet.world.ray_points import ray_points
from fleet.world.scene import Scene
from fleet.world.surroundings import Surroundings, SurroundingsSnapshot

TYRE_GRIP_MPS2 = 0.9 * 9.81
"""Sideways acceleration that a car's tyres hold in physics: their friction on the floor times gravity [m/s^2]."""
_LIMITS = (
    "wheelbase_m",
    "max_speed_mps",
    "max_accel_mps2",
    "max_brake_mps2",
    "max_steering_rad",
    "max_steering_rate_radps",
)
PASS, STOP, HOLD = CONTACTS = ("pass", "stop", "hold")
"""What collisions do in a kinematic world."""


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

    def put(self, car: int, pose: FloatArray) -> None:
        """Let a car stand at a pose x, y, yaw, shape (3,)."""

    def push(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Displace a car."""

    def save(self) -> tuple[npt.NDArray[np.generic], ...]:
        """Copies of all that decides how cars move on."""

    def load(self, snapshot: tuple[npt.NDArray[np.generic], ...]) -> None:
        """Return to a saved state."""


class _CarStates:
    """Where cars are and how fast, which is all that decides how they move on.

    Attributes:
        poses: x, y, yaw, shape (n_cars, 3).
        speeds: Signed forward speeds [m/s], shape (n_cars,).
        steering: Steering angles [rad], of cars that do not steer yaw rates [rad/s], shape (n_cars,).

    Args:
        start: Poses x, y, yaw, shape (n_cars, 3).
    """

    def __init__(self, start: FloatArray) -> None:
        self.poses = np.array(start, dtype=np.float64)
        self.speeds = np.zeros(len(start))
        self.steering = np.zeros(len(start))

    def push(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `CarMotion`."""
        self.poses[car] += (dx_m, dy_m, dyaw_rad)

    def put(self, car: int, pose: FloatArray) -> None:
        """See `CarMotion`."""
        self.poses[car] = pose
        self.speeds[car] = 0.0

    def save(self) -> tuple[npt.NDArray[np.generic], ...]:
        """See `CarMotion`."""
        return self.poses.copy(), self.speeds.copy(), self.steering.copy()

    def load(self, snapshot: tuple[npt.NDArray[np.generic], ...]) -> None:
        """See `CarMotion`."""
        self.poses[:], self.speeds[:], self.steering[:] = snapshot


class BicycleCars(_CarStates):
    """Cars as bicycles: speed and steering go to their commands steadily over each tick, within the limits.

    Tyres do not slip, unless a curve asks for more than their grip: then the car drives a wider one.

    Args:
        models: Models of the cars with their limits.
        start: Poses x, y, yaw, shape (n_cars, 3).
        tick_s: Length of a tick [s].
        substep_s: Greatest integration step [s].
        grip_mps2: Greatest sideways acceleration [m/s^2].
    """

    def __init__(
        self, models: CarModels, start: FloatArray, tick_s: float, substep_s: float, grip_mps2: float = math.inf
    ) -> None:
        super().__init__(start)
        self._limits = np.stack([models.each(number) for number in _LIMITS], axis=1)
        self._n_substeps = max(1, math.ceil(tick_s / substep_s - 1e-9))
        self._substep_s = tick_s / self._n_substeps
        self._grip_mps2 = grip_mps2

    def step(self, commands: FloatArray) -> None:
        """See `CarMotion`."""
        _drive(
            self.poses,
            self.speeds,
            self.steering,
            commands,
            self._n_substeps,
            self._substep_s,
            self._limits,
            self._grip_mps2,
        )


class UnlikeCars(_CarStates):
    """Cars of several drives: those that steer as `BicycleCars`, the others as `TwistMotion`; arguments as there."""

    def __init__(
        self, models: CarModels, start: FloatArray, tick_s: float, substep_s: float, grip_mps2: float = math.inf
    ) -> None:
        super().__init__(start)
        self._steers = models.each("turn_base_m") > 0.0
        steers = np.flatnonzero(self._steers)
        self._steered = steers, BicycleCars(models.some(steers), start[steers], tick_s, substep_s, grip_mps2)
        self._twisted = []
        for number, kind in enumerate(models.kinds):
            if kind.differential is not None:
                cars = models.cars_of(number)
                self._twisted.append((cars, TwistMotion(kind.differential, start[cars], tick_s, substep_s)))

    def put(self, car: int, pose: FloatArray) -> None:
        """See `CarMotion`; wheels stay as they are steered, but a car that does not steer no longer turns."""
        super().put(car, pose)
        if not self._steers[car]:
            self.steering[car] = 0.0

    def step(self, commands: FloatArray) -> None:
        """See `CarMotion`; a car that does not steer is told a yaw rate [rad/s] and a speed."""
        cars, bicycles = self._steered
        bicycles.load((self.poses[cars], self.speeds[cars], self.steering[cars]))
        bicycles.step(commands[cars])
        self.poses[cars], self.speeds[cars], self.steering[cars] = bicycles.save()
        for cars, motion in self._twisted:
            motion.load((self.poses[cars], self.speeds[cars], self.steering[cars]))
            motion.step(commands[cars][:, ::-1].copy())
            self.poses[cars], self.speeds[cars], self.steering[cars] = motion.save()
        self.poses[:, 2] = wrapped_all(self.poses[:, 2])


@dataclass(frozen=True, kw_only=True)
class PlanarSnapshot:
    """State of a `PlanarWorld` at one instant."""

    cars: tuple[npt.NDArray[np.generic], ...]
    arms: tuple[FloatArray, FloatArray]
    parcels: ParcelSnapshot
    failed: BoolArray
    surroundings: SurroundingsSnapshot
    pods: PlanarPodsSnapshot | None


class PlanarWorld:
    """A `World` without physics; only the way its cars move is left open.

    Contacts and clearances are judged at the end of each tick, by geometry. What they do to cars is the `contact`.

    Args:
        scene: The world at the start.
        cars: Moves the cars.
        tick_s: Length of one tick [s].
        contact: What a collision with a car or a box does, see `KinematicConfig`; arms and parcels stop nothing.
    """

    def __init__(self, scene: Scene, cars: CarMotion, tick_s: float, *, contact: str = PASS) -> None:
        self.tick_s = tick_s
        self.n_cars = len(scene.car_start)
        self.n_arms = len(scene.arm_base)
        self._cars = cars
        self._contact = contact
        self._arms = ServoArms(scene.arms, scene.arm_base, scene.arm_start, tick_s)
        self._parcels = PlanarParcels(scene.boxes, scene.cars, self.n_arms)
        self._failed = np.zeros(self.n_arms, dtype=np.bool_)
        self._surroundings = Surroundings(scene, self._arms)
        self.pods = PlanarPods(scene.pod_start, self.n_cars, tick_s) if len(scene.pod_start) else None

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """See `World`; joints are moved by position alone, `arm_qd` is not used.

        Raises:
            CommandError: An array has the wrong shape.
        """
        shapes = (car_commands.shape, arm_q.shape, grip.shape)
        valid = ((self.n_cars, 2), self._arms.q.shape, (self.n_arms,))
        if shapes != valid:
            raise CommandError(f"step: car_commands, arm_q, grip have shapes {shapes}; valid: {valid}")
        before = self._cars.poses.copy() if self._contact == HOLD else NOT_HELD
        self._cars.step(car_commands)
        if self._contact != PASS:
            self._surroundings.set_apart(self._cars.poses, self._cars.speeds, before)
        self._arms.step(arm_q)
        self._failed &= grip
        self._parcels.update(self._cars.poses, self._arms.tips, grip & ~self._failed)
        if self.pods is not None:
            self.pods.step(self._cars.poses)
            self._surroundings.see_pods(self.pods.planar, self.pods.carried_by())
        self._surroundings.observe(self._cars.poses, self._parcels.held_spheres())

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
        return self._parcels.ids

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

    def shove_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `World`."""
        poses = self._cars.poses.copy()
        self._surroundings.shove(poses, car, np.array([dx_m, dy_m, dyaw_rad]))
        dx_m, dy_m, dyaw_rad = (poses[car] - self._cars.poses[car]).tolist()
        self._cars.push(car, dx_m, dy_m, dyaw_rad)

    def put_car(self, car: int, pose: FloatArray) -> None:
        """See `World`."""
        self._cars.put(car, pose)

    def fail_grip(self, arm: int) -> None:
        """See `World`; the parcel falls within the next tick."""
        self._failed[arm] = True

    def grip_loss(self, arm: int) -> str:
        """See `World`; tools lose nothing unless they fail."""
        return TOOL_FAILED if self._failed[arm] else ""

    def contacts(self) -> Contacts:
        """See `World`."""
        return Contacts(robot=self._surroundings.n_robot_contacts, static=self._surroundings.n_static_contacts)

    def contacts_of(self) -> tuple[IntArray, IntArray]:
        """See `World`."""
        return self._surroundings.of_cars.copy(), self._surroundings.of_arms.copy()

    def min_clearance_m(self) -> float:
        """See `World`; arms are spheres here, so theirs is a coarse figure."""
        return self._surroundings.min_clearance_m

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """See `World`; in the plane: z is ignored, a body that contains a ray's origin does not stop it."""
        return self._surroundings.rays(*ray_points(origins, ends), self._cars.poses)

    def image(self, camera: Camera) -> CameraImage:
        """Refuse: nothing here has a body that could be seen.

        Raises:
            SensorError: Always.
        """
        raise SensorError(f"camera {camera.name}: this world has no bodies to see; valid: fidelity physics or mixed")

    def save(self, *, settle: bool = False) -> PlanarSnapshot:
        """See `World`; this one has no past to forget."""
        del settle
        return PlanarSnapshot(
            cars=self._cars.save(),
            arms=self._arms.save(),
            parcels=self._parcels.save(),
            failed=self._failed.copy(),
            surroundings=self._surroundings.save(),
            pods=None if self.pods is None else self.pods.save(),
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
        self._failed = snapshot.failed.copy()
        self._surroundings.load(snapshot.surroundings)
        if self.pods is not None and snapshot.pods is not None:
            self.pods.load(snapshot.pods)
            self._surroundings.see_pods(self.pods.planar, self.pods.carried_by())

    def state_bytes(self) -> bytes:
        """See `World`."""
        parcels = self._parcels
        pods = () if self.pods is None else self.pods.save()
        arrays = (*self._cars.save(), *self._arms.save(), parcels.ids, parcels.poses, parcels.held, *pods)
        return b"".join(array.tobytes() for array in arrays)

    def close(self) -> None:
        """See `World`; there is nothing to free."""


@dataclass(frozen=True, kw_only=True)
class KinematicConfig:
    """Time steps of the kinematic world, and what a collision does."""

    tick_s: float = 0.05
    substep_s: float = 0.0125
    """Greatest integration step of the car model [s]."""
    grip_mps2: float = math.inf
    """Greatest sideways acceleration of cars [m/s^2]; that of tyres in physics is `TYRE_GRIP_MPS2`."""
    contact: str = PASS
    """`pass`: cars drive through each other and through walls, and only the touches are counted; `stop`: they are set
    apart and lose their speed, see `fleet.world.collisions`; `hold`: and a nose that meets something head-on is held by
    friction, so that its car has to reverse, as in physics."""

    def __post_init__(self) -> None:
        if self.contact not in CONTACTS:
            valid = ", ".join(CONTACTS)
            raise ConfigError(f"kinematic world: contact is {self.contact!r}; valid: {valid}")
        if not self.grip_mps2 > 0:
            raise ConfigError(f"kinematic world: grip_mps2 is {self.grip_mps2!r}; valid: a number > 0")
        for name in ("tick_s", "substep_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"kinematic world: {name} is {value!r}; valid: a number > 0")


class KinematicWorld(PlanarWorld):
    """A `World` of cars without physics.

    Args:
        scene: The world at the start.
        config: Time steps, and what a collision does.
    """

    def __init__(self, scene: Scene, config: KinematicConfig | None = None) -> None:
        config = config or KinematicConfig()
        motion = BicycleCars if all(kind.steers for kind in scene.car_kinds) else UnlikeCars
        cars = motion(scene.cars, scene.car_start, config.tick_s, config.substep_s, config.grip_mps2)
        super().__init__(scene, cars, config.tick_s, contact=config.contact)

    def place(self, car_poses: FloatArray, arm_q: FloatArray) -> None:
        """See `OpenWorld`."""
        still = np.zeros(self.n_cars)
        self._cars.load((car_poses, still, still))
        self._arms.load((arm_q, np.zeros_like(arm_q)))


@njit(cache=True)
def _drive(  # flat: bundled, it would take 2 us instead of 0.7, as often as the world is stepped
    poses: FloatArray,
    speeds: FloatArray,
    steering: FloatArray,
    commands: FloatArray,
    n_substeps: int,
    dt: float,
    limits: FloatArray,
    grip: float,
) -> None:
    """Bicycle model by the midpoint rule; speed and steering reach what they can of the command at the tick's end."""
    tick = n_substeps * dt
    for i in range(len(poses)):
        wheelbase, max_speed, accel, brake = limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3]
        max_steering, steering_rate = limits[i, 4], limits[i, 5]
        goal_speed = min(max(commands[i, 1], -max_speed), max_speed)
        goal_steering = min(max(commands[i, 0], -max_steering), max_steering)
        old_speed, old_steering = speeds[i], steering[i]
        # Slowing down is braking, at most to a stand within a tick; the rest is accelerating.
        if goal_speed * old_speed < 0.0:
            goal_speed = 0.0
        rate = brake if abs(goal_speed) < abs(old_speed) else accel
        speeds[i] = min(max(goal_speed, old_speed - rate * tick), old_speed + rate * tick)
        turned = steering_rate * tick
        steering[i] = min(max(goal_steering, old_steering - turned), old_steering + turned)
        if old_speed == 0.0 and speeds[i] == 0.0:  # most cars stand
            poses[i, 2] = wrapped(poses[i, 2])
            continue
        for step in range(n_substeps):
            part = (step + 0.5) / n_substeps
            way = (old_speed + part * (speeds[i] - old_speed)) * dt
            turn = way * math.tan(old_steering + part * (steering[i] - old_steering)) / wheelbase
            if abs(way * turn) > grip * dt * dt:
                turn = math.copysign(grip * dt * dt / way, turn)
            middle = poses[i, 2] + 0.5 * turn
            poses[i, 0] += way * math.cos(middle)
            poses[i, 1] += way * math.sin(middle)
            poses[i, 2] += turn
        poses[i, 2] = wrapped(poses[i, 2])
