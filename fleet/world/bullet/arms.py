"""Arms: loads the arms with their tools, holds them on their set-points by joint motors, and reads their joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.robots.arms.team import ArmTeam
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.engine.urdf_text import without_visuals

# An arm comes to less than this within half a second of its last command.
_STILL_RADPS = 1e-6
# Nearer to its set-point than this, an arm that should rest is held there.
_HELD_RAD = 1e-3
# Share of the position error that the motors take back in one physics step: higher chatters at 10 solver iterations.
_POSITION_GAIN = 0.3


@dataclass(frozen=True, kw_only=True)
class MotorSteps:
    """How the motors of arms are told what to do within a tick."""

    n: int
    """Physics steps per tick."""
    length_s: float
    """Length of a physics step [s]."""
    at_once: bool = False
    """A "physics step" is a whole tick, of which the engine makes many steps by itself."""
    limit_share: float = 1.0
    """Part of their limits that motors are given; see `BulletConfig`."""
    cubic: bool = False
    """Between set-points joints go along cubics, without a jump; else with constant acceleration."""


class _Targets(NamedTuple):
    """What the motors were told last, and which arms that moves."""

    q: FloatArray
    """Joint positions at the end of the tick [rad], shape (m, n_joints)."""
    qd: FloatArray
    """Joint velocities there [rad/s], shape (m, n_joints)."""
    acceleration: FloatArray
    """Taken as constant until then [rad/s^2], shape (m, n_joints)."""
    held: BoolArray
    """Whether an arm that rests needs no more telling, shape (m,)."""
    moving: BoolArray
    """Whether each arm moves or is told to, shape (m,)."""
    from_q: FloatArray
    """Joint positions at the beginning of the tick [rad], shape (m, n_joints)."""
    from_qd: FloatArray
    """Joint velocities there [rad/s], shape (m, n_joints)."""


class Arms:
    """The arms of one world.

    Args:
        client: Connection.
        team: Models of the arms; the engine loads their descriptions.
        base: Base poses x, y, z, yaw, shape (m, 4).
        start: Joint positions [rad], shape (m, n_joints).
        steps: When the motors are told what.
        visuals: Whether they can be seen in images; without it one takes 3 MB less.
    """

    def __init__(
        self,
        client: Client,
        team: ArmTeam,
        base: FloatArray,
        start: FloatArray,
        steps: MotorSteps,
        *,
        visuals: bool = True,
    ) -> None:
        self._client = client
        self._steps = steps
        self._joints = [list(range(spec.n_joints)) for spec in team.specs]
        self._forces = [(steps.limit_share * spec.max_torque_nm).tolist() for spec in team.specs]
        self._gains = [[_POSITION_GAIN] * spec.n_joints for spec in team.specs]
        self._loose = [[0.0] * spec.n_joints for spec in team.specs]
        self._unit = [[1.0] * spec.n_joints for spec in team.specs]
        self.tools = [spec.tool for spec in team.specs]
        """What each arm holds."""
        self.bodies: list[int] = []
        self.links: list[dict[str, int]] = []
        """Index of every link of each arm by its name; a joint has the index of its child link."""
        self._fingers: list[list[int]] = []
        texts = {spec.name: spec.description if visuals else without_visuals(spec.description) for spec in team.models}
        for spec, (x, y, z, yaw), q in zip(team.specs, base, start, strict=True):
            body = client.load_urdf(
                texts[spec.name],
                basePosition=(float(x), float(y), float(z)),
                baseOrientation=quaternion(yaw),
                useFixedBase=True,
                flags=client.URDF_USE_INERTIA_FROM_FILE,
            )
            for joint in range(spec.n_joints):
                client.resetJointState(body, joint, float(q[joint]))
            infos = [client.getJointInfo(body, joint) for joint in range(client.getNumJoints(body))]
            number = {info[1].decode(): joint for joint, info in enumerate(infos)}
            self.bodies.append(body)
            self.links.append({info[12].decode(): link for link, info in enumerate(infos)})
            self._fingers.append([number[name] for name in spec.tool.finger_joints])
        n = len(self.bodies)
        self.q = np.array(start, dtype=np.float64).reshape(n, team.width)
        self.qd = np.zeros_like(self.q)
        self._targets = _Targets(
            q=np.full_like(self.q, np.nan),
            qd=np.zeros_like(self.q),
            acceleration=np.zeros_like(self.q),
            held=np.full(n, not steps.at_once),
            moving=np.ones(n, dtype=np.bool_),
            from_q=np.zeros_like(self.q),
            from_qd=np.zeros_like(self.q),
        )
        self._told = self.q.copy()  # the last set-points; `_targets.q` forgets them where motors have to be set anew
        self.stirred = np.ones(n, dtype=np.bool_)
        """Whether each arm was told to move in the last tick; motors that are set anew tell it nothing, shape (m,)."""
        self._turns = np.zeros_like(self.q)
        self._active = np.zeros(0, dtype=np.int64)

    @property
    def moving(self) -> BoolArray:
        """Whether each arm moves or is told to, shape (m,)."""
        return self._targets.moving

    def rest(self, slow_radps: float) -> bool:
        """Whether all arms are told to stand, and their joints turn more slowly than that [rad/s]."""
        return not self._targets.qd.any() and bool((np.abs(self.qd) < slow_radps).all())

    def still(self, slow_radps: float) -> BoolArray:
        """Which arms are told to stand, and turn more slowly than that [rad/s], shape (m,)."""
        still: BoolArray = ~self.stirred & (np.abs(self.qd) < slow_radps).all(axis=1)
        return still

    def aim(self, q: FloatArray, qd: FloatArray) -> None:
        """Take the set-points for the end of the coming tick.

        Args:
            q: Joint positions [rad], shape (m, n_joints).
            qd: Joint velocities there [rad/s], same shape.
        """
        tick_s = self._steps.n * self._steps.length_s
        if self._steps.cubic:
            self._targets.from_q[:], self._targets.from_qd[:] = self._told, self._targets.qd
        self.stirred = ((q != self._told) | (qd != 0.0)).any(axis=1)
        self._told[:] = q
        active = np.empty(len(self.bodies), dtype=np.int64)
        n = _aim(self._targets, q, qd, self.qd, tick_s, active)
        self._active = active[:n]

    def hold(self, substep: int) -> None:
        """Set the motors of the moving arms for one physics step.

        The motor law adds the target velocity to a share of the present error, so the position target is where the arm
        should be when the step begins; between the set-points the acceleration is taken as constant.

        Args:
            substep: Index of the step in its tick.
        """
        if self._steps.at_once:
            self._turn()
            return
        step_s = self._steps.length_s
        left = (self._steps.n - substep) * step_s
        targets = self._targets
        for arm in self._active.tolist():
            if self._steps.cubic:
                q, qd = self._on_cubic(arm, substep)
            else:
                qd = targets.qd[arm] - targets.acceleration[arm] * (left - step_s / 2)
                q = targets.q[arm] - targets.qd[arm] * left + targets.acceleration[arm] * (left * left / 2)
            self._set_motors(arm, q, qd, self._gains)

    def _on_cubic(self, arm: int, substep: int) -> tuple[FloatArray, FloatArray]:
        """Positions where a physics step begins and velocities in its middle, on cubics between set-points."""
        targets, n = self._targets, self._steps.n
        tick_s = n * self._steps.length_s
        u, m = substep / n, (substep + 0.5) / n
        way = targets.q[arm] - targets.from_q[arm]
        first, last = targets.from_qd[arm] * tick_s, targets.qd[arm] * tick_s
        square, cube = 3.0 * way - 2.0 * first - last, first + last - 2.0 * way
        q = targets.from_q[arm] + u * (first + u * (square + u * cube))
        return q, (first + m * (2.0 * square + m * 3.0 * cube)) / tick_s

    def _turn(self) -> None:
        """Let the moving arms turn so fast that they come to their set-points within the tick, or hold them there."""
        targets = self._targets
        _speeds(targets, self._active, self.q, self._steps.length_s, self._turns)
        for arm in self._active.tolist():
            gains = self._gains if targets.held[arm] else self._loose
            self._set_motors(arm, targets.q[arm], self._turns[arm], gains)

    def _set_motors(self, arm: int, q: FloatArray, qd: FloatArray, gains: list[list[float]]) -> None:
        client, joints = self._client, self._joints[arm]
        client.setJointMotorControlArray(
            self.bodies[arm],
            joints,
            client.POSITION_CONTROL,
            targetPositions=q[: len(joints)].tolist(),
            targetVelocities=qd[: len(joints)].tolist(),
            forces=self._forces[arm],
            positionGains=gains[arm],
            velocityGains=self._unit[arm],
        )

    def read(self) -> None:
        """Fetch joint positions and velocities from the engine: something may have hit an arm that rests, too."""
        states = self._client.getJointStates
        for arm, (body, joints) in enumerate(zip(self.bodies, self._joints, strict=True)):
            told = states(body, joints)
            self.q[arm, : len(joints)] = [state[0] for state in told]
            self.qd[arm, : len(joints)] = [state[1] for state in told]

    def state(self) -> list[float]:
        """All joint positions and velocities of the arms, fingers included, one after the other."""
        return [
            x
            for body, joints in zip(self.bodies, self._all_joints(), strict=True)
            for s in self._client.getJointStates(body, joints)
            for x in s[:2]
        ]

    def place(self, state: list[float]) -> None:
        """Set what `state` gives."""
        joints = [(body, j) for body, own in zip(self.bodies, self._all_joints(), strict=True) for j in own]
        for k, (body, joint) in enumerate(joints):
            self._client.resetJointState(body, joint, state[2 * k], state[2 * k + 1])

    def stand(self, q: FloatArray) -> None:
        """Let the arms stand elsewhere.

        Args:
            q: Joint positions [rad], shape (m, n_joints).
        """
        for body, joints, positions in zip(self.bodies, self._joints, q.tolist(), strict=True):
            for joint in joints:
                self._client.resetJointState(body, joint, positions[joint], 0.0)
        self.recall(np.array([np.zeros_like(q), q, np.zeros_like(q), q]))

    def memory(self) -> FloatArray:
        """What the engine's own snapshot does not hold, shape (4, m, n_joints).

        Last target velocities, last readings of positions and velocities, last target positions.
        """
        return np.array([self._targets.qd, self.q, self.qd, self._told])

    def recall(self, memory: FloatArray) -> None:
        """Return to `memory`; every motor is set anew at the next command."""
        self._targets.qd[:], self.q, self.qd, self._told = memory.copy()
        self._targets.held[:] = not self._steps.at_once
        self._targets.q[:] = np.inf  # no target equals it, so every arm counts as moving

    def hold_still(self, bodies: set[int]) -> None:
        """Set the motors of some arms that stand, after a `recall`, where they were told to stand."""
        for arm, body in enumerate(self.bodies):
            if body in bodies:
                self._targets.q[arm] = self._told[arm]
                self._set_motors(arm, self._told[arm], np.zeros_like(self._told[arm]), self._gains)

    def _all_joints(self) -> list[list[int]]:
        """Of each arm, fingers last."""
        return [own + fingers for own, fingers in zip(self._joints, self._fingers, strict=True)]


@njit(cache=True)
def _aim(targets: _Targets, q: FloatArray, qd: FloatArray, speeds: FloatArray, tick: float, active: IntArray) -> int:
    """Take new goals, note which arms move, and list those whose motors have to be set; returns their number.

    A resting arm keeps its motors' targets: nothing to send once it was told to stand there.
    """
    goal_q, goal_qd, acceleration, held, moving, _, _ = targets
    n = 0
    for arm in range(len(q)):
        known = not np.isnan(goal_q[arm, 0])
        told, turns = False, False
        for j in range(q.shape[1]):
            told = told or q[arm, j] != goal_q[arm, j] or qd[arm, j] != goal_qd[arm, j] or qd[arm, j] != 0.0
            turns = turns or abs(speeds[arm, j]) > _STILL_RADPS
            acceleration[arm, j] = (qd[arm, j] - goal_qd[arm, j]) / tick if known else 0.0
            goal_q[arm, j], goal_qd[arm, j] = q[arm, j], qd[arm, j]
        moving[arm] = told or turns
        if told or not held[arm]:
            active[n] = arm
            n += 1
    return n


@njit(cache=True)
def _speeds(targets: _Targets, active: IntArray, q: FloatArray, tick: float, speeds: FloatArray) -> None:
    """Fill in the speeds that lead active arms to their set-points; one that should rest where it is, is held there."""
    goal_q, goal_qd, _, held, _, _, _ = targets
    for arm in active:
        held[arm] = True
        for j in range(q.shape[1]):
            way = goal_q[arm, j] - q[arm, j]
            speeds[arm, j] = way / tick
            held[arm] = held[arm] and goal_qd[arm, j] == 0.0 and abs(way) < _HELD_RAD
        if held[arm]:
            speeds[arm] = 0.0
