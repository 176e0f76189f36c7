"""Reversed lanes: a lane graph some of whose moves may be driven backwards as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from maps.lane_graph import REVERSE, Ints, LaneGraph

Bools = npt.NDArray[np.bool_]
_FlatRows = tuple[npt.NDArray[np.int64], Ints]  # where rows begin, shape (k + 1,); entries to take, shape (n,)


def with_reversed(graph: LaneGraph, moves: Ints, is_open: Bools) -> LaneGraph:
    """Append moves that drive others backwards, from their ends to their beginnings over the same ground.

    The moves there are keep their numbers, so that whoever has some in hand can go on. Those that are appended are not
    in the order of their from states; `in_order` puts all into it.

    Args:
        graph: Without them.
        moves: To be driven backwards, too; number k is move `graph.n_moves + k` of the result, shape (K,).
        is_open: Which of these lead from a state to another; the others are only known by their numbers, shape (K,).

    Returns:
        The graph with them.
    """
    swept_ptr, swept = _rows_reversed(graph.swept_ptr, moves)
    path_ptr, path = _rows_reversed(graph.path_ptr, moves)
    of_path = np.repeat(moves, np.diff(path_ptr))
    longer = replace(
        graph,
        move_from=np.append(graph.move_from, graph.move_to[moves]),
        move_to=np.append(graph.move_to, graph.move_from[moves]),
        move_kind=np.append(graph.move_kind, np.full(len(moves), REVERSE, dtype=np.int8)),
        move_length=np.append(graph.move_length, graph.move_length[moves]),
        swept_ptr=_joined(graph.swept_ptr, swept_ptr),
        swept_cell=np.append(graph.swept_cell, graph.swept_cell[swept]),
        path_ptr=_joined(graph.path_ptr, path_ptr),
        path_points=np.concatenate((graph.path_points, graph.path_points[path])),
        path_s=np.append(graph.path_s, graph.move_length[of_path] - graph.path_s[path]),
    )
    used = np.append(np.ones(graph.n_moves, dtype=np.bool_), is_open)
    return _connected(longer, used)


def in_order(graph: LaneGraph) -> LaneGraph:
    """The same lanes with only those moves that lead somewhere, in the order of their from states, and new numbers."""
    order = graph.out_move
    rows = [_rows_of(ptr, order) for ptr in (graph.swept_ptr, graph.path_ptr)]
    (swept_ptr, swept), (path_ptr, path) = rows
    ordered = replace(
        graph,
        move_from=graph.move_from[order],
        move_to=graph.move_to[order],
        move_kind=graph.move_kind[order],
        move_length=graph.move_length[order],
        swept_ptr=swept_ptr.astype(np.int32),
        swept_cell=graph.swept_cell[swept],
        path_ptr=path_ptr.astype(np.int32),
        path_points=np.ascontiguousarray(graph.path_points[path]),
        path_s=graph.path_s[path],
    )
    return _connected(ordered, np.ones(len(order), dtype=np.bool_))


def both_ways(graph: LaneGraph, blocked: Bools) -> npt.NDArray[np.int64]:
    """Parts of the floor that hang together if every lane may be driven both ways.

    Args:
        graph: The lanes.
        blocked: Cells nobody may enter, shape (n_cells,).

    Returns:
        Number of the part that each state is in, shape (n_states,).
    """
    return _parts(graph, ~_touch(graph, blocked), one_way=False)


def cut_moves(graph: LaneGraph, blocked: Bools) -> Ints:
    """Moves that nothing leads back from past blocked cells, though something did before.

    Where all of them may be driven backwards, whatever hangs together can be reached from everywhere in it: a move
    that a way leads back from lies in one strongly connected part of the lanes, and all others are driven both ways.

    Args:
        graph: The lanes.
        blocked: Cells nobody may enter, shape (n_cells,).

    Returns:
        The moves, ascending, shape (k,).
    """
    is_open = ~_touch(graph, blocked)
    before, now = (_parts(graph, open_now, one_way=True) for open_now in (np.ones_like(is_open), is_open))
    origin, target = graph.move_from, graph.move_to
    cut = is_open & (before[origin] == before[target]) & (now[origin] != now[target])
    return np.flatnonzero(cut).astype(np.int32)


def dead_ends(graph: LaneGraph, blocked: Bools) -> tuple[npt.NDArray[np.int64], ...]:
    """Find the dead ends of a floor, from the outermost inwards.

    The outer ones are all but the largest stretch that can be driven round forwards. Within them there may be smaller
    stretches to drive round in, where cars can pass each other; the inner dead ends are what these leave.

    Args:
        graph: The lanes.
        blocked: Cells nobody may enter, shape (n_cells,).

    Returns:
        Number of the dead end that each state is in, -1 where lanes still go round, shape (n_states,), of the outer
        ones and, if they differ from those, of the inner ones.
    """
    is_open = ~_touch(graph, blocked)
    forwards = is_open & (graph.move_kind != REVERSE)
    part, stretch = _parts(graph, is_open, one_way=False), _parts(graph, forwards, one_way=True)
    size = np.bincount(stretch)[stretch]
    largest = np.zeros(part.max() + 1, dtype=np.int64)
    np.maximum.at(largest, part, size)
    outermost = size == largest[part]
    found = []
    for goes_round in (outermost, outermost | (size > 1)):
        inside = is_open & ~goes_round[graph.move_from] & ~goes_round[graph.move_to]
        found.append(np.where(goes_round, -1, _parts(graph, inside, one_way=False)))
    return tuple(found if (found[1] != found[0]).any() else found[:1])


def _touch(graph: LaneGraph, blocked: Bools) -> Bools:
    """Which moves touch a blocked cell, shape (M,)."""
    touched: Bools = np.logical_or.reduceat(blocked[graph.swept_cell], graph.swept_ptr[:-1])
    return touched


def _parts(graph: LaneGraph, is_open: Bools, *, one_way: bool) -> npt.NDArray[np.int64]:
    moves = _matrix(graph, is_open)
    labels: npt.NDArray[np.int64] = connected_components(moves, directed=one_way, connection="strong")[1]
    return labels.astype(np.int64)


def _matrix(graph: LaneGraph, is_open: Bools) -> csr_array:
    """Which state open moves lead to from which."""
    used = graph.out_move[is_open[graph.out_move]]
    shape = (graph.n_states, graph.n_states)
    return csr_array((np.ones(len(used)), (graph.move_from[used], graph.move_to[used])), shape=shape)


def _rows_of(ptr: Ints, which: Ints) -> _FlatRows:
    """Entries of some rows of compressed rows."""
    counts = np.diff(ptr)[which]
    begins = np.concatenate(([0], np.cumsum(counts)))
    entries = np.arange(begins[-1]) - np.repeat(begins[:-1] - ptr[which], counts)
    return begins, entries.astype(np.int32)


def _rows_reversed(ptr: Ints, which: Ints) -> _FlatRows:
    """The same, those of each row from its end to its beginning."""
    begins, entries = _rows_of(ptr, which)
    counts = np.diff(begins)
    row = np.repeat(np.arange(len(which)), counts)
    return begins, entries[begins[row] + begins[row + 1] - 1 - np.arange(len(entries))]


def _joined(ptr: Ints, more: npt.NDArray[np.int64]) -> Ints:
    return np.append(ptr, ptr[-1] + more[1:]).astype(np.int32)


def _connected(graph: LaneGraph, used: Bools) -> LaneGraph:
    """The graph in which some moves lead from state to state, in the order of their numbers, and the others do not."""
    moves = np.flatnonzero(used).astype(np.int32)
    rows = []
    for ends in (graph.move_from, graph.move_to):
        order = moves[np.argsort(ends[moves], kind="stable")]
        counts = np.bincount(ends[moves], minlength=graph.n_states)
        rows += [np.concatenate(([0], np.cumsum(counts))).astype(np.int32), order]
    out_ptr, out_move, in_ptr, in_move = rows
    return replace(graph, out_ptr=out_ptr, out_move=out_move, in_ptr=in_ptr, in_move=in_move)
