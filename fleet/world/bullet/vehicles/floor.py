"""BareFloor: an engine with a floor and nothing else, stepped as the shared world is."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.config import BulletConfig
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.fixed import FLOOR_FRICTION

GRAVITY_MPS2 = 9.81
_FLOOR_RGBA = (0.45, 0.46, 0.48, 1.0)


class BareFloor:
    """A connection of its own with gravity and a floor.

    Args:
        step_s: Length of a physics step [s]; None = as the shared world with suction.
        n_iterations: Of the solver; None = as the shared world.
        friction: Of the floor, which multiplies that of what stands on it.
    """

    def __init__(
        self, *, step_s: float | None = None, n_iterations: int | None = None, friction: float = FLOOR_FRICTION
    ) -> None:
        shared = BulletConfig()
        self.step_s = step_s or shared.substep_s
        self._contact_breaking_m = shared.contact_breaking_m
        self.client = client = Client()
        client.setGravity(0.0, 0.0, -GRAVITY_MPS2)
        client.setPhysicsEngineParameter(
            fixedTimeStep=self.step_s,
            numSubSteps=0,
            numSolverIterations=n_iterations or shared.n_iterations,
            solverResidualThreshold=shared.residual,
            deterministicOverlappingPairs=1,
            collisionFilterMode=groups.BOTH_AGREE,
        )
        client.keep_contacts(self._contact_breaking_m)
        floor = client.createMultiBody(
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_PLANE),
            baseVisualShapeIndex=client.createVisualShape(
                client.GEOM_BOX,
                halfExtents=(50.0, 50.0, 0.005),
                rgbaColor=_FLOOR_RGBA,
                visualFramePosition=(0, 0, -0.005),
            ),
        )
        client.changeDynamics(floor, -1, lateralFriction=friction)
        client.setCollisionFilterGroupMask(floor, -1, groups.FIXED | groups.FLOOR, groups.ALL)

    def step(self) -> None:
        """Advance one physics step."""
        self.client.keep_contacts(self._contact_breaking_m)
        self.client.stepSimulation()

    def add_box(self, size_m: FloatArray, mass_kg: float, place_m: FloatArray, friction: float) -> int:
        """Put a box into the world, its centre at a place; returns its body."""
        client = self.client
        half = (0.5 * np.asarray(size_m)).tolist()
        body = client.createMultiBody(
            baseMass=mass_kg,
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=half),
            baseVisualShapeIndex=client.createVisualShape(
                client.GEOM_BOX, halfExtents=half, rgbaColor=(0.76, 0.60, 0.42, 1.0)
            ),
            basePosition=np.asarray(place_m).tolist(),
        )
        client.changeDynamics(body, -1, lateralFriction=friction)
        return int(body)

    def close(self) -> None:
        """End the connection."""
        self.client.close()


def load_on_floor(client: Client, description: str, pose: FloatArray) -> int:
    """Load a vehicle whose base frame is on the floor, at a pose x, y, yaw, shape (3,); returns its body."""
    x, y, yaw = (float(number) for number in pose)
    return client.load_urdf(
        description,
        basePosition=(x, y, 0.0),
        baseOrientation=quaternion(yaw),
        flags=client.URDF_USE_INERTIA_FROM_FILE,
    )


def planar(client: Client, body: int, com: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure how a body lies on the floor.

    Args:
        client: Connection.
        body: The body.
        com: Centre of mass of its base in the frame of its description [m], shape (3,).

    Returns:
        Pose x, y, yaw of that frame; speeds of its origin ahead and to the left [m/s] and the yaw rate [rad/s]; roll
        and pitch [rad]; shapes (3,), (3,), (2,).
    """
    (px, py, _), (qx, qy, qz, qw) = client.getBasePositionAndOrientation(body)
    (vx, vy, _), (wx, wy, wz) = client.getBaseVelocity(body)
    turn = rotation(np.array((qx, qy, qz, qw)))
    ax, ay, az = (turn @ com).tolist()
    (r00, _, _), (r10, _, _), (r20, r21, r22) = turn.tolist()
    yaw = math.atan2(r10, r00)
    # The velocity of the frame's origin: v - w x arm.
    vx, vy = vx - (wy * az - wz * ay), vy - (wz * ax - wx * az)
    c, s = math.cos(yaw), math.sin(yaw)
    lean = (math.atan2(r21, r22), -math.asin(max(-1.0, min(1.0, r20))))
    return np.array((px - ax, py - ay, yaw)), np.array((c * vx + s * vy, c * vy - s * vx, wz)), np.array(lean)
