"""Costs from tables of distances, and the few pairs that are worth a look when all of them are too many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import Distances, FloatArray, IntArray

UNREACHABLE = 65_535
"""Distance in a table that stands for no way."""
_BLOCK_ROWS = 64
"""Rows of a table that are read together, so that they stay in the cache and results are written side by side."""

_FEW = 4
"""Tasks per goal from which on each goal is looked up once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """Pairs to choose from, by vehicle; no pair stands there twice."""

    vehicle: IntArray
    """Shape (n_pairs,)."""
    task: IntArray
    """Shape (n_pairs,)."""
    cost: FloatArray
    """Finite, shape (n_pairs,)."""
    beyond: FloatArray
    """A pair of a vehicle that was left out costs at least this, inf if none was, shape (n_vehicles,)."""
    shape: tuple[int, int]
    """Vehicles and tasks."""


def prune(cost: FloatArray, n_nearest: int) -> Candidates:
    """Keep the cheapest tasks of each vehicle that are allowed.

    Args:
        cost: Cost of each task for each vehicle, inf = not allowed, shape (n_vehicles, n_tasks).
        n_nearest: Tasks that a vehicle keeps at most, >= 1.
    """
    kept = min(n_nearest, cost.shape[1])
    task = np.zeros((len(cost), kept), dtype=np.int32)
    chosen = np.full(task.shape, np.inf)
    _cheapest(cost, task, chosen)
    return _candidates(task, chosen, cost.shape[1])


def nearest(distances: Distances, row: IntArray, state: IntArray, n_nearest: int) -> Candidates:
    """Keep the nearest tasks of each vehicle, without writing down the distance of every pair.

    Args:
        distances: Distance from each state to some goals, `UNREACHABLE` = no way, shape (n_rows, n_states).
        row: Row of each task's goal, shape (n_tasks,).
        state: State of each vehicle, shape (n_vehicles,).
        n_nearest: Tasks that a vehicle keeps at most, >= 1; of those as far as the last, it keeps the first.
    """
    kept = min(n_nearest, len(row))
    task = np.zeros((len(state), kept), dtype=np.int32)
    cost = np.full((len(state), kept), np.inf)
    _nearest(distances, row.astype(np.int64), state.astype(np.int64), task, cost)
    return _candidates(task, cost, len(row))


def travel_cost(distances: Distances, row: IntArray, state: IntArray, cost: FloatArray | None = None) -> FloatArray:
    """Write down the cost matrix of travel.

    Args:
        distances: As for `nearest`.
        row: Row of each task's goal, shape (n_tasks,).
        state: State of each vehicle, shape (n_vehicles,).
        cost: Matrix to fill; new memory of that size takes longer than what is to be written into it.

    Returns:
        Distance of each task for each vehicle, inf where there is no way, shape (n_vehicles, n_tasks).
    """
    cost = np.empty((len(state), len(row))) if cost is None else cost
    goals, which = np.unique(row, return_inverse=True)
    if len(goals) * _FEW < len(row):
        of_goals = np.empty((len(state), len(goals)))
        _travel_cost(distances, goals.astype(np.int64), state.astype(np.int64), of_goals)
        np.take(of_goals, which, axis=1, out=cost, mode="clip")  # any other mode copies the result once more
    else:
        _travel_cost(distances, row.astype(np.int64), state.astype(np.int64), cost)
    return cost


def _candidates(task: IntArray, cost: FloatArray, n_tasks: int) -> Candidates:
    vehicle = np.broadcast_to(np.arange(len(task), dtype=np.int32)[:, None], task.shape)
    allowed = np.isfinite(cost)
    all_kept = task.shape[1] == n_tasks
    return Candidates(
        vehicle=vehicle[allowed],
        task=task[allowed],
        cost=cost[allowed],
        beyond=np.full(len(task), np.inf) if all_kept else cost.max(axis=1),
        shape=(len(task), n_tasks),
    )


@njit(cache=True, nogil=True)
def _cheapest(cost: FloatArray, task: IntArray, chosen: FloatArray) -> None:
    kept = chosen.shape[1]
    for v in range(cost.shape[0]):
        last = 0  # where the dearest of those kept stands
        for t in range(cost.shape[1]):
            if cost[v, t] >= chosen[v, last]:
                continue
            task[v, last] = t
            chosen[v, last] = cost[v, t]
            for k in range(kept):
                if chosen[v, k] > chosen[v, last]:
                    last = k


@njit(cache=True, nogil=True)
def _travel_cost(
    distances: Distances, row: npt.NDArray[np.int64], state: npt.NDArray[np.int64], cost: FloatArray
) -> None:
    block = np.empty((_BLOCK_ROWS, len(state)), dtype=np.uint16)
    for first in range(0, len(row), _BLOCK_ROWS):
        n = min(_BLOCK_ROWS, len(row) - first)
        for k in range(n):
            for v in range(len(state)):
                block[k, v] = distances[row[first + k], state[v]]
        for v in range(len(state)):
            for k in range(n):
                cost[v, first + k] = np.inf if block[k, v] == UNREACHABLE else np.float64(block[k, v])


@njit(cache=True, nogil=True)
def _nearest(
    distances: Distances,
    row: npt.NDArray[np.int64],
    state: npt.NDArray[np.int64],
    task: IntArray,
    cost: FloatArray,
) -> None:
    n_vehicles, kept = cost.shape
    furthest = np.full(n_vehicles, UNREACHABLE, dtype=np.uint16)  # of those kept
    slot = np.zeros(n_vehicles, dtype=np.int64)  # where it stands
    for t in range(len(row)):
        for v in range(n_vehicles):
            distance = distances[row[t], state[v]]
            if distance >= furthest[v]:
                continue
            task[v, slot[v]] = t
            cost[v, slot[v]] = distance
            last = 0
            for k in range(1, kept):
                if cost[v, k] > cost[v, last]:
                    last = k
            slot[v] = last
            furthest[v] = UNREACHABLE if cost[v, last] == np.inf else np.uint16(cost[v, last])
