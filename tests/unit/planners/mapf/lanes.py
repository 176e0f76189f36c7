"""Small lane graphs and instances that are built by hand for tests of planners and of plan execution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from maps.grid import DCOL, DROW, EAST, NORTH, SOUTH, WEST, GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.problem import NO_GOAL, Instance, Plan


def graph_of(
    state_cell: Sequence[int],
    moves: Sequence[tuple[int, int]],
    *,
    sweeps: Mapping[tuple[int, int], Sequence[int]] | None = None,
    n_cells: int | None = None,
) -> LaneGraph:
    """Lane graph of bare states and moves, without metric paths; a move sweeps its two cells and its `sweeps`."""
    cells = np.array(state_cell, dtype=np.int32)
    ends = np.array(sorted(moves), dtype=np.int32).reshape(-1, 2)
    swept = []
    for a, b in ends.tolist():
        swept.append(list(dict.fromkeys([int(cells[a]), int(cells[b]), *(sweeps or {}).get((a, b), ())])))
    total = int(cells.max()) + 1 if n_cells is None else n_cells

    def rows(key: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        order = np.argsort(key, kind="stable").astype(np.int32)
        return np.searchsorted(key[order], np.arange(len(cells) + 1)).astype(np.int32), order

    out_ptr, out_move = rows(ends[:, 0])
    in_ptr, in_move = rows(ends[:, 1])
    m = len(ends)
    return LaneGraph(
        motion="pebble",
        n_states=len(cells),
        n_cells=total,
        state_cell=cells,
        state_heading=np.zeros(len(cells), dtype=np.int8),
        state_pose=np.zeros((len(cells), 3)),
        state_index=np.full((total, 4), -1, dtype=np.int32),
        move_from=np.ascontiguousarray(ends[:, 0]),
        move_to=np.ascontiguousarray(ends[:, 1]),
        move_kind=np.zeros(m, dtype=np.int8),
        move_length=np.ones(m),
        out_ptr=out_ptr,
        out_move=out_move,
        in_ptr=in_ptr,
        in_move=in_move,
        swept_ptr=np.cumsum([0, *map(len, swept)]).astype(np.int32),
        swept_cell=np.array([cell for cells_ in swept for cell in cells_], dtype=np.int32),
        path_ptr=(2 * np.arange(m + 1)).astype(np.int32),
        path_points=np.zeros((2 * m, 3)),
        path_s=np.zeros(2 * m),
    )


def open_grid(rows: int, cols: int) -> LaneGraph:
    """Two-way grid, one state per cell, state = cell."""
    return grid_lane_graph(GridMap(np.ones((rows, cols), dtype=np.bool_)), "pebble")


def rotating_grid(rows: int, cols: int) -> LaneGraph:
    """Two-way grid of vehicles that turn on the spot, four states per cell."""
    return grid_lane_graph(GridMap(np.ones((rows, cols), dtype=np.bool_)), "rotating")


def one_way_loop(n: int) -> LaneGraph:
    """Cells 0 -> 1 -> ... -> n - 1 -> 0, state = cell."""
    return graph_of(range(n), [(k, (k + 1) % n) for k in range(n)])


def one_way_grid(rows: int, cols: int) -> LaneGraph:
    """Car-like states on alternating one-way rows and columns, both even in number: strongly connected, no U-turn."""
    row_heading = [EAST if row % 2 else WEST for row in range(rows)]
    col_heading = [NORTH if col % 2 else SOUTH for col in range(cols)]
    state_of: dict[tuple[int, int], int] = {}
    cells = []
    for row in range(rows):
        for col in range(cols):
            for heading in (row_heading[row], col_heading[col]):
                if 0 <= row - DROW[heading] < rows and 0 <= col - DCOL[heading] < cols:
                    state_of[row * cols + col, heading] = len(cells)
                    cells.append(row * cols + col)
    moves = []
    for (cell, _), state in state_of.items():
        row, col = divmod(cell, cols)
        for heading in (row_heading[row], col_heading[col]):
            to = row + DROW[heading], col + DCOL[heading]
            if 0 <= to[0] < rows and 0 <= to[1] < cols:
                moves.append((state, state_of[to[0] * cols + to[1], heading]))
    return graph_of(cells, moves)


def king_grid(rows: int, cols: int) -> LaneGraph:
    """Two-way grid with diagonals, state = cell; a diagonal sweeps the two cells beside it too."""
    moves, sweeps = [], {}
    for cell in range(rows * cols):
        row, col = divmod(cell, cols)
        for d_row in (-1, 0, 1):
            for d_col in (-1, 0, 1):
                to_row, to_col = row + d_row, col + d_col
                if (d_row, d_col) != (0, 0) and 0 <= to_row < rows and 0 <= to_col < cols:
                    move = cell, to_row * cols + to_col
                    moves.append(move)
                    if d_row and d_col:
                        sweeps[move] = to_row * cols + col, row * cols + to_col
    return graph_of(range(rows * cols), moves, sweeps=sweeps)


def instance_of(
    graph: LaneGraph,
    starts: Sequence[int],
    goals: Sequence[int] | None = None,
    *,
    priorities: Sequence[float] | None = None,
    stay: Sequence[bool] | None = None,
    fixed: Sequence[bool] | None = None,
    blocked: Sequence[int] = (),
    allow_rotation: bool = False,
    horizon: int = 12,
) -> Instance:
    """Instance with everything that is not said left at its plainest."""
    n = len(starts)
    closed = np.zeros(graph.n_cells, dtype=np.bool_)
    closed[list(blocked)] = True
    return Instance(
        graph=graph,
        starts=np.array(starts, dtype=np.int32),
        goals=np.full(n, NO_GOAL, dtype=np.int32) if goals is None else np.array(goals, dtype=np.int32),
        priorities=np.zeros(n) if priorities is None else np.array(priorities, dtype=np.float64),
        stay=np.zeros(n, dtype=np.bool_) if stay is None else np.array(stay, dtype=np.bool_),
        fixed=np.zeros(n, dtype=np.bool_) if fixed is None else np.array(fixed, dtype=np.bool_),
        blocked=closed,
        allow_rotation=allow_rotation,
        horizon=horizon,
    )


def random_starts(graph: LaneGraph, n: int, rng: np.random.Generator) -> list[int]:
    """States in distinct cells."""
    taken: set[int] = set()
    starts = []
    for state in rng.permutation(graph.n_states).tolist():
        cell = int(graph.state_cell[state])
        if cell not in taken and len(starts) < n:
            taken.add(cell)
            starts.append(state)
    return starts


def reached(instance: Instance, plan: Plan) -> npt.NDArray[np.bool_]:
    """Which agents stand at their goal in some row of the plan, shape (n,); agents without a goal count as there."""
    there: npt.NDArray[np.bool_] = (plan.states == instance.goals).any(axis=0) | (instance.goals == NO_GOAL)
    return there
