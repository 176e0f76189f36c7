"""Standing: lets a robot stand in a world of its own, pushes it, and says whether it still stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation
from fleet.robots.standing import StandingRobot
from fleet.world.bullet.engine.client import Client, quiet
from fleet.world.bullet.vehicles.floor import BareFloor

_GAP_M = 0.001
_SETTLED_S = 1.0
_PUSH_S = 0.1
_FALLEN_SHARE = 0.7
"""A robot lies whose base has come below this part of its height."""


@dataclass(frozen=True, kw_only=True)
class StandReport:
    """How a robot stood."""

    stands: bool
    """Whether it did not fall."""
    height_m: float
    """Of its base at the end."""
    drift_m: float
    """How far its base went over the floor after it had settled."""
    lean_rad: float
    """How far it was from upright at most."""


class Standing:
    """A robot that stands in an engine of its own, held by its motors.

    Args:
        robot: Which.

    Raises:
        PhysicsError: The engine cannot load it.
    """

    def __init__(self, robot: StandingRobot) -> None:
        self._robot = robot
        self._floor = floor = BareFloor(step_s=robot.step_s, n_iterations=robot.n_iterations)
        self.client = client = floor.client
        with quiet():
            self.body: int = client.loadURDF(
                str(robot.path),
                basePosition=(0.0, 0.0, 0.0),
                baseOrientation=robot.upright_xyzw,
                globalScaling=robot.scale,
                flags=client.URDF_USE_INERTIA_FROM_FILE,
            )
        self._hold()
        lowest = lowest_m(client, self.body)
        self._height_m = _GAP_M - lowest
        client.resetBasePositionAndOrientation(self.body, (0.0, 0.0, self._height_m), robot.upright_xyzw)
        # The base's pose is that of its centre of mass.
        self._height_m = client.getBasePositionAndOrientation(self.body)[0][2]

    def run(self, duration_s: float, push_ns: FloatArray | None = None) -> StandReport:
        """Let it stand for a time, settle it first, and push its base in the middle of that.

        Args:
            duration_s: Time after it has settled [s].
            push_ns: Impulse along x and y [N s], shape (2,); None for none.
        """
        client, body, step_s = self.client, self.body, self._robot.step_s
        up = rotation(np.array(client.getBasePositionAndOrientation(body)[1])).T @ (0.0, 0.0, 1.0)
        for _ in range(round(_SETTLED_S / step_s)):
            self._floor.step()
        start = np.array(client.getBasePositionAndOrientation(body)[0])
        lean = drift = 0.0
        place = start
        n_steps, begins = round(duration_s / step_s), round(0.5 * duration_s / step_s)
        for step in range(n_steps):
            if push_ns is not None and begins <= step < begins + round(_PUSH_S / step_s):
                force = (float(push_ns[0]) / _PUSH_S, float(push_ns[1]) / _PUSH_S, 0.0)
                client.applyExternalForce(body, -1, force, place.tolist(), client.WORLD_FRAME)
            self._floor.step()
            where, quat = client.getBasePositionAndOrientation(body)
            place = np.array(where)
            drift = max(drift, float(np.hypot(*(place - start)[:2])))
            upright = float((rotation(np.array(quat)) @ up)[2])
            lean = max(lean, float(np.arccos(min(1.0, max(-1.0, upright)))))
        return StandReport(
            stands=bool(place[2] > _FALLEN_SHARE * self._height_m),
            height_m=float(place[2]),
            drift_m=drift,
            lean_rad=lean,
        )

    def close(self) -> None:
        """End its world."""
        self._floor.close()

    def _hold(self) -> None:
        """Put the joints into the posture, and let the motors hold them there."""
        client, body, robot = self.client, self.body, self._robot
        position, velocity = robot.gains
        for joint in range(client.getNumJoints(body)):
            info = client.getJointInfo(body, joint)
            name, kind = info[1].decode(), info[2]
            if kind == client.JOINT_SPHERICAL:
                client.setJointMotorControlMultiDof(
                    body,
                    joint,
                    client.POSITION_CONTROL,
                    targetPosition=(0.0, 0.0, 0.0, 1.0),
                    positionGain=position,
                    velocityGain=velocity,
                    force=(robot.torque_nm,) * 3,
                )
            elif kind == client.JOINT_REVOLUTE:
                angle = next((angle for end, angle in robot.posture.items() if _ends(name, end)), 0.0)
                client.resetJointState(body, joint, angle)
                client.setJointMotorControl2(
                    body,
                    joint,
                    client.POSITION_CONTROL,
                    targetPosition=angle,
                    positionGain=position,
                    velocityGain=velocity,
                    force=robot.torque_nm,
                )


def lowest_m(client: Client, body: int) -> float:
    """Height of the lowest point of a body's shapes [m], as boxes about them have it."""
    return min(client.getAABB(body, link)[0][2] for link in range(-1, client.getNumJoints(body)))


def _ends(name: str, end: str) -> bool:
    """Whether a joint is meant: numbers are whole names."""
    return name == end if end.isdigit() else name.endswith(end)
