"""Words of allocation: the cost of each vehicle for each task, and who got what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.status import Status


class CostError(PlanningError):
    """A cost matrix is malformed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AllocationProblem:
    """At most one task per vehicle and one vehicle per task.

    Raises:
        CostError: The matrix is not two-dimensional, or an entry is nan or minus infinity.
    """

    cost: npt.NDArray[np.float64]
    """Cost of each task for each vehicle, shape (n_vehicles, n_tasks), in any one unit; inf = not allowed."""

    def __post_init__(self) -> None:
        if np.ndim(self.cost) != 2:
            raise CostError(f"allocation: cost has shape {np.shape(self.cost)}; valid: (n_vehicles, n_tasks)")
        bad = np.argwhere(np.isnan(self.cost) | np.isneginf(self.cost))
        if bad.size:
            vehicle, task = bad[0]
            value = self.cost[vehicle, task]
            raise CostError(f"allocation: cost[{vehicle}, {task}] = {value}; valid: a number, or inf = not allowed")


@dataclass(frozen=True, kw_only=True, eq=False)
class Assignment:
    """Who got what."""

    pairs: npt.NDArray[np.int32]
    """Rows (vehicle, task), by vehicle, shape (k, 2)."""
    cost: float
    """Sum over the pairs."""
    status: Status
    """`optimal`: most pairs, then least cost; `feasible`: neither is proven; `infeasible`: no pair is allowed."""


def assignment(problem: AllocationProblem, pairs: npt.ArrayLike, status: Status) -> Assignment:
    """Put pairs into order and add up their cost; without any pair where some were asked for, it is infeasible."""
    rows = np.asarray(pairs, dtype=np.int32).reshape(-1, 2)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if not len(rows) and problem.cost.size:
        status = Status.INFEASIBLE
    return Assignment(pairs=rows, cost=float(problem.cost[rows[:, 0], rows[:, 1]].sum()), status=status)


class Allocator(Protocol):
    """What every allocator offers."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Choose pairs; an allocation with no pair is a result, not an error."""
