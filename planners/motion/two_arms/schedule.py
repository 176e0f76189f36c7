"""Schedule: who waits where, so that arms that share a workspace keep to their paths and do not meet.

A schedule is a path through free cells of the coordination diagram, from the start of all arms to the end of all, that
never goes back. Here an arm waits only where its motion rests anyway: a schedule is therefore inside the same velocity
and acceleration limits as the motions it is made of, and nothing has to be timed again.

Source: LaValle and Hutchinson, Optimal motion planning for multiple robots having independent goals, IEEE T-RA 1998.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planners.errors import PlanningError
from planners.motion.arrays import BoolArray, IntArray
from planners.motion.kernel import kernel
from planners.motion.path.timed_path import TimedPath
from planners.motion.status import MotionStatus
from planners.motion.two_arms.diagram import MARGIN_M, free_cells
from planners.motion.two_arms.swept import ArmInWorld, swept

MAX_CELLS = 20_000_000
"""Largest diagram that is searched: 0.2 GB, seconds."""
_STEP_COST = 1 << 32  # one step of everybody; the steps of single arms count below that
_NEVER = np.iinfo(np.int64).max


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Who is where when."""

    status: MotionStatus
    index: IntArray
    """Sample of each arm's path at the beginning of each step, shape (T+1, n_arms); (0, n_arms) if not solved."""
    step_s: float

    @property
    def solved(self) -> bool:
        """Whether there is a schedule."""
        return self.status is MotionStatus.SOLVED

    @property
    def makespan_s(self) -> float:
        """Time until all arms are done [s]; inf if not solved."""
        return (len(self.index) - 1) * self.step_s if self.solved else np.inf

    def along_s(self, arm: int, time_s: float) -> float:
        """How much of its own motion an arm has done at a time [s]."""
        step = min(max(int(time_s / self.step_s), 0), len(self.index) - 1)
        here = int(self.index[step, arm])
        moves = step + 1 < len(self.index) and int(self.index[step + 1, arm]) > here
        return here * self.step_s + (time_s - step * self.step_s if moves else 0.0)


def schedule(arms: Sequence[ArmInWorld], paths: Sequence[TimedPath], margin_m: float = MARGIN_M) -> Schedule:
    """The shortest schedule of motions whose paths are given; of several, one in which the arms are done soonest.

    Args:
        arms: Two or more arms.
        paths: Motion of each, all with the same step.
        margin_m: Distance kept between arms [m], >= 0.

    Raises:
        PlanningError: Malformed input, or the diagram is too large.
    """
    if len(arms) != len(paths) or len(arms) < 2 or len({path.step_s for path in paths}) != 1:
        steps = sorted({path.step_s for path in paths})
        raise PlanningError(
            f"schedule: {len(arms)} arms, {len(paths)} paths with steps {steps} s; valid: two or more arms, a path "
            "for each, and one step"
        )
    covers = [swept(arm, path) for arm, path in zip(arms, paths, strict=True)]
    tables = [free_cells(covers[i], covers[j], margin_m) for i in range(len(covers)) for j in range(i + 1, len(covers))]
    return schedule_in(tables, [cover.rests for cover in covers], paths[0].step_s)


