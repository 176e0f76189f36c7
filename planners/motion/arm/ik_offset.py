"""Closed-form inverse kinematics of 7-joint arms with an offset elbow and an offset last joint, such as the Panda.

With the last joint at a given angle there are up to eight solutions, found in eight steps:

1. Frame 6, and the wrist where axes 5 and 6 meet, follow from the pose: only joint 7 comes after them.
2. The distance from shoulder to wrist gives the elbow, joint 4: two angles.
3. The line from shoulder to wrist, and two axes across it, are a frame for the plane of the arm.
4. In frame 3 the elbow's angle fixes the triangle of shoulder, elbow and wrist, and axis 5 with it.
5. The triangle may turn about the line from shoulder to wrist until axes 5 and 6 have their fixed angle: two angles.
6. That places the triangle, and frame 3, in the base frame.
7. Joints 5 and 6 lead from frame 4 to frame 6.
8. Joints 1 to 3, three axes through the shoulder, make frame 3: two postures.

Source: He and Liu, Analytical inverse kinematics for Franka Emika Panda, ICMRA 2021 (the last joint as the redundancy,
steps 1 to 4); here from the joint transforms, for any arm of the kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.kinematics import link_frames
from planners.motion.arm.seven_joints import FIT_TOLERANCE, N_JOINTS, SevenJointArm, seven_joint_arm
from planners.motion.arrays import FloatArray
from planners.motion.kernel import borrowing, kernel

_MOST_LASTS = 100_000
_MEET_M = 1e-6
_MEET = 1e-9  # shoulder and wrist in one place: no line between them
_STRETCHED = 1e-9  # axis 5 along the line of sight: the arm is stretched, the plane is free
_MOST = 8  # solutions at one value of the last joint: elbow, arm plane and shoulder have two postures each
_GRID = 48
_FINE = 32
"""A pose that the grid does not solve is tried again on one so many times as fine."""


@borrowing
def _turn_into(m: FloatArray, q: float, out: FloatArray) -> None:
    """out = m Rz(q), for (3, 3)."""
    c = np.cos(q)
    s = np.sin(q)
    for i in range(3):
        x, y = m[i, 0], m[i, 1]
        out[i, 0] = x * c + y * s
        out[i, 1] = y * c - x * s
        out[i, 2] = m[i, 2]


@borrowing
def _product_into(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@borrowing
def _normal_into(m: FloatArray) -> None:
    """The third column of (3, 3) becomes the cross product of the others."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        m[i, 2] = m[j, 0] * m[k, 1] - m[k, 0] * m[j, 1]


@borrowing
def _two_angles(a: float, b: float, c: float) -> tuple[float, float]:
    """Both solutions of a cos(x) + b sin(x) = c; NaN if there is none."""
    size = np.hypot(a, b)
    if size < 1e-12 or abs(c) > size * (1.0 + 1e-12):
        return np.nan, np.nan
    middle = np.arctan2(b, a)
    apart = np.arccos(min(1.0, max(-1.0, c / size)))
    return middle + apart, middle - apart


@borrowing
def _settled(q: FloatArray, lower: FloatArray, upper: FloatArray) -> bool:
    """Move the angles by full turns into the limits; False if one cannot be."""
    turn = 2.0 * np.pi
    for i in range(q.shape[0]):
        q[i] -= turn * np.floor((q[i] - lower[i]) / turn)  # the smallest one above the lower limit
        if not q[i] <= upper[i]:
            return False
    return True


class _Arm(NamedTuple):
    """The arm as the kernels see it."""

    joints: FloatArray
    """Shape (7, 3, 4)."""
    shoulder: FloatArray
    """Where axes 1 to 3 meet, in the base frame and in frame 3 [m], shape (2, 3)."""
    lower: FloatArray
    upper: FloatArray


