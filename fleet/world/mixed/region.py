"""Region: a part of the floor with contact physics, which is stepped only while something in it moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.world.bullet.engine.config import BulletConfig
from fleet.world.bullet.world import BulletWorld
from fleet.world.mixed.config import MixedConfig
from fleet.world.mixed.split import aside, reaches, region_scene
from fleet.world.protocol import Contacts, ParcelBody
from fleet.world.scene import Scene

_SETTLE_S = 0.5
_FREE = -1
_ROUSED_TICKS = 3


@dataclass(frozen=True, kw_only=True)
class RegionSnapshot:
    """A moment of one `Region`."""

    world: object
    car_in: IntArray
    serving: IntArray
    """Car that each arm serves."""
    roused: tuple[int, int]
    """Slot that was roused, and ticks since then."""
    still_s: float
    bodies: dict[int, ParcelBody]
    state: bytes | None


class Region:
    """Some arms with their racks, in an engine of their own, and bodies for the cars that come to them.

    Attributes:
        arms: Indices of its arms in the fleet, shape (m,).
        world: The physics; its cars are slots.
        car_in: Car whose body each slot is, -1 for none, shape (n_slots,).
        bodies: Size and mass of its parcels, by id.

    Args:
        scene: The whole.
        arms: Indices of the region's arms.
        config: Settings.
    """

    def __init__(self, scene: Scene, arms: list[int], config: MixedConfig) -> None:
        n_slots = config.n_slots + len(arms) - 1
        self._config = config
        self.arms = np.array(arms, dtype=np.int64)
        self._base = scene.arm_base[arms]
        part = region_scene(scene, arms, n_slots, config.near_m)
        self.world = BulletWorld(
            part,
            BulletConfig(
                grip=config.grip,
                grip_force_n=config.grip_force_n,
                tick_s=config.tick_s,
                n_steps_per_tick=config.n_substeps,
                visuals=config.images,
                sleeps_after_s=config.still_s,
                slow=config.slow,
            ),
        )
        self.car_in = np.full(n_slots, _FREE, dtype=np.int64)
        self.bodies: dict[int, ParcelBody] = {}
        self._serving = np.full(len(arms), -1, dtype=np.int64)
        still = np.zeros_like(part.arm_start)
        none = np.zeros((n_slots, 2)), part.arm_start, still, np.zeros(len(arms), dtype=np.bool_)
        for _ in range(round(_SETTLE_S / config.tick_s)):
            self.world.step(*none)
        self.world.ride()
        for slot in range(n_slots):
            self.world.set_car_aside(slot, aside(slot))
        self._seen = (self.world.contacts(), *self.world.contacts_of())
        self._still_s = 0.0
        self._state: bytes | None = None
        self._roused, self._roused_for = _FREE, 0

    @property
    def asleep(self) -> bool:
        """Whether nothing has moved for a while."""
        return self._still_s >= self._config.still_s

    def wake(self) -> None:
        """Something may move from now on."""
        self._still_s = 0.0
        self._state = None

    def step(self, commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick.

        Args:
            commands: Of all cars of the fleet, shape (n_cars, 2).
            arm_q: Joint targets of all arms [rad], shape (n_arms, n_joints).
            arm_qd: Joint velocities there [rad/s], same shape.
            grip: Whether each holds, shape (n_arms,).
        """
        here = self.car_in >= 0
        own = np.zeros((len(here), 2))
        own[here] = commands[self.car_in[here]]
        self.world.step(own, arm_q[self.arms], arm_qd[self.arms], grip[self.arms])
        self._state = None
        if self._roused >= 0:
            self._roused_for += 1
            if self._roused_for > _ROUSED_TICKS:  # its car has turned away
                self.world.set_car_aside(self._roused, aside(self._roused))
                self._roused = _FREE
        self._still_s = self._still_s + self._config.tick_s if self.world.rests() else 0.0

    def fresh_contacts(self) -> tuple[Contacts, IntArray, IntArray] | None:
        """Contacts since this was asked last: all, of each slot's car, and of each arm; None if there were none."""
        now = self.world.contacts()
        then, before_slots, before_arms = self._seen
        if now == then:
            return None
        of_slots, of_arms = self.world.contacts_of()
        self._seen = now, of_slots, of_arms
        fresh = Contacts(robot=now.robot - then.robot, static=now.static - then.static)
        return fresh, of_slots - before_slots, of_arms - before_arms

    def free_slot(self, *, moving: bool) -> int:
        """A slot whose body is not used, -1 if there is none yet.

        Args:
            moving: It is for a car that moves; such a body has to be awake, and is so in the next tick.
        """
        if self._roused >= 0:
            return self._roused
        free = np.flatnonzero(self.car_in == _FREE)
        if not len(free):
            return -1
        slot = int(free[0])
        if not moving:
            return slot
        self.wake()
        self.world.rouse_car(slot)
        self._roused, self._roused_for = slot, 0
        return -1

    def enter(self, slot: int, car: int, pose: FloatArray, speed_mps: float, steering_rad: float) -> None:
        """Let a free slot's body be a car, in the motion that it has.

        Args:
            slot: The slot.
            car: Index in the fleet.
            pose: Of its rear axle x, y, yaw, shape (3,).
            speed_mps: Along its heading.
            steering_rad: Angle of its bicycle.
        """
        self.wake()
        if slot == self._roused:
            self._roused = _FREE
        self.world.enter_car(slot, pose, speed_mps, steering_rad)
        self.car_in[slot] = car
        self._tell_served()

    def leave(self, slot: int) -> None:
        """Put the body of a slot to sleep; its car goes on elsewhere."""
        self.wake()
        self.world.set_car_aside(slot, aside(slot))
        self.car_in[slot] = _FREE
        self._tell_served()

    def serve(self, arm: int, car: int) -> None:
        """Say which car's tray an arm may touch, both by their indices in the fleet."""
        self._serving[int(np.searchsorted(self.arms, arm))] = car
        self._tell_served()

    def add_parcel(self, body: ParcelBody, velocity: FloatArray | None = None) -> None:
        """Put a parcel into the region; see `BulletWorld.add_parcel`."""
        self.wake()
        self.world.add_parcel(body, velocity)
        self.bodies[body.parcel] = body

    def remove_parcel(self, parcel: int) -> ParcelBody:
        """Take a parcel out; returns it with its present pose."""
        self.wake()
        row = int(np.searchsorted(self.world.parcel_ids(), parcel))
        pose = self.world.parcel_poses()[row]
        self.world.remove_parcel(parcel)
        return replace(self.bodies.pop(parcel), pose=pose)

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put a box up, if it reaches into the region, in place of an earlier one of the same id."""
        self.remove_obstacle(obstacle)
        if not reaches(self._base, centre_m, half_m, self._config.near_m):
            return
        self.wake()
        self.world.add_obstacle(obstacle, centre_m, half_m)

    def remove_obstacle(self, obstacle: int) -> None:
        """Take such a box down, if there is one."""
        if obstacle in self.world.obstacle_ids():
            self.wake()
            self.world.remove_obstacle(obstacle)

    def state_bytes(self) -> bytes:
        """The physical state, equal for equal states."""
        if self._state is None:
            self._state = self.car_in.tobytes() + self.world.state_bytes()
        return self._state

    def save(self, *, settle: bool) -> RegionSnapshot:
        """Remember this moment."""
        return RegionSnapshot(
            world=self.world.save(settle=settle),
            car_in=self.car_in.copy(),
            serving=self._serving.copy(),
            roused=(self._roused, self._roused_for),
            still_s=self._still_s,
            bodies=dict(self.bodies),
            state=self._state,
        )

    def load(self, snapshot: RegionSnapshot) -> None:
        """Return to such a moment."""
        self.world.load(snapshot.world)
        self.car_in[:] = snapshot.car_in
        self._serving[:] = snapshot.serving
        self._roused, self._roused_for = snapshot.roused
        self._still_s = snapshot.still_s
        self.bodies = dict(snapshot.bodies)
        self._state = snapshot.state
        self._seen = (self.world.contacts(), *self.world.contacts_of())

    def _tell_served(self) -> None:
        """Arms serve bodies: those of the slots that their cars have."""
        for arm, car in enumerate(self._serving.tolist()):
            here = self.car_in == car
            self.world.set_serving(arm, int(here.argmax()) if car >= 0 and here.any() else -1)
