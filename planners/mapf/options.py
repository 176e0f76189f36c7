"""Options: the cells an agent may aim at from each state, with the turns on the spot that come before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, Int64Array, IntArray


def open_moves(graph: LaneGraph, blocked: BoolArray) -> BoolArray:
    """Which moves enter no blocked cell, shape (n_moves,); leaving a blocked cell is open."""
    counts = np.diff(graph.swept_ptr)
    if not blocked.any():
        return np.ones(len(counts), dtype=np.bool_)
    of_move = np.repeat(np.arange(len(counts)), counts)
    entered = graph.swept_cell != graph.state_cell[graph.move_from][of_move]
    is_open = np.ones(len(counts), dtype=np.bool_)
    is_open[of_move[entered & blocked[graph.swept_cell]]] = False
    return is_open


class Options(NamedTuple):
    """What an agent can aim at: a neighbouring cell, or another state of its own cell.

    Where vehicles turn on the spot, a neighbouring cell may be one or more turns away. An agent that aims there turns
    now and counts as leaving, so that whoever stands in the way learns of it; on all other graphs an option is a move.
    """

    aim: IntArray
    """State that is aimed at, or -1 behind the last option, and its cell; shape (n_states, widest, 2)."""
    start: IntArray
    """State after the first timestep, and timesteps spent turning before the cell is left; shape like `aim`."""
    sweep: IntArray
    """The move, if it touches cells besides its two ends and is made at once; else -1; shape (n_states, widest)."""
    beside_ptr: IntArray
    """Cells that move m touches besides its two ends: beside[beside_ptr[m]:beside_ptr[m + 1]]."""
    beside: IntArray
    has_turns: bool
    """Whether an option of another cell begins with a turn."""
    has_sweeps: bool
    """Whether a move touches cells besides its two ends."""

    @property
    def widest(self) -> int:
        """Most options of a state."""
        return int(self.aim.shape[1])


def options_of(graph: LaneGraph, blocked: BoolArray) -> Options:
    """List the options of every state, those with fewest turns where several lead to the same state.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
    """
    move = np.flatnonzero(open_moves(graph, blocked))
    to_cell = graph.state_cell[graph.move_to]
    leaves = graph.state_cell[graph.move_from[move]] != to_cell[move]
    exits, turns = move[leaves], move[~leaves]

    # Rows (state, first state, state now, turns): agents that turned on the spot, then those that left after it.
    turned = _rows(graph.move_from[turns], graph.move_to[turns], graph.move_to[turns], 1)
    found = [_rows(graph.move_from[exits], graph.move_to[exits], graph.move_to[exits], 0), turned - [0, 0, 0, 1]]
    seen = np.arange(graph.n_states, dtype=np.int64) * (graph.n_states + 1)
    while len(turned):
        seen = np.concatenate((seen, turned[:, 0] * graph.n_states + turned[:, 2]))
        found.append(_extended(turned, exits, graph, turning=False))
        turned = _extended(turned, turns, graph, turning=True)
        pair, at = np.unique(turned[:, 0] * graph.n_states + turned[:, 2], return_index=True)
        turned = turned[at[~np.isin(pair, seen)]]
    rows = np.concatenate(found)
    rows = rows[np.unique(rows[:, 0] * graph.n_states + rows[:, 2], return_index=True)[1]]

    counts = np.bincount(rows[:, 0], minlength=graph.n_states)
    widest = int(counts.max(initial=1))
    place = rows[:, 0], np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    aim = np.full((graph.n_states, widest, 2), -1, dtype=np.int32)
    aim[place] = np.column_stack((rows[:, 2], graph.state_cell[rows[:, 2]]))
    start = np.zeros_like(aim)
    start[place] = rows[:, [1, 3]]
    sweep = np.full((graph.n_states, widest), -1, dtype=np.int32)
    wide = np.diff(graph.swept_ptr) > 2
    if wide.any():
        ends = graph.move_from.astype(np.int64) * graph.n_states + graph.move_to
        order = np.argsort(ends, kind="stable")
        at_once = rows[:, 1] == rows[:, 2]
        made = order[np.searchsorted(ends[order], (rows[:, 0] * graph.n_states + rows[:, 2])[at_once])]
        sweep[place[0][at_once], place[1][at_once]] = np.where(wide[made], made, -1)
    beside_ptr, beside = cells_beside(graph)
    return Options(
        aim=aim,
        start=start,
        sweep=sweep,
        beside_ptr=beside_ptr,
        beside=beside,
        has_turns=bool(rows[:, 3].any()),
        has_sweeps=bool(wide.any()),
    )


def cells_beside(graph: LaneGraph) -> tuple[IntArray, IntArray]:
    """Cells that each move touches besides its two ends, as CSR: of move m those from ptr[m] to ptr[m + 1]."""
    counts = np.diff(graph.swept_ptr)
    of_move = np.repeat(np.arange(len(counts)), counts)
    cell = graph.swept_cell
    aside = (cell != graph.state_cell[graph.move_from[of_move]]) & (cell != graph.state_cell[graph.move_to[of_move]])
    n_beside = np.bincount(of_move[aside], minlength=len(counts))
    return np.concatenate(([0], np.cumsum(n_beside))).astype(np.int32), cell[aside].astype(np.int32)


def _rows(state: IntArray, first: IntArray, now: IntArray, turns: int) -> Int64Array:
    return np.column_stack((state, first, now, np.full(len(state), turns))).astype(np.int64)


def _extended(rows: Int64Array, moves: npt.NDArray[np.intp], graph: LaneGraph, *, turning: bool) -> Int64Array:
    """Every row followed by each of the moves that begin where it ends; `moves` ascend, and so do their from states."""
    begin, end = np.searchsorted(graph.move_from[moves], [rows[:, 2], rows[:, 2] + 1])
    which = np.repeat(np.arange(len(rows)), end - begin)
    offset = np.arange(len(which)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin)
    longer = rows[which].copy()
    longer[:, 2] = graph.move_to[moves[begin[which] + offset]]
    longer[:, 3] += turning
    return longer
