"""Words of allocation: the cost of each vehicle for each task, and who got what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from planners.allocation.shop import Shop, Timetable
from planners.errors import PlanningError
from planners.status import Status

NO_TASK = -1
"""What a vehicle holds that has no task."""


class CostError(PlanningError):
    """A cost matrix is malformed."""


class TaskError(PlanningError):
    """What is said about tasks and vehicles beside their costs is malformed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AllocationProblem:
    """At most one task per vehicle and one vehicle per task; only `cost` must be given.

    Raises:
        CostError: The matrix is not two-dimensional, or an entry is nan or minus infinity.
        TaskError: Another field has the wrong length, or names or means nothing.
    """

    cost: npt.NDArray[np.float64]
    """Cost of each task for each vehicle, shape (n_vehicles, n_tasks), in any one unit; inf = not allowed."""
    class_of: npt.NDArray[np.int32] | None = None
    """Priority class of each task, 0 = most urgent, shape (n_tasks,): a class goes before all costs of the next."""
    since_s: npt.NDArray[np.float64] | None = None
    """Since when each task has been ready [s], shape (n_tasks,); None = in the order of the columns."""
    held: npt.NDArray[np.int32] | None = None
    """Task that each vehicle has already but may still give away, `NO_TASK` = none, shape (n_vehicles,)."""
    keep_gain: float = 0.0
    """A vehicle gives its task away only for a gain larger than this, in units of cost, >= 0 ..."""
    keep_share: float = 0.0
    """... and larger than this share of the cost of its task, 0..1."""
    shop: Shop | None = None
    """The same vehicles and tasks with their stations and times, for allocators that plan sequences."""

    def __post_init__(self) -> None:
        if np.ndim(self.cost) != 2:
            raise CostError(f"allocation: cost has shape {np.shape(self.cost)}; valid: (n_vehicles, n_tasks)")
        # A sum is nan or minus infinity if an entry is, which is cheaper than to look at each.
        with np.errstate(invalid="ignore", over="ignore"):
            suspicious = not self.cost.sum() > -np.inf
        if suspicious:
            bad = np.argwhere(np.isnan(self.cost) | np.isneginf(self.cost))
            if bad.size:
                vehicle, task = bad[0]
                value = self.cost[vehicle, task]
                raise CostError(f"allocation: cost[{vehicle}, {task}] = {value}; valid: a number, or inf = not allowed")
        self._check_tasks()

    def _check_tasks(self) -> None:
        vehicles, tasks = self.cost.shape
        for name, n in (("class_of", tasks), ("since_s", tasks), ("held", vehicles)):
            value = getattr(self, name)
            if value is not None and np.shape(value) != (n,):
                raise TaskError(f"allocation: {name} has shape {np.shape(value)}; valid: ({n},)")
        if self.class_of is not None and (wrong := np.flatnonzero(self.class_of < 0)).size:
            raise TaskError(f"allocation: class_of[{wrong[0]}] = {self.class_of[wrong[0]]}; valid: 0, 1, ...")
        if self.since_s is not None and (wrong := np.flatnonzero(~np.isfinite(self.since_s))).size:
            raise TaskError(f"allocation: since_s[{wrong[0]}] = {self.since_s[wrong[0]]}; valid: a finite number")
        if self.held is not None:
            wrong = np.flatnonzero((self.held < NO_TASK) | (self.held >= tasks))
            if wrong.size:
                valid = f"0..{tasks - 1}, or {NO_TASK} = none"
                raise TaskError(f"allocation: held[{wrong[0]}] = {self.held[wrong[0]]}; valid: {valid}")
            tasks_held, times = np.unique(self.held[self.held >= 0], return_counts=True)
            if (times > 1).any():
                raise TaskError(f"allocation: held has task {tasks_held[times > 1][0]} twice; valid: one vehicle each")
        if not 0.0 <= self.keep_gain < np.inf:
            raise TaskError(f"allocation: keep_gain = {self.keep_gain}; valid: a number >= 0")
        if not 0.0 <= self.keep_share <= 1.0:
            raise TaskError(f"allocation: keep_share = {self.keep_share}; valid: 0..1")
        if self.shop is not None and (self.shop.n_vehicles, self.shop.n_jobs) != (vehicles, tasks):
            shape = (self.shop.n_vehicles, self.shop.n_jobs)
            raise TaskError(f"allocation: shop has (vehicles, jobs) = {shape}; valid: {(vehicles, tasks)}, as cost")

    def choice_cost(self) -> npt.NDArray[np.float64]:
        """The costs by which to choose: a held task is cheaper by what another has to gain, against flapping."""
        if self.held is None or not (self.keep_gain or self.keep_share):
            return self.cost
        holders, tasks, worth = self.kept()
        cost = self.cost.copy()
        cost[holders, tasks] -= worth
        return cost

    def kept(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int32], npt.NDArray[np.float64]]:
        """Vehicles that hold a task they may still do, their tasks, and what another has to gain by taking each."""
        if self.held is None:
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.int32), np.zeros(0)
        holders = np.flatnonzero(self.held >= 0)
        holders = holders[np.isfinite(self.cost[holders, self.held[holders]])]
        tasks = self.held[holders]
        return holders, tasks, np.maximum(self.keep_gain, self.keep_share * np.abs(self.cost[holders, tasks]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Assignment:
    """Who got what."""

    pairs: npt.NDArray[np.int32]
    """Rows (vehicle, task), by vehicle, shape (k, 2)."""
    cost: float
    """Sum over the pairs."""
    status: Status
    """`optimal`: most pairs, then least cost; `feasible`: neither is proven; `infeasible`: no pair is allowed."""
    sequence: tuple[tuple[int, ...], ...] = ()
    """Tasks of each vehicle in order as planned ahead, the one of its pair first; empty = nothing is planned ahead."""
    timetable: Timetable | None = None
    """When they are done, of allocators that plan the stations too."""
    note: str = ""
    """What the caller should know, such as that another method had to step in; empty = nothing."""


def assignment(problem: AllocationProblem, pairs: npt.ArrayLike, status: Status, note: str = "") -> Assignment:
    """Put pairs into order and add up their cost; without any pair where some were asked for, it is infeasible."""
    rows = np.asarray(pairs, dtype=np.int32).reshape(-1, 2)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if not len(rows) and problem.cost.size:
        status = Status.INFEASIBLE
    return Assignment(pairs=rows, cost=float(problem.cost[rows[:, 0], rows[:, 1]].sum()), status=status, note=note)


class Allocator(Protocol):
    """What every allocator offers.

    Its class is made without arguments, or with `config=` if it has settings: a frozen dataclass, which the annotation
    of that argument names.

    One that reads the shop of a problem says so by `plans_ahead = True`; the others need not be given any. One that
    is to be given vehicles that are free only in `soon_s` seconds says so by that attribute; their costs tell.
    """

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Choose pairs; an allocation with no pair is a result, not an error."""
