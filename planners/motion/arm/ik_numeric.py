"""Inverse kinematics of any serial arm by damped least squares with restarts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.kinematics import jacobian_into, joint_rows, last_link_pose, link_frames_into
from planners.motion.arrays import Chance, FloatArray
from planners.motion.chance import uniform
from planners.motion.kernel import borrowing, kernel

POSITION_M = 1e-6
"""A solution is this near to the wanted point [m] ..."""
TURN_RAD = 1e-5
"""... and to the wanted orientation [rad]."""
_STEPS = 60
_MOST_WANTED = 100_000
_MOST_SEED = 2**63
_SLOW = 12  # steps after which an attempt that is still far is given up
_FAR = 0.05
_METRE_PER_RAD = 0.3  # weight of orientation against position: an arm's typical lever
_SAME_RAD = 0.05


class _Arm(NamedTuple):
    """The arm as the kernels see it."""

    joints: FloatArray
    """Shape (n, 3, 4)."""
    lower: FloatArray
    upper: FloatArray


class _Work(NamedTuple):
    """Memory of a descent; what it holds is said where it is filled."""

    frames: FloatArray
    """Shape (n+1, 3, 4)."""
    jacobian: FloatArray
    """Shape (6, n)."""
    error: FloatArray
    """Shape (6,)."""
    matrix: FloatArray
    """Shape (6, 6)."""
    solved: FloatArray
    """Shape (6,)."""
    step: FloatArray
    """Change of the joints, shape (n,)."""


@borrowing
def _error_into(
    joints: FloatArray, q: FloatArray, pose: FloatArray, frames: FloatArray, error: FloatArray
) -> tuple[float, float]:
    """Position error [m] and rotation error times the lever [m], base frame; returns both sizes, in m and rad."""
    link_frames_into(joints, q, frames)
    tip = frames[q.shape[0]]
    far = 0.0
    for i in range(3):
        error[i] = pose[i, 3] - tip[i, 3]
        far += error[i] * error[i]
    # Rotation vector of pose . tip^T.
    trace = 0.0
    x = 0.0
    y = 0.0
    z = 0.0
    for k in range(3):
        trace += pose[0, k] * tip[0, k] + pose[1, k] * tip[1, k] + pose[2, k] * tip[2, k]
        x += pose[2, k] * tip[1, k] - pose[1, k] * tip[2, k]
        y += pose[0, k] * tip[2, k] - pose[2, k] * tip[0, k]
        z += pose[1, k] * tip[0, k] - pose[0, k] * tip[1, k]
    sine = np.sqrt(x * x + y * y + z * z)  # twice the sine
    angle = np.arctan2(sine, trace - 1.0)
    scale = angle / sine if sine > 1e-9 else 0.5
    if sine <= 1e-9 and trace < 0.0:
        x, y, z, scale = np.pi, 0.0, 0.0, 1.0  # half a turn: any axis leads away from it
    error[3] = x * scale * _METRE_PER_RAD
    error[4] = y * scale * _METRE_PER_RAD
    error[5] = z * scale * _METRE_PER_RAD
    return np.sqrt(far), angle


@borrowing
def _solve_into(h: FloatArray, g: FloatArray, x: FloatArray) -> None:
    """x = h^-1 g by Cholesky, for a symmetric positive definite h, which is overwritten."""
    n = g.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = h[i, j]
            for k in range(j):
                total -= h[i, k] * h[j, k]
            if i == j:
                h[i, i] = np.sqrt(total)
            else:
                h[i, j] = total / h[j, j]
    for i in range(n):
        total = g[i]
        for k in range(i):
            total -= h[i, k] * x[k]
        x[i] = total / h[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= h[k, i] * x[k]
        x[i] = total / h[i, i]


@borrowing
def _descend(arm: _Arm, pose: FloatArray, q: FloatArray, work: _Work) -> bool:
    """Improve q until it reaches the pose; whether it does. Joints that want to leave their limits stay at them."""
    lower, upper = arm.lower, arm.upper
    frames, jacobian, error = work.frames, work.jacobian, work.error
    h, y, x = work.matrix, work.solved, work.step
    n = q.shape[0]
    for step in range(_STEPS):
        far, angle = _error_into(arm.joints, q, pose, frames, error)
        if far <= POSITION_M and angle <= TURN_RAD:
            return True
        square = 0.0
        for i in range(6):
            square += error[i] * error[i]
        if step == _SLOW and square > _FAR * _FAR:
            return False
        jacobian_into(frames, jacobian)
        for i in range(n):
            for a in range(3, 6):
                jacobian[a, i] *= _METRE_PER_RAD
            push = 0.0
            for a in range(6):
                push += jacobian[a, i] * error[a]
            if (q[i] >= upper[i] and push > 0.0) or (q[i] <= lower[i] and push < 0.0):
                for a in range(6):
                    jacobian[a, i] = 0.0
        # dq = J^T (J J^T + damping)^-1 e: a 6 x 6 system whatever the number of joints.
        for a in range(6):
            for b in range(a + 1):
                total = 0.0
                for i in range(n):
                    total += jacobian[a, i] * jacobian[b, i]
                h[a, b] = total
            h[a, a] += 0.5 * square + 1e-9
        _solve_into(h, error, y)
        largest = 0.0
        for i in range(n):
            x[i] = 0.0
            for a in range(6):
                x[i] += jacobian[a, i] * y[a]
            largest = max(largest, abs(x[i]))
        part = 1.0 if largest < 1.0 else 1.0 / largest
        for i in range(n):
            q[i] = min(upper[i], max(lower[i], q[i] + part * x[i]))
    return False


@kernel
def _solutions(
    arm: _Arm, pose: FloatArray, seeds: FloatArray, n_wanted: int, n_starts: int, random: Chance, out: FloatArray
) -> tuple[int, int]:
    """Descend from the seeds, then from random starts, until enough solutions differ; returns solutions and starts."""
    lower, upper = arm.lower, arm.upper
    n_joints = lower.shape[0]
    work = _Work(
        np.empty((n_joints + 1, 3, 4)),
        np.empty((6, n_joints)),
        np.empty(6),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(n_joints),
    )
    q = np.empty(n_joints)
    n = 0
    for start in range(n_starts):
        for i in range(n_joints):
            if start < seeds.shape[0]:
                q[i] = min(upper[i], max(lower[i], seeds[start, i]))
            else:
                q[i] = lower[i] + (upper[i] - lower[i]) * uniform(random)
        if not _descend(arm, pose, q, work):
            continue
        new = True
        for k in range(n):
            apart = 0.0
            for i in range(n_joints):
                apart = max(apart, abs(out[k, i] - q[i]))
            new = new and apart > _SAME_RAD
        if new:
            for i in range(n_joints):
                out[n, i] = q[i]
            n += 1
            if n == n_wanted:
                return n, start + 1
    return n, n_starts


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericInverse:
    """Inverse kinematics of any arm of revolute joints; solutions respect the limits, but not all may be found.

    Source: damping by the squared error after Sugihara, Solvability-unconcerned inverse kinematics by the
    Levenberg-Marquardt method, IEEE T-RO 2011; random restarts.
    """

    base_from_joint: FloatArray
    """Joint transforms, shape (n, 4, 4)."""
    lower: FloatArray
    """Lower joint limits [rad], shape (n,)."""
    upper: FloatArray
    """Upper joint limits [rad], shape (n,)."""
    joints: FloatArray
    """Kernel input: upper three rows of the joint transforms, shape (n, 3, 4)."""
    n_starts: int = 200
    """Descents before a pose is given up."""

    @classmethod
    def from_joints(cls, base_from_joint: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike) -> NumericInverse:
        """An arm from its joint transforms.

        Args:
            base_from_joint: Fixed transform before each joint's rotation about its own z, shape (n, 4, 4).
            lower: Lower joint limits [rad], shape (n,).
            upper: Upper joint limits [rad], shape (n,).

        Returns:
            The solver.

        Raises:
            PlanningError: Shapes do not fit, or a limit is not finite.
        """
        rows = joint_rows(base_from_joint)
        low, high = checks.limits("NumericInverse", lower, upper)
        if low.shape != (len(rows),) or high.shape != (len(rows),) or not np.all(np.isfinite(high - low)):
            raise PlanningError(
                f"NumericInverse: {len(rows)} joints, limits {low.shape} and {high.shape}; valid: as many, finite"
            )
        return cls(base_from_joint=np.array(base_from_joint, dtype=np.float64), lower=low, upper=high, joints=rows)

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link in the base frame for one configuration (n,), shape (4, 4)."""
        return last_link_pose(self.joints, q)

    def ik_near(self, base_from_flange: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray | None:
        """The solution that descent from a configuration leads to, without a restart.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            q: Where to start [rad], shape (n,).

        Returns:
            Solution [rad], shape (n,); None if descent ends elsewhere.

        Raises:
            PlanningError: No pose, or no configuration.
        """
        found = self._solve(base_from_flange, checks.vector("q", q, len(self.lower))[None], 1, 1, 0)
        return found[0] if len(found) else None

    def ik_all(self, base_from_flange: npt.ArrayLike, n_wanted: int = 1, seed: int = 0) -> FloatArray:
        """Different solutions inside the joint limits.

        Args:
            base_from_flange: Wanted pose of the last link frame, shape (4, 4).
            n_wanted: Solutions after which to stop, >= 1; they differ by more than 0.05 rad in a joint.
            seed: Seed of the restarts.

        Returns:
            Solutions [rad], shape (m, n), 0 <= m <= n_wanted, in the order they were found.

        Raises:
            PlanningError: No pose, or a number out of range.
        """
        checks.whole("ik_all: n_wanted", n_wanted, 1, _MOST_WANTED)
        checks.whole("ik_all: seed", seed, 0, _MOST_SEED)
        middle = (0.5 * (self.lower + self.upper))[None]
        return self._solve(base_from_flange, middle, n_wanted, self.n_starts, seed)

    def _solve(
        self, base_from_flange: npt.ArrayLike, seeds: FloatArray, n_wanted: int, n_starts: int, seed: int
    ) -> FloatArray:
        pose = checks.rigid("base_from_flange", base_from_flange)
        out = np.empty((n_wanted, len(self.lower)))
        random = np.array([seed], dtype=np.uint64)
        arm = _Arm(joints=self.joints, lower=self.lower, upper=self.upper)
        n, _ = _solutions(arm, pose, seeds, n_wanted, n_starts, random, out)
        return out[:n]
