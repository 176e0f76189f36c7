"""Composite planning: two arms searched as one, for when no schedule of their own paths exists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planners.errors import PlanningError
from planners.motion.arrays import FloatArray, IntArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.kernel import kernel
from planners.motion.path.trajectory import Trajectory, retime
from planners.motion.problem import MotionResult
from planners.motion.status import MotionStatus
from planners.motion.two_arms.diagram import MARGIN_M, clearance
from planners.motion.two_arms.swept import ArmInWorld, place_spheres

_RANGE_RAD = 1.0  # longest tree edge
_FINEST = 1.0 / 4096  # a part of an edge below this that is still in doubt is refused
_SHORTCUTS = 60
_DEVIATIONS_RAD = (0.1, 0.03, 0.01)


class _Placed(NamedTuple):
    """An arm as the kernel sees it; what the arrays hold is said at `ArmInWorld`."""

    joints: FloatArray
    spheres: FloatArray
    parts: IntArray
    lever: FloatArray
    base: FloatArray
    """Upper three rows of the base's pose, shape (3, 4)."""
    points: FloatArray
    """Scratch memory for the centres of spheres, shape (s, 3)."""


@kernel
def _apart_between(
    qa: FloatArray, to_a: FloatArray, qb: FloatArray, to_b: FloatArray, arm_a: _Placed, arm_b: _Placed, margin: float
) -> bool:
    """Whether two arms keep their distance while both move straight in joint space; a 14-joint edge.

    The middle of an interval proves it free if the arms' distance there exceeds what both can move until its ends;
    otherwise it is halved.
    """
    joints_a, spheres_a, parts_a, lever_a, base_a, points_a = arm_a
    joints_b, spheres_b, parts_b, lever_b, base_b, points_b = arm_b
    way = 0.0
    for s in range(spheres_a.shape[0]):
        bound = 0.0
        for j in range(qa.shape[0]):
            bound += lever_a[s, j] * abs(to_a[j] - qa[j])
        way = max(way, bound)
    other = 0.0
    for s in range(spheres_b.shape[0]):
        bound = 0.0
        for j in range(qb.shape[0]):
            bound += lever_b[s, j] * abs(to_b[j] - qb[j])
        other = max(other, bound)
    way += other
    stack = np.empty((64, 2))
    stack[0, 0] = 0.0
    stack[0, 1] = 1.0
    top = 1
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        middle = 0.5 * (low + high)
        place_spheres(joints_a, spheres_a, base_a, qa + (to_a - qa) * middle, points_a)
        place_spheres(joints_b, spheres_b, base_b, qb + (to_b - qb) * middle, points_b)
        gap = clearance(points_a, spheres_a[:, 3], parts_a, points_b, spheres_b[:, 3], parts_b, margin)
        if gap < 0.0:
            return False
        if gap < way * 0.5 * (high - low):
            if high - low < _FINEST:
                return False
            stack[top, 0], stack[top, 1] = low, middle
            stack[top + 1, 0], stack[top + 1, 1] = middle, high
            top += 2
    return True


@dataclass(frozen=True, kw_only=True, eq=False)
class CompositeProblem:
    """Bring two arms from where they are to where they should be, both moving at once."""

    arms: tuple[ArmInWorld, ArmInWorld]
    checkers: tuple[CollisionChecker, CollisionChecker]
    """Each arm among its obstacles; what it holds must be the same as in `arms`."""
    start: FloatArray
    """Joint angles of the first arm, then of the second [rad], shape (n + m,)."""
    goal: FloatArray
    """Same shape."""
    seed: int = 0
    max_iterations: int = 5000
    margin_m: float = MARGIN_M

    def __post_init__(self) -> None:
        n = sum(arm.model.n_joints for arm in self.arms)
        if self.start.shape != (n,) or self.goal.shape != (n,):
            raise PlanningError(
                f"CompositeProblem: start {self.start.shape}, goal {self.goal.shape}; valid: ({n},) both"
            )
        if not (np.all(np.isfinite(self.start)) and np.all(np.isfinite(self.goal))):
            raise PlanningError(
                f"CompositeProblem: start {self.start.tolist()}, goal {self.goal.tolist()}; valid: finite numbers"
            )


