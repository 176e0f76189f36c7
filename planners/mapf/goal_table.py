"""Goal table: cost of the way from every state to a cell, under weighted moves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.mapf.problem import BoolArray, IntArray

Row = npt.NDArray[np.uint16]
FAR = 65535


@njit(cache=True, nogil=True)
def fill_weighted(
    sources: IntArray,
    in_ptr: IntArray,
    in_move: IntArray,
    move_from: IntArray,
    is_open: BoolArray,
    move_cost: IntArray,
    largest: int,
    row: Row,
    bucket: IntArray,
    follow: IntArray,
) -> None:  # pragma: no cover - compiled
    """Dijkstra against the moves with a ring of buckets (Dial 1969); `largest` = greatest move cost."""
    n = len(row)
    row[:] = FAR
    ring = largest + 1
    head = np.full(ring, -1, dtype=np.int32)
    # entries: linked lists over a pool
    pool = 0
    for s in sources:
        row[s] = 0
        bucket[pool] = s
        follow[pool] = head[0]
        head[0] = pool
        pool += 1
    free = -1
    level, empty = 0, 0
    while empty < ring:
        slot = level % ring
        if head[slot] < 0:
            empty += 1
            level += 1
            continue
        empty = 0
        while head[slot] >= 0:
            e = head[slot]
            head[slot] = follow[e]
            state = bucket[e]
            follow[e] = free
            free = e
            if row[state] != level:
                continue
            for k in range(in_ptr[state], in_ptr[state + 1]):
                move = in_move[k]
                if not is_open[move]:
                    continue
                before = move_from[move]
                value = level + move_cost[move]
                if value < row[before]:
                    row[before] = value
                    if free >= 0:
                        e = free
                        free = follow[e]
                    else:
                        e = pool
                        pool += 1
                    bucket[e] = before
                    target = value % ring
                    follow[e] = head[target]
                    head[target] = e
        level += 1
