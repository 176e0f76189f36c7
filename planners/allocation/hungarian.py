"""Hungarian allocation: the most pairs, of these the most urgent tasks, and of these the cheapest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from planners.allocation.arrays import FloatArray, IntArray
from planners.allocation.matching.dense_matching import match_all
from planners.allocation.matching.prune import prune
from planners.allocation.matching.sparse_matching import match
from planners.allocation.problem import AllocationProblem, Assignment, CostError, assignment
from planners.errors import PlanningError
from planners.status import Status

SOON_S = 10.0
"""Vehicles that are free so soon are matched as well: they may do better than a far one that is free now [s]."""
N_SMALL = 10_000
"""Fewer pairs than that are solved sooner than a compiled kernel is loaded."""
MORE = 4
"""How many times as many of the cheapest are matched when the first ones are not enough."""
EXACT = 1e-6
"""What is called optimal costs at most such a share more: beside the step between classes, small costs are rounded."""
MOST_RANGE = 1e200
"""Most that costs may differ by where a step has to be larger than what all of them can save."""


@dataclass(frozen=True, kw_only=True)
class HungarianConfig:
    """Settings of `Hungarian`."""

    dense_work: float = 3e10
    """Smaller side squared x larger side up to which the whole matrix is solved; 10 s at the most, mostly 0.1 s."""
    nearest_n: int = 64
    """How many of the cheapest are matched first beyond that."""

    def __post_init__(self) -> None:
        for name, value, least in (
            ("dense_work", self.dense_work, 0),
            ("nearest_n", self.nearest_n, 1),
        ):
            if not value >= least:
                raise PlanningError(f"hungarian: {name} = {value}; valid: at least {least}")


class Hungarian:
    """Exact for any shape and any pairs forbidden, up to a size; beyond it, exact where that can be proven.

    Of a very large matrix only the cheapest tasks of each vehicle are matched, and the prices that come with the
    matching prove that no other pair could have made it cheaper. If they do not, those left without a pair choose
    again, and the assignment does not call itself optimal.

    Priority classes are strict: no saving makes up for a less urgent task. One step of cost per class, larger than
    what all pairs together can save, does it: the sets of tasks that can be served together are a matroid (of a
    bipartite graph), so the best set by any falling weights of the classes is the lexicographic best (Edmonds,
    "Matroids and the greedy algorithm", Mathematical Programming 1, 1971), and numbers stay small. Where costs differ
    by so much that the step drowns the small ones, the assignment does not call itself optimal.

    Source of the solver of small matrices: Crouse, "On implementing 2D rectangular assignment algorithms", IEEE
    Transactions on Aerospace and Electronic Systems 52(4), 2016, which scipy implements.

    Args:
        config: Settings.
    """

    soon_s = SOON_S

    def __init__(self, config: HungarianConfig | None = None) -> None:
        self.config = HungarianConfig() if config is None else config

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; 5 ms for 1000 vehicles and 1500 tasks.

        Raises:
            CostError: Costs differ by more than `MOST_RANGE`, and there are classes or pairs that are not allowed.
        """
        plain = cost = problem.choice_cost()
        least, rounded = 0.0, 0.0
        if problem.class_of is not None and len(np.unique(problem.class_of)) > 1:
            least, _, step = _range(plain)
            ranks = np.unique(problem.class_of, return_inverse=True)[1]
            cost = plain - least + step * ranks
            rounded = float(np.spacing(step * (ranks.max() + 1.0))) * min(cost.shape)
        if cost.shape[0] <= cost.shape[1]:
            pairs, status = self._choose(cost)
        else:
            turned, status = self._choose(cost.T)
            pairs = turned[:, ::-1]
        if rounded > EXACT * float((plain[pairs[:, 0], pairs[:, 1]] - least).sum()) > 0.0:
            status = Status.FEASIBLE
        return assignment(problem, pairs, status)

    def _choose(self, cost: FloatArray) -> tuple[IntArray, Status]:
        """Pairs of rows and columns, of which there are as many or more."""
        if len(cost) * cost.size <= self.config.dense_work:
            return _dense(cost), Status.OPTIMAL
        for n_nearest in (self.config.nearest_n, MORE * self.config.nearest_n):
            candidates = prune(cost, n_nearest)
            most, least = candidates.cost.max(initial=0.0), candidates.cost.min(initial=0.0)
            column_of, pays = match(candidates, most + (most - least + 1.0) * (len(cost) + 1))
            rows = np.flatnonzero(column_of >= 0)
            if len(rows) == len(cost) and (pays <= candidates.beyond).all():
                return _pairs(rows, column_of[rows]), Status.OPTIMAL
        pairs = _pairs(rows, column_of[rows])
        left = [np.setdiff1d(np.arange(n), pairs[:, axis]) for axis, n in enumerate(cost.shape)]
        again = _dense(cost[np.ix_(*left)])
        return np.concatenate((pairs, _pairs(left[0][again[:, 0]], left[1][again[:, 1]]))), Status.FEASIBLE


def _pairs(rows: npt.NDArray[np.integer], columns: npt.NDArray[np.integer]) -> IntArray:
    return np.column_stack((rows, columns)).astype(np.int32)


def _range(cost: FloatArray) -> tuple[float, float, float]:
    """Least and most of the finite entries, and a step that is more than any choice of pairs can save by them.

    Raises:
        CostError: The step would be too large for a number.
    """
    finite = np.isfinite(cost)
    if not finite.any():
        return 0.0, 0.0, 1.0
    least, most = float(cost.min()), float(cost.max(initial=-np.inf, where=finite))
    if not most / 2.0 - least / 2.0 <= MOST_RANGE / 2.0:
        raise CostError(
            f"hungarian: costs are from {least:g} to {most:g}; valid: a difference of at most {MOST_RANGE:g}"
        )
    return least, most, (most - least + 1.0) * (min(cost.shape) + 1)


def _dense(cost: FloatArray) -> IntArray:
    """The most of the finite entries, and of these choices the cheapest.

    One forbidden pair costs more than all others together can save, so as few as possible are taken.
    """
    finite = cost
    if cost.size and cost.max() == np.inf:
        least, most, step = _range(cost)
        finite = np.minimum(cost - least, most - least + step)
    if cost.size < N_SMALL:
        rows, columns = linear_sum_assignment(finite)
    else:
        rows, columns = np.arange(len(cost)), match_all(np.ascontiguousarray(finite))
    real = np.isfinite(cost[rows, columns])
    return _pairs(rows[real], columns[real])
