"""TaskSchedule: which robot does which task, decided anew in every timestep for all tasks that are not opened yet."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.optimize import linear_sum_assignment

from fleet.arrays import BoolArray
from fleet.league.rules import NO_TASK, Tasks
from fleet.league.view import LeagueView
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.multi_step_kernel import Costs

Int64Array = npt.NDArray[np.int64]

_HASTE = 5
"""What a step to a task's first errand counts against a step of the task itself: the first is lost, the second not."""
_MOST_PAIRS = 120_000
"""Pairs of robots and tasks that a timestep compares."""
_EXACT_PAIRS = 10_000
"""Pairs up to which the best assignment is computed; the greedy one is a little worse and much faster."""
_SHORTLIST = 12
"""Tasks that a robot is offered before it takes what is left."""
_NONE = 2**40


class TaskSchedule:
    """Tasks by cost: the way to the first errand, weighted, and then the task's own length; cheapest pair first.

    A robot that has not opened its task may get another one. In a large fleet only some of these robots are asked in
    each timestep, in turn, and a task counts as shorter the longer it waits: those that are long or out of the way
    would fill the pool otherwise, and leave little to choose from. Where crowds delay what leads into them, such tasks
    wait until they have gone: no part of the floor gets more work than it can pass.

    Args:
        arena: The arena.
        costs: Costs on its floor.

    Source: the greedy rule is known from the winner of the 2024 League (No Man's Sky), described in
    https://arxiv.org/abs/2511.09193.
    """

    def __init__(self, arena: LeagueView, costs: GoalCosts) -> None:
        self._costs = costs
        self._onward = np.full(len(arena.errand_cell), -1, dtype=np.int32)
        self.onward_of: IntArray = self._onward
        """Cost from each errand to the next one of its task, 0 behind the last, -1 where not known yet."""
        self.rest_of: IntArray = np.zeros(len(arena.errand_cell), dtype=np.int32)
        """Cost from each errand to the end of its task."""
        self._turn = 0

    def learn(self, arena: LeagueView, tasks: Tasks) -> None:
        """Compute how long tasks are that are seen for the first time."""
        row = tasks % arena.problem.n_tasks
        row = np.unique(row[self._onward[arena.errand_ptr[row]] < 0])
        if not row.size:
            return
        begin, end = arena.errand_ptr[row].astype(np.int64), arena.errand_ptr[row + 1].astype(np.int64)
        counts = end - begin
        place = np.repeat(end - np.cumsum(counts), counts) + np.arange(counts.sum())
        last = np.repeat(end - 1, counts) == place
        follower = np.where(last, place, place + 1)
        rows = self._costs.rows(arena.errand_cell[follower])
        self._onward[place] = np.where(last, 0, self._costs.between(rows, arena.errand_cell[place]))
        backwards = place[::-1]
        _add_up(backwards, last[::-1].copy(), self._onward, self.rest_of)

    def assign(self, arena: LeagueView, *, delay: IntArray | None = None, everybody: bool = False) -> Tasks:
        """Decide who does what.

        Args:
            arena: The arena.
            delay: Cost of what crowds around each cell delay an errand there, shape (n_cells,); None = nothing.
            everybody: Ask all robots that may still change, however many pairs that makes.

        Returns:
            Task of each robot or `NO_TASK`, shape (n,).
        """
        pool = arena.pool()
        self.learn(arena, pool)
        free = np.flatnonzero((arena.task_of == NO_TASK) | (arena.errand_of == 0))
        in_turn = not everybody and len(free) * len(pool) > _MOST_PAIRS
        asked = self._in_turn(arena, free, len(pool)) if in_turn else free
        task_of = arena.task_of.copy()
        task_of[asked] = NO_TASK
        tasks = pool[~np.isin(pool, task_of)]
        if not asked.size or not tasks.size:
            return task_of
        place = arena.errand_ptr[tasks % arena.problem.n_tasks]
        rows = self._costs.rows(arena.errand_cell[place])
        length = self.rest_of[place]
        if delay is not None:
            end = arena.errand_ptr[tasks % arena.problem.n_tasks + 1]
            length = length + _sum_at_errands(delay, arena.errand_cell, place, end)
        if in_turn:
            length = length - self._waited(arena, pool, tasks)
        if len(asked) * len(tasks) <= _EXACT_PAIRS:
            way = left(self._costs.costs, np.repeat(arena.states[asked], len(rows)), np.tile(rows, len(asked)))
            robot, task = linear_sum_assignment(_HASTE * way.reshape(len(asked), -1) + length)
            task_of[asked[robot]] = tasks[task]
            return task_of
        width = min(_SHORTLIST, len(tasks))
        best = np.empty((len(asked), width), dtype=np.int32)
        key = np.empty((len(asked), width), dtype=np.int64)
        grid, graph = arena.problem.grid, arena.graph
        here = np.column_stack(grid.row_col(graph.state_cell[arena.states[asked]])).astype(np.int32)
        there = np.column_stack(grid.row_col(arena.errand_cell[place])).astype(np.int32)
        _shortlist(self._costs.costs, arena.states[asked], rows, length, here, there, self._costs.unit, best, key)
        order = np.argsort(key, axis=None, kind="stable")
        chosen = np.full(len(asked), -1, dtype=np.int64)
        _greedy(order, best, chosen, np.zeros(len(tasks), dtype=np.bool_))
        task_of[asked] = np.where(chosen >= 0, tasks[chosen], NO_TASK)
        return task_of

    def _waited(self, arena: LeagueView, pool: Tasks, tasks: Tasks) -> Int64Array:
        """What the wait of tasks counts: the mean length of the pool for each time that it was filled anew since."""
        mean = np.mean(self.rest_of[arena.errand_ptr[pool % arena.problem.n_tasks]])
        waited: Int64Array = (mean * (pool[-1] - tasks) / arena.problem.pool_size).astype(np.int64)
        return waited

    def _in_turn(self, arena: LeagueView, free: npt.NDArray[np.intp], n_tasks: int) -> npt.NDArray[np.intp]:
        """Robots whose task is decided in this timestep, of those that are free to take one."""
        idle = arena.task_of[free] == NO_TASK
        idle_robots, rest = free[idle], free[~idle]
        n_tasks_left = max(n_tasks - len(rest), 1)
        room = max(_MOST_PAIRS // n_tasks_left - len(idle_robots), 0)
        taken = np.roll(rest, -self._turn)[:room]
        self._turn = (self._turn + len(taken)) % max(len(rest), 1)
        return np.sort(np.concatenate((idle_robots, taken)))


@njit(cache=True, nogil=True)
def _add_up(
    backwards: Int64Array, last: BoolArray, onward: IntArray, rest: IntArray
) -> None:  # pragma: no cover - compiled
    """Sum up the costs between errands from the end of each task to its begin."""
    total = 0
    for k in range(len(backwards)):
        total = 0 if last[k] else total + onward[backwards[k]]
        rest[backwards[k]] = total


@njit(cache=True, nogil=True)
def _sum_at_errands(
    delay: IntArray, cell: IntArray, begin: IntArray, end: IntArray
) -> IntArray:  # pragma: no cover - compiled
    """Sum of the delays at the errands `begin` to `end` - 1 of each task."""
    total = np.zeros(len(begin), dtype=np.int32)
    for task in range(len(begin)):
        for errand in range(begin[task], end[task]):
            total[task] += delay[cell[errand]]
    return total


@njit(cache=True, nogil=True)
def _shortlist(
    costs: Costs,
    states: IntArray,
    rows: IntArray,
    length: IntArray,
    here: IntArray,
    there: IntArray,
    unit: int,
    best: IntArray,
    key: Int64Array,
) -> None:  # pragma: no cover - compiled
    """The cheapest tasks of each robot in order, shape (robots, width), and their costs; -1 where there are no more.

    No way is shorter than rows and columns apart. Where that is least, costs are looked up first: then most of the
    other tasks are out of the question without. Of equal costs the earlier task comes first.
    """
    n_tasks, width = len(rows), best.shape[1]
    least = np.empty(n_tasks, dtype=np.int64)
    likely = np.empty(width, dtype=np.int32)
    looked_at = np.full(n_tasks, -1, dtype=np.int32)
    for robot in range(len(states)):
        row, col = here[robot, 0], here[robot, 1]
        for other in range(n_tasks):
            apart = abs(row - there[other, 0]) + abs(col - there[other, 1])
            least[other] = _HASTE * unit * apart + length[other]
        _least_first(least, likely)
        keys, chosen = key[robot], best[robot]
        keys[:], chosen[:] = _NONE, -1
        first, end = costs.look.ptr[states[robot]], costs.look.ptr[states[robot] + 1]
        for k in range(width + n_tasks):
            task = np.int32(likely[k] if k < width else k - width)
            if looked_at[task] == robot or not _is_before(least[task], task, keys, chosen, width - 1):
                continue
            looked_at[task] = robot
            way = np.int64(2**20)
            for j in range(first, end):
                ahead = costs.look.scale * np.int64(costs.table[rows[task], costs.look.key[j]])
                way = min(way, costs.look.ahead[j] + ahead)
            value = _HASTE * way + length[task]
            if not _is_before(value, task, keys, chosen, width - 1):
                continue
            place = width - 1
            while place > 0 and _is_before(value, task, keys, chosen, place - 1):
                keys[place], chosen[place] = keys[place - 1], chosen[place - 1]
                place -= 1
            keys[place], chosen[place] = value, task


@njit(cache=True, nogil=True)
def _is_before(
    value: np.int64, task: np.int32, keys: Int64Array, chosen: IntArray, place: int
) -> bool:  # pragma: no cover - compiled
    """Whether a task of some cost comes before the one at a place of a shortlist."""
    return bool(value < keys[place] or (value == keys[place] and task < chosen[place]))


@njit(cache=True, nogil=True)
def _least_first(numbers: Int64Array, chosen: IntArray) -> None:  # pragma: no cover - compiled
    """Fill in where the smallest numbers are, in order."""
    filled, width = 0, len(chosen)
    for k in range(len(numbers)):
        if filled == width and numbers[k] >= numbers[chosen[width - 1]]:
            continue
        place = min(filled, width - 1)
        while place > 0 and numbers[chosen[place - 1]] > numbers[k]:
            chosen[place] = chosen[place - 1]
            place -= 1
        chosen[place] = k
        filled = min(filled + 1, width)


@njit(cache=True, nogil=True)
def _greedy(
    order: Int64Array, best: IntArray, chosen: Int64Array, used: BoolArray
) -> None:  # pragma: no cover - compiled
    """Give out pairs from the cheapest on; robots that went away empty-handed take what is left."""
    width = best.shape[1]
    for k in order:
        robot, task = k // width, best[k // width, k % width]
        if task >= 0 and chosen[robot] < 0 and not used[task]:
            chosen[robot] = task
            used[task] = True
    task = 0
    for robot in range(len(chosen)):
        if chosen[robot] < 0:
            while task < len(used) and used[task]:
                task += 1
            if task < len(used):
                chosen[robot] = task
                used[task] = True
