"""Forward kinematics of a serial arm whose joints all turn about their own z axis."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import FloatArray
from planners.motion.kernel import kernel


@kernel
def link_frames_into(joints: FloatArray, q: FloatArray, frames: FloatArray) -> None:
    """Fill `frames` (n+1, 3, 4) from joint transforms (n, 3, 4) and q (n,); frame 0 is the identity."""
    for a in range(3):
        for b in range(4):
            frames[0, a, b] = 1.0 if a == b else 0.0
    for i in range(q.shape[0]):
        c = np.cos(q[i])
        s = np.sin(q[i])
        for a in range(3):
            r0 = 0.0
            r1 = 0.0
            r2 = 0.0
            t = frames[i, a, 3]
            for k in range(3):
                f = frames[i, a, k]
                r0 += f * joints[i, k, 0]
                r1 += f * joints[i, k, 1]
                r2 += f * joints[i, k, 2]
                t += f * joints[i, k, 3]
            frames[i + 1, a, 0] = r0 * c + r1 * s
            frames[i + 1, a, 1] = r1 * c - r0 * s
            frames[i + 1, a, 2] = r2
            frames[i + 1, a, 3] = t


@kernel
def jacobian_into(frames: FloatArray, jacobian: FloatArray) -> None:
    """Linear (rows 0-2) and angular (3-5) velocity of the last frame per joint velocity, base frame, shape (6, n)."""
    n = jacobian.shape[1]
    for i in range(n):
        ax, ay, az = frames[i + 1, 0, 2], frames[i + 1, 1, 2], frames[i + 1, 2, 2]
        x = frames[n, 0, 3] - frames[i + 1, 0, 3]
        y = frames[n, 1, 3] - frames[i + 1, 1, 3]
        z = frames[n, 2, 3] - frames[i + 1, 2, 3]
        jacobian[0, i] = ay * z - az * y
        jacobian[1, i] = az * x - ax * z
        jacobian[2, i] = ax * y - ay * x
        jacobian[3, i] = ax
        jacobian[4, i] = ay
        jacobian[5, i] = az


@kernel
def _frames_batch(joints: FloatArray, q: FloatArray, frames: FloatArray) -> None:
    for i in range(q.shape[0]):
        link_frames_into(joints, q[i], frames[i])


def joint_rows(base_from_joint: npt.ArrayLike) -> FloatArray:
    """Check joint transforms and drop their constant last row.

    Args:
        base_from_joint: Transform before each joint's rotation, shape (n, 4, 4).

    Returns:
        The upper three rows, contiguous, shape (n, 3, 4).

    Raises:
        PlanningError: Wrong shape, or a rotation part that is not a rotation.
    """
    joints = checks.floats("base_from_joint", base_from_joint)
    if joints.ndim != 3 or joints.shape[1:] != (4, 4) or len(joints) == 0:
        raise PlanningError(f"base_from_joint: shape {joints.shape}; valid: (n_joints, 4, 4) with n_joints > 0")
    if not np.isfinite(joints).all():
        bad = joints[~np.isfinite(joints).all(axis=(1, 2))][0]
        raise PlanningError(f"base_from_joint: {bad.tolist()}; valid: finite numbers")
    rotation = joints[:, :3, :3]
    unit = rotation @ rotation.transpose(0, 2, 1)
    if not np.allclose(unit, np.eye(3), atol=1e-6):
        bad = joints[np.argmax(np.abs(unit - np.eye(3)).max(axis=(1, 2)))]
        raise PlanningError(f"base_from_joint: {bad.tolist()}; valid: a rotation in the upper left 3x3 part")
    return np.ascontiguousarray(joints[:, :3, :])


def link_frames(base_from_joint: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
    """Poses of all links in the base frame.

    Args:
        base_from_joint: Fixed transform from the previous link to each joint, shape (n, 4, 4).
        q: Joint angles [rad], shape (n,), or (m, n) for a batch.

    Returns:
        Shape (n+1, 4, 4), or (m, n+1, 4, 4) for a batch: frame 0 is the base, frame i moves with joint i.

    Raises:
        PlanningError: Shapes do not fit.
    """
    joints = joint_rows(base_from_joint)
    angles = np.atleast_2d(checks.floats("q", q))
    if angles.ndim != 2 or angles.shape[1] != len(joints):
        raise PlanningError(f"q: shape {np.shape(q)}; valid: (..., {len(joints)}), one angle per joint")
    rows = np.empty((len(angles), len(joints) + 1, 3, 4))
    _frames_batch(joints, np.ascontiguousarray(angles), rows)
    frames = np.zeros((*rows.shape[:2], 4, 4))
    frames[..., :3, :] = rows
    frames[..., 3, 3] = 1.0
    return frames if np.ndim(q) == 2 else frames[0]


def jacobian(base_from_joint: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
    """Velocity of the last link frame per joint velocity, in the base frame.

    Args:
        base_from_joint: Fixed transform from the previous link to each joint, shape (n, 4, 4).
        q: Joint angles [rad], shape (n,).

    Returns:
        Rows 0 to 2 linear [m/rad], 3 to 5 angular [rad/rad], shape (6, n).

    Raises:
        PlanningError: Shapes do not fit.
    """
    joints = joint_rows(base_from_joint)
    angles = checks.floats("q", q)
    if angles.shape != (len(joints),):
        raise PlanningError(f"q: shape {angles.shape}; valid: ({len(joints)},), one angle per joint")
    frames = np.empty((len(joints) + 1, 3, 4))
    link_frames_into(joints, angles, frames)
    out = np.empty((6, len(joints)))
    jacobian_into(frames, out)
    return out


def last_link_pose(joints: FloatArray, q: npt.ArrayLike) -> FloatArray:
    """Pose of the last link in the base frame, for solvers that ask often.

    Args:
        joints: What `joint_rows` gives, shape (n, 3, 4).
        q: Joint angles [rad], shape (n,).

    Returns:
        Shape (4, 4).

    Raises:
        PlanningError: Not one finite number per joint: the kernel would leave frames out, or read beyond.
    """
    angles = checks.vector("q", q, len(joints))
    frames = np.empty((len(joints) + 1, 3, 4))
    link_frames_into(joints, angles, frames)
    pose = np.eye(4)
    pose[:3] = frames[-1]
    return pose


def turn_about_z(angle: float) -> FloatArray:
    """Matrix of a turn about the z axis by an angle [rad], shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pointing_down(yaw: float) -> FloatArray:
    """Pose of a tool tip that looks straight down, for the caller to put where it is wanted.

    Args:
        yaw: Direction of its x axis, seen from above [rad].

    Returns:
        The pose at the origin, shape (4, 4).
    """
    c, s = np.cos(yaw), np.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = [[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]
    return pose


def flange_from_tip(base_from_tip: npt.ArrayLike, tool_length_m: float) -> FloatArray:
    """Pose of the last link frame that puts the tool tip, ahead on its +z, at a pose.

    Args:
        base_from_tip: Wanted tip pose, shape (4, 4).
        tool_length_m: Distance from the last link frame to the tip [m].

    Returns:
        Pose of the last link frame in the base frame, shape (4, 4).

    Raises:
        PlanningError: No numbers, or of another shape.
    """
    flange = checks.floats("base_from_tip", base_from_tip).copy()
    if flange.shape != (4, 4):
        raise PlanningError(f"base_from_tip: shape {flange.shape}; valid: (4, 4)")
    flange[:3, 3] -= tool_length_m * flange[:3, 2]
    return flange