def schedule_in(free: Sequence[BoolArray], rests: Sequence[BoolArray], step_s: float) -> Schedule:
    """The shortest schedule through given diagrams.

    Exact: dynamic programming from the end over the product of all arms' samples.

    Args:
        free: Diagrams of the pairs (0, 1), (0, 2), ..., (1, 2), ...; shapes (k_i, k_j).
        rests: Where each arm may wait, shapes (k_i,); the last sample counts as one.
        step_s: Length of a step [s].

    Raises:
        PlanningError: The diagrams do not belong to the arms, or the product is too large.
    """
    size = np.array([len(r) for r in rests], dtype=np.int64)
    pairs = [(i, j) for i in range(len(size)) for j in range(i + 1, len(size))]
    shapes = [(int(size[i]), int(size[j])) for i, j in pairs]
    if [table.shape for table in free] != shapes:
        raise PlanningError(f"schedule_in: diagrams {[table.shape for table in free]}; valid: {shapes}")
    if np.prod(size.astype(np.float64)) > MAX_CELLS:
        raise PlanningError(
            f"schedule_in: {' x '.join(map(str, size))} cells; valid: at most {MAX_CELLS}; lengthen the step"
        )

    def failed(status: MotionStatus) -> Schedule:
        return Schedule(status=status, index=np.empty((0, len(size)), dtype=np.int64), step_s=step_s)

    if not all(table[0, 0] for table in free):
        return failed(MotionStatus.INVALID_START)
    if not all(table[-1, -1] for table in free):
        return failed(MotionStatus.INVALID_GOAL)
    together = np.concatenate(rests)
    if len(size) == 2:
        cost = _costs_of_two(free[0], rests[0], rests[1]).ravel()
    else:
        cost = np.full(int(np.prod(size)), _NEVER)
        _costs_of_arms(np.concatenate([table.ravel() for table in free]), together, size, cost)
    if cost[0] == _NEVER:
        return failed(MotionStatus.NO_SOLUTION)
    index = np.zeros((int(cost[0] // _STEP_COST) + 1, len(size)), dtype=np.int64)
    _follow(cost, together, size, index)
    return Schedule(status=MotionStatus.SOLVED, index=index, step_s=step_s)


@kernel
def _costs_of_two(free: BoolArray, rests_a: BoolArray, rests_b: BoolArray) -> IntArray:
    """Cost to go from every cell (k, m) of one diagram."""
    k, m = free.shape
    cost = np.full((k, m), _NEVER)
    cost[k - 1, m - 1] = 0
    for i in range(k - 1, -1, -1):
        for j in range(m - 1, -1, -1):
            if not free[i, j] or (i == k - 1 and j == m - 1):
                continue
            best = _NEVER
            if i < k - 1 and j < m - 1:
                best = cost[i + 1, j + 1]
            if i < k - 1 and (rests_b[j] or j == m - 1):
                best = min(best, cost[i + 1, j])
            if j < m - 1 and (rests_a[i] or i == k - 1):
                best = min(best, cost[i, j + 1])
            if best < _NEVER:
                cost[i, j] = best + _STEP_COST + (i < k - 1) + (j < m - 1)
    return cost


@kernel
def _strides(size: IntArray) -> tuple[IntArray, IntArray]:
    """Cells from one index of each arm to the next in a flat table, and the first row of each arm, shape (n,) each."""
    n = size.shape[0]
    stride = np.ones(n, dtype=np.int64)
    first = np.zeros(n, dtype=np.int64)
    for a in range(n - 2, -1, -1):
        stride[a] = stride[a + 1] * size[a + 1]
    for a in range(1, n):
        first[a] = first[a - 1] + size[a - 1]
    return stride, first


@kernel
def _costs_of_arms(flat: BoolArray, rests: BoolArray, size: IntArray, cost: IntArray) -> None:
    """Fill the cost to go (product of sizes,) of any number of arms."""
    n = size.shape[0]
    stride, first = _strides(size)
    here = np.empty(n, dtype=np.int64)
    last = cost.shape[0] - 1
    cost[last] = 0
    for cell in range(last - 1, -1, -1):
        rest = cell
        moving = 0
        for a in range(n):
            here[a] = rest // stride[a]
            rest -= here[a] * stride[a]
            moving += here[a] < size[a] - 1
        ok = True
        offset = 0
        for a in range(n):
            for b in range(a + 1, n):
                ok = ok and flat[offset + here[a] * size[b] + here[b]]
                offset += size[a] * size[b]
        if not ok:
            continue
        best = _NEVER
        for move in range(1, 1 << n):
            ahead = cell
            allowed = True
            for a in range(n):
                at_end = here[a] == size[a] - 1
                if move >> a & 1:
                    allowed = allowed and not at_end
                    ahead += stride[a]
                else:
                    allowed = allowed and (at_end or rests[first[a] + here[a]])
            if allowed and cost[ahead] < best:
                best = cost[ahead]
        if best < _NEVER:
            cost[cell] = best + _STEP_COST + moving


@kernel
def _follow(cost: IntArray, rests: BoolArray, size: IntArray, index: IntArray) -> None:
    """Fill `index` (T+1, n) with the cheapest way; of equal moves, one in which the last arms go on."""
    n = size.shape[0]
    stride, first = _strides(size)
    cell = 0
    for step in range(1, index.shape[0]):
        best = -1
        chosen = 0
        for move in range((1 << n) - 1, 0, -1):
            ahead = cell
            allowed = True
            for a in range(n):
                here = index[step - 1, a]
                at_end = here == size[a] - 1
                if move >> a & 1:
                    allowed = allowed and not at_end
                    ahead += stride[a]
                else:
                    allowed = allowed and (at_end or rests[first[a] + here])
            if allowed and (best < 0 or cost[ahead] < cost[best]):
                best = ahead
                chosen = move
        cell = best
        for a in range(n):
            index[step, a] = index[step - 1, a] + (chosen >> a & 1)
