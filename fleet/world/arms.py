"""Arms without physics: joints that follow their targets within their speed limits, and where the links are then."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.arms.team import ArmTeam
from planners.motion.arm.kinematics import link_frames_into

LINK_RADIUS_M = 0.08
"""Arms are judged against cars as spheres of this radius on and between their joints [m]; links are 0.06-0.09."""
TIP_RADIUS_M = 0.03
"""Radius of the sphere at the tool tip [m]."""


class ServoArms:
    """Arms whose joints go straight to their targets, as fast as their velocity limits let them.

    Attributes:
        q: Joint positions [rad], shape (n_arms, n_joints).
        qd: Joint velocities over the last tick [rad/s], same shape.
        tips: World poses of the tool tips x, y, z, quat_xyzw, shape (n_arms, 7).
        points: Centres of spheres along each arm in the world, base to tip [m], shape (n_arms, n_points, 3).
        radii: Radii of those spheres [m], shape (n_points,).

    Args:
        team: Models of the arms.
        base: Base poses x, y, z, yaw, shape (n_arms, 4).
        start: Joint positions [rad], shape (n_arms, n_joints).
        tick_s: Length of a tick [s].
    """

    def __init__(self, team: ArmTeam, base: FloatArray, start: FloatArray, tick_s: float) -> None:
        self._team, self._base, self._tick_s = team, np.array(base, dtype=np.float64).reshape(-1, 4), tick_s
        n_arms, n_joints = len(self._base), team.width
        self._boundless = np.full((n_arms, n_joints), np.inf)
        self.q = np.array(start, dtype=np.float64).reshape(n_arms, n_joints)
        self.qd = np.zeros((n_arms, n_joints))
        self.tips = np.zeros((n_arms, 7))
        self.points = np.zeros((n_arms, 2 * n_joints + 2, 3))
        self.radii = np.full(2 * n_joints + 2, LINK_RADIUS_M)
        self.radii[-1] = TIP_RADIUS_M
        self.reach_m = max(
            (
                float(np.linalg.norm(s.joints[:, :, 3], axis=1).sum()) + s.tool_length_m + LINK_RADIUS_M
                for s in team.models
            ),
            default=0.0,
        )
        """Nothing of any arm is farther from its base [m]."""
        self._follow(self.q, everything=True)

    def step(self, target_q: FloatArray) -> None:
        """Move towards joint targets [rad], shape (n_arms, n_joints), for one tick."""
        self._follow(target_q, everything=False)

    def follow(self, q: FloatArray, qd: FloatArray) -> None:
        """Be where something else has moved the arms.

        Args:
            q: Joint positions [rad], shape (n_arms, n_joints).
            qd: Their velocities [rad/s], same shape.
        """
        self._follow(q, everything=False, fastest=self._boundless)
        self.qd[:] = qd

    def save(self) -> tuple[FloatArray, FloatArray]:
        """Copies of positions and velocities."""
        return self.q.copy(), self.qd.copy()

    def load(self, snapshot: tuple[FloatArray, FloatArray]) -> None:
        """Return to a saved state."""
        self.q[:] = snapshot[0]
        self._follow(self.q, everything=True)
        self.qd[:] = snapshot[1]

    def _follow(self, target_q: FloatArray, *, everything: bool, fastest: FloatArray | None = None) -> None:
        team = self._team
        _servo(
            self.q,
            self.qd,
            target_q,
            team.lower_rad,
            team.upper_rad,
            team.max_velocity_radps if fastest is None else fastest,
            self._tick_s,
            everything,
            team.joints,
            team.tool_length_m,
            self._base,
            self.tips,
            self.points,
        )


@njit(cache=True)
def _servo(  # flat: bundled, it would take 2.4 us instead of 1 for arms that rest, as often as the world is stepped
    q: FloatArray,
    qd: FloatArray,
    target: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    max_velocity: FloatArray,
    dt: float,
    everything: bool,
    joints: FloatArray,
    tool_length: FloatArray,
    base: FloatArray,
    tips: FloatArray,
    points: FloatArray,
) -> None:
    """Move joints, then place tips and spheres of the arms that moved (of all arms if `everything`)."""
    n_joints = q.shape[1]
    frames = np.zeros((n_joints + 1, 3, 4))
    for i in range(len(q)):
        moved = everything
        for j in range(n_joints):
            goal = min(max(target[i, j], lower[i, j]), upper[i, j])
            step = max_velocity[i, j] * dt
            new = min(max(goal, q[i, j] - step), q[i, j] + step)
            qd[i, j] = (new - q[i, j]) / dt
            moved = moved or new != q[i, j]
            q[i, j] = new
        if not moved:
            continue
        link_frames_into(joints[i], q[i], frames)
        cos, sin = math.cos(base[i, 3]), math.sin(base[i, 3])
        for k in range(2 * n_joints + 2):
            # Even spheres sit on frames, odd ones half-way to the next frame; the last one is the tool tip.
            a, b = k // 2, min((k + 1) // 2, n_joints)
            ahead = tool_length[i] if k > 2 * n_joints else 0.0
            x = 0.5 * (frames[a, 0, 3] + frames[b, 0, 3]) + ahead * frames[b, 0, 2]
            y = 0.5 * (frames[a, 1, 3] + frames[b, 1, 3]) + ahead * frames[b, 1, 2]
            z = 0.5 * (frames[a, 2, 3] + frames[b, 2, 3]) + ahead * frames[b, 2, 2]
            points[i, k, 0] = base[i, 0] + cos * x - sin * y
            points[i, k, 1] = base[i, 1] + sin * x + cos * y
            points[i, k, 2] = base[i, 2] + z
        for axis in range(3):
            tips[i, axis] = points[i, 2 * n_joints + 1, axis]
        _quaternion(frames[n_joints], base[i, 3], tips[i])


@njit(cache=True)
def _quaternion(m: FloatArray, yaw: float, out: FloatArray) -> None:
    """Fill `out[3:7]` with the quaternion x, y, z, w of a rotation about z by `yaw` times the rotation matrix in `m`.

    Source: S. W. Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace >= max(m[0, 0], m[1, 1], m[2, 2]):
        x, y, z, w = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace
    elif m[0, 0] >= max(m[1, 1], m[2, 2]):
        x, y, z, w = 1.0 + 2.0 * m[0, 0] - trace, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]
    elif m[1, 1] >= m[2, 2]:
        x, y, z, w = m[0, 1] + m[1, 0], 1.0 + 2.0 * m[1, 1] - trace, m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]
    else:
        x, y, z, w = m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1.0 + 2.0 * m[2, 2] - trace, m[1, 0] - m[0, 1]
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    c, s = math.cos(yaw / 2.0) / norm, math.sin(yaw / 2.0) / norm
    out[3], out[4], out[5], out[6] = c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z
