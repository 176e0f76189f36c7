"""Bare: the loop that one writes by hand around PyBullet, in the same scene with the same robots and rays.

It sets every motor, makes the physics steps one by one, reads cars and arms, and casts the rays. It does not read where
parcels lie, has no orders, no traffic, no rewards, no contacts, and its observations are lists of numbers that nobody
puts in order.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from fleet.robots import ARMS
from fleet.robots.cars.racecar import racecar_urdf
from fleet.robots.spec import HINGES, WHEELS
from fleet.robots.tools import TOOLS
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.config import BulletConfig, exact_tick_s
from fleet.world.bullet.fixed import FLOOR_FRICTION
from fleet.world.scene import Scene

FloatArray = npt.NDArray[np.float64]

PHYSICS_HZ = 240.0


class BareLoop:
    """A scene in the engine, without the fleet.

    Args:
        scene: Robots and boxes.
        n_parcels: Parcels on the slots of the site.
        n_rays: Rays of each car's lidar, which may be none.
        n_steps: Physics steps per control step.
        like_fleet: The floor is as rough as in the fleet's world; else as the engine makes it by itself.
        physics_hz: Physics steps a second.
        solver: How exactly the engine solves; None = as training does.
    """

    def __init__(
        self,
        scene: Scene,
        n_parcels: int,
        n_rays: int,
        n_steps: int,
        *,
        like_fleet: bool = False,
        physics_hz: float = PHYSICS_HZ,
        solver: BulletConfig | None = None,
    ) -> None:
        self._client = client = Client()
        config = solver or BulletConfig(tick_s=exact_tick_s(n_steps, physics_hz), n_steps_per_call=n_steps)
        client.setGravity(0.0, 0.0, -9.81)
        client.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / physics_hz,
            numSolverIterations=config.n_iterations,
            solverResidualThreshold=config.residual,
            contactBreakingThreshold=config.contact_breaking_m,
            deterministicOverlappingPairs=1,
            collisionFilterMode=groups.BOTH_AGREE,
        )
        floor = client.createMultiBody(baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_PLANE))
        client.setCollisionFilterGroupMask(floor, -1, groups.FIXED | groups.FLOOR, groups.ALL)
        if like_fleet:
            client.changeDynamics(floor, -1, lateralFriction=FLOOR_FRICTION)
        flags = client.URDF_USE_INERTIA_FROM_FILE
        self._cars = [
            client.load_urdf(
                racecar_urdf(),
                basePosition=(x, y, 0.0),
                baseOrientation=client.getQuaternionFromEuler((0, 0, yaw)),
                flags=flags,
            )
            for x, y, yaw in scene.car_start.tolist()
        ]
        names = {client.getJointInfo(self._cars[0], joint)[1].decode(): joint for joint in range(6)}
        self._wheels, self._hinges = [names[f"{wheel}_spin"] for wheel in WHEELS], [names[hinge] for hinge in HINGES]
        for car in self._cars:
            for wheel in self._wheels:
                client.setCollisionFilterGroupMask(car, wheel, groups.MOVING, groups.WHEELS_MASK)
        self._arms = [
            client.load_urdf(
                ARMS["iiwa"].text(TOOLS["suction"]),
                basePosition=(x, y, z),
                baseOrientation=client.getQuaternionFromEuler((0, 0, yaw)),
                useFixedBase=True,
                flags=flags,
            )
            for x, y, z, yaw in scene.arm_base.tolist()
        ]
        self._joints = list(range(7))
        for arm, q in zip(self._arms, scene.arm_start.tolist(), strict=True):
            for joint in self._joints:
                client.resetJointState(arm, joint, q[joint])
            for link in range(-1, 3):
                client.setCollisionFilterPair(arm, floor, link, -1, 0)
        for box in scene.boxes:
            shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[float(x) for x in box.half_m])
            client.createMultiBody(baseCollisionShapeIndex=shape, basePosition=[float(x) for x in box.centre_m])
        slots = [box for box in scene.boxes if box.kind == "pedestal"][:n_parcels]
        cube = client.createCollisionShape(client.GEOM_BOX, halfExtents=[0.03] * 3)
        for box in slots:
            x, y, z = (float(a) for a in box.centre_m)
            client.createMultiBody(0.3, cube, basePosition=(x, y, z + float(box.half_m[2]) + 0.03))
        self._n_steps = n_steps
        self.engine_s = 0.0
        """Computing time of the physics steps alone so far [s]."""
        self._forces = scene.arms.specs[0].max_torque_nm.tolist()
        self._drive_nm, self._steer_nm = [0.6] * 4, [10.0] * 2
        model = scene.car
        self._ring = (
            LidarRing(Lidar(n_rays=n_rays, noise_m=0.0), model.front_m, model.rear_m, model.half_width_m)
            if n_rays
            else None
        )
        self._state = client.saveState()

    def reset(self) -> None:
        """Return to the start."""
        self._client.restoreState(self._state)
        self._client.performCollisionDetection()

    def step(self, cars: FloatArray, arms: FloatArray) -> list[object]:
        """Act for one control step.

        Args:
            cars: Steering [rad] and wheel speed [rad/s], shape (n_cars, 2).
            arms: Joint velocities [rad/s], shape (n_arms, 7).

        Returns:
            What was read.
        """
        client = self._client
        for body, (steering, speed) in zip(self._cars, cars.tolist(), strict=True):
            client.setJointMotorControlArray(
                body, self._wheels, client.VELOCITY_CONTROL, targetVelocities=[speed] * 4, forces=self._drive_nm
            )
            client.setJointMotorControlArray(
                body, self._hinges, client.POSITION_CONTROL, targetPositions=[steering] * 2, forces=self._steer_nm
            )
        for body, speeds in zip(self._arms, arms.tolist(), strict=True):
            client.setJointMotorControlArray(
                body, self._joints, client.VELOCITY_CONTROL, targetVelocities=speeds, forces=self._forces
            )
        begin = time.process_time()
        for _ in range(self._n_steps):
            client.stepSimulation()
        self.engine_s += time.process_time() - begin
        read: list[object] = []
        poses = np.empty((len(self._cars), 3))
        for car, body in enumerate(self._cars):
            place, turn = client.getBasePositionAndOrientation(body)
            poses[car] = place[0], place[1], client.getEulerFromQuaternion(turn)[2]
            read += [client.getBaseVelocity(body), client.getJointStates(body, self._hinges)]
        if self._ring is not None:
            origins, ends = self._ring.rays(poses)
            read.append([hit[2] for hit in client.rayTestBatch(origins.tolist(), ends.tolist())])
        for body in self._arms:
            read += [client.getJointStates(body, self._joints), client.getLinkState(body, 6)]
        return read

    def close(self) -> None:
        """End the connection."""
        self._client.close()