class _Work(NamedTuple):
    """What the steps of a derivation leave to those that follow: rotations (3, 3) and vectors (3,).

    A frame has the name of the last joint that moves it; with that joint at zero it is the frame before it turns.
    """

    frame6: FloatArray
    """In the base frame, as the last joint leaves it (step 1)."""
    to_wrist: FloatArray
    """From shoulder to wrist in the base frame [m] (step 1)."""
    back: FloatArray
    """From elbow to shoulder in frame 3 [m] (step 2)."""
    across: FloatArray
    """Columns u, w, v in the base frame: along the line from shoulder to wrist, and two across it (step 3)."""
    elbow: FloatArray
    """Frame 4 in frame 3 (step 4)."""
    fifth: FloatArray
    """Frame 5 in frame 3, joint 5 at zero (step 4)."""
    local: FloatArray
    """Columns in frame 3: u, what axis 5 has across it, and the normal of both (step 4)."""
    world: FloatArray
    """The same in the base frame (step 6)."""
    frame3: FloatArray
    """In the base frame (step 6)."""
    frame4: FloatArray
    frame5: FloatArray
    """In the base frame, joint 5 at zero; then frame 6, joint 6 at zero (step 7)."""
    turned: FloatArray
    third: FloatArray
    """Frame 3 after joint 1, joint 3 at zero (step 8)."""
    inner: FloatArray
    """Frame 3 as joint 1 sees it (step 8)."""


@borrowing
def _wrist_into(pose: FloatArray, last: float, arm: _Arm, work: _Work) -> float:
    """Step 1: with the last joint known, so are frame 6 and the wrist; returns the square of the way to it."""
    joints, frame6, to_wrist, turned = arm.joints, work.frame6, work.to_wrist, work.turned
    _turn_into(joints[6, :, :3], last, turned)
    for i in range(3):  # pose = frame6 . joint 7 . Rz(last)
        for j in range(3):
            frame6[i, j] = pose[i, 0] * turned[j, 0] + pose[i, 1] * turned[j, 1] + pose[i, 2] * turned[j, 2]
    for i in range(3):
        wrist = pose[i, 3]
        for j in range(3):
            wrist -= frame6[i, j] * joints[6, j, 3]
        to_wrist[i] = wrist - arm.shoulder[0, i]
    square: float = to_wrist[0] ** 2 + to_wrist[1] ** 2 + to_wrist[2] ** 2
    return square


@borrowing
def _elbows(square: float, arm: _Arm, work: _Work) -> tuple[float, float]:
    """Step 2: the way from shoulder to wrist is as long as the elbow makes it, by the law of cosines; NaN for none.

    In frame 3 it is the way back from the elbow to the shoulder, and that ahead to the wrist, turned by joint 4.
    """
    back, ahead = work.back, arm.joints[4, :, 3]
    for i in range(3):
        back[i] = arm.shoulder[1, i] - arm.joints[3, i, 3]
    m4 = arm.joints[3, :, :3]
    bx = m4[0, 0] * back[0] + m4[1, 0] * back[1] + m4[2, 0] * back[2]
    by = m4[0, 1] * back[0] + m4[1, 1] * back[1] + m4[2, 1] * back[2]
    bz = m4[0, 2] * back[0] + m4[1, 2] * back[1] + m4[2, 2] * back[2]
    a = bx * ahead[0] + by * ahead[1]
    b = by * ahead[0] - bx * ahead[1]
    both = back[0] ** 2 + back[1] ** 2 + back[2] ** 2 + ahead[0] ** 2 + ahead[1] ** 2 + ahead[2] ** 2
    return _two_angles(a, b, 0.5 * (both - square) - bz * ahead[2])


@borrowing
def _across_into(length: float, work: _Work) -> None:
    """Step 3: two axes across the line from shoulder to wrist."""
    across, to_wrist = work.across, work.to_wrist
    u, w, v = across[:, 0], across[:, 1], across[:, 2]
    least = 0
    for i in range(3):
        u[i] = to_wrist[i] / length
        if abs(u[i]) < abs(u[least]):
            least = i
    size = np.sqrt(1.0 - u[least] ** 2)
    for i in range(3):
        w[i] = ((1.0 if i == least else 0.0) - u[least] * u[i]) / size
    v[0] = u[1] * w[2] - u[2] * w[1]
    v[1] = u[2] * w[0] - u[0] * w[2]
    v[2] = u[0] * w[1] - u[1] * w[0]


