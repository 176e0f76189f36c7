"""Streets: open rows and columns of a floor, which robots are to drive in alternating directions."""

from __future__ import annotations

import numpy as np

from maps.grid import GridMap
from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.distance_table import MOST_COST

_OPEN = 0.5
"""Share of neighbouring cells of a row or column that are both free, from which on it is a street by itself."""


def street_share(grid: GridMap) -> float:
    """Share of the free cells that lie in a street, 0 to 1; 0 for a floor without free cells."""
    rows, columns = _streets(grid, _OPEN)
    inside = grid.free & (rows[:, None] | columns)
    return float(inside.sum() / max(grid.free.sum(), 1))


def street_costs(grid: GridMap, graph: LaneGraph, *, against: int, open_share: float = _OPEN) -> IntArray:
    """Costs under which robots fall into one-way streets without being forced to.

    The streets of a floor are numbered; robots are to drive east in one and west in the next, north in one column and
    south in the next. A move between two streets belongs to the one before it. Where aisles are as wide as a robot,
    that keeps robots from meeting head-on, which no planner of a few timesteps can undo in a crowd.

    Args:
        grid: The floor.
        graph: Lane graph on it.
        against: Cost of a move against its street; with it, and for turns, 1.
        open_share: Share of neighbouring cells that are both free, from which on a row or column is a street; with 0
            all are.

    Returns:
        Cost of each move, shape (n_moves,).

    Raises:
        PlanningError: `against` is out of range.
    """
    if not 1 <= against <= MOST_COST:
        raise PlanningError(f"street costs: against = {against}; valid: whole numbers from 1 to {MOST_COST}")
    width = grid.free.shape[1]
    row, column = np.divmod(graph.state_cell[graph.move_from], width)
    to_row, to_column = np.divmod(graph.state_cell[graph.move_to], width)
    forward_in_row, forward_in_column = (_forward(streets) for streets in _streets(grid, open_share))
    towards_end = to_column - column + to_row - row > 0
    wanted = np.where(column != to_column, forward_in_row[row], forward_in_column[column])
    turn = graph.state_cell[graph.move_from] == graph.state_cell[graph.move_to]
    return np.where(turn | (towards_end == wanted), 1, against).astype(np.int32)


def _streets(grid: GridMap, open_share: float) -> tuple[BoolArray, BoolArray]:
    """Which rows and which columns are streets."""
    free = grid.free
    across = free[:, 1:] & free[:, :-1]
    along = free[1:] & free[:-1]
    if open_share == 0.0:
        return np.ones(len(free), dtype=np.bool_), np.ones(free.shape[1], dtype=np.bool_)
    least_across, least_along = (max(open_share * n, 1) for n in (across.shape[1], along.shape[0]))
    return across.sum(axis=1) >= least_across, along.sum(axis=0) >= least_along


def _forward(streets: BoolArray) -> BoolArray:
    """Whether each row or column is to be driven towards larger indices."""
    forward: BoolArray = np.asarray((np.cumsum(streets) - streets) % 2 == 0)
    return forward