class CompositePlanner:
    """RRT-Connect in the joint space of both arms.

    A last resort: it can only bring both to goals that do not exclude each other, and its paths bind the arms to each
    other all the way. Decoupled paths and a schedule come first.

    Source: Kuffner and LaValle, RRT-Connect, ICRA 2000; Sanchez and Latombe, On delaying collision checking in PRM
        planning: application to multi-robot coordination, IJRR 2002 (centralized planning is the more reliable one).
    """

    def plan(self, problem: CompositeProblem) -> MotionResult:
        """Find a path of both arms.

        Args:
            problem: The query.

        Returns:
            Path (k, n + m), status and iterations.
        """
        edges = _Edges(problem)
        nothing = np.empty((0, len(problem.start)))
        if not edges.state_free(problem.start):
            return MotionResult(path=nothing, status=MotionStatus.INVALID_START, iterations=0)
        if not edges.state_free(problem.goal):
            return MotionResult(path=nothing, status=MotionStatus.INVALID_GOAL, iterations=0)
        if edges.free(problem.start, problem.goal):
            path = np.stack([problem.start, problem.goal])
            return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=0)
        rng = np.random.default_rng(problem.seed)
        models = [arm.model for arm in problem.arms]
        lower, upper = np.concatenate([m.lower for m in models]), np.concatenate([m.upper for m in models])
        trees = [_Tree(problem.start), _Tree(problem.goal)]
        for iteration in range(problem.max_iterations):
            own, other = trees[iteration % 2], trees[1 - iteration % 2]
            new = own.extend(rng.uniform(lower, upper), edges)
            if new is None:
                continue
            node = own.nodes[new]
            while True:
                reached = other.extend(node, edges)
                if reached is None:
                    break
                if np.array_equal(other.nodes[reached], node):
                    own_way, other_way = own.way_to(new), other.way_to(reached)
                    forward = (own_way, other_way) if iteration % 2 == 0 else (other_way, own_way)
                    path = np.array(forward[0] + forward[1][::-1][1:])
                    path = _shortened(path, edges, rng)
                    return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=iteration + 1)
        return MotionResult(path=nothing, status=MotionStatus.NO_SOLUTION, iterations=problem.max_iterations)

    def timed(
        self,
        problem: CompositeProblem,
        path: FloatArray,
        max_velocity: FloatArray,
        max_acceleration: FloatArray,
        dt_s: float,
    ) -> tuple[Trajectory, Trajectory] | None:
        """Time a path of both arms, so that they stay in step.

        Args:
            problem: The query the path answers.
            path: Shape (k, n + m).
            max_velocity: Of the first arm's joints, then of the second's [rad/s], shape (n + m,).
            max_acceleration: The same [rad/s^2].
            dt_s: Sample period [s].

        Returns:
            One trajectory for each arm, of the same duration; None if every rounding of corners touches something.
        """
        edges = _Edges(problem)
        n = problem.arms[0].model.n_joints
        for deviation in _DEVIATIONS_RAD:
            both = retime(path, max_velocity, max_acceleration, dt_s, max_deviation_rad=deviation)
            if all(edges.free(a, b) for a, b in zip(both.q[:-1], both.q[1:], strict=True)):
                return (
                    Trajectory(t=both.t, q=both.q[:, :n].copy(), qd=both.qd[:, :n].copy()),
                    Trajectory(t=both.t, q=both.q[:, n:].copy(), qd=both.qd[:, n:].copy()),
                )
        return None


class _Edges:
    """Checks states and edges of both arms at once."""

    def __init__(self, problem: CompositeProblem) -> None:
        self._checkers = problem.checkers
        self._arms = [
            _Placed(
                joints=arm.joints,
                spheres=arm.spheres,
                parts=arm.parts,
                lever=arm.lever,
                base=np.ascontiguousarray(arm.world_from_base[:3]),
                points=np.empty((len(arm.spheres), 3)),
            )
            for arm in problem.arms
        ]
        self._n = problem.arms[0].model.n_joints
        self._margin = problem.margin_m

    def state_free(self, q: FloatArray) -> bool:
        """Limits, obstacles, each other."""
        parts = (q[: self._n], q[self._n :])
        return all(
            bool(c.model.within_limits(p)) and c.free(p) for c, p in zip(self._checkers, parts, strict=True)
        ) and self._apart(q, q)

    def free(self, a: FloatArray, b: FloatArray) -> bool:
        """Whether the straight motion of both is free; `a` itself is taken as free."""
        n = self._n
        first, second = self._checkers
        return first.edge(a[:n], b[:n]) and second.edge(a[n:], b[n:]) and self._apart(a, b)

    def _apart(self, a: FloatArray, b: FloatArray) -> bool:
        n = self._n
        return bool(_apart_between(a[:n], b[:n], a[n:], b[n:], self._arms[0], self._arms[1], self._margin))


class _Tree:
    """Nodes and their parents."""

    def __init__(self, root: FloatArray) -> None:
        self.nodes = [root]
        self._parent = [-1]

    def extend(self, towards: FloatArray, edges: _Edges) -> int | None:
        """One step from the nearest node; the new node's number, None if the step is not free."""
        gaps = np.linalg.norm(np.array(self.nodes) - towards, axis=1)
        near = int(np.argmin(gaps))
        if gaps[near] <= _RANGE_RAD:
            new = towards
        else:
            new = self.nodes[near] + (towards - self.nodes[near]) * (_RANGE_RAD / gaps[near])
        if not edges.free(self.nodes[near], new):
            return None
        self.nodes.append(new)
        self._parent.append(near)
        return len(self.nodes) - 1

    def way_to(self, node: int) -> list[FloatArray]:
        """Nodes from the root."""
        way = []
        while node >= 0:
            way.append(self.nodes[node])
            node = self._parent[node]
        return way[::-1]


def _shortened(path: FloatArray, edges: _Edges, rng: np.random.Generator) -> FloatArray:
    """Cut between random points of a path, as often as it helps."""
    corners: Sequence[FloatArray] = list(path)
    for _ in range(_SHORTCUTS):
        if len(corners) < 3:
            break
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(np.array(corners), axis=0), axis=1))])
        first, last = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (int(np.searchsorted(along, s, side="right")) - 1 for s in (first, last))
        if i == j or j + 1 >= len(corners):
            continue
        a = corners[i] + (corners[i + 1] - corners[i]) * ((first - along[i]) / (along[i + 1] - along[i]))
        b = corners[j] + (corners[j + 1] - corners[j]) * ((last - along[j]) / (along[j + 1] - along[j]))
        if edges.free(a, b) and edges.free(corners[i], a) and edges.free(b, corners[j + 1]):
            corners = [*corners[: i + 1], a, b, *corners[j + 1 :]]
    return np.array(corners)
