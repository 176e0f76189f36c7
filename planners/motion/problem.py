"""The words of arm motion planning: a problem, its result and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import FloatArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.scene_kernel import straight_goal
from planners.motion.status import MotionStatus

_MAX_SEED = 2**32 - 2
_MOST_ITERATIONS = 2**62


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProblem:
    """Find a free path from one configuration to any of several goals."""

    checker: CollisionChecker
    """Arm, obstacles and held parcel."""
    start: FloatArray
    """Start [rad], shape (n,)."""
    goals: FloatArray
    """Goals, any of which will do [rad], shape (k, n), k >= 1."""
    seed: int = 0
    """The same problem and seed give the same bytes, in any process."""
    max_iterations: int = 20000
    """Tree extensions a planner may try; the only budget."""

    def __post_init__(self) -> None:
        if not isinstance(self.checker, CollisionChecker):
            raise PlanningError(f"MotionProblem.checker: {self.checker!r}; valid: a CollisionChecker")
        checks.is_array("MotionProblem.start", self.start)
        checks.is_array("MotionProblem.goals", self.goals)
        n = self.checker.model.n_joints
        if self.start.shape != (n,) or self.goals.ndim != 2 or self.goals.shape[1:] != (n,) or len(self.goals) == 0:
            raise PlanningError(
                f"MotionProblem: start {self.start.shape}, goals {self.goals.shape}; valid: ({n},) and (k, {n}), k >= 1"
            )
        if not np.all(np.isfinite(self.start)) or not np.all(np.isfinite(self.goals)):
            raise PlanningError(
                f"MotionProblem: start {self.start.tolist()}, goals {self.goals.tolist()}; valid: finite numbers"
            )
        checks.whole("MotionProblem: seed", self.seed, 0, _MAX_SEED)
        checks.whole("MotionProblem: max_iterations", self.max_iterations, 0, _MOST_ITERATIONS)


def path_length(path: FloatArray) -> float:
    """Joint-space length of a piecewise straight path [rad]; its corners have shape (k, n)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionResult:
    """Outcome of a motion query."""

    path: FloatArray
    """Corners of a piecewise straight path from start to goal [rad], shape (k, n); (0, n) if not solved."""
    status: MotionStatus
    iterations: int
    """Tree extensions used; 0 when the straight line was free."""

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return self.status is MotionStatus.SOLVED

    @property
    def length_rad(self) -> float:
        """Joint-space length of the path [rad]."""
        return path_length(self.path)


class MotionPlanner(Protocol):
    """What every arm planner offers."""

    def plan(self, problem: MotionProblem) -> MotionResult:
        """Solve one problem; "no solution" is a status, not an error."""


def settle_early(problem: MotionProblem) -> tuple[MotionResult | None, FloatArray]:
    """What every planner does first: check both ends and try the straight lines.

    Args:
        problem: The query.

    Returns:
        A result if the query is settled (else None), and the valid goals, nearest first, shape (k, n).
    """
    model = problem.checker.model
    nothing = np.empty((0, model.n_joints))
    start = np.ascontiguousarray(problem.start, dtype=np.float64)
    goals = np.ascontiguousarray(problem.goals, dtype=np.float64)
    order, distance = np.empty(len(goals), dtype=np.int64), np.empty(len(goals))
    n, row = straight_goal(start, goals, model.lower, model.upper, problem.checker.scene, order, distance)
    if n <= 0:
        status = MotionStatus.INVALID_START if n < 0 else MotionStatus.INVALID_GOAL
        return MotionResult(path=nothing, status=status, iterations=0), nothing
    valid = goals[order[:n]]
    if row < 0:
        return None, valid
    path = np.empty((2, model.n_joints))
    path[0], path[1] = start, goals[row]
    return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=0), valid
