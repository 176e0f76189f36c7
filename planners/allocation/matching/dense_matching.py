"""Matching of a whole cost matrix that is wider than high, fast where there are many more columns than rows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import FloatArray


@njit(cache=True, nogil=True)
def match_all(cost: FloatArray) -> npt.NDArray[np.int64]:
    """The cheapest choice of a column for every row, no column twice.

    Rows are given a column one by one along a shortest augmenting path. A column that no row has yet costs nothing but
    its entries, and ends a path: of those a path needs to know one for each row, the cheapest, which is found anew only
    when another row has taken it. So a step looks at the columns that are taken, of which there are fewer than rows.

    Source: Jonker, Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems",
    Computing 38, 1987, without its reductions before; the cheapest free column of each row is ours.

    Args:
        cost: Finite, shape (n_rows, n_columns), not more rows than columns; read fastest if rows are contiguous.

    Returns:
        Column of each row, shape (n_rows,).
    """
    n_rows, n_columns = cost.shape
    free_of = np.empty(n_rows, dtype=np.int64)  # the cheapest column of a row that is free, once it was
    pays = np.empty(n_rows)
    for row in range(n_rows):
        free_of[row] = _cheapest(cost[row])
        pays[row] = cost[row, free_of[row]]
    # Columns that are taken have places 0, 1, ... in the order in which they were taken first.
    is_taken = np.zeros(n_columns, dtype=np.bool_)
    column_at = np.empty(n_rows, dtype=np.int64)
    row_at = np.empty(n_rows, dtype=np.int64)
    place_of = np.empty(n_rows, dtype=np.int64)
    price = np.zeros(n_rows)
    way = np.empty(n_rows)
    before = np.empty(n_rows, dtype=np.int64)
    done = np.empty(n_rows, dtype=np.bool_)
    for newcomer in range(n_rows):
        n_taken = newcomer
        way[:n_taken], done[:n_taken] = np.inf, False
        row, length = newcomer, 0.0
        shortest, last = np.inf, newcomer
        while True:
            start = length - pays[row]
            if is_taken[free_of[row]]:
                free_of[row] = _cheapest_free(cost[row], is_taken)
            if start + cost[row, free_of[row]] < shortest:
                shortest, last = start + cost[row, free_of[row]], row
            nearest, next_place = np.inf, -1
            for place in range(n_taken):
                if done[place]:
                    continue
                longer = start + cost[row, column_at[place]] - price[place]
                if longer < way[place]:
                    way[place], before[place] = longer, row
                if way[place] < nearest:
                    nearest, next_place = way[place], place
            if next_place < 0 or shortest <= nearest:
                break
            length = nearest
            done[next_place] = True
            row = row_at[next_place]
        pays[newcomer] += shortest
        for place in range(n_taken):
            if done[place]:
                pays[row_at[place]] += shortest - way[place]
                price[place] -= shortest - way[place]
        # The last row of the path takes the free column; each row before it takes what the next one had.
        column_at[n_taken], price[n_taken] = free_of[last], 0.0
        is_taken[free_of[last]] = True
        place, row = n_taken, last
        while True:
            left = place_of[row]
            place_of[row], row_at[place] = place, row
            if row == newcomer:
                break
            place, row = left, before[left]
    return column_at[place_of]


@njit(cache=True, nogil=True, inline="always")
def _cheapest(row: FloatArray) -> int:
    best = 0
    for column in range(1, len(row)):
        if row[column] < row[best]:
            best = column
    return best


@njit(cache=True, nogil=True)
def _cheapest_free(row: FloatArray, is_taken: npt.NDArray[np.bool_]) -> int:
    best, least = -1, np.inf
    for column in range(len(row)):
        if row[column] < least and not is_taken[column]:
            best, least = column, row[column]
    return best
