"""Matching among few candidates per vehicle, with the prices that prove it best among all pairs, if it is."""

from __future__ import annotations

import heapq

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import FloatArray, Int, IntArray
from planners.allocation.matching.prune import Candidates


def match(candidates: Candidates, forbidden: float) -> tuple[IntArray, FloatArray]:
    """The most of the candidate pairs, and of these choices the cheapest; exact among the candidates.

    Vehicles are given a task one by one along a shortest augmenting path, searched with a heap. Source: Jonker,
    Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems", Computing 38,
    1987; that a vehicle may stay without a task is a task of its own, at a price.

    Args:
        candidates: Pairs to choose from, sorted by vehicle.
        forbidden: Price of staying without a task, more than what any choice of pairs can save.

    Returns:
        Task of each vehicle, -1 = none, shape (n_vehicles,), and what each vehicle pays, shape (n_vehicles,): a pair
        that costs a vehicle at least that much, task prices being zero or less, could not make the whole cheaper.
    """
    n_vehicles, n_tasks = candidates.shape
    first = np.searchsorted(candidates.vehicle, np.arange(n_vehicles + 1))
    return _match(first, candidates.task, candidates.cost, n_tasks, forbidden)


@njit(cache=True, nogil=True)
def _match(
    first: npt.NDArray[np.int64], task: IntArray, cost: FloatArray, n_tasks: int, forbidden: float
) -> tuple[IntArray, FloatArray]:
    n_vehicles = len(first) - 1
    pays = np.full(n_vehicles, forbidden)
    price = np.zeros(n_tasks)
    task_of = np.full(n_vehicles, -1, dtype=np.int32)
    vehicle_of = np.full(n_tasks, -1, dtype=np.int32)
    for row in range(n_vehicles):
        best = -1
        for k in range(first[row], first[row + 1]):
            if cost[k] < pays[row]:
                pays[row], best = cost[k], task[k]
        if best >= 0 and vehicle_of[best] < 0:
            task_of[row], vehicle_of[best] = best, row

    way = np.full(n_tasks, np.inf)
    before = np.empty(n_tasks, dtype=np.int32)  # the vehicle by which the way to a task came
    done = np.zeros(n_tasks, dtype=np.bool_)
    touched = np.empty(n_tasks, dtype=np.int32)
    for newcomer in range(n_vehicles):
        if task_of[newcomer] >= 0:
            continue
        heap = [(0.0, np.int32(0))]
        heap.pop()
        n_touched, length = 0, 0.0
        v: Int = newcomer
        least_idle = np.inf
        idle: Int = -1
        sink: Int = -1
        while True:
            if length + forbidden - pays[v] < least_idle:
                least_idle, idle = length + forbidden - pays[v], v
            for k in range(first[v], first[v + 1]):
                t = task[k]
                longer = length + cost[k] - pays[v] - price[t]
                if not done[t] and longer < way[t]:
                    if way[t] == np.inf:
                        touched[n_touched] = t
                        n_touched += 1
                    way[t], before[t] = longer, v
                    heapq.heappush(heap, (longer, t))
            t = np.int32(-1)
            while heap:
                length, t = heapq.heappop(heap)
                if not done[t]:
                    break
                t = np.int32(-1)
            if t < 0 or length >= least_idle:
                length = least_idle
                break
            if vehicle_of[t] < 0:
                sink = t
                break
            done[t] = True
            v = vehicle_of[t]

        pays[newcomer] += length
        for k in range(n_touched):
            t = touched[k]
            if done[t]:
                pays[vehicle_of[t]] += length - way[t]
                price[t] -= length - way[t]
            way[t], done[t] = np.inf, False
        if sink < 0:
            # The vehicle that stays without a task passes its own on, unless it is the newcomer itself.
            sink = task_of[idle]
            task_of[idle] = -1
        while sink >= 0:
            v = before[sink]
            sink_next = task_of[v]
            task_of[v], vehicle_of[sink] = sink, v
            sink = -1 if v == newcomer else sink_next
    return task_of, pays
