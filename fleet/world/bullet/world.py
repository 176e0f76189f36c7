"""BulletWorld: the shared physical world of cars, arms and parcels."""

from __future__ import annotations

import weakref
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.config import Connect, Grip
from fleet.errors import ConfigError
from fleet.robots import CARS
from fleet.sensors.camera import Camera, CameraImage
from fleet.sensors.errors import SensorError
from fleet.world.bullet.arms import Arms, MotorSteps
from fleet.world.bullet.camera import render
from fleet.world.bullet.cars import CarBodyMotion, CarReading, Cars, CarSteps
from fleet.world.bullet.clearance import Clearance, Moment
from fleet.world.bullet.contacts import ContactMonitor
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client, quiet
from fleet.world.bullet.engine.config import BulletConfig
from fleet.world.bullet.engine.sleep import Sleepers
from fleet.world.bullet.engine.urdf_text import without_visuals
from fleet.world.bullet.engine.window import EngineWindow, arranged
from fleet.world.bullet.fixed import FixedBodies
from fleet.world.bullet.ghosts import Ghosts
from fleet.world.bullet.grip import make_grip
from fleet.world.bullet.parcels import Parcels
from fleet.world.bullet.pods import PhysicalPods
from fleet.world.bullet.rays import Rays
from fleet.world.protocol import Contacts, ParcelBody
from fleet.world.ray_points import ray_points
from fleet.world.scene import Scene

_GRAVITY_MPS2 = 9.81
# What a car may gain on top of its present speed within one tick, braking and shoves included.
_NEAR_MARGIN_M = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """A moment of one `BulletWorld`; the engine frees its part when the object dies."""

    state: int
    """The engine's own copy."""
    cars: list[float]
    arms: list[float]
    reading: CarReading
    """What the engine said of the cars."""
    memory: dict[str, Any]
    """What the engine's copy does not hold."""
    parcels: dict[int, tuple[ParcelBody, FloatArray]]
    """Every parcel with position, orientation and velocities, shape (13,)."""
    obstacles: dict[int, tuple[FloatArray, FloatArray]]
    pods: list[float]
    """As `PhysicalPods.state` tells them."""
    bodies: tuple[int, ...]
    """How often cars came or went, how many ghosts were made, and the engine's ids of all else that can."""
    settled: bool
    """Whether the engine finds all pairs of bodies anew."""


