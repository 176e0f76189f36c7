"""World: the one interface of the three fidelities (physics, kinematic, grid); arrays with one row per robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.sensors.camera import Camera, CameraImage
from fleet.world.pods import PodLifts

TOOL_FAILED = "its tool has failed"
"""Why a parcel was lost that was dropped by `World.fail_grip`."""


@dataclass(frozen=True, kw_only=True)
class ParcelBody:
    """A parcel as a physical box."""

    parcel: int
    """Identity, unique in a run."""
    size_m: tuple[float, float, float]
    mass_kg: float
    pose: FloatArray
    """World pose of the box centre, x, y, z, qx, qy, qz, qw, shape (7,)."""


@dataclass(kw_only=True)
class Contacts:
    """Contacts that physics reported since the start of the run; a touch that lasts counts once until it ends."""

    robot: int = 0
    """Car-car, arm-arm, and arm-car outside the tray the arm serves."""
    static: int = 0
    """Robots against walls, shelves, pedestals (an arm's parcel on its pedestal is not one)."""


class World(Protocol):
    """What a simulation may ask of the place where robots move.

    A car command is ``(steering_rad, speed_mps)`` in the continuous worlds; a car that does not steer is told
    ``(yaw_rate_radps, speed_mps)``. On the grid it is ``(next_state, 0)``:
    the id of the lane-graph state to move to, or of the present state to stay.
    """

    tick_s: float
    """Length of one tick [s]."""
    n_cars: int
    n_arms: int

    @property
    def pods(self) -> PodLifts | None:
        """The pods on its floor; None = it has none."""

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick.

        Args:
            car_commands: Shape (n_cars, 2).
            arm_q: Joint targets [rad], shape (n_arms, n_joints).
            arm_qd: Joint target velocities [rad/s], same shape.
            grip: True = hold (suction on, fingers closed), shape (n_arms,).
        """

    def car_poses(self) -> FloatArray:
        """Rear-axle poses x, y, yaw, shape (n_cars, 3)."""

    def car_speeds(self) -> FloatArray:
        """Signed forward speed [m/s], shape (n_cars,)."""

    def car_steering(self) -> FloatArray:
        """Measured steering angle (bicycle equivalent) [rad], or yaw rate of a car that does not steer [rad/s], shape
        (n_cars,)."""

    def arm_positions(self) -> FloatArray:
        """Joint positions [rad], shape (n_arms, n_joints)."""

    def arm_velocities(self) -> FloatArray:
        """Joint velocities [rad/s], shape (n_arms, n_joints)."""

    def held(self) -> IntArray:
        """Parcel id in each arm's grip, -1 for none, shape (n_arms,)."""

    def parcel_ids(self) -> IntArray:
        """Ids of the parcels in the world, ascending, shape (p,); the same array until one comes or goes."""

    def parcel_poses(self) -> FloatArray:
        """Poses in the order of `parcel_ids`, shape (p, 7)."""

    def add_parcel(self, body: ParcelBody) -> None:
        """Put a parcel into the world."""

    def remove_parcel(self, parcel: int) -> None:
        """Take a parcel out of the world."""

    def set_serving(self, arm: int, car: int) -> None:
        """Say which car's tray an arm may touch (-1: none); used to judge contacts only."""

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put a fixed box into the world at run time (a blocked lane)."""

    def remove_obstacle(self, obstacle: int) -> None:
        """Take such a box away."""

    def push_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Shove a car sideways: what a careless human does. Physics applies an impulse towards it, others displace."""

    def shove_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Do `push_car` as far as nothing is in the way, also where there is no physics."""

    def put_car(self, car: int, pose: FloatArray) -> None:
        """Let a car stand elsewhere, at a pose of its rear axle x, y, yaw, shape (3,)."""

    def fail_grip(self, arm: int) -> None:
        """Let an arm's tool fail: it drops what it holds, and holds nothing until it was told to let go."""

    def grip_loss(self, arm: int) -> str:
        """Why an arm's tool lost what it held last, in words; empty if it did not."""

    def contacts(self) -> Contacts:
        """Contacts so far."""

    def contacts_of(self) -> tuple[IntArray, IntArray]:
        """Contacts of each robot so far, shapes (n_cars,) and (n_arms,); one between two robots counts for both."""

    def min_clearance_m(self) -> float:
        """Smallest clearance so far: car-car bodies, and arms against cars they do not serve [m]."""

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """Hit fraction of each ray in [0, 1], 1 = nothing hit, shape (r,).

        Args:
            origins: World points, shape (r, 3).
            ends: World points, shape (r, 3).

        Raises:
            SensorError: Other shapes, or numbers that are no places.
        """

    def image(self, camera: Camera) -> CameraImage:
        """What a camera sees now.

        Raises:
            SensorError: A world without bodies to see.
        """

    def save(self, *, settle: bool = False) -> object:
        """A snapshot for `load` in this process.

        Args:
            settle: Forget the past first, but for positions and velocities, so that a return to a start is exact
                whatever happened since. What follows differs in last bits from what would have followed.
        """

    def load(self, snapshot: object) -> None:
        """Return to a snapshot of this world."""

    def state_bytes(self) -> bytes:
        """The physical state as bytes, equal for equal states: input of the state hash."""

    def close(self) -> None:
        """Free what the world holds; calling twice is harmless."""


class OpenWorld(World, Protocol):
    """A world whose robots can be put anywhere."""

    def place(self, car_poses: FloatArray, arm_q: FloatArray) -> None:
        """Put all robots elsewhere at once, where they stand still; meant for the start of a run.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            arm_q: Joint positions [rad], shape (n_arms, n_joints).
        """
