"""MixedWorld: contact physics where arms work, kinematic cars elsewhere, in one world."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.sensors.camera import Camera, CameraImage
from fleet.sensors.errors import SensorError
from fleet.world.arms import ServoArms
from fleet.world.kinematic import BicycleCars, CommandError, SnapshotError
from fleet.world.mixed.config import MixedConfig
from fleet.world.mixed.region import Region, RegionSnapshot
from fleet.world.mixed.split import regions_of
from fleet.world.parcels import ParcelError, ParcelSnapshot, PlanarParcels
from fleet.world.protocol import Contacts, ParcelBody
from fleet.world.ray_points import ray_points
from fleet.world.scene import Scene
from fleet.world.surroundings import Surroundings, SurroundingsSnapshot
from fleet.world.touches import ARM_ARM, CAR_ARM, CAR_CAR, KIND_SHIFT, robots_of

OUTSIDE = -1
"""In place of a region's number: a car or a parcel is in none."""


@dataclass(frozen=True, kw_only=True)
class MixedSnapshot:
    """State of a `MixedWorld` at one instant."""

    cars: tuple[npt.NDArray[np.generic], ...]
    arms: tuple[FloatArray, FloatArray]
    regions: tuple[RegionSnapshot, ...]
    parcels: ParcelSnapshot
    loose: dict[int, ParcelBody]
    surroundings: SurroundingsSnapshot
    region_of: IntArray
    slot_of: IntArray
    counts: tuple[Contacts, IntArray, IntArray]
    told: _Told


class _Told(NamedTuple):
    """What robots were told in the last tick."""

    cars: FloatArray
    """Steering [rad] and speed [m/s], shape (n_cars, 2)."""
    q: FloatArray
    """Joint targets [rad], shape (n_arms, n_joints)."""
    qd: FloatArray
    """Joint velocities there [rad/s], same shape."""
    grip: BoolArray
    """Shape (n_arms,)."""

    def copy(self) -> _Told:
        """A copy of its own."""
        return _Told(cars=self.cars.copy(), q=self.q.copy(), qd=self.qd.copy(), grip=self.grip.copy())