class BulletWorld:
    """Cars that drive on their wheels, arms that move by joint motors, parcels with mass and contact, in one world.

    Arm set-points are meant for the end of the tick; the motors follow them with a lag of less than one physics step.

    `save` and `load`: a world in which nothing touched anything but what it stood on returns exactly, so the same
    commands give the same states to the last bit; touches leave differences in the last bits, which grow, a suction
    grip that was made or undone after the snapshot up to 1e-2. A world that settled when it was saved, with its robots
    apart and nothing in a grip, returns exactly whatever happened since. If parcels or obstacles came or went,
    what is missing is made anew and what is new is removed; positions and velocities are restored, the solver's memory
    of contacts is not. Creating a new world and repeating the same calls is always exact.

    With SHARED_MEMORY the server's world is emptied first.

    Args:
        scene: Robots and fixed things.
        config: Settings.

    Raises:
        PhysicsError: The engine cannot be reached or refuses a description.
        ConfigError: The scene's arm was described with another tool than `config.grip` names.
    """

    def __init__(self, scene: Scene, config: BulletConfig | None = None) -> None:
        config = config or BulletConfig()
        for spec in scene.arms.models:
            if spec.tool.name != config.grip:
                raise ConfigError(f"scene.arms: {spec.name} holds the tool {spec.tool.name!r}; valid: {config.grip}")
        self.tick_s = config.tick_s
        self.n_cars = len(scene.car_start)
        self.n_arms = len(scene.arm_base)
        self._n_calls = config.n_calls
        self._contact_breaking_m = config.contact_breaking_m
        self._slow, self._has_visuals = config.slow, config.visuals
        call_s = config.tick_s / config.n_calls
        at_once = config.n_steps_per_call is not None
        urdfs = [CARS[kind.name].urdf(config.wheels) for kind in scene.car_kinds]
        self._scene = scene
        self._client = client = Client(config.connect, config.shared_memory_key)
        try:
            with arranged(client, scene.size_m):
                with quiet():
                    client.resetSimulation()
                    client.setGravity(0.0, 0.0, -_GRAVITY_MPS2)
                    client.setPhysicsEngineParameter(
                        fixedTimeStep=call_s,
                        numSubSteps=config.n_steps_per_call or 0,
                        numSolverIterations=config.n_iterations,
                        solverResidualThreshold=config.residual,
                        deterministicOverlappingPairs=1,
                        collisionFilterMode=groups.BOTH_AGREE,
                    )
                client.keep_contacts(self._contact_breaking_m)
                self._fixed = FixedBodies(client, scene)
                self._cars = Cars(
                    client,
                    scene.cars,
                    scene.car_start,
                    urdfs if config.visuals else [without_visuals(urdf) for urdf in urdfs],
                    CarSteps(length_s=call_s, tick_s=config.tick_s, limit_share=config.limit_share),
                    brakes=not at_once,
                )
                self._arms = Arms(
                    client,
                    scene.arms,
                    scene.arm_base,
                    scene.arm_start,
                    MotorSteps(
                        n=config.n_calls,
                        length_s=call_s,
                        at_once=at_once,
                        limit_share=config.limit_share,
                        cubic=config.n_steps_per_tick is not None,
                    ),
                    visuals=config.visuals,
                )
                self._parcels = Parcels(client, anchored=config.grip is Grip.FRICTION)
                self._monitor = ContactMonitor(client, scene.cars, self._cars.bodies, self._arms.bodies, call_s)
                self._monitor.floor = floor = self._fixed.floor
                for body, spec in zip(self._arms.bodies, scene.arms.specs, strict=True):
                    for link in range(-1, spec.outline.n_standing_links):
                        client.setCollisionFilterPair(body, floor, link, -1, 0)
                self._monitor.pedestals, self._monitor.fixed = self._fixed.stand()
                self.pods = (
                    PhysicalPods(
                        client,
                        scene.pod_start,
                        scene.cars,
                        self._cars.bodies,
                        config.tick_s,
                        visuals=config.visuals,
                    )
                    if len(scene.pod_start)
                    else None
                )
                self._grip = make_grip(
                    config.grip,
                    client,
                    self._arms,
                    self._parcels,
                    force_n=config.grip_force_n,
                    touched=self._monitor.touched,
                    limit_share=config.limit_share,
                )
        except BaseException:
            client.close()
            raise
        self.window = EngineWindow(client, self._cars.bodies) if config.connect is Connect.GUI else None
        """The engine's own window, if it has one here."""
        self._ghosts = Ghosts(client, scene.car_kinds[0])
        self._n_car_changes = 0
        self._arm_links = [(arm, link) for arm in self._arms.bodies for link in range(-1, client.getNumJoints(arm))]
        self._clearance = Clearance(scene)
        self._empty = np.full((self.n_arms, 4), -1.0)
        self._rays = Rays(client, scene, self._arms.bodies)
        self._touch_tells = config.grip is Grip.FRICTION
        rest_s = config.sleeps_after_s
        self._sleepers = None if rest_s is None else Sleepers(client, max(1, round(rest_s / self.tick_s)))
        self._monitor.look_again()
        self._near = self._measure()
        client.performCollisionDetection()  # the engine's rays would not find all of the cars

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick; see `World.step`."""
        self._cars.drive(np.asarray(car_commands, dtype=np.float64).reshape(self.n_cars, 2))
        self._arms.aim(np.asarray(arm_q, dtype=np.float64), np.asarray(arm_qd, dtype=np.float64))
        grip = np.asarray(grip, dtype=np.bool_)
        self._grip.command(grip)
        if self._sleepers is not None:
            self._rouse(self._sleepers, grip)
        parcels = self._parcels
        watched = self._watched()
        self._client.keep_contacts(self._contact_breaking_m)
        for call in range(self._n_calls):
            self._arms.hold(call)
            self._grip.before_step()
            self._cars.before_step()
            self._client.stepSimulation()
            self._parcels.moved()
            held = [(arm, parcels.body(parcel)) for arm, parcel in enumerate(self._grip.held) if parcel >= 0]
            self._monitor.observe(watched, self._near, held, parcels.by_body)
            if self.pods is not None:
                self.pods.observe(self._monitor)
            self._grip.after_step()
        self._cars.now = self._cars.reading()
        self._arms.read()
        if self.pods is not None:
            self.pods.tick(self._cars.now.poses)
        self._near = self._measure(ghosts=False)  # they are where they were before this tick
        if self._sleepers is not None:
            self._let_sleep(self._sleepers, grip)

    def car_poses(self) -> FloatArray:
        """Rear-axle poses x, y, yaw, shape (n_cars, 3)."""
        return self._cars.now.poses.copy()

    def car_speeds(self) -> FloatArray:
        """Signed forward speed [m/s], shape (n_cars,)."""
        return self._cars.now.speeds.copy()

    def car_steering(self) -> FloatArray:
        """Measured steering angle (bicycle equivalent) [rad], shape (n_cars,)."""
        return self._cars.now.steering.copy()

    def arm_positions(self) -> FloatArray:
        """Joint positions [rad], shape (n_arms, n_joints)."""
        return self._arms.q.copy()

    def arm_velocities(self) -> FloatArray:
        """Joint velocities [rad/s], shape (n_arms, n_joints)."""
        return self._arms.qd.copy()

    def held(self) -> IntArray:
        """Parcel id in each arm's grip, -1 for none, shape (n_arms,)."""
        return np.array(self._grip.held, dtype=np.int64)

    def parcel_ids(self) -> IntArray:
        """Ids of the parcels in the world, ascending, shape (p,); the same array until one comes or goes."""
        return self._parcels.numbers()

    def parcel_poses(self) -> FloatArray:
        """Poses in the order of `parcel_ids`, shape (p, 7)."""
        return self._parcels.poses()

    def add_parcel(self, body: ParcelBody, velocity: FloatArray | None = None) -> None:
        """Put a parcel into the world; raises `PhysicsError` if its id is taken.

        Args:
            body: The parcel.
            velocity: Linear and angular, shape (6,) [m/s, rad/s]; None = it stands.
        """
        self._parcels.add(body)
        if velocity is not None:
            self._parcels.place(body.parcel, np.concatenate((body.pose, velocity)))

    def remove_parcel(self, parcel: int) -> None:
        """Take a parcel out of the world; raises `PhysicsError` if it is not there."""
        body = self._parcels.body(parcel)
        if self._sleepers is not None:
            self._sleepers.forget(body)
        self._grip.forget(parcel)
        self._parcels.remove(parcel)

    def set_serving(self, arm: int, car: int) -> None:
        """Say which car's tray an arm may touch (-1: none); used to judge contacts and clearance only."""
        self._monitor.serving[arm] = car

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put a fixed box into the world; raises `PhysicsError` if its id is taken."""
        self._monitor.fixed.add(self._fixed.add(obstacle, centre_m, half_m))
        self._monitor.look_again()
        self._near = self._measure()

    def remove_obstacle(self, obstacle: int) -> None:
        """Take such a box away; raises `PhysicsError` if it is not there."""
        self._monitor.fixed.discard(self._fixed.remove(obstacle))
        self._monitor.look_again()
        self._near = self._measure()

    def obstacle_ids(self) -> set[int]:
        """Ids of the boxes that were added and not removed."""
        return set(self._fixed.obstacles())

    def push_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Shove a car for half a second: by that much in the world's frame, unless something is in the way."""
        self._cars.push(car, np.array([dx_m, dy_m, dyaw_rad]))

    def shove_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `World`."""
        self.push_car(car, dx_m, dy_m, dyaw_rad)

    def put_car(self, car: int, pose: FloatArray) -> None:
        """See `World`."""
        self._cars.put(car, pose)
        self._near = self._measure()

    def ride(self) -> None:
        """Remember how cars stand on their wheels, for `enter_car`; the first one has to stand still."""
        self._cars.note_ride()

    def set_car_aside(self, car: int, pose: FloatArray) -> None:
        """Take a car out of all that happens, asleep at a pose x, y, yaw where nothing comes, shape (3,)."""
        if self._sleepers is not None:
            self._sleepers.forget(self._cars.bodies[car])
        self._cars.set_aside(car, pose)
        self._near = self._measure()

    def rouse_car(self, car: int) -> None:
        """Wake a car that was set aside, a tick before it enters in motion."""
        self._cars.rouse(car)

    def enter_car(self, car: int, pose: FloatArray, speed_mps: float, steering_rad: float) -> None:
        """Let a car that was set aside drive on from a motion; the pose is that of its rear axle, shape (3,)."""
        self._cars.enter(car, pose, speed_mps, steering_rad)
        self._monitor.look_again()
        self._near = self._measure()

    def car_motion(self, car: int) -> CarBodyMotion:
        """All that a car takes along into another world."""
        return self._cars.motion(car)

    def admit_car(self, pose: FloatArray, motion: CarBodyMotion | None = None) -> None:
        """Let one more car come, as the last one.

        Args:
            pose: Of its rear axle x, y, yaw, shape (3,).
            motion: What it takes along; None = it stands.
        """
        self._cars.admit(pose, motion)
        self._other_cars()

    def dismiss_car(self, car: int) -> None:
        """Let a car go; those after it move up by one place."""
        self._cars.dismiss(car)
        self._other_cars()

    def show_ghosts(self, numbers: list[int], poses: FloatArray, own: list[int]) -> None:
        """Show cars of other worlds: what runs into them is stopped, and counts.

        Args:
            numbers: Which they are, in the numbers of the fleet.
            poses: Of their rear axles x, y, yaw, shape (g, 3).
            own: Numbers of this world's cars; a touch with a ghost of a lower one is counted in the ghost's world.
        """
        if not numbers and not self._ghosts.bodies:
            return
        self._ghosts.show(numbers, poses)
        self._monitor.ghosts = {body: number for number, body in self._ghosts.bodies.items()}
        self._monitor.numbers = own
        self._near = self._measure()

    def in_tray(self, car: int) -> list[int]:
        """Ids of the parcels that lie in a car's tray and in nobody's grip."""
        spec, ids, poses = self._cars.models[car], self.parcel_ids(), self.parcel_poses()
        x, y, yaw = self._cars.now.poses[car]
        c, s = np.cos(yaw), np.sin(yaw)
        dx, dy = poses[:, 0] - x, poses[:, 1] - y
        length, width, _ = spec.tray_size_m
        inside = (np.abs(c * dx + s * dy - spec.tray_x_m) <= length / 2) & (np.abs(c * dy - s * dx) <= width / 2)
        inside &= (poses[:, 2] >= spec.tray_floor_z_m) & ~np.isin(ids, self.held())
        return [int(parcel) for parcel in ids[inside]]

    def parcel_motion(self, parcel: int) -> FloatArray:
        """Pose, linear and angular velocity of a parcel, shape (13,) [m, m/s, rad/s]."""
        return self._parcels.motion(parcel)

    def rests(self) -> bool:
        """Whether nothing moves, or was told to."""
        return self._cars.rest and self._arms.rest(self._slow) and self._parcels.rest(self._slow)

    def fail_grip(self, arm: int) -> None:
        """Let an arm's tool fail: the vacuum breaks down, or the fingers open, until it is told to let go."""
        self._grip.fail(arm)

    def grip_loss(self, arm: int) -> str:
        """Why an arm's tool lost what it held last, in words; empty if it did not."""
        return self._grip.loss[arm]

    def contacts(self) -> Contacts:
        """Contacts so far; `fleet.world.bullet.contacts` says what counts."""
        return Contacts(robot=self._monitor.counts.robot, static=self._monitor.counts.static)

    def contacts_of(self) -> tuple[IntArray, IntArray]:
        """Contacts of each robot so far, shapes (n_cars,) and (n_arms,)."""
        return self._monitor.of_cars.copy(), self._monitor.of_arms.copy()

    def place(self, car_poses: FloatArray, arm_q: FloatArray) -> None:
        """Put all robots elsewhere at once; see `OpenWorld.place`. The engine finds all pairs of bodies anew."""
        self._search(on=False)
        self._cars.stand(np.asarray(car_poses, dtype=np.float64))
        self._arms.stand(np.asarray(arm_q, dtype=np.float64))
        self._search(on=True)
        self._monitor.look_again()
        self._near = self._measure()

    def min_clearance_m(self) -> float:
        """Smallest clearance so far, infinite with fewer than two robots that can meet [m].

        Read once per tick: cars are rectangles, arms chains of spheres, served cars are left out.
        """
        return float(self._clearance.smallest_m)

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """See `World`; wheels stop no rays."""
        origins, ends = ray_points(origins, ends)
        pods = () if self.pods is None else (self.pods.balls(),)
        return self._rays.cast(
            origins,
            ends,
            boxes=self._fixed.corners,
            cars=self._cars.now.frames,
            kind_of=self._cars.models.kind_of,
            arms=self._arms.q,
            loads=np.concatenate((self._parcels.balls(), *pods)),
        )

    def image(self, camera: Camera) -> CameraImage:
        """What a camera sees now, rendered without a display; changes nothing.

        Raises:
            SensorError: Robots are not to be seen.
        """
        if not self._has_visuals:
            raise SensorError(f"camera {camera.name}: this world was made without images; valid: perception camera")
        return render(self._client, camera, self._parcels.by_body)

    def save(self, *, settle: bool = False) -> Snapshot:
        """Remember this moment; see the class for how exact a return is.

        The engine remembers pairs of bodies: wide boxes around them, where it began to search for their nearest points,
        how hard they pressed. None of that is in its snapshots, and all of it decides last bits. A world that settles,
        and one that returns to that moment, finds all pairs anew.
        """
        client = self._client
        if settle:
            self._search(on=False)
            client.performCollisionDetection()
            self._search(on=True)
        state = client.saveState()
        parcels = {}
        for parcel in self._parcels.ids():
            parcels[parcel] = (self._parcels.shapes[parcel], self._parcels.motion(parcel))
        snapshot = Snapshot(
            state=state,
            cars=self._cars.state(),
            arms=self._arms.state(),
            reading=self._cars.reading(),
            memory={
                "cars": self._cars.memory(),
                "arms": self._arms.memory(),
                "grip": self._grip.memory(),
                "contacts": self._monitor.memory(),
                "clearance": self._clearance.smallest_m,
                "pods": None if self.pods is None else self.pods.memory(),
                "sleepers": {} if self._sleepers is None else self._sleepers.memory(),
            },
            parcels=parcels,
            obstacles=self._fixed.obstacles(),
            pods=[] if self.pods is None else self.pods.state(),
            bodies=self._visitors(),
            settled=settle,
        )
        weakref.finalize(snapshot, _remove_state, weakref.ref(client), state)
        return snapshot

    def load(self, snapshot: object) -> None:
        """Return to a snapshot of this world.

        Raises:
            TypeError: Not a snapshot of a `BulletWorld`.
        """
        if not isinstance(snapshot, Snapshot):
            raise TypeError(f"snapshot is a {type(snapshot).__name__}; valid: what BulletWorld.save returned")
        client = self._client
        client.keep_contacts(self._contact_breaking_m)
        for parcel in [p for p in self._parcels.ids() if p not in snapshot.parcels]:
            self.remove_parcel(parcel)
        for obstacle, place in self._fixed.obstacles().items():
            if not np.array_equal(place, snapshot.obstacles.get(obstacle, ())):
                self.remove_obstacle(obstacle)
        restored = self._visitors() == snapshot.bodies
        if snapshot.settled:
            self._search(on=False)
        if restored:
            client.restoreState(snapshot.state)
        else:
            self._rebuild(snapshot)
        self._cars.recall(snapshot.memory["cars"])
        self._arms.recall(snapshot.memory["arms"])
        if self._sleepers is not None:
            self._recall_sleep(self._sleepers, snapshot, restored)
        if snapshot.settled:
            self._search(on=True)
        else:
            client.performCollisionDetection()  # rays would see the old poses
        self._ghosts.hide()
        self._parcels.moved()
        self._grip.recall(snapshot.memory["grip"])
        self._monitor.recall(snapshot.memory["contacts"])
        if self.pods is not None:
            self.pods.recall(snapshot.memory["pods"])
        self._clearance.smallest_m = snapshot.memory["clearance"]
        self._cars.now = snapshot.reading if restored else self._cars.reading()
        self._near = self._measure()

    def state_bytes(self) -> bytes:
        """Positions, velocities and joint states of all bodies as float64, equal for equal states."""
        numbers = self._cars.state() + self._arms.state() + self._parcels.state()
        numbers += [] if self.pods is None else self.pods.state()
        return (np.array(numbers, dtype=np.float64) + 0.0).tobytes()  # + 0.0: no negative zeros

    def close(self) -> None:
        """End the connection to the engine; calling twice is harmless."""
        self._client.close()

    def _recall_sleep(self, sleepers: Sleepers, snapshot: Snapshot, restored: bool) -> None:
        """Let those sleep that slept then: that takes the engine two steps, after which it returns once more."""
        sleepers.recall(snapshot.memory["sleepers"] if restored else {})
        if not restored:
            return
        asleep = sleepers.asleep()
        self._cars.hold_still(asleep)
        self._arms.hold_still(asleep)
        sleepers.go_on(just_now=False)
        for _ in range(2):
            self._client.stepSimulation()
        self._client.restoreState(snapshot.state)
        sleepers.go_on(just_now=True)

    def _rouse(self, sleepers: Sleepers, grip: BoolArray) -> None:
        """Wake what is told something in this tick, and what is in a grip."""
        told = zip(self._arms.bodies, self._arms.stirred.tolist(), grip.tolist(), strict=True)
        sleepers.rouse(
            [
                *self._cars.parked(on=False),
                *(body for body, stirred, grips in told if stirred or grips),
                *(self._parcels.body(parcel) for parcel in self._grip.held if parcel >= 0),
            ]
        )

    def _let_sleep(self, sleepers: Sleepers, grip: BoolArray) -> None:
        """Let what rests sleep: parked cars, arms without a parcel, and parcels that nobody holds."""
        held, still = self._grip.held, self._arms.still(self._slow).tolist()
        arms = zip(self._arms.bodies, still, grip.tolist(), held, strict=True)
        in_grip = {self._parcels.body(parcel) for parcel in held if parcel >= 0}
        sleepers.look(
            [
                *self._cars.parked(on=True),
                *(body for body, rests, grips, parcel in arms if rests and not grips and parcel < 0),
                *(body for body in self._parcels.still(self._slow) if body not in in_grip),
            ]
        )

    def _watched(self) -> list[bool]:
        """Arms that could touch something new in this tick, or whose fingers have to feel what they hold."""
        if self._touch_tells:
            return [True] * self.n_arms
        arms = zip(self._arms.moving.tolist(), self._clearance.near_arms.tolist(), self._grip.held, strict=True)
        return [moving or near or held >= 0 for moving, near, held in arms]

    def _measure(self, *, ghosts: bool = True) -> list[tuple[int, int]]:
        """Update the smallest clearance and name the bodies that cars can touch within a tick."""
        now, fixed = self._cars.now, self._fixed
        cars, n_own, poses, kind_of = self._cars.bodies, len(self._cars.bodies), now.poses, self._cars.models.kind_of
        if ghosts and self._ghosts.bodies:
            cars, poses = [*cars, *self._ghosts.bodies.values()], np.concatenate((poses, self._ghosts.poses))
            kind_of = np.append(kind_of, np.zeros(len(self._ghosts.poses), dtype=np.int64))  # all are of one model
        held, serving = self._held_spheres(), self._monitor.serving
        moment = Moment(poses=poses, kind_of=kind_of, q=self._arms.q, held=held, serving=serving)
        pairs, beside = self._clearance.look(moment, fixed.plans, _NEAR_MARGIN_M + 2 * now.top_speed * self.tick_s)
        # The first of a pair is the lower one: two ghosts are looked at by their own worlds.
        near = [(cars[i], cars[j]) for i, j in pairs.tolist() if i < n_own]
        return near + [(cars[i], fixed.plan_bodies[j]) for i, j in beside.tolist() if i < n_own]

    def _other_cars(self) -> None:
        """Cars came or went."""
        self.n_cars = len(self._cars.bodies)
        self._n_car_changes += 1
        self._monitor.change_cars(self._cars.bodies, self._cars.models)
        self._monitor.look_again()
        self._near = self._measure()

    def _held_spheres(self) -> FloatArray:
        spheres = self._empty
        if max(self._grip.held, default=-1) < 0:
            return spheres
        spheres = spheres.copy()
        for arm, parcel in enumerate(self._grip.held):
            if parcel >= 0:
                spheres[arm] = self._parcels.ball(parcel)
        return spheres

    def _search(self, *, on: bool) -> None:
        """Let the engine look for bodies that touch, or forget all that it knows of any."""
        filtered, floor = self._client.setCollisionFilterGroupMask, self._monitor.floor
        # Wheels touch nothing but the floor.
        moving = self._arm_links + self._cars.links()
        moving += [(self._parcels.body(parcel), -1) for parcel in self._parcels.ids()]
        group, mask = (groups.MOVING, groups.ALL) if on else (0, 0)
        # The floor touches everything: without it the engine has few pairs to go through.
        if not on:
            filtered(floor, -1, 0, 0)
        for body, link in moving:
            filtered(body, link, group, mask)
        if on:
            filtered(floor, -1, groups.FIXED | groups.FLOOR, groups.ALL)

    def _visitors(self) -> tuple[int, ...]:
        parcels = tuple(self._parcels.body(parcel) for parcel in self._parcels.ids())
        return (self._n_car_changes, self._ghosts.n_made, *parcels, *self._fixed.obstacle_bodies())

    def _rebuild(self, snapshot: Snapshot) -> None:
        """Return to a snapshot whose parcels or obstacles are not all there any more."""
        for obstacle, (centre, half) in snapshot.obstacles.items():
            if obstacle not in self._fixed.obstacles():
                self.add_obstacle(obstacle, centre, half)
        for parcel, (shape, motion) in snapshot.parcels.items():
            if parcel not in self._parcels.shapes:
                self._parcels.add(shape)
            self._parcels.place(parcel, motion)
        self._cars.place(snapshot.cars)
        self._arms.place(snapshot.arms)
        if self.pods is not None:
            self.pods.place(snapshot.pods)


def _remove_state(client: weakref.ref[Client], state: int) -> None:
    owner = client()
    if owner is not None and owner.id >= 0:
        with suppress(owner.engine.error):
            owner.removeState(state)
