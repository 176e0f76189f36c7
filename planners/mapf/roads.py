"""Roads: the open moves of a lane graph as flat arrays of successor states, the form in which the kernels read it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.options import Options, open_moves
from planners.mapf.problem import Instance


class Roads(NamedTuple):
    """Moves that enter no blocked cell; cells are numbered anew, without those no vehicle ever touches."""

    ptr: IntArray
    """Moves that leave state s: ptr[s] .. ptr[s + 1], shape (n_states + 1,)."""
    to: IntArray
    """State a move leads to, shape (n_open_moves,)."""
    cell: IntArray
    """Cell of each state, shape (n_states,)."""
    beside_ptr: IntArray
    """Cells that move k sweeps besides its two ends: beside[beside_ptr[k]:beside_ptr[k + 1]]."""
    beside: IntArray
    n_cells: int
    two_way: bool
    """Every cell has one state, and whoever drives somewhere can drive back: vehicles can trade places."""


def closed_cells(instance: Instance) -> BoolArray:
    """Cells nobody can enter: blocked ones, and those of agents that do not move, shape (n_cells,)."""
    closed = np.array(instance.blocked)
    closed[instance.graph.state_cell[instance.starts[instance.fixed]]] = True
    return closed


def roads_of(graph: LaneGraph, blocked: BoolArray) -> Roads:
    """Read a lane graph.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
    """
    is_open = open_moves(graph, blocked)
    moves = graph.out_move[is_open[graph.out_move]]
    origin, target = graph.move_from[moves], graph.move_to[moves]
    used, number = np.unique(np.concatenate((graph.state_cell, graph.swept_cell)), return_inverse=True)
    cell = number[: graph.n_states].astype(np.int32)
    swept = number[graph.n_states :]

    length = np.diff(graph.swept_ptr)
    of_move = np.repeat(np.arange(len(length)), length)
    aside = (swept != cell[graph.move_from[of_move]]) & (swept != cell[graph.move_to[of_move]])
    n_beside = np.bincount(of_move[aside], minlength=len(length))
    first = np.concatenate(([0], np.cumsum(n_beside)))
    parts = [swept[aside][first[move] : first[move + 1]] for move in moves[n_beside[moves] > 0]]

    ends = origin.astype(np.int64) * graph.n_states + target
    back = target.astype(np.int64) * graph.n_states + origin
    return Roads(
        ptr=_pointers(np.bincount(origin, minlength=graph.n_states)),
        to=target,
        cell=cell,
        beside_ptr=_pointers(n_beside[moves]),
        beside=np.concatenate([np.empty(0, dtype=np.int32), *parts]).astype(np.int32),
        n_cells=len(used),
        two_way=len(np.unique(cell)) == len(cell) and bool(np.isin(back, ends).all()),
    )


def options_of_roads(roads: Roads) -> Options:
    """The roads that leave each state as its options, in their order; a turn on the spot is one like any other."""
    counts = np.diff(roads.ptr)
    move = np.arange(len(roads.to), dtype=np.int32)
    place = np.arange(len(counts)).repeat(counts), move - roads.ptr[:-1].repeat(counts)
    aim = np.full((len(counts), int(counts.max(initial=1)), 2), -1, dtype=np.int32)
    aim[place] = np.column_stack((roads.to, roads.cell[roads.to]))
    sweep = np.full(aim.shape[:2], -1, dtype=np.int32)
    sweep[place] = np.where(np.diff(roads.beside_ptr) > 0, move, np.int32(-1))
    return Options(
        aim=aim,
        start=np.zeros((0, 0, 2), dtype=np.int32),  # not read where nothing begins with a turn
        sweep=sweep,
        beside_ptr=roads.beside_ptr,
        beside=roads.beside,
        has_turns=False,
        has_sweeps=len(roads.beside) > 0,
    )


def _pointers(counts: np.typing.NDArray[np.int64]) -> IntArray:
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
