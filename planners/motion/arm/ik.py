"""Closed-form inverse kinematics of 7-joint arms with a spherical shoulder, a hinge elbow and a spherical wrist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.kinematics import link_frames, turn_about_z
from planners.motion.arm.seven_joints import FIT_TOLERANCE, N_JOINTS, SevenJointArm, seven_joint_arm
from planners.motion.arrays import FloatArray
from planners.motion.kernel import inlined, kernel

N_BRANCHES = 8
"""Elbow, shoulder and wrist each have two postures."""

_MOST_ARM_ANGLES = 100_000
_STRAIGHT = 1e-9  # below this the shoulder-wrist line is vertical and the reference plane is free


@kernel
def wrist_target_into(pose: FloatArray, geometry: FloatArray, target: FloatArray) -> None:
    """Wanted wrist pose in the shoulder frame (3, 4) from the wanted last-link pose in the base frame (>=3, 4)."""
    for i in range(3):
        for j in range(3):
            target[i, j] = 0.0
            for k in range(3):
                for m in range(3):
                    target[i, j] += geometry[0, k, i] * pose[k, m] * geometry[1, m, j]
    for i in range(3):
        target[i, 3] = 0.0
        for k in range(3):
            point = pose[k, 3] - geometry[0, k, 3]
            for m in range(3):
                point += pose[k, m] * geometry[1, m, 3]
            target[i, 3] += geometry[0, k, i] * point


class _Reference(NamedTuple):
    """The arm that reaches the wrist with joint 3 at zero: its shoulder is Rz(turn) Ry(tilt)."""

    elbow: float
    """Angle of joint 4 [rad]; NaN if the wrist is out of reach."""
    elbow_cos: float
    elbow_sin: float
    turn_cos: float
    turn_sin: float
    tilt_cos: float
    tilt_sin: float
    x: float
    """Direction from shoulder to wrist, about which the arm swings."""
    y: float
    z: float


@kernel
def _reference(target: FloatArray, bend: float, geometry: FloatArray) -> _Reference:
    """Solve the triangle of shoulder, elbow and wrist for a wrist pose in the shoulder frame (3, 4)."""
    upper_arm, fore_arm = geometry[2, 0, 0], geometry[2, 0, 1]
    x, y, z = target[0, 3], target[1, 3], target[2, 3]
    square = x * x + y * y + z * z
    ce = (square - upper_arm * upper_arm - fore_arm * fore_arm) / (2.0 * upper_arm * fore_arm)
    if ce > 1.0 or ce < -1.0 or square < _STRAIGHT:
        return _Reference(np.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elbow = bend * np.arccos(ce)
    se = np.sin(elbow)
    # In the frame after joint 3 the wrist is at (-fore_arm sin q4, 0, upper_arm + fore_arm cos q4).
    radius = np.hypot(x, y)
    turn = np.arctan2(y, x) if radius > _STRAIGHT else 0.0
    tilt = np.arctan2(radius, z) - np.arctan2(-fore_arm * se, upper_arm + fore_arm * ce)
    length = np.sqrt(square)
    return _Reference(
        elbow, ce, se, np.cos(turn), np.sin(turn), np.cos(tilt), np.sin(tilt), x / length, y / length, z / length
    )


@inlined
def _column(reference: _Reference, j: int) -> tuple[float, float, float]:
    """A column of the reference's shoulder rotation."""
    if j == 0:
        column = (reference.turn_cos * reference.tilt_cos, reference.turn_sin * reference.tilt_cos, -reference.tilt_sin)
    elif j == 1:
        column = (-reference.turn_sin, reference.turn_cos, 0.0)
    else:
        column = (reference.turn_cos * reference.tilt_sin, reference.turn_sin * reference.tilt_sin, reference.tilt_cos)
    return column