@borrowing
def _triangle_into(elbow: float, length: float, arm: _Arm, work: _Work) -> tuple[float, float]:
    """Step 4: the triangle of shoulder, elbow and wrist in frame 3; the parts of axis 5 along u and across it."""
    local, frame, back, ahead = work.local, work.elbow, work.back, arm.joints[4, :, 3]
    _turn_into(arm.joints[3, :, :3], elbow, frame)
    _product_into(frame, arm.joints[4, :, :3], work.fifth)
    across5 = 0.0
    along5 = 0.0
    for i in range(3):
        local[i, 0] = (frame[i, 0] * ahead[0] + frame[i, 1] * ahead[1] + frame[i, 2] * ahead[2] - back[i]) / length
        along5 += local[i, 0] * work.fifth[i, 2]
    for i in range(3):
        local[i, 1] = work.fifth[i, 2] - along5 * local[i, 0]
        across5 += local[i, 1] ** 2
    across5 = np.sqrt(across5)
    if across5 < _STRETCHED:
        return along5, across5
    for i in range(3):
        local[i, 1] /= across5
    _normal_into(local)
    return along5, across5


@borrowing
def _planes(along5: float, across5: float, arm: _Arm, work: _Work) -> tuple[float, float]:
    """Step 5: the plane of the arm turns about u by x until axes 5 and 6 have their fixed angle; NaN for none.

    Axis 5 is along5 u + across5 (w cos(x) + v sin(x)), and its product with axis 6 the cosine of that angle.
    """
    across, frame6 = work.across, work.frame6
    z6u = across[0, 0] * frame6[0, 2] + across[1, 0] * frame6[1, 2] + across[2, 0] * frame6[2, 2]
    z6w = across[0, 1] * frame6[0, 2] + across[1, 1] * frame6[1, 2] + across[2, 1] * frame6[2, 2]
    z6v = across[0, 2] * frame6[0, 2] + across[1, 2] * frame6[1, 2] + across[2, 2] * frame6[2, 2]
    between = arm.joints[5, 2, 2]
    return _two_angles(across5 * z6w, across5 * z6v, between - along5 * z6u)


@borrowing
def _plane_into(plane: float, work: _Work) -> None:
    """Step 6: the triangle's axes in the base frame, and with them frame 3 = world . local^T."""
    world, local, across, frame3 = work.world, work.local, work.across, work.frame3
    c = np.cos(plane)
    s = np.sin(plane)
    for i in range(3):
        world[i, 0] = across[i, 0]
        world[i, 1] = c * across[i, 1] + s * across[i, 2]
    _normal_into(world)
    for i in range(3):
        for j in range(3):
            frame3[i, j] = world[i, 0] * local[j, 0] + world[i, 1] * local[j, 1] + world[i, 2] * local[j, 2]


@borrowing
def _wrist_angles(arm: _Arm, work: _Work) -> tuple[float, float]:
    """Step 7: joints 5 and 6 lead from frame 4 to frame 6; axis 6 says the one, the x axis the other."""
    joints, frame6, frame5 = arm.joints, work.frame6, work.frame5
    _product_into(work.frame3, work.elbow, work.frame4)
    _product_into(work.frame4, joints[4, :, :3], frame5)
    # Axis 6 in frame 5 before its turn is Rz(q5) times axis 6 after it.
    x = frame5[0, 0] * frame6[0, 2] + frame5[1, 0] * frame6[1, 2] + frame5[2, 0] * frame6[2, 2]
    y = frame5[0, 1] * frame6[0, 2] + frame5[1, 1] * frame6[1, 2] + frame5[2, 1] * frame6[2, 2]
    q5 = np.arctan2(y, x) - np.arctan2(joints[5, 1, 2], joints[5, 0, 2])
    _turn_into(frame5, q5, work.turned)
    _product_into(work.turned, joints[5, :, :3], frame5)
    x = frame5[0, 0] * frame6[0, 0] + frame5[1, 0] * frame6[1, 0] + frame5[2, 0] * frame6[2, 0]
    y = frame5[0, 1] * frame6[0, 0] + frame5[1, 1] * frame6[1, 0] + frame5[2, 1] * frame6[2, 0]
    return q5, np.arctan2(y, x)