class MixedWorld:
    """Physics round the arms, where parcels are gripped, put down and carried off; bicycles on the rest of the floor.

    Physics: arms, their tools, parcels within reach of an arm, and cars whose trays are within `MixedConfig.radius_m`
    of an arm's base; contacts among them and with walls, racks and obstacles there.

    Not physics: all other cars, which are those of a `KinematicWorld` with `contact="stop"`, and the parcels on their
    trays, which keep their places there. What they touch is judged by geometry, as `Surroundings` does.

    A car is handed over with its pose, speed and steering, and with what lies in its tray, which keeps its pose
    relative to the car. A region in which nothing moves is not stepped.

    Args:
        scene: The world at the start.
        config: Settings.

    Raises:
        PhysicsError: The engine refuses a description.
    """

    def __init__(self, scene: Scene, config: MixedConfig | None = None) -> None:
        self._config = config = config or MixedConfig()
        self._scene = scene
        self.tick_s = config.tick_s
        self.pods = None
        self.n_cars = len(scene.car_start)
        self.n_arms = len(scene.arm_base)
        self._cars = BicycleCars(scene.cars, scene.car_start, config.tick_s, config.car_substep_s)
        self._arms = ServoArms(scene.arms, scene.arm_base, scene.arm_start, config.tick_s)
        self._surroundings = Surroundings(scene, self._arms)
        self._regions: list[Region] = []
        try:
            for arms in regions_of(scene, config):
                self._regions.append(Region(scene, arms, config))
        except BaseException:
            self.close()
            raise
        self._region_of_arm = np.zeros(self.n_arms, dtype=np.int64)
        for number, region in enumerate(self._regions):
            self._region_of_arm[region.arms] = number
        self._arm_xy = np.ascontiguousarray(np.asarray(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2])
        self._region_of = np.full(self.n_cars, OUTSIDE, dtype=np.int64)
        self._slot_of = np.full(self.n_cars, -1, dtype=np.int64)
        self._wanted = np.full(self.n_cars, OUTSIDE, dtype=np.int64)
        self._q = np.array(scene.arm_start, dtype=np.float64).reshape(self._arms.q.shape)
        self._qd = np.zeros_like(self._q)
        self._held = np.full(self.n_arms, -1, dtype=np.int64)
        self._told = _Told(
            cars=np.full((self.n_cars, 2), np.nan),
            q=np.full_like(self._q, np.nan),
            qd=np.full_like(self._q, np.nan),
            grip=np.zeros(self.n_arms, dtype=np.bool_),
        )
        self._ids = np.zeros(0, dtype=np.int64)
        self._loose_parcels = PlanarParcels(scene.boxes, scene.cars, 0)
        self._no_tips, self._no_grip = np.zeros((0, 7)), np.zeros(0, dtype=np.bool_)
        self._loose: dict[int, ParcelBody] = {}
        self._counts = Contacts()
        self._of_cars = np.zeros(self.n_cars, dtype=np.int64)
        self._of_arms = np.zeros(self.n_arms, dtype=np.int64)
        self._parcels_changed()
        for number in range(len(self._regions)):
            self._read(number)
        self._hand_over()

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick; see `World.step`.

        Raises:
            CommandError: An array has the wrong shape.
        """
        shapes = (car_commands.shape, arm_q.shape, arm_qd.shape, grip.shape)
        valid = ((self.n_cars, 2), self._q.shape, self._q.shape, (self.n_arms,))
        if shapes != valid:
            raise CommandError(f"step: car_commands, arm_q, arm_qd, grip have shapes {shapes}; valid: {valid}")
        self._hand_over()
        cars = self._cars
        inside = np.flatnonzero(self._region_of >= 0)
        with self._kept(inside):
            cars.step(car_commands)
        self._wake(inside, car_commands, arm_q, arm_qd, grip)
        for number, region in enumerate(self._regions):
            if not region.asleep:
                region.step(car_commands, arm_q, arm_qd, grip)
                self._read(number)
        if len(self._loose_parcels.ids):
            self._loose_parcels.update(cars.poses, self._no_tips, self._no_grip)
        self._arms.follow(self._q, self._qd)
        touching = self._surroundings.observe(cars.poses, self._held_spheres(), self._is_physics)
        if touching:
            self._set_apart()

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
        return self._q.copy()

    def arm_velocities(self) -> FloatArray:
        """See `World`."""
        return self._qd.copy()

    def held(self) -> IntArray:
        """See `World`."""
        return self._held.copy()

    def parcel_ids(self) -> IntArray:
        """See `World`."""
        return self._ids

    def parcel_poses(self) -> FloatArray:
        """See `World`."""
        poses = self._poses
        loose = self._loose_parcels
        poses[self._loose_rows] = loose.poses
        return poses.copy()

    def add_parcel(self, body: ParcelBody) -> None:
        """Put a parcel into the world: into the region of the arm that reaches it, or where it drops onto.

        Raises:
            ParcelError: The id is in use.
        """
        if body.parcel in self._ids:
            raise ParcelError(f"parcel {body.parcel} is in the world already; valid: an id not in use")
        region = self._region_at(body.pose[:2], self._config.radius_m)
        if region is not None:
            region.add_parcel(body)
        else:
            self._loose_parcels.add(body, self._cars.poses)
            self._loose[body.parcel] = body
        self._parcels_changed()

    def remove_parcel(self, parcel: int) -> None:
        """Take a parcel out of the world.

        Raises:
            ParcelError: No such parcel.
        """
        if parcel in self._loose:
            self._loose_parcels.remove(parcel)
            del self._loose[parcel]
        else:
            region = self._region_with(parcel)
            region.remove_parcel(parcel)
            self._held[region.arms] = region.world.held()
        self._parcels_changed()

    def set_serving(self, arm: int, car: int) -> None:
        """See `World`."""
        self._surroundings.serving[arm] = car
        self._regions[self._region_of_arm[arm]].serve(arm, car)

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """See `World`."""
        self._surroundings.add_box(obstacle, centre_m, half_m)
        for region in self._regions:
            region.add_obstacle(obstacle, np.asarray(centre_m), np.asarray(half_m))

    def remove_obstacle(self, obstacle: int) -> None:
        """See `World`."""
        self._surroundings.remove_box(obstacle)
        for region in self._regions:
            region.remove_obstacle(obstacle)

    def push_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Shove a car until something is in the way: at once, or for half a second where there is physics."""
        if self._region_of[car] >= 0:
            region = self._regions[self._region_of[car]]
            region.wake()
            region.world.push_car(int(self._slot_of[car]), dx_m, dy_m, dyaw_rad)
            return
        self._surroundings.shove(self._cars.poses, car, np.array([dx_m, dy_m, dyaw_rad]))

    def shove_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `World`."""
        self.push_car(car, dx_m, dy_m, dyaw_rad)

    def put_car(self, car: int, pose: FloatArray) -> None:
        """See `World`."""
        if self._region_of[car] >= 0:
            self._hand_back(car)
        self._cars.put(car, pose)

    def fail_grip(self, arm: int) -> None:
        """See `World`."""
        region = self._regions[self._region_of_arm[arm]]
        region.wake()
        region.world.fail_grip(int(np.searchsorted(region.arms, arm)))

    def grip_loss(self, arm: int) -> str:
        """See `World`."""
        region = self._regions[self._region_of_arm[arm]]
        return region.world.grip_loss(int(np.searchsorted(region.arms, arm)))

    def contacts(self) -> Contacts:
        """Contacts so far: those that physics reports, and those that geometry does elsewhere."""
        here = self._surroundings
        return Contacts(
            robot=self._counts.robot + here.n_robot_contacts, static=self._counts.static + here.n_static_contacts
        )

    def contacts_of(self) -> tuple[IntArray, IntArray]:
        """See `World`."""
        return self._of_cars + self._surroundings.of_cars, self._of_arms + self._surroundings.of_arms

    def min_clearance_m(self) -> float:
        """Smallest clearance so far, by geometry everywhere [m]."""
        return self._surroundings.min_clearance_m

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """Hit fractions, shape (r,): walls, boxes, cars and feet of arms as seen from above, and near arms all bodies.

        Raises:
            SensorError: Other shapes, or numbers that are no places.
        """
        origins, ends = ray_points(origins, ends)
        hits = self._surroundings.rays(origins, ends, self._cars.poses)
        way = ends[:, :2] - origins[:, :2]
        square = np.maximum((way * way).sum(axis=1), 1e-12)
        for region in self._regions:
            near = np.zeros(len(hits), dtype=np.bool_)
            for x, y in self._arm_xy[region.arms]:
                gap = np.array([x, y]) - origins[:, :2]
                along = np.clip((gap * way).sum(axis=1) / square, 0.0, 1.0)
                near |= np.hypot(*(gap - along[:, None] * way).T) <= self._arms.reach_m
            if near.any():
                hits[near] = np.minimum(hits[near], region.world.rays(origins[near], ends[near]))
        return hits

    def image(self, camera: Camera) -> CameraImage:
        """What a camera at an arm sees: all that is in the region of the nearest arm.

        Raises:
            SensorError: No arm is in sight, or cars are not to be seen.
        """
        region = self._region_at(camera.aims_at, self._config.near_m)
        if region is None:
            raise SensorError(f"camera {camera.name}: no arm is near what it looks at; valid: a camera at a station")
        return region.world.image(camera)

    def place(self, car_poses: FloatArray, arm_q: FloatArray) -> None:
        """See `OpenWorld`."""
        for car in np.flatnonzero(self._region_of >= 0).tolist():
            self._hand_back(car)
        still = np.zeros(self.n_cars)
        self._cars.load((np.asarray(car_poses), still, still))
        for number, region in enumerate(self._regions):
            region.wake()
            region.world.place(region.world.car_poses(), np.asarray(arm_q)[region.arms])
            self._read(number)
        self._arms.load((self._q, np.zeros_like(self._q)))
        self._hand_over()

    def save(self, *, settle: bool = False) -> MixedSnapshot:
        """See `World`; what `BulletWorld` says of exactness holds for each region."""
        return MixedSnapshot(
            cars=self._cars.save(),
            arms=(self._q.copy(), self._qd.copy()),
            regions=tuple(region.save(settle=settle) for region in self._regions),
            parcels=self._loose_parcels.save(),
            loose=dict(self._loose),
            surroundings=self._surroundings.save(),
            region_of=self._region_of.copy(),
            slot_of=self._slot_of.copy(),
            counts=(replace(self._counts), self._of_cars.copy(), self._of_arms.copy()),
            told=self._told.copy(),
        )

    def load(self, snapshot: object) -> None:
        """See `World`.

        Raises:
            SnapshotError: The snapshot is of another kind of world, or of one with other robots.
        """
        if not isinstance(snapshot, MixedSnapshot) or len(snapshot.cars[0]) != self.n_cars:
            raise SnapshotError(f"snapshot is {type(snapshot).__name__}; valid: what save() of this world returned")
        self._cars.load(snapshot.cars)
        for region, part in zip(self._regions, snapshot.regions, strict=True):
            region.load(part)
            self._held[region.arms] = region.world.held()
        self._q[:], self._qd[:] = snapshot.arms
        self._arms.load(snapshot.arms)
        self._loose_parcels.load(snapshot.parcels)
        self._loose = dict(snapshot.loose)
        self._surroundings.load(snapshot.surroundings)
        self._region_of[:], self._slot_of[:] = snapshot.region_of, snapshot.slot_of
        counts, of_cars, of_arms = snapshot.counts
        self._counts = replace(counts)
        self._told = snapshot.told.copy()
        self._of_cars[:], self._of_arms[:] = of_cars, of_arms
        self._parcels_changed()

    def state_bytes(self) -> bytes:
        """See `World`."""
        loose = self._loose_parcels
        arrays = (*self._cars.save(), self._q, self._qd, loose.ids, loose.poses)
        return b"".join((*(array.tobytes() for array in arrays), *(region.state_bytes() for region in self._regions)))

    def close(self) -> None:
        """See `World`."""
        for region in self._regions:
            region.world.close()

    def regions(self) -> IntArray:
        """The region that each car is in, -1 for none, shape (n_cars,)."""
        return self._region_of.copy()

    def n_awake(self) -> int:
        """Number of regions in which something moves, or may."""
        return sum(not region.asleep for region in self._regions)

    # --- cars that come to arms, and go

    def _hand_over(self) -> None:
        """Let cars that come to an arm drive on their wheels, and those that leave become bicycles again."""
        config, cars = self._config, self._cars
        if not self._regions:
            return
        _nearest(
            cars.poses,
            self._scene.car.tray_x_m,
            self._arm_xy,
            self._region_of_arm,
            self._region_of,
            config.radius_m,
            config.radius_m + config.margin_m,
            self._wanted,
        )
        moves = np.flatnonzero(self._wanted != self._region_of).tolist()
        for car in moves:
            if self._region_of[car] >= 0:
                self._hand_back(car)
        for car in moves:
            if self._wanted[car] >= 0:
                self._hand_in(car, int(self._wanted[car]))

    def _wake(
        self, inside: IntArray, commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray
    ) -> None:
        """Wake the regions in which a robot is told something else than in the last tick."""
        told = self._told
        arms = (told.q != arm_q).any(axis=1) | (told.qd != arm_qd).any(axis=1) | (told.grip != grip)
        cars = inside[(told.cars[inside] != commands[inside]).any(axis=1)]
        for number in {*self._region_of_arm[arms].tolist(), *self._region_of[cars].tolist()}:
            self._regions[number].wake()
        told.cars[:], told.q[:], told.qd[:], told.grip[:] = commands, arm_q, arm_qd, grip

    def _hand_in(self, car: int, number: int) -> None:
        """Give a car to a region, if that has a body for it; else it is tried again in the next tick."""
        region, cars = self._regions[number], self._cars
        speed, steering = float(cars.speeds[car]), float(cars.steering[car])
        slot = region.free_slot(moving=speed != 0.0)
        if slot < 0:
            return
        region.enter(slot, car, cars.poses[car], speed, steering)
        self._region_of[car], self._slot_of[car] = number, slot
        for parcel in self._loose_parcels.on_car(car):
            body = replace(self._loose.pop(parcel), pose=self._loose_parcels.pose(parcel).copy())
            self._loose_parcels.remove(parcel)
            region.add_parcel(body, _carried(cars.poses[car], speed, steering, self._scene.car.wheelbase_m, body.pose))
            self._parcels_changed()

    def _hand_back(self, car: int) -> None:
        """Take a car out of its region, with what lies in its tray."""
        region, slot = self._regions[self._region_of[car]], int(self._slot_of[car])
        for parcel in region.world.in_tray(slot):
            body = region.remove_parcel(parcel)
            self._loose_parcels.load_on(body, car, self._cars.poses[car])
            self._loose[parcel] = body
            self._parcels_changed()
        region.leave(slot)
        self._region_of[car], self._slot_of[car] = OUTSIDE, -1

    def _read(self, number: int) -> None:
        """Take over what a region has done in a tick."""
        region, cars = self._regions[number], self._cars
        world = region.world
        slots = np.flatnonzero(region.car_in >= 0)
        if len(slots):
            here = region.car_in[slots]
            cars.poses[here] = world.car_poses()[slots]
            cars.speeds[here] = world.car_speeds()[slots]
            cars.steering[here] = world.car_steering()[slots]
        self._q[region.arms], self._qd[region.arms] = world.arm_positions(), world.arm_velocities()
        self._held[region.arms] = world.held()
        self._poses[self._rows[number]] = world.parcel_poses()
        fresh = region.fresh_contacts()
        if fresh is not None:
            counts, of_cars, of_arms = fresh
            self._counts.robot += counts.robot
            self._counts.static += counts.static
            used = region.car_in >= 0
            self._of_cars[region.car_in[used]] += of_cars[used]
            self._of_arms[region.arms] += of_arms

    # --- what is elsewhere

    def _is_physics(self, code: int) -> bool:
        """Whether a region looks after a touch, so that geometry need not."""
        kind = code >> KIND_SHIFT
        cars, arms = robots_of(code)
        regions = [int(self._region_of[car]) for car in cars] + [int(self._region_of_arm[arm]) for arm in arms]
        if kind in (CAR_CAR, CAR_ARM, ARM_ARM):
            return regions[0] == regions[1] != OUTSIDE
        return regions[0] != OUTSIDE

    def _set_apart(self) -> None:
        """Let cars that touch something stop at it; those in a region are moved by nothing but physics."""
        with self._kept(np.flatnonzero(self._region_of >= 0)):
            self._surroundings.set_apart(self._cars.poses, self._cars.speeds)

    @contextmanager
    def _kept(self, inside: IntArray) -> Iterator[None]:
        """Let the motion of cars in regions be afterwards what it was before."""
        cars = self._cars
        kept = cars.poses[inside], cars.speeds[inside], cars.steering[inside]
        yield
        cars.poses[inside], cars.speeds[inside], cars.steering[inside] = kept

    # --- parcels

    def _parcels_changed(self) -> None:
        """List anew which parcels there are, and where their poses stand."""
        loose = self._loose_parcels
        parts = [region.world.parcel_ids() for region in self._regions]
        ids = np.sort(np.concatenate((loose.ids, *parts))).astype(np.int64)
        if not np.array_equal(ids, self._ids):
            self._ids = ids
        self._poses = np.zeros((len(ids), 7))
        self._radii = np.zeros(len(ids))
        self._loose_rows = np.searchsorted(ids, loose.ids)
        self._rows = [np.searchsorted(ids, part) for part in parts]
        for region, rows in zip(self._regions, self._rows, strict=True):
            self._poses[rows] = region.world.parcel_poses()
            self._radii[rows] = [math.hypot(*region.bodies[parcel].size_m) / 2.0 for parcel in self._ids[rows].tolist()]

    def _held_spheres(self) -> FloatArray:
        """Centre and radius of a ball round each tool's parcel, radius -1 for none, shape (n_arms, 4)."""
        spheres = np.full((self.n_arms, 4), -1.0)
        holding = np.flatnonzero(self._held >= 0)
        rows = np.searchsorted(self._ids, self._held[holding])
        spheres[holding, :3], spheres[holding, 3] = self._poses[rows, :3], self._radii[rows]
        return spheres

    def _region_at(self, xy: FloatArray, within_m: float) -> Region | None:
        """The region of the nearest arm, if a place is so near to that arm's base."""
        if not self.n_arms:
            return None
        gaps = np.hypot(*(self._arm_xy - np.asarray(xy)).T)
        arm = int(gaps.argmin())
        return self._regions[self._region_of_arm[arm]] if gaps[arm] <= within_m else None

    def _region_with(self, parcel: int) -> Region:
        for region in self._regions:
            if parcel in region.bodies:
                return region
        raise ParcelError(f"parcel {parcel} is not in the world; valid: {self._ids.tolist()}")


