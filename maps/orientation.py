"""Lane directions: every lane between two cells gets one direction, so that cars that cannot turn never meet head-on.

Aisles and cross-aisles alternate, as streets of a grid city do; a few lanes are then reversed until every cell reaches
every other. Alternating keeps mean paths near 1.3 times the two-way ones; a depth-first orientation gives 3 times.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from maps.grid import BoolGrid, GridMap
from maps.plan import FloorPlan

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

_REVERSAL_COST = 1000.0
"""Reversing one lane counts as much as a detour of so many cells when a disconnected part is joined."""
_REPAIR_ROUNDS = 5
_LOOK_BACK_LINES = 12
"""How many rows (columns) back a comparable aisle is looked for."""
_LARGE_N_EDGES = 40_000
"""Above so many edges candidates are compared by fewer paths, to stay within seconds."""
_LARGE_SOURCES = 4
_WAY_ROUND_CELLS = 3
"""A way round a dock is looked for among the lanes this near to it."""
_MAX_VISITS = 4_000_000
"""Path lengths of a large floor are averaged from fewer cells, which see so many cells together."""
_SAMPLE_SOURCES = 64
"""Path lengths are averaged from at most so many evenly spread cells while candidates are compared."""


@dataclass(frozen=True, kw_only=True)
class Orientation:
    """Directed lanes of a floor plan."""

    lanes: npt.NDArray[np.int32]
    """(from cell, to cell), shape (n_lanes, 2), sorted."""
    against: npt.NDArray[np.int32]
    """Those of two-way lanes that lead against the street: where two-way lanes could be made one-way, they would lead
    the other way, shape (k, 2), sorted."""
    cut_cells: tuple[int, ...]
    """Open cells outside the strongly connected part: no lane touches them."""


@dataclass(frozen=True, kw_only=True)
class PathLengths:
    """Mean shortest path between two drivable cells [cells]."""

    one_way: float
    two_way: float

    @property
    def ratio(self) -> float:
        """Price of one-way lanes: mean one-way path over mean two-way path."""
        return self.one_way / self.two_way if self.two_way else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Edges:
    """Edges between neighbouring cells: tail (west or north end), head (east or south end), one row per edge."""

    tail: Ints
    head: Ints
    horizontal: Bools
    sign: npt.NDArray[np.int8]
    """+1 the lane runs tail to head, -1 the other way; 0 still open."""
    fixed: Bools
    """The plan gives the direction."""
    both: Bools
    """Two-way: lanes run both ways."""

    def select(self, keep: Bools) -> _Edges:
        return _Edges(**{name: getattr(self, name)[keep] for name in self.__dataclass_fields__})

    def arcs(self, sign: npt.NDArray[np.int8]) -> tuple[Ints, Ints]:
        """Start and end of every lane if the edges had these signs."""
        start = np.where(sign > 0, self.tail, self.head)
        end = np.where(sign > 0, self.head, self.tail)
        return np.concatenate((start, end[self.both])), np.concatenate((end, start[self.both]))


def orient_lanes(
    plan: FloorPlan, arm_sides: dict[int, tuple[int, ...]], ways: npt.NDArray[np.int32] | None = None
) -> Orientation:
    """Give every lane of a plan a direction.

    An arrow fixes the lanes along its own axis; lanes across it are derived like those of plain floor. A bay (dock,
    parking, charger) keeps one entry and one exit, straight through where possible, so that no bay is a dead end and
    no car turns beside an arm. Strong connectivity: lanes are reversed along cheapest joining paths and the set of
    reversals is then made minimal; a minimal such set (a dijoin) leaves a bridgeless graph strongly connected.

    Args:
        plan: The drawing.
        arm_sides: For each dock cell the headings in which its arms lie; its lane runs perpendicular to them.
        ways: Where lanes may lead (from cell, to cell), shape (n, 2): one of which there is the opposite, too, is given
            a direction, the others keep theirs. None = between any two open neighbours.

    Source: C. L. Lucchesi and D. H. Younger, A minimax theorem for directed graphs, J. London Math. Soc. 1978; the
        reversal property: A. Frank, How to make a digraph strongly connected, Combinatorica 1981.
    """
    grid = GridMap(plan.open)
    arm_side = {cell: sides[0] for cell, sides in arm_sides.items()}
    drawn = _edges_of(plan) if ways is None else _edges_along(ways, grid, two_way=False)
    edges = _two_edge_connected(_pruned_at_bays(drawn, plan, grid, arm_side), grid)
    if len(edges.tail) == 0:
        none = np.empty((0, 2), dtype=np.int32)
        return Orientation(lanes=none, against=none, cut_cells=tuple(plan.cells(_open_characters(plan))))

    best: tuple[tuple[int, float], _Edges] | None = None
    starts = _alternating_starts(edges, grid)
    n_sources = _SAMPLE_SOURCES if len(edges.tail) <= _LARGE_N_EDGES else _LARGE_SOURCES
    for signs in starts:
        repaired = _repaired(replace(edges, sign=signs), grid.n_cells)
        candidate = _strong_part(repaired, grid.n_cells)
        if len(candidate.tail) == 0:
            continue
        kept = np.unique(np.concatenate((candidate.tail, candidate.head)))
        rank = (-len(kept), _mean_path(*candidate.arcs(candidate.sign), kept, n_sources))
        if best is None or rank < best[0]:
            best = rank, candidate
    lanes = against = np.empty((0, 2), dtype=np.int32)
    if best is not None:
        chosen = _with_ways_round(best[1], sorted(arm_side), np.flatnonzero(plan.bays.ravel()), grid)
        lanes = _sorted(*chosen.arcs(chosen.sign))
        if chosen.both.any():
            against = _sorted(*_against_streets(chosen, grid))
    cut = plan.open.ravel().copy()
    cut[lanes.ravel()] = False
    return Orientation(lanes=lanes, against=against, cut_cells=tuple(int(cell) for cell in np.flatnonzero(cut)))


def given_lanes(plan: FloorPlan, lanes: npt.NDArray[np.int32]) -> Orientation:
    """The orientation of a plan whose lanes are known: nothing but the streets of two-way aisles is derived.

    Args:
        plan: The drawing.
        lanes: Directed lanes (from cell, to cell) between open cells, shape (n, 2).
    """
    grid = GridMap(plan.open)
    edges = _edges_along(lanes, grid, two_way=True)
    against = np.empty((0, 2), dtype=np.int32)
    if edges.both.any():
        against = _sorted(*_against_streets(replace(edges, sign=_alternating_starts(edges, grid)[0]), grid))
    cut = plan.open.ravel().copy()
    cut[lanes.ravel()] = False
    start, end = lanes.T.astype(np.int64)
    return Orientation(
        lanes=_sorted(start, end), against=against, cut_cells=tuple(int(cell) for cell in np.flatnonzero(cut))
    )


def weakly_joined(lanes: npt.NDArray[np.int32]) -> Ints:
    """Cells from which, or to which, the lanes do not lead from and to all of the largest part, ascending."""
    start, end = lanes.T.astype(np.int64)
    cells = np.unique(lanes).astype(np.int64)
    return cells[~_largest_part(start, end, strong=True)[cells]]


def path_lengths(lanes: npt.NDArray[np.int32], grid: GridMap, *, max_sources: int = 256) -> PathLengths:
    """Mean path over the lanes, and over the same cells if every neighbouring pair were connected both ways.

    Args:
        lanes: Directed lanes (from cell, to cell), shape (n, 2), strongly connected.
        grid: The floor the cells belong to.
        max_sources: Paths start from at most so many evenly spread cells, on floors above 15,000 cells from fewer; all
            cells are used below that number.
    """
    if len(lanes) == 0:
        return PathLengths(one_way=0.0, two_way=0.0)
    kept = np.unique(lanes).astype(np.int64)
    max_sources = min(max_sources, max(_MAX_VISITS // len(kept), 1))
    one_way = _mean_path(lanes[:, 0].astype(np.int64), lanes[:, 1].astype(np.int64), kept, max_sources)
    present = np.zeros(grid.n_cells, dtype=np.bool_)
    present[kept] = True
    tail, head, _ = _neighbour_pairs(present.reshape(grid.rows, grid.cols))
    two_way = _mean_path(np.concatenate((tail, head)), np.concatenate((head, tail)), kept, max_sources)
    return PathLengths(one_way=one_way, two_way=two_way)


def n_separated(start: Ints, end: Ints, cell: int, places: Ints) -> int:
    """How many other places fall out of the largest strongly connected part when a car stands in a cell.

    Args:
        start: First cell of every lane, shape (n_lanes,).
        end: Second cell of every lane, shape (n_lanes,).
        cell: Where the car stands.
        places: Cells cars want to go to, shape (n_places,).
    """
    rest = (start != cell) & (end != cell)
    n_cells = int(max(start.max(), end.max(), places.max())) + 1
    part = _largest_part(start[rest], end[rest], strong=True, n_cells=n_cells)
    return int((~part[places]).sum()) - int((places == cell).sum())


def separating(start: Ints, end: Ints, places: Sequence[int]) -> list[int]:
    """Places at which a standing car may keep others from other places: `n_separated` is 0 for all the rest.

    A car blocks its cell, and with it the cells that lead nowhere else or that nothing else leads to. None of them is
    needed if the cells before them lead to those behind by other ways. These are short as a rule, so that a look at
    each place takes a small part of what `n_separated` takes.

    Args:
        start: First cell of every lane, shape (n_lanes,).
        end: Second cell of every lane, shape (n_lanes,); all lanes strongly connected.
        places: Cells cars want to go to.
    """
    n_cells = int(max(start.max(initial=-1), end.max(initial=-1), *places, -1)) + 1
    onward, back = _Neighbours.of(start, end, n_cells), _Neighbours.of(end, start, n_cells)
    wanted = set(places)
    found = []
    for place in places:
        closed = {place}
        first = _end_of_blocked(place, back, onward, wanted, closed)
        last = _end_of_blocked(place, onward, back, wanted, closed)
        if not all(_leads(onward, cell, onward[last], closed) for cell in back[first]):
            found.append(place)
    return found


@dataclass(frozen=True)
class _Neighbours:
    """Where the lanes from each cell lead, or where those to it come from; lists, on which small looks are fast."""

    bounds: list[int]
    cells: list[int]

    @classmethod
    def of(cls, start: Ints, end: Ints, n_cells: int) -> _Neighbours:
        order = np.argsort(start, kind="stable")
        bounds = np.searchsorted(start[order], np.arange(n_cells + 1))
        return cls(bounds.tolist(), end[order].tolist())

    def __getitem__(self, cell: int) -> list[int]:
        return self.cells[self.bounds[cell] : self.bounds[cell + 1]]


def _end_of_blocked(cell: int, onward: _Neighbours, back: _Neighbours, wanted: set[int], closed: set[int]) -> int:
    """The last of the cells that are of no use when a cell is blocked, on one side of it; adds them to the closed."""
    while len(following := onward[cell]) == 1 and len(back[following[0]]) == 1:
        if following[0] in wanted or following[0] in closed:
            break
        cell = following[0]
        closed.add(cell)
    return cell


def _leads(onward: _Neighbours, first: int, goals: list[int], closed: set[int]) -> bool:
    """Whether lanes lead from a cell to all of some others, never through closed ones."""
    # A cell that is also a goal has to lead back to itself: on a ring without the closed part it does not.
    missing, seen, frontier = set(goals), set(closed), [first]
    while missing and frontier:
        following = []
        for cell in frontier:
            for other in onward[cell]:
                if other not in seen:
                    seen.add(other)
                    following.append(other)
                    missing.discard(other)
        frontier = following
    return not missing


def _open_characters(plan: FloorPlan) -> str:
    return "".join(np.unique(plan.chars[plan.open]))


def _neighbour_pairs(present: BoolGrid) -> tuple[Ints, Ints, Bools]:
    """West-east and north-south pairs of present neighbours: tail, head, horizontal."""
    cols = present.shape[1]
    row, col = np.nonzero(present[:, :-1] & present[:, 1:])
    west = row * cols + col
    row, col = np.nonzero(present[:-1] & present[1:])
    north = row * cols + col
    tail = np.concatenate((west, north))
    head = np.concatenate((west + 1, north + cols))
    return tail, head, np.arange(len(tail)) < len(west)


def _edges_of(plan: FloorPlan) -> _Edges:
    """All edges of a plan with the directions its arrows give; edges with contradicting arrows are left out."""
    tail, head, horizontal = _neighbour_pairs(plan.open)
    arrows = plan.arrows.ravel()
    # Value of an arrow for an edge of its own axis: east and south run tail to head.
    along_row = np.array([1, 0, -1, 0, 0], dtype=np.int8)
    along_col = np.array([0, -1, 0, 1, 0], dtype=np.int8)
    at_tail = np.where(horizontal, along_row[arrows[tail]], along_col[arrows[tail]])
    at_head = np.where(horizontal, along_row[arrows[head]], along_col[arrows[head]])
    sign = np.where(at_tail != 0, at_tail, at_head).astype(np.int8)
    contradicting = at_tail * at_head < 0
    two_way = plan.mask("x").ravel()
    both = (two_way[tail] | two_way[head]) & (sign == 0)
    edges = _Edges(tail=tail, head=head, horizontal=horizontal, sign=sign, fixed=sign != 0, both=both)
    return edges.select(~contradicting)


def _edges_along(ways: npt.NDArray[np.int32], grid: GridMap, *, two_way: bool) -> _Edges:
    """Edges under given lanes; of lanes that lead both ways, either both are meant or the direction is open."""
    low, high = ways.min(axis=1).astype(np.int64), ways.max(axis=1).astype(np.int64)
    forward = ways[:, 0] < ways[:, 1]
    pairs, number = np.unique(np.column_stack((low, high)), axis=0, return_inverse=True)
    onward = np.bincount(number.ravel()[forward], minlength=len(pairs)) > 0
    back = np.bincount(number.ravel()[~forward], minlength=len(pairs)) > 0
    sign = onward.astype(np.int8) - back.astype(np.int8)
    tail, head = pairs.reshape(-1, 2).T
    both = onward & back & two_way
    return _Edges(tail=tail, head=head, horizontal=head - tail != grid.cols, sign=sign, fixed=sign != 0, both=both)


def _pruned_at_bays(edges: _Edges, plan: FloorPlan, grid: GridMap, arm_side: dict[int, int]) -> _Edges:
    """Leave every bay two edges, one in and one out; where the entry is certain its direction becomes fixed."""
    bays = plan.bays.ravel()
    beside = np.flatnonzero(bays[edges.tail] | bays[edges.head])
    ends = zip(edges.tail[beside].tolist(), edges.head[beside].tolist(), strict=True)
    at = dict(zip(ends, beside.tolist(), strict=True))
    keep = np.ones(len(edges.tail), dtype=np.bool_)
    sign, fixed = edges.sign.copy(), edges.fixed.copy()
    done: set[int] = set()

    def edge(cell: int, heading: int) -> int:
        """Number of the edge that leaves a cell in a heading, -1 if there is none (any more)."""
        other = grid.neighbour(cell, heading)
        number = at.get((min(cell, other), max(cell, other)), -1) if other >= 0 else -1
        return number if number >= 0 and keep[number] else -1

    def outward(cell: int, number: int) -> int:
        """+1 the edge must leave the cell, -1 it must enter, 0 open."""
        return int(sign[number]) * (1 if edges.tail[number] == cell else -1)

    def worth(cell: int, pair: tuple[int, int]) -> float:
        """How well two headings serve as the way through a bay."""
        score = 2.0 if (pair[0] + 2) % 4 == pair[1] else 0.0
        for heading in pair:
            number, other = edge(cell, heading), grid.neighbour(cell, heading)
            score += 4.0 * (sign[number] != 0) + (3.0 if not bays[other] else 8.0 * (other in done))
        return score

    cells = [*arm_side, *(cell for cell in map(int, np.flatnonzero(bays)) if cell not in arm_side)]
    for cell in cells:
        sides = [heading for heading in range(4) if edge(cell, heading) >= 0]
        pairs = [(a, b) for a in sides for b in sides if a < b]
        if cell in arm_side:
            axis = {(arm_side[cell] + 1) % 4, (arm_side[cell] + 3) % 4}
            pairs = [pair for pair in pairs if axis & set(pair)]
        # One of the two must be able to enter and the other to leave.
        pairs = [p for p in pairs if outward(cell, edge(cell, p[0])) * outward(cell, edge(cell, p[1])) <= 0]
        chosen = max(pairs, key=lambda pair: worth(cell, pair), default=None)
        kept = set() if chosen is None else {edge(cell, heading) for heading in chosen}
        if chosen is not None and cell in arm_side and not axis >= set(chosen):
            # The car must arrive along the arm's front, so the one edge on the axis is the entry.
            for heading in chosen:
                number = edge(cell, heading)
                leaves = heading not in axis
                sign[number] = 1 if (edges.tail[number] == cell) == leaves else -1
                fixed[number] = True
        for heading in sides:
            if edge(cell, heading) not in kept:
                keep[edge(cell, heading)] = False
        done.add(cell)
    return replace(edges, sign=sign, fixed=fixed, both=edges.both & ~fixed).select(keep)


def _two_edge_connected(edges: _Edges, grid: GridMap) -> _Edges:
    """The largest part that stays connected when any one edge is taken out: only that can be made one-way."""
    edges = edges.select(~_bridges(edges, grid) | edges.both)
    if len(edges.tail) == 0:
        return edges
    part = _largest_part(edges.tail, edges.head, strong=False, n_cells=grid.n_cells)
    return edges.select(part[edges.tail])


def _bridges(edges: _Edges, grid: GridMap) -> Bools:
    """Which edges cut the floor in two when they are taken out: those that have the same face on both sides.

    A face is a set of cells' corners that are joined where no edge passes between two of them.
    """
    # The edge between two cells side by side passes between the corners above and below their border.
    across = np.ones((grid.rows, grid.cols + 1), dtype=np.bool_)
    down = np.ones((grid.rows + 1, grid.cols), dtype=np.bool_)
    row, col = np.divmod(edges.tail, grid.cols)
    side = edges.horizontal
    across[row[side], col[side] + 1] = False
    down[row[~side] + 1, col[~side]] = False
    corner = np.arange((grid.rows + 1) * (grid.cols + 1)).reshape(grid.rows + 1, grid.cols + 1)
    start = np.concatenate((corner[:-1][across], corner[:, :-1][down]))
    end = np.concatenate((corner[1:][across], corner[:, 1:][down]))
    face = connected_components(_graph(start, end, corner.size), directed=False)[1].reshape(corner.shape)
    one = np.where(side, face[row, col + 1], face[row + 1, col])
    return np.asarray(one == face[row + 1, col + 1])


def _alternating_starts(edges: _Edges, grid: GridMap) -> list[npt.NDArray[np.int8]]:
    """First guesses: directions alternate from aisle to aisle (or from line to line), cross-aisles in both phases."""
    starts = []
    for by_aisle in (True, False):
        rows = _line_signs(edges, grid, horizontal=True, by_aisle=by_aisle)
        columns = _line_signs(edges, grid, horizontal=False, by_aisle=by_aisle)
        # Turning every lane round changes nothing unless arrows fix some, so two phases are enough without arrows.
        for row_phase in (1, -1) if edges.fixed.any() else (1,):
            for column_phase in (1, -1):
                guess = np.where(edges.horizontal, rows * row_phase, columns * column_phase).astype(np.int8)
                starts.append(np.where(edges.fixed, edges.sign, guess).astype(np.int8))
    return starts


def _line_signs(edges: _Edges, grid: GridMap, *, horizontal: bool, by_aisle: bool) -> npt.NDArray[np.int8]:
    """One sign per straight run of edges: opposite to the nearest comparable run before it, or by line parity.

    Comparable runs overlap by at least half of the longer one, so a long aisle is set against the next long aisle
    and not against a stub beside a shelf.
    """
    sign = np.zeros(len(edges.tail), dtype=np.int8)
    members = np.flatnonzero(edges.horizontal == horizontal)
    if len(members) == 0:
        return sign
    row, col = np.divmod(edges.tail[members], grid.cols)
    line, position = (row, col) if horizontal else (col, row)
    order = np.lexsort((position, line))
    members, line, position = members[order], line[order], position[order]
    breaks = np.flatnonzero((np.diff(line) != 0) | (np.diff(position) != 1)) + 1
    bounds = [0, *breaks.tolist(), len(members)]
    runs_of_line: dict[int, list[tuple[int, int, int]]] = {}
    for first, last in pairwise(bounds):
        number, begin, end = int(line[first]), int(position[first]), int(position[last - 1]) + 1
        direction = 1 if number % 2 else -1
        given = int(edges.sign[members[first:last]].sum())
        if given:
            direction = 1 if given > 0 else -1
        elif by_aisle:
            direction = _against_previous(runs_of_line, number, begin, end, direction)
        runs_of_line.setdefault(number, []).append((begin, end, direction))
        sign[members[first:last]] = direction
    return sign


def _against_previous(
    runs_of_line: dict[int, list[tuple[int, int, int]]], line: int, begin: int, end: int, otherwise: int
) -> int:
    for before in range(line - 1, line - 1 - _LOOK_BACK_LINES, -1):
        runs = runs_of_line.get(before, [])
        for other_begin, other_end, direction in runs[bisect_right(runs, begin, key=itemgetter(1)) :]:
            if other_begin >= end:
                break
            overlap = min(end, other_end) - max(begin, other_begin)
            if 2 * overlap >= max(end - begin, other_end - other_begin):
                return -direction
    return otherwise


def _repaired(edges: _Edges, n_cells: int) -> _Edges:
    """Reverse as few lanes as found necessary for strong connectivity; parts that fixed lanes keep apart stay apart."""
    present = np.unique(np.concatenate((edges.tail, edges.head)))
    compact = np.full(n_cells, -1, dtype=np.int64)
    compact[present] = np.arange(len(present))
    small = replace(edges, tail=compact[edges.tail], head=compact[edges.head])
    n = len(present)
    sign = small.sign
    free = ~small.fixed & ~small.both
    for _ in range(_REPAIR_ROUNDS):
        start, end = small.arcs(sign)
        if _n_strong(start, end, n) == 1:
            break
        reversals = _joining_reversals(small, sign, free, n)
        if len(reversals) == 0:
            break
        needed = _minimal(reversals, start, end, n)
        sign = sign.copy()
        sign[needed] *= -1
    return replace(edges, sign=sign)


def _joining_reversals(edges: _Edges, sign: npt.NDArray[np.int8], free: Bools, n: int) -> Ints:
    """Edges to open for the other direction so that a root cell reaches all and is reached from all."""
    start, end = edges.arcs(sign)
    root = int(np.argmax(_largest_part(start, end, strong=True, n_cells=n)))
    back_start, back_end = end[: len(sign)][free], start[: len(sign)][free]
    weight = np.concatenate((np.ones(len(start)), np.full(len(back_start), _REVERSAL_COST)))
    tails, heads = np.concatenate((start, back_start)), np.concatenate((end, back_end))
    back = zip(back_start.tolist(), back_end.tolist(), strict=True)
    number_of = dict(zip(back, np.flatnonzero(free).tolist(), strict=True))
    opened: set[int] = set()
    for outward in (True, False):
        graph = csr_array((weight, (tails, heads) if outward else (heads, tails)), shape=(n, n))
        parent = dijkstra(graph, indices=root, return_predecessors=True)[1]
        for child in np.flatnonzero(parent >= 0).tolist():
            arc = (int(parent[child]), child) if outward else (child, int(parent[child]))
            if arc in number_of:
                opened.add(number_of[arc])
    return np.array(sorted(opened), dtype=np.int64)


def _minimal(opened: Ints, start: Ints, end: Ints, n: int) -> Ints:
    """Drop opened edges, in halving blocks, while the number of strongly connected parts stays the same."""
    target = _n_strong(*_with_opened(opened, start, end), n)
    kept = opened
    pending = [opened]
    while pending:
        block = pending.pop()
        without = kept[~np.isin(kept, block)]
        if _n_strong(*_with_opened(without, start, end), n) == target:
            kept = without
        elif len(block) > 1:
            half = len(block) // 2
            pending += [block[:half], block[half:]]
    return kept


def _with_opened(opened: Ints, start: Ints, end: Ints) -> tuple[Ints, Ints]:
    return np.concatenate((start, end[opened])), np.concatenate((end, start[opened]))


def _with_ways_round(edges: _Edges, docks: list[int], places: Ints, grid: GridMap) -> _Edges:
    """Reverse single lanes near a dock where that gives cars a way round it to the other docks and bays."""
    free = ~edges.fixed & ~edges.both
    row, col = grid.row_col(edges.tail)

    def n_blocked(sign: npt.NDArray[np.int8]) -> int:
        start, end = edges.arcs(sign)
        return sum(n_separated(start, end, dock, places) for dock in separating(start, end, docks))

    sign = edges.sign
    blocked = n_blocked(sign)
    for dock in docks:
        if blocked == 0:
            break
        if n_separated(*edges.arcs(sign), dock, places) == 0:
            continue
        dock_row, dock_col = grid.row_col(dock)
        near = abs(row - dock_row) + abs(col - dock_col) <= _WAY_ROUND_CELLS
        for number in np.flatnonzero(near & free).tolist():
            trial = sign.copy()
            trial[number] *= -1
            candidate = replace(edges, sign=trial)
            if len(_strong_part(candidate, grid.n_cells).tail) == len(edges.tail) and n_blocked(trial) < blocked:
                sign, blocked = trial, n_blocked(trial)
                if n_separated(*edges.arcs(sign), dock, places) == 0:
                    break
    return replace(edges, sign=sign)


def _against_streets(edges: _Edges, grid: GridMap) -> tuple[Ints, Ints]:
    """Start and end of the lanes of two-way edges that a one-way drawing would not have.

    Only a bridge has to stay two-way; all else keeps the directions of the alternating guess, repaired like that of
    one-way lanes.

    Source: F. Boesch and R. Tindell, Robbins's theorem for mixed multigraphs, Amer. Math. Monthly 87(9), 1980.
    """
    streets = edges.both & ~_bridges(edges, grid)
    sign = _repaired(replace(edges, both=edges.both & ~streets), grid.n_cells).sign[streets]
    tail, head = edges.tail[streets], edges.head[streets]
    return np.where(sign > 0, head, tail), np.where(sign > 0, tail, head)


def _sorted(start: Ints, end: Ints) -> npt.NDArray[np.int32]:
    """Lanes (from cell, to cell), shape (n, 2), sorted."""
    order = np.lexsort((end, start))
    return np.column_stack((start, end))[order].astype(np.int32)


def _strong_part(edges: _Edges, n_cells: int) -> _Edges:
    """Edges inside the largest strongly connected part."""
    start, end = edges.arcs(edges.sign)
    part = _largest_part(start, end, strong=True, n_cells=n_cells)
    return edges.select(part[edges.tail] & part[edges.head])


def _graph(start: Ints, end: Ints, n: int) -> Any:
    return csr_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))


def _n_strong(start: Ints, end: Ints, n: int) -> int:
    return int(connected_components(_graph(start, end, n), directed=True, connection="strong")[0])


def _largest_part(start: Ints, end: Ints, *, strong: bool, n_cells: int | None = None) -> Bools:
    """Membership in the largest (strongly) connected part, one flag per cell; ties go to the lowest cell."""
    n = n_cells if n_cells is not None else int(max(start.max(initial=-1), end.max(initial=-1))) + 1
    _, label = connected_components(_graph(start, end, n), directed=True, connection="strong" if strong else "weak")
    size = np.bincount(label)
    first = np.full(len(size), n)
    np.minimum.at(first, label, np.arange(n))
    largest = int(np.lexsort((first, -size))[0])
    return np.asarray(label == largest)


def _mean_path(start: Ints, end: Ints, kept: Ints, max_sources: int) -> float:
    """Mean number of lanes of the shortest path from evenly spread cells to every other cell."""
    compact = np.full(int(kept[-1]) + 1, -1, dtype=np.int64)
    compact[kept] = np.arange(len(kept))
    n = len(kept)
    sources = np.unique(np.linspace(0, n - 1, min(n, max_sources)).round().astype(np.int64))
    distance = dijkstra(_graph(compact[start], compact[end], n), unweighted=True, indices=sources)
    return float(distance.sum() / (len(sources) * (n - 1)))
