"""Lanes: the arrays of a lane graph that searches read, as kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, IntArray


class Lanes(NamedTuple):
    """A lane graph of S states and M moves, as CSR from states to moves and from moves to cells."""

    out_ptr: IntArray
    """Moves that leave state s: out_move[out_ptr[s]:out_ptr[s + 1]], shape (S + 1,)."""
    out_move: IntArray
    move_to: IntArray
    """State that each move leads to, shape (M,)."""
    state_cell: IntArray
    """Cell of each state, shape (S,)."""
    swept_ptr: IntArray
    """Cells that move m touches: swept_cell[swept_ptr[m]:swept_ptr[m + 1]], shape (M + 1,)."""
    swept_cell: IntArray
    is_open: BoolArray
    """Moves that may be used, shape (M,)."""


def lanes_of(graph: LaneGraph, is_open: BoolArray) -> Lanes:
    """The arrays of a graph.

    Args:
        graph: Lane graph.
        is_open: Moves that may be used, shape (M,).
    """
    return Lanes(
        out_ptr=graph.out_ptr,
        out_move=graph.out_move,
        move_to=graph.move_to,
        state_cell=graph.state_cell,
        swept_ptr=graph.swept_ptr,
        swept_cell=graph.swept_cell,
        is_open=is_open,
    )
