"""Closed-form inverse kinematics of 7-joint arms with a spherical shoulder, a hinge elbow and a spherical wrist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.errors import PlanningError
from planners.motion.kinematics import joint_rows, link_frames, link_frames_into

FloatArray = npt.NDArray[np.float64]

N_BRANCHES = 8
"""Elbow, shoulder and wrist each have two postures."""

_N_JOINTS = 7
_FIT_TOLERANCE = 1e-6
_STRAIGHT = 1e-9  # below this the shoulder-wrist line is vertical and the reference plane is free


@njit(cache=True)
def _reference(wrist, upper_arm, fore_arm, bend, rotation):  # type: ignore[no-untyped-def]
    """Shoulder rotation (3, 3) that reaches the wrist point with joint 3 at zero; the elbow angle; reachable or not.

    `rotation` takes the upper-arm frame after joint 3 to the shoulder frame.
    """
    wx, wy, wz = wrist[0], wrist[1], wrist[2]
    square = wx * wx + wy * wy + wz * wz
    cosine = (square - upper_arm * upper_arm - fore_arm * fore_arm) / (2.0 * upper_arm * fore_arm)
    if cosine > 1.0 or cosine < -1.0 or square < _STRAIGHT:
        return False, 0.0
    elbow = bend * np.arccos(cosine)
    radius = np.hypot(wx, wy)
    turn = np.arctan2(wy, wx) if radius > _STRAIGHT else 0.0
    # In the upper-arm frame the wrist is at (-fore_arm sin q4, 0, upper_arm + fore_arm cos q4).
    lean = np.arctan2(radius, wz) - np.arctan2(-fore_arm * np.sin(elbow), upper_arm + fore_arm * cosine)
    ct, st, cl, sl = np.cos(turn), np.sin(turn), np.cos(lean), np.sin(lean)
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = ct * cl, -st, ct * sl
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = st * cl, ct, st * sl
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = -sl, 0.0, cl
    return True, elbow


@njit(cache=True)
def _product(a, b, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def wrist_target_into(pose, geometry, target):  # type: ignore[no-untyped-def]
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


@njit(cache=True)
def branch_into(target, arm_angle, branch, geometry, q):  # type: ignore[no-untyped-def]
    """Solve one branch at one arm angle for a wrist pose in the shoulder frame; fills q (7,); limits unchecked."""
    bend = 1.0 if branch & 1 else -1.0
    lean = 1.0 if branch & 2 else -1.0
    wrist_bend = 1.0 if branch & 4 else -1.0
    reference = np.empty((3, 3))
    reached, elbow = _reference(target[:, 3], geometry[2, 0, 0], geometry[2, 0, 1], bend, reference)
    if not reached:
        return False
    x, y, z = target[0, 3], target[1, 3], target[2, 3]
    length = np.sqrt(x * x + y * y + z * z)
    x /= length
    y /= length
    z /= length
    c = np.cos(arm_angle)
    s = np.sin(arm_angle)
    v = 1.0 - c
    swing = np.empty((3, 3))  # Rodrigues: by the arm angle about the shoulder-wrist line
    swing[0, 0], swing[0, 1], swing[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    swing[1, 0], swing[1, 1], swing[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    swing[2, 0], swing[2, 1], swing[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    shoulder = np.empty((3, 3))
    _product(swing, reference, shoulder)
    # Shoulder = Rz(q1) Ry(q2) Rz(q3)
    q[0] = np.arctan2(lean * shoulder[1, 2], lean * shoulder[0, 2])
    q[1] = lean * np.arccos(min(1.0, max(-1.0, shoulder[2, 2])))
    q[2] = np.arctan2(lean * shoulder[2, 1], -lean * shoulder[2, 0])
    q[3] = elbow
    ce = np.cos(elbow)
    se = np.sin(elbow)
    for i in range(3):  # reuse: swing = shoulder Ry(-q4)
        swing[i, 0] = shoulder[i, 0] * ce + shoulder[i, 2] * se
        swing[i, 1] = shoulder[i, 1]
        swing[i, 2] = shoulder[i, 2] * ce - shoulder[i, 0] * se
    # Wrist = Rz(q5) Ry(q6) Rz(q7)
    for i in range(3):
        for j in range(3):
            reference[i, j] = swing[0, i] * target[0, j] + swing[1, i] * target[1, j] + swing[2, i] * target[2, j]
    q[4] = np.arctan2(wrist_bend * reference[1, 2], wrist_bend * reference[0, 2])
    q[5] = wrist_bend * np.arccos(min(1.0, max(-1.0, reference[2, 2])))
    q[6] = np.arctan2(wrist_bend * reference[2, 1], -wrist_bend * reference[2, 0])
    for i in range(7):
        q[i] *= geometry[3, i // 4, i % 4]
    return True


@njit(cache=True)
def _all_branches(pose, n_arm_angles, geometry, lower, upper, out):  # type: ignore[no-untyped-def]
    target = np.empty((3, 4))
    wrist_target_into(pose, geometry, target)
    q = np.empty(7)
    n = 0
    for a in range(n_arm_angles):
        for branch in range(8):
            if not branch_into(target, -np.pi + 2.0 * np.pi * a / n_arm_angles, branch, geometry, q):
                continue
            inside = True
            for i in range(7):
                if q[i] < lower[i] or q[i] > upper[i]:
                    inside = False
            if inside:
                out[n] = q
                n += 1
    return n


@njit(cache=True)
def _arm_angle(q, geometry):  # type: ignore[no-untyped-def]
    """Branch and arm angle of a configuration."""
    t = np.empty(7)
    for i in range(7):
        t[i] = q[i] * geometry[3, i // 4, i % 4]
    c1, s1, c2, s2, c3, s3 = np.cos(t[0]), np.sin(t[0]), np.cos(t[1]), np.sin(t[1]), np.cos(t[2]), np.sin(t[2])
    shoulder = np.empty((3, 3))
    shoulder[0, 0], shoulder[0, 1], shoulder[0, 2] = c1 * c2 * c3 - s1 * s3, -c1 * c2 * s3 - s1 * c3, c1 * s2
    shoulder[1, 0], shoulder[1, 1], shoulder[1, 2] = s1 * c2 * c3 + c1 * s3, c1 * c3 - s1 * c2 * s3, s1 * s2
    shoulder[2, 0], shoulder[2, 1], shoulder[2, 2] = -s2 * c3, s2 * s3, c2
    upper_arm, fore_arm = geometry[2, 0, 0], geometry[2, 0, 1]
    along = upper_arm + fore_arm * np.cos(t[3])
    aside = -fore_arm * np.sin(t[3])
    wrist = np.empty(3)
    for i in range(3):
        wrist[i] = shoulder[i, 0] * aside + shoulder[i, 2] * along
    branch = (1 if t[3] > 0.0 else 0) + (2 if t[1] > 0.0 else 0) + (4 if t[5] > 0.0 else 0)
    reference = np.empty((3, 3))
    reached, _ = _reference(wrist, upper_arm, fore_arm, 1.0 if branch & 1 else -1.0, reference)
    if not reached:
        return branch, 0.0
    swing = np.zeros((3, 3))  # shoulder * reference^T: a rotation about the shoulder-wrist line
    for i in range(3):
        for j in range(3):
            for k in range(3):
                swing[i, j] += shoulder[i, k] * reference[j, k]
    length = np.sqrt(wrist[0] ** 2 + wrist[1] ** 2 + wrist[2] ** 2)
    sine = (
        (swing[2, 1] - swing[1, 2]) * wrist[0]
        + (swing[0, 2] - swing[2, 0]) * wrist[1]
        + (swing[1, 0] - swing[0, 1]) * wrist[2]
    ) / length
    return branch, np.arctan2(sine, swing[0, 0] + swing[1, 1] + swing[2, 2] - 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SrsGeometry:
    """A 7-joint arm of the kind spherical shoulder, hinge elbow, spherical wrist (KUKA iiwa and the like).

    The redundancy is the arm angle: the rotation of the elbow about the shoulder-wrist line, zero where joint 3 is.
    A branch is a number 0 to 7: bit 0 elbow, bit 1 shoulder, bit 2 wrist bent to the positive side.

    Source: Shimizu et al., Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint
    limits, IEEE T-RO 2008; here the arm angle is measured from the plane of joint 3 at zero.
    """

    base_from_joint: FloatArray
    """Joint transforms, shape (7, 4, 4)."""
    lower: FloatArray
    """Lower joint limits [rad], shape (7,)."""
    upper: FloatArray
    """Upper joint limits [rad], shape (7,)."""
    packed: FloatArray
    """Kernel input (4, 4, 4): base_from_shoulder, last_from_wrist, arm lengths [m], joint signs."""
    joints: FloatArray
    """Kernel input: upper three rows of the joint transforms, shape (7, 3, 4)."""

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
        transforms = np.array(base_from_joint, dtype=np.float64)
        rows = joint_rows(transforms)
        low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
        if len(rows) != _N_JOINTS or low.shape != (_N_JOINTS,) or high.shape != (_N_JOINTS,):
            raise PlanningError(
                f"SrsGeometry: {len(rows)} joints, limits {low.shape} and {high.shape}; expected {_N_JOINTS} of each"
            )
        geometry = cls(base_from_joint=transforms, lower=low, upper=high, packed=_pack(transforms), joints=rows)
        for q in np.random.default_rng(0).uniform(-1.5, 1.5, (4, _N_JOINTS)):
            angle, branch = geometry.arm_angle_and_branch(q)
            again = geometry.ik_branch(link_frames(transforms, q)[-1], angle, branch)
            if again is None or np.abs(again - q).max() > _FIT_TOLERANCE:
                raise PlanningError(
                    "SrsGeometry: the arm has no spherical shoulder, hinge elbow and spherical wrist in line at q = 0"
                )
        return geometry

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link in the base frame for one configuration (7,), shape (4, 4)."""
        frames = np.empty((_N_JOINTS + 1, 3, 4))
        link_frames_into(self.joints, np.ascontiguousarray(q, dtype=np.float64), frames)
        pose = np.eye(4)
        pose[:3] = frames[-1]
        return pose

    def within_limits(self, q: npt.ArrayLike) -> bool:
        """Whether one configuration (7,) respects the joint limits."""
        angles = np.asarray(q, dtype=np.float64)
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
            PlanningError: No such branch.
        """
        if not 0 <= branch < N_BRANCHES:
            raise PlanningError(f"ik_branch: branch {branch}, expected 0 to {N_BRANCHES - 1}")
        target = np.empty((3, 4))
        wrist_target_into(_pose(base_from_flange), self.packed, target)
        q = np.empty(_N_JOINTS)
        return q if branch_into(target, float(arm_angle), int(branch), self.packed, q) else None

    def ik_all(self, base_from_flange: npt.ArrayLike, n_arm_angles: int = 24) -> FloatArray:
        """All solutions inside the joint limits on a regular grid of arm angles.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            n_arm_angles: Arm angles over the full circle, >= 1; times 8 branches are tried.

        Returns:
            Solutions [rad], shape (m, 7), m >= 0, ordered by arm angle, then branch.
        """
        out = np.empty((N_BRANCHES * n_arm_angles, _N_JOINTS))
        n = _all_branches(_pose(base_from_flange), n_arm_angles, self.packed, self.lower, self.upper, out)
        return out[:n]

    def arm_angle_and_branch(self, q: npt.ArrayLike) -> tuple[float, int]:
        """Arm angle [rad] and branch (0 to 7) of a configuration: the inverse of `ik_branch`."""
        branch, angle = _arm_angle(np.ascontiguousarray(q, dtype=np.float64), self.packed)
        return float(angle), int(branch)


def _pose(base_from_flange: npt.ArrayLike) -> FloatArray:
    return np.ascontiguousarray(base_from_flange, dtype=np.float64)


def _pack(transforms: FloatArray) -> FloatArray:
    """Fit the canonical chain Rz Ry Rz | -Ry | Rz Ry Rz to the arm at q = 0; wrong arms fail the caller's check."""
    zero = link_frames(transforms, np.zeros(_N_JOINTS))
    axis, origin = zero[1:, :3, 2], zero[1:, :3, 3]
    up = origin[5] - origin[1]  # from shoulder to wrist
    if np.linalg.norm(up) < _FIT_TOLERANCE or abs(axis[0] @ axis[1]) > _FIT_TOLERANCE:
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
    sign[:_N_JOINTS] = [np.sign(a @ (axis[1] if i % 2 else up)) for i, a in enumerate(axis)]
    sign[3] *= -1.0  # the canonical elbow bends against the shoulder's axis
    signs = np.zeros((4, 4))
    signs[:2] = sign.reshape(2, 4)
    return np.stack([base_from_shoulder, np.linalg.inv(zero[-1]) @ base_from_wrist, lengths, signs])
