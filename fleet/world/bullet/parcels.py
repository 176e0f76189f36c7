"""Parcels: boxes with mass and friction, known by their id."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.robots.tools import CARDBOARD_FRICTION
from fleet.world.bullet.engine.client import Client, PhysicsError
from fleet.world.protocol import ParcelBody

_SPINNING_FRICTION = 0.05
_RGBA = (0.72, 0.53, 0.34, 1.0)


class Parcels:
    """The parcels of one world.

    Args:
        client: Connection.
        anchored: Whether their friction is anchored, as the pads of fingers need it.
    """

    def __init__(self, client: Client, *, anchored: bool = False) -> None:
        self._client = client
        self._anchored = anchored
        self._bodies: dict[int, int] = {}
        self._numbers: IntArray | None = None
        # Poses, as far as measured since anything moved last.
        self._places: dict[int, tuple[float, ...]] = {}
        self._poses: FloatArray | None = None
        self._speeds: dict[int, float] | None = None
        self._radii: dict[int, float] = {}
        self.shapes: dict[int, ParcelBody] = {}
        """Size and mass of every parcel; the pose is that of its entry."""
        self.by_body: dict[int, int] = {}
        """Parcel id of every parcel's body."""

    def body(self, parcel: int) -> int:
        """Return the engine's id of a parcel.

        Raises:
            PhysicsError: Unknown parcel.
        """
        if parcel not in self._bodies:
            raise PhysicsError(f"parcel {parcel} is not in the world; valid: {sorted(self._bodies)}")
        return self._bodies[parcel]

    def add(self, parcel: ParcelBody) -> None:
        """Put a parcel into the world.

        Raises:
            PhysicsError: The id is taken.
        """
        if parcel.parcel in self._bodies:
            raise PhysicsError(f"parcel {parcel.parcel} is in the world already")
        client = self._client
        half = [size / 2 for size in parcel.size_m]
        pose = [float(x) for x in parcel.pose]
        body = client.createMultiBody(
            baseMass=parcel.mass_kg,
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=half),
            baseVisualShapeIndex=client.createVisualShape(client.GEOM_BOX, halfExtents=half, rgbaColor=_RGBA),
            basePosition=pose[:3],
            baseOrientation=pose[3:],
        )
        client.changeDynamics(
            body,
            -1,
            lateralFriction=CARDBOARD_FRICTION,
            spinningFriction=_SPINNING_FRICTION,
            frictionAnchor=self._anchored,
        )
        self._bodies[parcel.parcel] = body
        self._listed_anew()
        self.by_body[body] = parcel.parcel
        self.shapes[parcel.parcel] = parcel
        self._radii[parcel.parcel] = float(np.linalg.norm(parcel.size_m)) / 2

    def remove(self, parcel: int) -> None:
        """Take a parcel out of the world.

        Raises:
            PhysicsError: Unknown parcel.
        """
        body = self.body(parcel)
        self._client.removeBody(body)
        del self._bodies[parcel], self.by_body[body], self.shapes[parcel], self._radii[parcel]
        self._listed_anew()
        self._places.pop(parcel, None)

    def ids(self) -> list[int]:
        """Return the ids in the world, ascending."""
        return sorted(self._bodies)

    def numbers(self) -> IntArray:
        """Return what `ids` does as an array, the same one until a parcel comes or goes, shape (p,)."""
        if self._numbers is None:
            self._numbers = np.array(self.ids(), dtype=np.int64)
        return self._numbers

    def where(self, parcel: int) -> tuple[float, ...]:
        """Measure x, y, z, qx, qy, qz, qw of a parcel, once until `moved` is called."""
        place = self._places.get(parcel)
        if place is None:
            position, quat = self._client.getBasePositionAndOrientation(self.body(parcel))
            place = self._places[parcel] = position + quat
        return place

    def moved(self) -> None:
        """Everything may have moved: poses are measured anew."""
        self._places.clear()
        self._poses = self._speeds = None

    def pose(self, parcel: int) -> FloatArray:
        """The same as an array, shape (7,)."""
        return np.array(self.where(parcel))

    def poses(self) -> FloatArray:
        """Measure the poses in the order of `ids`, once until `moved` is called, shape (p, 7)."""
        if self._poses is None:
            poses = self._client.base_poses([self._bodies[parcel] for parcel in self.ids()])
            self._poses = np.array(poses, dtype=np.float64).reshape(-1, 7)
        return self._poses.copy()

    def ball(self, parcel: int) -> tuple[float, float, float, float]:
        """Measure the ball round a parcel, centre x, y, z and radius."""
        x, y, z = self.where(parcel)[:3]
        return x, y, z, self._radii[parcel]

    def balls(self) -> FloatArray:
        """The same of all in the order of `ids`, shape (p, 4)."""
        balls = self.poses()[:, :4]
        balls[:, 3] = [self._radii[parcel] for parcel in self.ids()]
        return balls

    def motion(self, parcel: int) -> FloatArray:
        """Measure pose and linear and angular velocity of a parcel, shape (13,)."""
        linear, angular = self._client.getBaseVelocity(self.body(parcel))
        return np.array([*self.pose(parcel), *linear, *angular])

    def place(self, parcel: int, motion: FloatArray) -> None:
        """Set what `motion` measures."""
        numbers = motion.tolist()
        self._client.resetBasePositionAndOrientation(self.body(parcel), numbers[:3], numbers[3:7])
        self._client.resetBaseVelocity(self.body(parcel), numbers[7:10], numbers[10:13])
        self._places.pop(parcel, None)
        self._poses = self._speeds = None

    def rest(self, slow_mps: float) -> bool:
        """Whether all parcels move and turn more slowly than that [m/s, rad/s]."""
        return all(speed < slow_mps for speed in self._fastest().values())

    def still(self, slow_mps: float) -> list[int]:
        """Bodies of the parcels that move and turn more slowly than that [m/s, rad/s]."""
        return [body for body, speed in self._fastest().items() if speed < slow_mps]

    def _fastest(self) -> dict[int, float]:
        """Measure the greatest part of each body's velocities, once until `moved` is called [m/s, rad/s]."""
        if self._speeds is None:
            measure = self._client.getBaseVelocity
            self._speeds = {body: max(abs(v) for part in measure(body) for v in part) for body in self._bodies.values()}
        return self._speeds

    def state(self) -> list[float]:
        """All ids, positions and velocities, one after the other."""
        return [x for parcel in self.ids() for x in (float(parcel), *self.motion(parcel).tolist())]

    def _listed_anew(self) -> None:
        """Other parcels are in the world."""
        self._numbers = self._poses = self._speeds = None
