"""Hungarian allocation: the most pairs, of these the most urgent tasks, and of these the cheapest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.allocation.prune import Candidates, prune
from planners.status import Status

Pairs = npt.NDArray[np.int32]

DENSE_WORK = 3e10
"""Smaller side squared x larger side up to which the whole matrix is solved; 1,000 x 20,000 takes 0.2 s."""
NEAREST_N = 16
"""Cheapest tasks of each vehicle that are kept of a larger one."""


class Hungarian:
    """Exact for any shape and any pairs forbidden, up to a size; from there on, of the cheapest pairs of each vehicle.

    Priority classes are strict: no saving makes up for a less urgent task. One step of cost per class, larger than
    what all pairs together can save, does it: the sets of tasks that can be served together are a matroid (of a
    bipartite graph), so the best set by any falling weights of the classes is the lexicographic best (Edmonds,
    "Matroids and the greedy algorithm", Mathematical Programming 1, 1971), and numbers stay small.

    Sources: Crouse, "On implementing 2D rectangular assignment algorithms", IEEE Transactions on Aerospace and
    Electronic Systems 52(4), 2016, and Jonker, Volgenant, "A shortest augmenting path algorithm for dense and sparse
    linear assignment problems", Computing 38, 1987, which scipy implements.

    Args:
        dense_work: See `DENSE_WORK`.
        nearest_n: See `NEAREST_N`, >= 1.
    """

    def __init__(self, *, dense_work: float = DENSE_WORK, nearest_n: int = NEAREST_N) -> None:
        self._dense_work = dense_work
        self._nearest_n = nearest_n

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; 12 ms for 1000 vehicles and 1500 tasks."""
        cost = problem.choice_cost()
        n_classes = 1 if problem.class_of is None else len(np.unique(problem.class_of))
        small = min(cost.shape) ** 2 * max(cost.shape) <= self._dense_work
        if small and n_classes == 1 and cost.size and cost.max() < np.inf:
            return assignment(problem, np.column_stack(linear_sum_assignment(cost)), Status.OPTIMAL)

        finite = np.isfinite(cost)
        if not finite.any():
            return assignment(problem, np.empty((0, 2)), Status.OPTIMAL)
        least, most = cost.min(), cost.max(initial=-np.inf, where=finite)
        step = (most - least + 1.0) * (min(cost.shape) + 1)
        forbidden = n_classes * step
        cost = cost - least
        if problem.class_of is not None:
            cost += step * np.unique(problem.class_of, return_inverse=True)[1]
        if small:
            return assignment(problem, _dense(cost, forbidden), Status.OPTIMAL)
        pairs = match(prune(cost, self._nearest_n), forbidden)
        # Those left without a pair choose again, of all tasks that are left.
        left = [np.setdiff1d(np.arange(n), pairs[:, axis]) for axis, n in enumerate(cost.shape)]
        again = _dense(cost[np.ix_(*left)], forbidden)
        again = np.column_stack((left[0][again[:, 0]], left[1][again[:, 1]]))
        return assignment(problem, np.concatenate((pairs, again)), Status.FEASIBLE)


def match(candidates: Candidates, forbidden: float) -> Pairs:
    """The most of the candidate pairs, and of these choices the cheapest; exact.

    Each row has a dummy column of its own, since the sparse solver wants a column for every row.

    Args:
        candidates: Pairs to choose from.
        forbidden: More than what any choice of pairs can save.

    Returns:
        Rows (vehicle, task), shape (k, 2).
    """
    n_vehicles, n_tasks = candidates.shape
    least = candidates.cost.min(initial=0.0)
    matrix = csr_array(
        (
            # The sparse solver takes a zero for a pair that is not there.
            np.concatenate((candidates.cost - least + 1.0, np.full(n_vehicles, forbidden + 1.0))),
            (
                np.concatenate((candidates.vehicle, np.arange(n_vehicles, dtype=np.int32))),
                np.concatenate((candidates.task, np.arange(n_tasks, n_tasks + n_vehicles, dtype=np.int32))),
            ),
        ),
        shape=(n_vehicles, n_tasks + n_vehicles),
    )
    vehicles, tasks = min_weight_full_bipartite_matching(matrix)
    real = tasks < n_tasks
    return np.column_stack((vehicles[real], tasks[real])).astype(np.int32)


def _dense(cost: npt.NDArray[np.float64], forbidden: float) -> Pairs:
    """The most of the finite entries, and of these choices the cheapest.

    One forbidden pair costs more than all others together can save, so as few as possible are taken.
    """
    vehicles, tasks = linear_sum_assignment(np.minimum(cost, forbidden))
    real = np.isfinite(cost[vehicles, tasks])
    return np.column_stack((vehicles[real], tasks[real])).astype(np.int32)
