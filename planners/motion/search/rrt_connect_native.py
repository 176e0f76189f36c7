"""Arm planning by a compiled RRT-Connect: one call, no callbacks."""

from __future__ import annotations

import numpy as np

from planners.motion.arrays import Chance, FloatArray, Int, IntArray
from planners.motion.chance import uniform
from planners.motion.collision.scene_kernel import SceneArrays, edge_free
from planners.motion.kernel import kernel
from planners.motion.problem import MotionProblem, MotionResult, settle_early
from planners.motion.search.rrt_connect_config import RrtConnectConfig
from planners.motion.search.shortcut import shorten
from planners.motion.status import MotionStatus


@kernel
def _nearest(nodes: FloatArray, n: Int, q: FloatArray) -> tuple[int, float]:
    best = 0
    least = np.inf
    for i in range(n):
        total = 0.0
        for k in range(q.shape[0]):
            total += (nodes[i, k] - q[k]) ** 2
        if total < least:
            least = total
            best = i
    return best, np.sqrt(least)


@kernel
def _put(nodes: FloatArray, parent: IntArray, tree: Int, row: Int, q: FloatArray, below: Int) -> None:
    for k in range(q.shape[0]):
        nodes[tree, row, k] = q[k]
    parent[tree, row] = below


@kernel
def _search(
    start: FloatArray,
    goals: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    budget: int,
    reach: float,
    random: Chance,
    scene: SceneArrays,
) -> tuple[FloatArray, int]:
    """Grow trees from start (0) and goals (1) until they meet; returns the path (k, n) and the iterations used."""
    n = start.shape[0]
    nodes = np.empty((2, 4 * budget + goals.shape[0] + 1, n))
    parent = np.empty((2, nodes.shape[1]), dtype=np.int64)
    count = np.array([1, goals.shape[0]])
    _put(nodes, parent, 0, 0, start, -1)
    for i in range(goals.shape[0]):
        _put(nodes, parent, 1, i, goals[i], -1)
    q = np.empty(n)
    new = np.empty(n)
    for iteration in range(budget):
        own = iteration % 2
        other = 1 - own
        for k in range(n):
            q[k] = lower[k] + (upper[k] - lower[k]) * uniform(random)
        near, gap = _nearest(nodes[own], count[own], q)
        part = min(1.0, reach / max(gap, 1e-12))
        for k in range(n):
            new[k] = nodes[own, near, k] + (q[k] - nodes[own, near, k]) * part
        if not edge_free(nodes[own, near], new, scene):
            continue
        _put(nodes, parent, own, count[own], new, near)
        count[own] += 1
        near, gap = _nearest(nodes[other], count[other], new)
        while True:  # the other tree reaches for the new node as far as it can
            part = min(1.0, reach / max(gap, 1e-12))
            for k in range(n):
                q[k] = nodes[other, near, k] + (new[k] - nodes[other, near, k]) * part
            if not edge_free(nodes[other, near], q, scene):
                break
            if part >= 1.0:
                newest = count[own] - 1
                first, last = (newest, near) if own == 0 else (near, newest)
                return _joined(nodes, parent, first, last), iteration + 1
            if count[other] >= nodes.shape[1]:
                break
            _put(nodes, parent, other, count[other], q, near)
            near = count[other]
            count[other] += 1
            gap -= reach
        if count[0] >= nodes.shape[1] or count[1] >= nodes.shape[1]:
            return np.empty((0, n)), iteration + 1
    return np.empty((0, n)), budget


@kernel
def _joined(nodes: FloatArray, parent: IntArray, first: Int, last: Int) -> FloatArray:
    """The way from the root of tree 0 over node `first`, then `last` of tree 1, to a root of tree 1."""
    before = 0
    i = first
    while i >= 0:
        before += 1
        i = parent[0, i]
    after = 0
    i = last
    while i >= 0:
        after += 1
        i = parent[1, i]
    path = np.empty((before + after, nodes.shape[2]))
    i = first
    for row in range(before - 1, -1, -1):
        for k in range(path.shape[1]):
            path[row, k] = nodes[0, i, k]
        i = parent[0, i]
    i = last
    for row in range(before, before + after):
        for k in range(path.shape[1]):
            path[row, k] = nodes[1, i, k]
        i = parent[1, i]
    return path


class RrtConnectNative:
    """RRT-Connect as one compiled call: the fast lane, with the results of a planner of its own.

    Source: Kuffner and LaValle, RRT-Connect, ICRA 2000.
    """

    def __init__(self, config: RrtConnectConfig | None = None) -> None:
        self.config = config or RrtConnectConfig()

    def plan(self, problem: MotionProblem) -> MotionResult:
        """Find a path from the start to one of the goals.

        Args:
            problem: The query.

        Returns:
            Path, status and iterations.
        """
        settled, goals = settle_early(problem)
        if settled is not None:
            return settled
        checker = problem.checker
        path, iterations = _search(
            np.ascontiguousarray(problem.start),
            np.ascontiguousarray(goals),
            checker.model.lower,
            checker.model.upper,
            problem.max_iterations,
            self.config.range_rad,
            np.array([problem.seed], dtype=np.uint64),
            checker.scene,
        )
        if len(path) == 0:
            return MotionResult(path=path, status=MotionStatus.NO_SOLUTION, iterations=int(iterations))
        path = shorten(path, checker, rounds=self.config.shortcut_rounds, seed=problem.seed)
        return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=int(iterations))