def _carried(car: FloatArray, speed: float, steering: float, wheelbase_m: float, pose: FloatArray) -> FloatArray:
    """Velocity of a thing that is carried along by a car, linear and angular, shape (6,)."""
    rate = speed * math.tan(steering) / wheelbase_m
    x, y = pose[0] - car[0], pose[1] - car[1]
    return np.array([speed * math.cos(car[2]) - rate * y, speed * math.sin(car[2]) + rate * x, 0.0, 0.0, 0.0, rate])


@njit(cache=True)
def _nearest(
    poses: FloatArray,
    tray_x: float,
    arms: FloatArray,
    region_of_arm: IntArray,
    region_of: IntArray,
    enters: float,
    leaves: float,
    wanted: IntArray,
) -> None:
    """Fill in the region that each car should be in: that of the nearest arm, if its tray is near enough; else -1."""
    for car in range(len(poses)):
        x = poses[car, 0] + tray_x * math.cos(poses[car, 2])
        y = poses[car, 1] + tray_x * math.sin(poses[car, 2])
        best, nearest = math.inf, -1
        for arm in range(len(arms)):
            dx, dy = arms[arm, 0] - x, arms[arm, 1] - y
            gap = dx * dx + dy * dy
            if gap < best:
                best, nearest = gap, region_of_arm[arm]
        limit = leaves if nearest >= 0 and nearest == region_of[car] else enters
        wanted[car] = nearest if best <= limit * limit else -1
