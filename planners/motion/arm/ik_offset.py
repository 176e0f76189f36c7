"""Closed-form inverse kinematics of 7-joint arms with an offset elbow and an offset last joint, such as the Panda."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.kinematics import joint_rows, last_link_pose, link_frames
from planners.motion.arrays import FloatArray

_N_JOINTS = 7
_MOST_LASTS = 100_000
_MEET_M = 1e-6
_FIT_TOLERANCE = 1e-6
_MOST = 8  # solutions at one value of the last joint: elbow, arm plane and shoulder have two postures each
_GRID = 48
_FINE = 32
"""A pose that the grid does not solve is tried again on one so many times as fine."""


@njit(cache=True)
def _turn_into(m, q, out):  # type: ignore[no-untyped-def]
    """out = m Rz(q), for (3, 3)."""
    c = np.cos(q)
    s = np.sin(q)
    for i in range(3):
        x, y = m[i, 0], m[i, 1]
        out[i, 0] = x * c + y * s
        out[i, 1] = y * c - x * s
        out[i, 2] = m[i, 2]


@njit(cache=True)
def _product_into(a, b, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def _two_angles(a, b, c):  # type: ignore[no-untyped-def]
    """Both solutions of a cos(x) + b sin(x) = c; NaN if there is none."""
    size = np.hypot(a, b)
    if size < 1e-12 or abs(c) > size * (1.0 + 1e-12):
        return np.nan, np.nan
    middle = np.arctan2(b, a)
    apart = np.arccos(min(1.0, max(-1.0, c / size)))
    return middle + apart, middle - apart


@njit(cache=True)
def _settled(q, lower, upper):  # type: ignore[no-untyped-def]
    """Move the angles by full turns into the limits; False if one cannot be."""
    turn = 2.0 * np.pi
    for i in range(q.shape[0]):
        q[i] -= turn * np.floor((q[i] - lower[i]) / turn)  # the smallest one above the lower limit
        if not q[i] <= upper[i]:
            return False
    return True


@njit(cache=True)
def _at_last(pose, last, joints, shoulder, lower, upper, work, out, n):  # type: ignore[no-untyped-def]  # noqa: PLR0912 - one derivation
    """Append all solutions with the last joint at a given angle to `out`; returns their new number.

    With the last joint known, so are axis 6 and the wrist W where it meets axis 5. |SW| gives the elbow joint; the
    plane of the arm turns about SW until axes 5 and 6 have their fixed angle; the first three joints make that plane.
    """
    turned, frame6, elbow_frame, axis5, frame3 = work[0], work[1], work[2], work[3], work[4]
    frame4, frame5, local, world = work[5], work[6], work[7], work[8]
    to_wrist, u, w, v, back = work[9, 0], work[9, 1], work[9, 2], work[10, 0], work[10, 1]
    _turn_into(joints[6, :, :3], last, turned)
    for i in range(3):  # pose = frame6 . joint 7 . Rz(last)
        for j in range(3):
            frame6[i, j] = pose[i, 0] * turned[j, 0] + pose[i, 1] * turned[j, 1] + pose[i, 2] * turned[j, 2]
    for i in range(3):
        wrist = pose[i, 3]
        for j in range(3):
            wrist -= frame6[i, j] * joints[6, j, 3]
        to_wrist[i] = wrist - shoulder[0, i]
    square = to_wrist[0] ** 2 + to_wrist[1] ** 2 + to_wrist[2] ** 2
    length = np.sqrt(square)
    if length < 1e-9:
        return n
    # In frame 3, from elbow to shoulder and, turned by joint 4, to the wrist.
    for i in range(3):
        back[i] = shoulder[1, i] - joints[3, i, 3]
    ahead = joints[4, :, 3]
    m4 = joints[3, :, :3]
    bx = m4[0, 0] * back[0] + m4[1, 0] * back[1] + m4[2, 0] * back[2]
    by = m4[0, 1] * back[0] + m4[1, 1] * back[1] + m4[2, 1] * back[2]
    bz = m4[0, 2] * back[0] + m4[1, 2] * back[1] + m4[2, 2] * back[2]
    a = bx * ahead[0] + by * ahead[1]
    b = by * ahead[0] - bx * ahead[1]
    both = back[0] ** 2 + back[1] ** 2 + back[2] ** 2 + ahead[0] ** 2 + ahead[1] ** 2 + ahead[2] ** 2
    elbows = _two_angles(a, b, 0.5 * (both - square) - bz * ahead[2])
    if np.isnan(elbows[0]):
        return n
    # Two axes across the line from shoulder to wrist.
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
    z6u = u[0] * frame6[0, 2] + u[1] * frame6[1, 2] + u[2] * frame6[2, 2]
    z6w = w[0] * frame6[0, 2] + w[1] * frame6[1, 2] + w[2] * frame6[2, 2]
    z6v = v[0] * frame6[0, 2] + v[1] * frame6[1, 2] + v[2] * frame6[2, 2]
    between = joints[5, 2, 2]  # cosine between axes 5 and 6
    for elbow in elbows:
        if elbow - 2.0 * np.pi * np.floor((elbow - lower[3]) / (2.0 * np.pi)) > upper[3]:
            continue
        _turn_into(m4, elbow, elbow_frame)
        _product_into(elbow_frame, joints[4, :, :3], axis5)  # frame 5 at q5 = 0, in frame 3
        # The triangle in frame 3: along the way to the wrist, axis 5's part across it, and the normal.
        cross_length = 0.0
        along5 = 0.0
        for i in range(3):
            local[i, 0] = (
                elbow_frame[i, 0] * ahead[0] + elbow_frame[i, 1] * ahead[1] + elbow_frame[i, 2] * ahead[2] - back[i]
            ) / length
            along5 += local[i, 0] * axis5[i, 2]
        for i in range(3):
            local[i, 1] = axis5[i, 2] - along5 * local[i, 0]
            cross_length += local[i, 1] ** 2
        cross_length = np.sqrt(cross_length)
        if cross_length < 1e-9:
            continue  # axis 5 along the line of sight: the arm is stretched, the plane is free
        for i in range(3):
            local[i, 1] /= cross_length
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            local[i, 2] = local[j, 0] * local[k, 1] - local[k, 0] * local[j, 1]
        # The same axes in the base frame: the first is u, the second w cos(x) + v sin(x).
        planes = _two_angles(cross_length * z6w, cross_length * z6v, between - along5 * z6u)
        if np.isnan(planes[0]):
            continue
        for plane in planes:
            c = np.cos(plane)
            s = np.sin(plane)
            for i in range(3):
                world[i, 0] = u[i]
                world[i, 1] = c * w[i] + s * v[i]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                world[i, 2] = world[j, 0] * world[k, 1] - world[k, 0] * world[j, 1]
            for i in range(3):  # frame3 = world . local^T
                for j in range(3):
                    frame3[i, j] = world[i, 0] * local[j, 0] + world[i, 1] * local[j, 1] + world[i, 2] * local[j, 2]
            _product_into(frame3, elbow_frame, frame4)
            _product_into(frame4, joints[4, :, :3], frame5)
            # Axis 6 in frame 5 before its turn is Rz(q5) times axis 6 after it.
            x = frame5[0, 0] * frame6[0, 2] + frame5[1, 0] * frame6[1, 2] + frame5[2, 0] * frame6[2, 2]
            y = frame5[0, 1] * frame6[0, 2] + frame5[1, 1] * frame6[1, 2] + frame5[2, 1] * frame6[2, 2]
            q5 = np.arctan2(y, x) - np.arctan2(joints[5, 1, 2], joints[5, 0, 2])
            _turn_into(frame5, q5, turned)
            _product_into(turned, joints[5, :, :3], frame5)  # frame 6 at q6 = 0
            x = frame5[0, 0] * frame6[0, 0] + frame5[1, 0] * frame6[1, 0] + frame5[2, 0] * frame6[2, 0]
            y = frame5[0, 1] * frame6[0, 0] + frame5[1, 1] * frame6[1, 0] + frame5[2, 1] * frame6[2, 0]
            q6 = np.arctan2(y, x)
            n = _shoulder(frame3, joints, elbow, q5, q6, last, lower, upper, work, out, n)
    return n


@njit(cache=True)
def _shoulder(frame3, joints, q4, q5, q6, q7, lower, upper, work, out, n):  # type: ignore[no-untyped-def]
    """Append the two postures of the first three joints that make a rotation, if inside the limits."""
    g, turned, third = work[11], work[12], work[13]
    for i in range(3):  # g = (rotation before joint 1)^T . frame 3
        for j in range(3):
            g[i, j] = joints[0, 0, i] * frame3[0, j] + joints[0, 1, i] * frame3[1, j] + joints[0, 2, i] * frame3[2, j]
    m2 = joints[1]
    m3 = joints[2]
    p = m2[2]  # m2^T z
    r = m3[:, 2]  # m3 z
    for q2 in _two_angles(p[0] * r[0] + p[1] * r[1], p[1] * r[0] - p[0] * r[1], g[2, 2] - p[2] * r[2]):
        if np.isnan(q2):
            return n
        _turn_into(m2[:, :3], q2, turned)
        _product_into(turned, m3[:, :3], third)
        q1 = np.arctan2(g[1, 2], g[0, 2]) - np.arctan2(third[1, 2], third[0, 2])
        # What is left of g after joints 1 and 2 is joint 3.
        c = np.cos(q1)
        s = np.sin(q1)
        x = 0.0
        y = 0.0
        for i in range(3):
            first = g[0, 0] * c + g[1, 0] * s if i == 0 else (g[1, 0] * c - g[0, 0] * s if i == 1 else g[2, 0])
            x += third[i, 0] * first
            y += third[i, 1] * first
        q = out[n]
        q[0], q[1], q[2], q[3], q[4], q[5], q[6] = q1, q2, np.arctan2(y, x), q4, q5, q6, q7
        if _settled(q, lower, upper):
            n += 1
    return n


@njit(cache=True)
def _solutions(pose, lasts, joints, shoulder, lower, upper, out):  # type: ignore[no-untyped-def]
    n = 0
    work = np.empty((14, 3, 3))
    for k in range(lasts.shape[0]):
        if n + _MOST >= out.shape[0]:
            break
        n = _at_last(pose, lasts[k], joints, shoulder, lower, upper, work, out, n)
    return n


@dataclass(frozen=True, kw_only=True, eq=False)
class OffsetGeometry:
    """A 7-joint arm with a spherical shoulder whose axes 5 and 6 meet; elbow and last joint may be offset.

    The redundancy is the last joint: with it known, there are up to eight solutions.

    Source: He and Liu, Analytical inverse kinematics for Franka Emika Panda, ICMRA 2021; here from the joint
    transforms, for any arm of the kind, with the shoulder solved as three axes through a point.
    """

    base_from_joint: FloatArray
    """Joint transforms, shape (7, 4, 4)."""
    lower: FloatArray
    """Lower joint limits [rad], shape (7,)."""
    upper: FloatArray
    """Upper joint limits [rad], shape (7,)."""
    joints: FloatArray
    """Kernel input: upper three rows of the joint transforms, shape (7, 3, 4)."""
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
        transforms = np.array(base_from_joint, dtype=np.float64)
        rows = joint_rows(transforms)
        low, high = checks.limits("OffsetGeometry", lower, upper)
        if len(rows) != _N_JOINTS or low.shape != (_N_JOINTS,) or high.shape != (_N_JOINTS,):
            raise PlanningError(
                f"OffsetGeometry: {len(rows)} joints, limits {low.shape} and {high.shape}; expected {_N_JOINTS} of each"
            )
        zero = link_frames(transforms, np.zeros(_N_JOINTS))
        meet = _meeting_point(zero[1:4])
        wrist = _meeting_point(zero[5:7])
        if np.linalg.norm(wrist - zero[6, :3, 3]) > _MEET_M or np.linalg.norm(wrist - zero[5, :3, 3]) > _MEET_M:
            raise PlanningError("OffsetGeometry: the origins of joints 5 and 6 must lie where their axes meet")
        in_third = zero[3, :3, :3].T @ (meet - zero[3, :3, 3])
        if np.hypot(in_third[0], in_third[1]) > _MEET_M:
            raise PlanningError("OffsetGeometry: axes 1 to 3 must meet in one point")
        geometry = cls(
            base_from_joint=transforms, lower=low, upper=high, joints=rows, shoulder=np.stack([meet, in_third])
        )
        for q in np.random.default_rng(0).uniform(low, high, (4, _N_JOINTS)):
            again = geometry.at_last_joint(geometry.flange(q), q[-1])
            if len(again) == 0 or np.abs(again - q).max(axis=1).min() > _FIT_TOLERANCE:
                raise PlanningError("OffsetGeometry: the arm is not of this kind: a solution does not lead back")
        return geometry

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link in the base frame for one configuration (7,), shape (4, 4)."""
        return last_link_pose(self.joints, q)

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
        out = np.empty((_MOST * (min(len(lasts), 4 * _GRID) + 1), _N_JOINTS))
        n = _solutions(pose, lasts, self.joints, self.shoulder, self.lower, self.upper, out)
        return out[:n]


def _meeting_point(frames: FloatArray) -> FloatArray:
    """The point nearest to the z axes of some frames (k, 4, 4), by least squares."""
    axis, origin = frames[:, :3, 2], frames[:, :3, 3]
    across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    point: FloatArray = np.linalg.lstsq(across.reshape(-1, 3), np.einsum("kij,kj->ki", across, origin).ravel())[0]
    return point