@kernel
def branch_into(target: FloatArray, arm_angle: float, branch: int, geometry: FloatArray, q: FloatArray) -> bool:
    """Solve one branch at one arm angle for a wrist pose in the shoulder frame; fills q (7,); limits unchecked."""
    bend = 1.0 if branch & 1 else -1.0
    lean = 1.0 if branch & 2 else -1.0
    wrist_bend = 1.0 if branch & 4 else -1.0
    reference = _reference(target, bend, geometry)
    if np.isnan(reference.elbow):
        return False
    ce, se = reference.elbow_cos, reference.elbow_sin
    x, y, z = reference.x, reference.y, reference.z
    # Columns of the shoulder rotation: those of the reference, swung by the arm angle about the shoulder-wrist line.
    c = np.cos(arm_angle)
    s = np.sin(arm_angle)
    shoulder = np.empty((3, 3))
    for j in range(3):
        ax, ay, az = _column(reference, j)
        v = (1.0 - c) * (x * ax + y * ay + z * az)  # Rodrigues
        shoulder[0, j] = c * ax + s * (y * az - z * ay) + v * x
        shoulder[1, j] = c * ay + s * (z * ax - x * az) + v * y
        shoulder[2, j] = c * az + s * (x * ay - y * ax) + v * z
    # Shoulder = Rz(q1) Ry(q2) Rz(q3)
    q[0] = np.arctan2(lean * shoulder[1, 2], lean * shoulder[0, 2])
    q[1] = lean * np.arccos(min(1.0, max(-1.0, shoulder[2, 2])))
    q[2] = np.arctan2(lean * shoulder[2, 1], -lean * shoulder[2, 0])
    q[3] = reference.elbow
    # Wrist = (shoulder Ry(-q4))^T target = Rz(q5) Ry(q6) Rz(q7)
    wrist = np.zeros((3, 3))
    for k in range(3):
        first = shoulder[k, 0] * ce + shoulder[k, 2] * se
        third = shoulder[k, 2] * ce - shoulder[k, 0] * se
        for j in range(3):
            wrist[0, j] += first * target[k, j]
            wrist[1, j] += shoulder[k, 1] * target[k, j]
            wrist[2, j] += third * target[k, j]
    q[4] = np.arctan2(wrist_bend * wrist[1, 2], wrist_bend * wrist[0, 2])
    q[5] = wrist_bend * np.arccos(min(1.0, max(-1.0, wrist[2, 2])))
    q[6] = np.arctan2(wrist_bend * wrist[2, 1], -wrist_bend * wrist[2, 0])
    for i in range(7):
        q[i] *= geometry[3, i // 4, i % 4]
    return True


@kernel
def _circle_into(
    target: FloatArray, bend: float, geometry: FloatArray, shoulder: FloatArray, wrist: FloatArray
) -> float:
    """Shoulder and wrist rotation over the arm angle: cos * [0] + sin * [1] + [2], each (3, 3, 3); the elbow angle.

    The elbow angle is NaN if the wrist is out of reach.
    """
    reference = _reference(target, bend, geometry)
    if np.isnan(reference.elbow):
        return np.nan
    ce, se = reference.elbow_cos, reference.elbow_sin
    x, y, z = reference.x, reference.y, reference.z
    for j in range(3):  # Rodrigues, column by column, as in `branch_into`
        ax, ay, az = _column(reference, j)
        along = x * ax + y * ay + z * az
        shoulder[2, 0, j], shoulder[2, 1, j], shoulder[2, 2, j] = along * x, along * y, along * z
        shoulder[0, 0, j], shoulder[0, 1, j], shoulder[0, 2, j] = ax - along * x, ay - along * y, az - along * z
        shoulder[1, 0, j] = y * az - z * ay
        shoulder[1, 1, j] = z * ax - x * az
        shoulder[1, 2, j] = x * ay - y * ax
    for c in range(3):
        for j in range(3):
            wrist[c, 0, j] = wrist[c, 1, j] = wrist[c, 2, j] = 0.0
            for k in range(3):
                wrist[c, 0, j] += (shoulder[c, k, 0] * ce + shoulder[c, k, 2] * se) * target[k, j]
                wrist[c, 1, j] += shoulder[c, k, 1] * target[k, j]
                wrist[c, 2, j] += (shoulder[c, k, 2] * ce - shoulder[c, k, 0] * se) * target[k, j]
    return reference.elbow


@inlined
def _on_circle(part: FloatArray, i: int, j: int, c: float, s: float) -> float:
    entry: float = part[0, i, j] * c + part[1, i, j] * s + part[2, i, j]
    return entry


@kernel
def _wrapped(angle: float) -> float:
    if angle > np.pi:
        return angle - 2.0 * np.pi
    return angle + 2.0 * np.pi if angle < -np.pi else angle


@kernel
def _four_branches(
    arm_angle: float,
    elbow: float,
    shoulder: FloatArray,
    wrist: FloatArray,
    geometry: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    out: FloatArray,
    n: int,
) -> int:
    """Append the solutions inside the limits at one arm angle and elbow side to `out`; returns their new number."""
    c = np.cos(arm_angle)
    s = np.sin(arm_angle)
    turned = np.empty((2, 3))  # the three joints of shoulder and wrist, bent to the positive side
    for part in range(2):
        m = wrist if part else shoulder
        x, y = _on_circle(m, 0, 2, c, s), _on_circle(m, 1, 2, c, s)
        flat = np.hypot(x, y)
        turned[part, 0] = np.arctan2(y, x)
        turned[part, 1] = np.arctan2(flat, _on_circle(m, 2, 2, c, s))
        # The last joint takes what the first leaves, which stays exact where the two are nearly in line.
        cf, sf = (x / flat, y / flat) if flat > 0.0 else (1.0, 0.0)
        turned[part, 2] = np.arctan2(
            cf * _on_circle(m, 1, 0, c, s) - sf * _on_circle(m, 0, 0, c, s),
            cf * _on_circle(m, 1, 1, c, s) - sf * _on_circle(m, 0, 1, c, s),
        )
    q = np.empty(7)
    for half in range(4):  # bit 0 shoulder, bit 1 wrist; the branches of one elbow side, in order
        for part in range(2):
            flip = (half >> part) & 1 == 0
            first = 4 * part
            q[first] = _wrapped(turned[part, 0] + np.pi) if flip else turned[part, 0]
            q[first + 1] = -turned[part, 1] if flip else turned[part, 1]
            q[first + 2] = _wrapped(turned[part, 2] + np.pi) if flip else turned[part, 2]
        q[3] = elbow
        inside = True
        for i in range(7):
            q[i] *= geometry[3, i // 4, i % 4]
            inside = inside and lower[i] <= q[i] <= upper[i]
        if inside:
            for i in range(7):
                out[n, i] = q[i]
            n += 1
    return n


@kernel
def _roots(part: FloatArray, theta: float, row: int, roots: FloatArray, n: int) -> int:
    """Append the arm angles at which one joint of the shoulder or the wrist is at +-theta or theta + pi.

    Each of the three joints makes an equation a cos + b sin + c = 0. `row` is 0 to 2, the joint.
    """
    if row == 1:
        a, b, c = part[0, 2, 2], part[1, 2, 2], part[2, 2, 2] - np.cos(theta)
    else:
        ct, st = np.cos(theta), np.sin(theta)
        if row == 0:
            a = part[0, 1, 2] * ct - part[0, 0, 2] * st
            b = part[1, 1, 2] * ct - part[1, 0, 2] * st
            c = part[2, 1, 2] * ct - part[2, 0, 2] * st
        else:
            a = part[0, 2, 1] * ct + part[0, 2, 0] * st
            b = part[1, 2, 1] * ct + part[1, 2, 0] * st
            c = part[2, 2, 1] * ct + part[2, 2, 0] * st
    size = np.hypot(a, b)
    if size <= abs(c):
        return n
    middle = np.arctan2(b, a)
    apart = np.arccos(-c / size)
    roots[n] = _wrapped(middle + apart)
    roots[n + 1] = _wrapped(middle - apart)
    return n + 2


@kernel
def _solutions(
    pose: FloatArray, n_angles: int, geometry: FloatArray, lower: FloatArray, upper: FloatArray, out: FloatArray
) -> int:
    """Solutions inside the limits on a grid of arm angles, and one in every interval of arm angles between its points.

    Between two neighbouring arm angles at which a joint is at a limit, a branch is inside the limits or it is not.
    Returns the number of solutions.
    """
    target = np.empty((3, 4))
    wrist_target_into(pose, geometry, target)
    shoulder = np.empty((3, 3, 3))
    wrist = np.empty((3, 3, 3))
    roots = np.empty(24 + 2)
    n = 0
    step = 2.0 * np.pi / n_angles
    for bend_bit in range(2):
        elbow = _circle_into(target, 1.0 if bend_bit else -1.0, geometry, shoulder, wrist)
        if np.isnan(elbow) or not lower[3] <= elbow * geometry[3, 0, 3] <= upper[3]:
            continue
        for a in range(n_angles):
            n = _four_branches(-np.pi + a * step, elbow, shoulder, wrist, geometry, lower, upper, out, n)
        m = 0
        for joint in (0, 1, 2, 4, 5, 6):
            part = wrist if joint > 3 else shoulder
            sign = geometry[3, joint // 4, joint % 4]
            m = _roots(part, sign * lower[joint], joint % 4, roots, m)
            m = _roots(part, sign * upper[joint], joint % 4, roots, m)
        if m == 0:
            continue
        roots[:m].sort()
        roots[m] = roots[0] + 2.0 * np.pi
        for i in range(m):
            # The grid starts at -pi: is one of its points in between?
            if np.floor((roots[i + 1] + np.pi) / step) > np.floor((roots[i] + np.pi) / step):
                continue
            middle = 0.5 * (roots[i] + roots[i + 1])
            n = _four_branches(middle, elbow, shoulder, wrist, geometry, lower, upper, out, n)
    return n


@dataclass(frozen=True, kw_only=True, eq=False)
class SrsGeometry(SevenJointArm):
    """A 7-joint arm of the kind spherical shoulder, hinge elbow, spherical wrist (KUKA iiwa and the like).

    The redundancy is the arm angle: the rotation of the elbow about the shoulder-wrist line, zero where joint 3 is.
    A branch is a number 0 to 7: bit 0 elbow, bit 1 shoulder, bit 2 wrist bent to the positive side.

    Source: Shimizu et al., Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint
    limits, IEEE T-RO 2008; here the arm angle is measured from the plane of joint 3 at zero.
    """

    packed: FloatArray
    """Kernel input (4, 4, 4): base_from_shoulder, last_from_wrist, arm lengths [m], joint signs."""

    @classmethod
    def from_joints(cls, base_from_joint: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike) -> SrsGeometry:
        """Read the geometry off the joint transforms and check it.

        Args:
            base_from_joint: Fixed transform before each joint's rotation about its own z, shape (7, 4, 4).
            lower: Lower joint limits [rad], shape (7,).
            upper: Upper joint limits [rad], shape (7,).

        Returns:
            The geometry.

        Raises:
            PlanningError: Not 7 joints, or the axes do not meet in a shoulder, an elbow and a wrist.
        """
        arm = seven_joint_arm("SrsGeometry", base_from_joint, lower, upper)
        transforms = arm.base_from_joint
        geometry = cls(**vars(arm), packed=_pack(transforms))
        for q in np.random.default_rng(0).uniform(-1.5, 1.5, (4, N_JOINTS)):
            angle, branch = geometry.arm_angle_and_branch(q)
            again = geometry.ik_branch(link_frames(transforms, q)[-1], angle, branch)
            if again is None or np.abs(again - q).max() > FIT_TOLERANCE:
                raise PlanningError(
                    "SrsGeometry: the arm has no spherical shoulder, hinge elbow and spherical wrist in line at q = 0"
                )
        return geometry

    def within_limits(self, q: npt.ArrayLike) -> bool:
        """Whether one configuration (7,) respects the joint limits.

        Raises:
            PlanningError: It has another shape, or is no numbers.
        """
        angles = checks.floats("q", q)
        if angles.shape != (N_JOINTS,):
            raise PlanningError(f"q: shape {angles.shape}; valid: ({N_JOINTS},)")
        return bool(np.all((angles >= self.lower) & (angles <= self.upper)))

    def ik_branch(self, base_from_flange: npt.ArrayLike, arm_angle: float, branch: int) -> FloatArray | None:
        """One solution; joint limits are not looked at.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            arm_angle: Arm angle [rad].
            branch: 0 to 7.

        Returns:
            Joint angles in (-pi, pi] [rad], shape (7,); None if the wrist is out of reach.

        Raises:
            PlanningError: No such branch, no finite angle, or no pose.
        """
        checks.whole("ik_branch: branch", branch, 0, N_BRANCHES - 1)
        if not np.isfinite(arm_angle):
            raise PlanningError(f"ik_branch: arm_angle {arm_angle}; valid: a finite number")
        target, q = np.empty((3, 4)), np.empty(N_JOINTS)
        wrist_target_into(_pose(base_from_flange), self.packed, target)
        return q if branch_into(target, float(arm_angle), branch, self.packed, q) else None

    def ik_all(self, base_from_flange: npt.ArrayLike, n_arm_angles: int = 24) -> FloatArray:
        """All solutions inside the joint limits, on a regular grid of arm angles and in every gap of it.

        The arm angles for which a branch respects the limits are intervals, whose ends are known in closed form. An
        interval between two points of the grid gives its middle: no branch is missed because it is narrow.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            n_arm_angles: Arm angles over the full circle, >= 1; times 8 branches are tried.

        Returns:
            Solutions [rad], shape (m, 7), m >= 0, ordered by elbow side, then arm angle.

        Raises:
            PlanningError: No pose, or no such number of arm angles.
        """
        checks.whole("ik_all: n_arm_angles", n_arm_angles, 1, _MOST_ARM_ANGLES)
        out = np.empty((N_BRANCHES * n_arm_angles + 8 * 24, N_JOINTS))
        n = _solutions(_pose(base_from_flange), n_arm_angles, self.packed, self.lower, self.upper, out)
        return out[:n]

    def arm_angle_and_branch(self, q: npt.ArrayLike) -> tuple[float, int]:
        """Arm angle [rad] and branch (0 to 7) of a configuration: the inverse of `ik_branch`."""
        turned = checks.vector("q", q, N_JOINTS) * self.packed[3].reshape(-1)[:N_JOINTS]
        branch = int(turned[3] > 0.0) + 2 * int(turned[1] > 0.0) + 4 * int(turned[5] > 0.0)
        shoulder = turn_about_z(turned[0]) @ _ry(turned[1]) @ turn_about_z(turned[2])
        upper_arm, fore_arm = self.packed[2, 0, :2]
        aside, along = -fore_arm * np.sin(turned[3]), upper_arm + fore_arm * np.cos(turned[3])
        wrist = shoulder @ np.array([aside, 0.0, along])
        radius = np.hypot(wrist[0], wrist[1])
        turn = np.arctan2(wrist[1], wrist[0]) if radius > _STRAIGHT else 0.0
        reference = turn_about_z(turn) @ _ry(np.arctan2(radius, wrist[2]) - np.arctan2(aside, along))
        swing = shoulder @ reference.T  # a rotation about the shoulder-wrist line
        sine = np.array([swing[2, 1] - swing[1, 2], swing[0, 2] - swing[2, 0], swing[1, 0] - swing[0, 1]]) @ wrist
        return float(np.arctan2(sine / np.sqrt(wrist.dot(wrist)), swing.trace() - 1.0)), branch


def _ry(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _pose(base_from_flange: npt.ArrayLike) -> FloatArray:
    return checks.rigid("base_from_flange", base_from_flange)


def _pack(transforms: FloatArray) -> FloatArray:
    """Fit the canonical chain Rz Ry Rz | -Ry | Rz Ry Rz to the arm at q = 0; wrong arms fail the caller's check."""
    zero = link_frames(transforms, np.zeros(N_JOINTS))
    axis, origin = zero[1:, :3, 2], zero[1:, :3, 3]
    up = origin[5] - origin[1]  # from shoulder to wrist
    if np.linalg.norm(up) < FIT_TOLERANCE or abs(axis[0] @ axis[1]) > FIT_TOLERANCE:
        raise PlanningError("SrsGeometry: joints 1 and 2 must be perpendicular and joints 2 and 6 apart at q = 0")
    up = axis[0] * np.sign(axis[0] @ up)
    base_from_shoulder = np.eye(4)
    base_from_shoulder[:3, :3] = np.column_stack([np.cross(axis[1], up), axis[1], up])
    base_from_shoulder[:3, 3] = origin[0] + up * (up @ (origin[1] - origin[0]))
    base_from_wrist = base_from_shoulder.copy()
    base_from_wrist[:3, 3] = origin[0] + up * (up @ (origin[5] - origin[0]))
    lengths = np.zeros((4, 4))
    lengths[0, 0] = up @ (origin[3] - origin[1])
    lengths[0, 1] = up @ (origin[5] - origin[3])
    sign = np.zeros(8)
    sign[:N_JOINTS] = [np.sign(a @ (axis[1] if i % 2 else up)) for i, a in enumerate(axis)]
    sign[3] *= -1.0  # the canonical elbow bends against the shoulder's axis
    signs = np.zeros((4, 4))
    signs[:2] = sign.reshape(2, 4)
    return np.stack([base_from_shoulder, np.linalg.inv(zero[-1]) @ base_from_wrist, lengths, signs])