@borrowing
def _shoulder(arm: _Arm, work: _Work, q: FloatArray, second: float) -> bool:
    """Step 8: the first three joints make frame 3; fills the first and third of q (7,), with the second known."""
    joints, inner, third = arm.joints, work.inner, work.third
    _turn_into(joints[1, :, :3], second, work.turned)
    _product_into(work.turned, joints[2, :, :3], third)
    q1 = np.arctan2(inner[1, 2], inner[0, 2]) - np.arctan2(third[1, 2], third[0, 2])
    # What is left after joints 1 and 2 is joint 3.
    c = np.cos(q1)
    s = np.sin(q1)
    x = 0.0
    y = 0.0
    for i in range(3):
        if i == 0:
            first = inner[0, 0] * c + inner[1, 0] * s
        elif i == 1:
            first = inner[1, 0] * c - inner[0, 0] * s
        else:
            first = inner[2, 0]
        x += third[i, 0] * first
        y += third[i, 1] * first
    q[0], q[1], q[2] = q1, second, np.arctan2(y, x)
    return _settled(q, arm.lower, arm.upper)


@borrowing
def _shoulders_into(arm: _Arm, work: _Work, q4: float, q5: float, q6: float, q7: float, out: FloatArray, n: int) -> int:
    """Step 8: append the two postures of the first three joints, if inside the limits; returns their new number.

    Joint 2 tilts axis 3 to where frame 3 has it.
    """
    joints, inner, frame3 = arm.joints, work.inner, work.frame3
    for i in range(3):  # inner = (rotation before joint 1)^T . frame 3
        for j in range(3):
            inner[i, j] = (
                joints[0, 0, i] * frame3[0, j] + joints[0, 1, i] * frame3[1, j] + joints[0, 2, i] * frame3[2, j]
            )
    p = joints[1, 2]  # m2^T z
    r = joints[2, :, 2]  # m3 z
    for q2 in _two_angles(p[0] * r[0] + p[1] * r[1], p[1] * r[0] - p[0] * r[1], inner[2, 2] - p[2] * r[2]):
        if np.isnan(q2):
            return n
        q = out[n]
        q[3], q[4], q[5], q[6] = q4, q5, q6, q7
        if _shoulder(arm, work, q, q2):
            n += 1
    return n


@borrowing
def _at_last(pose: FloatArray, last: float, arm: _Arm, work: _Work, out: FloatArray, n: int) -> int:
    """Append all solutions with the last joint at a given angle to `out`; returns their new number."""
    square = _wrist_into(pose, last, arm, work)
    length = np.sqrt(square)
    if length < _MEET:
        return n
    elbows = _elbows(square, arm, work)
    if np.isnan(elbows[0]):
        return n
    _across_into(length, work)
    for elbow in elbows:
        if elbow - 2.0 * np.pi * np.floor((elbow - arm.lower[3]) / (2.0 * np.pi)) > arm.upper[3]:
            continue
        along5, across5 = _triangle_into(elbow, length, arm, work)
        if across5 < _STRETCHED:
            continue
        planes = _planes(along5, across5, arm, work)
        if np.isnan(planes[0]):
            continue
        for plane in planes:
            _plane_into(plane, work)
            q5, q6 = _wrist_angles(arm, work)
            n = _shoulders_into(arm, work, elbow, q5, q6, last, out, n)
    return n


@kernel
def _solutions(arm: _Arm, pose: FloatArray, lasts: FloatArray, out: FloatArray) -> int:
    """Fill `out` with the solutions at all angles of the last joint; returns their number."""
    rotations = np.empty((12, 3, 3))
    vectors = np.empty((2, 3))
    work = _Work(
        rotations[0],
        vectors[0],
        vectors[1],
        rotations[1],
        rotations[2],
        rotations[3],
        rotations[4],
        rotations[5],
        rotations[6],
        rotations[7],
        rotations[8],
        rotations[9],
        rotations[10],
        rotations[11],
    )
    n = 0
    for k in range(lasts.shape[0]):
        if n + _MOST >= out.shape[0]:
            break
        n = _at_last(pose, lasts[k], arm, work, out, n)
    return n


@dataclass(frozen=True, kw_only=True, eq=False)
class OffsetGeometry(SevenJointArm):
    """A 7-joint arm with a spherical shoulder whose axes 5 and 6 meet; elbow and last joint may be offset.

    The redundancy is the last joint: with it known, there are up to eight solutions; see above.
    """

    shoulder: FloatArray
    """Kernel input: where axes 1 to 3 meet, in the base frame and in frame 3 [m], shape (2, 3)."""

    @classmethod
    def from_joints(cls, base_from_joint: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike) -> OffsetGeometry:
        """Read the geometry off the joint transforms and check it.

        Args:
            base_from_joint: Fixed transform before each joint's rotation about its own z, shape (7, 4, 4).
            lower: Lower joint limits [rad], shape (7,).
            upper: Upper joint limits [rad], shape (7,).

        Returns:
            The geometry.

        Raises:
            PlanningError: Not 7 joints, or the axes do not meet as they must.
        """
        arm = seven_joint_arm("OffsetGeometry", base_from_joint, lower, upper)
        transforms, low, high = arm.base_from_joint, arm.lower, arm.upper
        zero = link_frames(transforms, np.zeros(N_JOINTS))
        meet = _meeting_point(zero[1:4])
        wrist = _meeting_point(zero[5:7])
        if np.linalg.norm(wrist - zero[6, :3, 3]) > _MEET_M or np.linalg.norm(wrist - zero[5, :3, 3]) > _MEET_M:
            raise PlanningError("OffsetGeometry: the origins of joints 5 and 6 must lie where their axes meet")
        in_third = zero[3, :3, :3].T @ (meet - zero[3, :3, 3])
        if np.hypot(in_third[0], in_third[1]) > _MEET_M:
            raise PlanningError("OffsetGeometry: axes 1 to 3 must meet in one point")
        geometry = cls(**vars(arm), shoulder=np.stack([meet, in_third]))
        for q in np.random.default_rng(0).uniform(low, high, (4, N_JOINTS)):
            again = geometry.at_last_joint(geometry.flange(q), q[-1])
            if len(again) == 0 or np.abs(again - q).max(axis=1).min() > FIT_TOLERANCE:
                raise PlanningError("OffsetGeometry: the arm is not of this kind: a solution does not lead back")
        return geometry

    def at_last_joint(self, base_from_flange: npt.ArrayLike, q7_rad: float) -> FloatArray:
        """All solutions inside the limits with the last joint at an angle.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            q7_rad: Angle of the last joint [rad].

        Returns:
            Solutions [rad], shape (m, 7), 0 <= m <= 8.
        """
        return self._solve(base_from_flange, checks.vector("q7_rad", [q7_rad], 1))

    def ik_all(self, base_from_flange: npt.ArrayLike, n_last: int = _GRID) -> FloatArray:
        """All solutions inside the joint limits on a regular grid of the last joint.

        If the grid finds none, one that is 32 times as fine is tried.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            n_last: Angles of the last joint over its range, >= 1; times 8 branches are tried.

        Returns:
            Solutions [rad], shape (m, 7), m >= 0, ordered by the last joint.

        Raises:
            PlanningError: No pose, or no such number of angles.
        """
        checks.whole("ik_all: n_last", n_last, 1, _MOST_LASTS)
        found = self._solve(base_from_flange, self._grid(n_last))
        return found if len(found) else self._solve(base_from_flange, self._grid(n_last * _FINE))

    def _grid(self, n: int) -> FloatArray:
        grid: FloatArray = self.lower[-1] + (self.upper[-1] - self.lower[-1]) * (np.arange(n) + 0.5) / n
        return grid

    def _solve(self, base_from_flange: npt.ArrayLike, lasts: FloatArray) -> FloatArray:
        pose = checks.rigid("base_from_flange", base_from_flange)
        out = np.empty((_MOST * (min(len(lasts), 4 * _GRID) + 1), N_JOINTS))
        arm = _Arm(joints=self.joints, shoulder=self.shoulder, lower=self.lower, upper=self.upper)
        n = _solutions(arm, pose, lasts, out)
        return out[:n]


def _meeting_point(frames: FloatArray) -> FloatArray:
    """The point nearest to the z axes of some frames (k, 4, 4), by least squares."""
    axis, origin = frames[:, :3, 2], frames[:, :3, 3]
    across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    point: FloatArray = np.linalg.lstsq(across.reshape(-1, 3), np.einsum("kij,kj->ki", across, origin).ravel())[0]
    return point
