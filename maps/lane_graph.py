"""LaneGraph: the states a vehicle can wait in and the moves between them, as flat arrays, for one motion model."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.grid import DCOL, DROW, GridMap
from maps.vehicle import BODY_FRONT_M, ENTRY_INSET_M, TURN_M_PER_RAD, TURN_RADIUS_M, Footprint

if TYPE_CHECKING:  # heavy, and most users of a lane graph need neither
    import networkx as nx

    from maps.site import Site

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
_Paths = tuple[npt.NDArray[np.int64], Floats, Floats]  # path_ptr, path_points, path_s
SmallInts = npt.NDArray[np.int8]

_TOLERANCE_M = 1e-9
_FLOATS = ("state_pose", "move_length", "path_points", "path_s")
SAMPLE_STEP_M = 0.05
"""Largest distance between neighbouring path samples of a car-like move [m]."""
SAMPLE_STEP_RAD = 0.1
"""Largest angle between neighbouring samples of a turn on the spot [rad]."""
_USUAL = Footprint(front_m=BODY_FRONT_M, rear_m=ENTRY_INSET_M, half_width_m=0.0, turn_radius_m=TURN_RADIUS_M)
"""How a vehicle moves whose moves sweep the cells of their ends."""


class MoveKind(IntEnum):
    """What a move does, seen from the vehicle."""

    STRAIGHT = 0
    LEFT = 1
    RIGHT = 2
    REVERSE = 3
    TURN = 4


STRAIGHT, LEFT, RIGHT, REVERSE, TURN = MoveKind


class MotionError(MapsError):
    """A motion model is unknown or does not fit the map."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneGraph:
    """States and moves of one motion model on one floor; S states, M moves.

    `carlike`: a state is (cell, heading the car entered with), one per lane; the car stands with its rear axle on the
    centre line, 0.1 m inside the entry side, or at the stop pose of a dock. `pebble`: a state is a cell (heading 0).
    `rotating`: a state is (cell, heading), turns are moves of their own. Nobody writes to the arrays; they are left
    writable only because numba would otherwise compile every kernel a second time for read-only arrays.
    """

    motion: str
    n_states: int
    n_cells: int
    """Cells of the whole floor, free or not, so that a cell index addresses arrays of this length."""
    state_cell: Ints
    """Shape (S,)."""
    state_heading: SmallInts
    """Shape (S,): 0 east, 1 north, 2 west, 3 south."""
    state_pose: Floats
    """x, y [m], yaw [rad] = heading * pi / 2, shape (S, 3)."""
    state_index: Ints
    """State of (cell, heading) or -1, shape (n_cells, 4)."""
    move_from: Ints
    move_to: Ints
    """From and to states, shape (M,), sorted by from state."""
    move_kind: SmallInts
    """MoveKind, shape (M,)."""
    move_length: Floats
    """Length of the driven path [m], shape (M,)."""
    out_ptr: Ints
    out_move: Ints
    """Moves leaving state s: out_move[out_ptr[s]:out_ptr[s + 1]]."""
    in_ptr: Ints
    in_move: Ints
    """Moves entering state s: in_move[in_ptr[s]:in_ptr[s + 1]]."""
    swept_ptr: Ints
    swept_cell: Ints
    """Cells the body touches during move m: swept_cell[swept_ptr[m]:swept_ptr[m + 1]], from and to cell first."""
    path_ptr: Ints
    path_points: Floats
    """x, y [m], yaw [rad] along move m, both ends included; yaw is continuous from the from state's yaw."""
    path_s: Floats
    """Arc length from the start of the move [m], one per path point."""
    n_kinds: int = 1
    """Kinds of vehicles that have states of their own: state s of the first one is s + k S / n_kinds of the k-th."""

    @property
    def n_moves(self) -> int:
        return len(self.move_from)

    @property
    def n_places(self) -> int:
        """States of each kind of vehicle."""
        return self.n_states // self.n_kinds

    def place_of(self, state: int) -> int:
        """The state of the first kind of vehicles with the same cell and heading."""
        return state % self.n_places

    def states_like(self, state: int) -> range:
        """States of the kind of vehicles that a state is of."""
        first = state - self.place_of(state)
        return range(first, first + self.n_places)

    def state_at(self, cell: int, heading: int) -> int:
        """State of a cell and heading, or -1 if no lane enters the cell so; of several kinds, that of the first."""
        return int(self.state_index[cell, heading])

    def states_of_cell(self, cell: int) -> Ints:
        """All states in a cell, shape (k,), k may be 0."""
        row = self.state_index[cell]
        return np.asarray(row[row >= 0])

    def first_states(self, cells: Sequence[int]) -> Ints:
        """The first of the states in each of some cells, which have one, shape (k,)."""
        rows = self.state_index[np.asarray(cells, dtype=np.int64)]
        return np.asarray(rows[np.arange(len(rows)), (rows >= 0).argmax(axis=1)])

    def to_networkx(self) -> nx.DiGraph:
        """The same graph with nodes = state ids (cell, heading, pose) and edges (length [m], kind, move id)."""
        import networkx as nx

        graph: nx.DiGraph[int] = nx.DiGraph(motion=self.motion)
        for state in range(self.n_states):
            attributes: dict[str, Any] = {
                "cell": int(self.state_cell[state]),
                "heading": int(self.state_heading[state]),
                "pose": tuple(self.state_pose[state].tolist()),
            }
            graph.add_node(state, **attributes)
        for move in range(self.n_moves):
            graph.add_edge(
                int(self.move_from[move]),
                int(self.move_to[move]),
                length=float(self.move_length[move]),
                kind=MoveKind(int(self.move_kind[move])),
                move=move,
            )
        return graph


def build_lane_graph(
    site: Site,
    motion: Literal["carlike"] = "carlike",
    footprint: Footprint | None = None,
    closed: Sequence[int] = (),
) -> LaneGraph:
    """Build the car-like graph of a site: one state per lane, moves straight, left, right (and reverse if allowed).

    A turn is straight, quarter circle of 0.4 m radius, straight; it is left out where a straight part would be
    negative, so a dock whose stop pose lies deeper in its cell has only its straight exit.

    A vehicle that turns on the spot waits in the middle of its cell, also in docks; its left and right moves are a
    quarter turn there and a straight on into the next cell.

    A vehicle stands in one cell, and may sweep more than two on its way from one to the next. Moves that are too tight
    for it, that sweep cells without a lane, or that begin or end where its body does not fit into the cell, are left
    out; a state that so loses all of its moves is still there.

    Args:
        site: The site; `grid_lane_graph` serves bare grids.
        motion: Only "carlike".
        footprint: Of the vehicle; None = the usual car's, whose moves sweep two cells each.
        closed: Cells that are closed to a vehicle with a footprint; moves that would leave it no way back are left out,
            too.

    Raises:
        MotionError: Another motion model is asked for, or the cells are too small for the turning circle.
    """
    if motion != "carlike":
        raise MotionError(f"lane graph of a site: motion {motion!r} is unknown; valid: 'carlike'")
    grid = site.grid
    cell_m, body = grid.cell_m, footprint or _USUAL
    if cell_m / 2 - TURN_RADIUS_M - ENTRY_INSET_M < -_TOLERANCE_M:
        raise MotionError(f"lane graph: cell_m {cell_m} is too small; valid: at least 1.0")

    lane_heading = _headings(site.lanes, grid.cols)
    order = np.lexsort((lane_heading, site.lanes[:, 1]))
    before = site.lanes[order, 0]
    cell = site.lanes[order, 1]
    heading = lane_heading[order]
    n_states = len(cell)
    index = _state_index(cell, heading, grid.n_cells)

    offset = np.zeros(n_states)  # how much deeper than the usual 0.1 m the car stands
    for station in () if body.pivots else site.stations:
        state = index[station.dock.cell, station.dock.heading]
        if state >= 0:
            offset[state] = station.dock.stop_offset_m
    yaw = heading * (math.pi / 2)
    ahead = np.column_stack((np.cos(yaw), np.sin(yaw)))
    pose = np.column_stack((grid.cell_xy(cell) + ahead * (body.inset_m(cell_m) + offset - cell_m / 2)[:, None], yaw))

    moves: list[npt.NDArray[np.int64]] = []  # rows (from, to, kind)
    for kind, quarter in ((STRAIGHT, 0), (LEFT, 1), (RIGHT, 3)):
        next_heading = (heading + quarter) % 4
        next_cell = _step(cell, next_heading, grid)
        to = np.where(next_cell >= 0, index[next_cell, next_heading], -1)
        # A lane into the next cell counts only if it starts in this cell, and heading fixes that already.
        possible = to >= 0
        if kind is not STRAIGHT and not body.pivots:
            lead_in = cell_m / 2 - TURN_RADIUS_M - ENTRY_INSET_M - offset
            possible &= lead_in >= -_TOLERANCE_M
        source = np.flatnonzero(possible)
        moves.append(np.column_stack((source, to[source], np.full(len(source), kind))))
    if site.allow_reverse:
        to = index[before, heading]
        source = np.flatnonzero(to >= 0)
        moves.append(np.column_stack((source, to[source], np.full(len(source), REVERSE))))
    move = np.concatenate(moves)
    move = move[np.lexsort((move[:, 2], move[:, 0]))]
    beside = None
    if footprint is not None:
        drivable: npt.NDArray[np.bool_] = np.asarray((index >= 0).any(axis=1))
        drivable[list(closed)] = False
        move = move[drivable[cell[move[:, :2]]].all(axis=1)]
        swept = [_beside(row, cell, heading, offset, grid, footprint) for row in move.tolist()]
        fits = np.array([cells is not None and bool(drivable[cells].all()) for cells in swept], dtype=np.bool_)
        if closed:
            fits[fits] = _joined(move[fits], n_states)
        move, beside = move[fits], [cells for cells, fit in zip(swept, fits, strict=True) if cells is not None and fit]

    length, paths = _carlike_paths(move, pose, offset, cell_m, pivots=body.pivots)
    return _assemble("carlike", cell, heading, pose, index, move, length, paths, beside)


def side_by_side(graphs: Sequence[LaneGraph]) -> LaneGraph:
    """Put the graphs of several kinds of vehicles over the same cells into one.

    Each kind has states and moves of its own, and no move leads from one kind's states to another's. Cells are those of
    all: who holds a cell keeps out vehicles of every kind.

    Args:
        graphs: Of the same site, with the same states; the first one's are what cells and headings name.
    """
    if len(graphs) == 1:
        return graphs[0]
    n, first = len(graphs), graphs[0]
    n_states, n_moves = first.n_states, np.cumsum([0, *(graph.n_moves for graph in graphs)])
    state_ids = np.arange(n) * n_states

    def shifted(name: str, shifts: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        each = [getattr(graph, name) + shift for graph, shift in zip(graphs, shifts.tolist(), strict=True)]
        return np.concatenate(each).astype(getattr(first, name).dtype)

    def chained(name: str) -> npt.NDArray[Any]:
        lengths = np.concatenate([np.diff(getattr(graph, name)) for graph in graphs])
        return np.concatenate(([0], np.cumsum(lengths))).astype(getattr(first, name).dtype)

    nothing = np.zeros(n, dtype=np.int64)
    arrays = {name: shifted(name, nothing) for name in ("state_cell", "state_heading", "move_kind", "swept_cell")}
    arrays |= {name: np.concatenate([getattr(graph, name) for graph in graphs]) for name in _FLOATS}
    arrays |= {name: shifted(name, state_ids) for name in ("move_from", "move_to")}
    arrays |= {name: shifted(name, n_moves[:-1]) for name in ("out_move", "in_move")}
    arrays |= {name: chained(name) for name in ("out_ptr", "in_ptr", "swept_ptr", "path_ptr")}
    return LaneGraph(
        motion=first.motion,
        n_states=n * n_states,
        n_cells=first.n_cells,
        state_index=first.state_index,
        n_kinds=n,
        **arrays,
    )


def states_of_lanes(graph: LaneGraph, lanes: Ints, grid: GridMap) -> Ints:
    """The state of each lane (from cell, to cell) of a site, lanes of shape (k, 2), shape (k,)."""
    return np.asarray(graph.state_index[lanes[:, 1], _headings(lanes, grid.cols)])


def grid_lane_graph(grid: GridMap, motion: Literal["pebble", "rotating"]) -> LaneGraph:
    """Build the graph of a bare grid for the motion models of the public benchmarks.

    Paths hold their two end points only: these vehicles are never driven along a path.

    Args:
        grid: The floor; every pair of neighbouring free cells is connected both ways.
        motion: "pebble" (four neighbours) or "rotating" (forward, turn left, turn right on the spot).

    Raises:
        MotionError: The motion model is unknown.
    """
    free = np.flatnonzero(grid.free).astype(np.int64)
    if motion == "pebble":
        cell, heading = free, np.zeros(len(free), dtype=np.int64)
        index = _state_index(cell, heading, grid.n_cells)
        moves = []
        for direction in range(4):
            next_cell = _step(cell, np.full(len(cell), direction), grid)
            to = np.where(next_cell >= 0, index[next_cell, 0], -1)
            source = np.flatnonzero(to >= 0)
            moves.append(np.column_stack((source, to[source], np.full(len(source), STRAIGHT))))
    elif motion == "rotating":
        cell, heading = np.repeat(free, 4), np.tile(np.arange(4), len(free))
        index = _state_index(cell, heading, grid.n_cells)
        next_cell = _step(cell, heading, grid)
        to = np.where(next_cell >= 0, index[next_cell, heading], -1)
        source = np.flatnonzero(to >= 0)
        moves = [np.column_stack((source, to[source], np.full(len(source), STRAIGHT)))]
        every = np.arange(len(cell))
        for quarter in (1, 3):
            moves.append(np.column_stack((every, index[cell, (heading + quarter) % 4], np.full(len(cell), TURN))))
    else:
        raise MotionError(f"lane graph of a grid: motion {motion!r} is unknown; valid: 'pebble' or 'rotating'")
    move = np.concatenate(moves)
    move = move[np.lexsort((move[:, 1], move[:, 2], move[:, 0]))]

    pose = np.column_stack((grid.cell_xy(cell), heading * (math.pi / 2)))
    length = np.where(move[:, 2] == TURN, 0.0, grid.cell_m)
    path_ptr = np.arange(len(move) + 1) * 2
    ends = pose[move[:, :2]]  # (M, 2, 3)
    quarter_turn = (ends[:, 1, 2] - ends[:, 0, 2] + math.pi) % (2 * math.pi) - math.pi
    ends[:, 1, 2] = ends[:, 0, 2] + quarter_turn
    path_s = np.column_stack((np.zeros(len(move)), length)).ravel()
    return _assemble(motion, cell, heading, pose, index, move, length, (path_ptr, ends.reshape(-1, 3), path_s))


def _joined(move: npt.NDArray[np.int64], n_states: int) -> npt.NDArray[np.bool_]:
    """Whether moves (from, to, kind) lead from and to states of the largest part in which every way has one back."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = move[:, 0], move[:, 1]
    ways = coo_array((np.ones(len(move), dtype=np.int8), ends), shape=(n_states, n_states))
    part_of = connected_components(ways, directed=True, connection="strong")[1]
    in_largest = part_of == np.bincount(part_of).argmax()
    return np.asarray(in_largest[move[:, 0]] & in_largest[move[:, 1]])


def _headings(lanes: Ints, cols: int) -> npt.NDArray[np.int64]:
    """Heading of each lane (from, to)."""
    step = lanes[:, 1].astype(np.int64) - lanes[:, 0]
    return np.select([step == 1, step == -cols, step == -1], [0, 1, 2], default=3)


def _state_index(cell: npt.NDArray[Any], heading: npt.NDArray[Any], n_cells: int) -> Ints:
    index = np.full((n_cells, 4), -1, dtype=np.int32)
    index[cell, heading] = np.arange(len(cell), dtype=np.int32)
    return index


def _step(cell: npt.NDArray[Any], heading: npt.NDArray[Any], grid: GridMap) -> npt.NDArray[np.int64]:
    """Next cell in a heading, -1 beyond the border."""
    row, col = np.divmod(cell.astype(np.int64), grid.cols)
    row = row + np.asarray(DROW)[heading]
    col = col + np.asarray(DCOL)[heading]
    inside = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
    return np.where(inside, row * grid.cols + col, -1)


def _beside(
    move: list[int],
    cell: npt.NDArray[Any],
    heading: npt.NDArray[Any],
    offset: Floats,
    grid: GridMap,
    footprint: Footprint,
) -> list[int] | None:
    """Cells that a body sweeps on a move (from, to, kind) beside those of its ends; None if the move is not for it."""
    begin, end, kind = move
    deep = [round(float(offset[state]), 9) for state in (begin, end)]
    ahead = _ahead_of(MoveKind(kind), deep[0], deep[1], grid.cell_m, footprint)
    if ahead is None:
        return None
    row, col = grid.row_col(int(cell[begin]))
    turn = int(heading[begin])
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
    cells = []
    for along, left in ahead:
        there = (row - (sin * along + cos * left), col + cos * along - sin * left)
        if not (0 <= there[0] < grid.rows and 0 <= there[1] < grid.cols):
            return None
        cells.append(int(grid.index(*there)))
    return [other for other in cells if other not in (cell[begin], cell[end])]


@functools.lru_cache(maxsize=256)
def _ahead_of(
    kind: MoveKind, offset_from: float, offset_to: float, cell_m: float, footprint: Footprint
) -> tuple[tuple[int, int], ...] | None:
    """Cells that a body sweeps on a kind of move, along the first heading and to the left of it from the first cell.

    None if the move is too tight, or the body does not stand in one cell before or after it.
    """
    turns = kind in (LEFT, RIGHT) and not footprint.pivots
    if turns and footprint.turn_radius_m > TURN_RADIUS_M + _TOLERANCE_M:
        return None
    points, _ = _template(kind, offset_from, offset_to, cell_m, pivots=footprint.pivots)
    at = points + np.array([footprint.inset_m(cell_m) + offset_from - cell_m / 2, 0.0, 0.0])
    if any(len(footprint.cells(at[[k]], cell_m)) > 1 for k in (0, -1)):
        return None
    return tuple(sorted(footprint.cells(at, cell_m)))


def _carlike_paths(
    move: npt.NDArray[np.int64], pose: Floats, offset: Floats, cell_m: float, *, pivots: bool
) -> tuple[Floats, _Paths]:
    """Length and samples of every move; moves alike in kind and stop offsets share one template, moved rigidly."""
    deep_from, deep_to = np.round(offset[move[:, 0]], 9), np.round(offset[move[:, 1]], 9)
    keys, group = np.unique(np.column_stack((move[:, 2], deep_from, deep_to)), axis=0, return_inverse=True)
    group = group.ravel()
    templates = [_template(MoveKind(int(kind)), a, b, cell_m, pivots=pivots) for kind, a, b in keys]
    count = np.array([len(s) for _, s in templates], dtype=np.int64)[group]
    length = np.array([s[-1] for _, s in templates])[group]
    ptr = np.concatenate(([0], np.cumsum(count)))
    points = np.empty((ptr[-1], 3))
    path_s = np.empty(ptr[-1])
    for number, (local, s) in enumerate(templates):
        members = np.flatnonzero(group == number)
        start = pose[move[members, 0]]
        cos, sin = np.round(np.cos(start[:, 2:])), np.round(np.sin(start[:, 2:]))  # headings: exactly -1, 0 or 1
        rows = ptr[members][:, None] + np.arange(len(s))
        points[rows, 0] = start[:, :1] + cos * local[:, 0] - sin * local[:, 1]
        points[rows, 1] = start[:, 1:2] + sin * local[:, 0] + cos * local[:, 1]
        points[rows, 2] = start[:, 2:] + local[:, 2]
        path_s[rows] = s
    return length, (ptr, points, path_s)


def _template(
    kind: MoveKind, offset_from: float, offset_to: float, cell_m: float, *, pivots: bool
) -> tuple[Floats, Floats]:
    """Samples (x, y, yaw) in the frame of the from pose and their arc length, for one kind of move."""
    if kind in (STRAIGHT, REVERSE):
        sign = 1.0 if kind is STRAIGHT else -1.0
        length = cell_m + sign * (offset_to - offset_from)
        s = np.linspace(0.0, length, max(2, math.ceil(length / SAMPLE_STEP_M - _TOLERANCE_M) + 1))
        return np.column_stack((sign * s, np.zeros_like(s), np.zeros_like(s))), s
    if pivots:
        return _pivoted(1.0 if kind is LEFT else -1.0, cell_m)
    radius = TURN_RADIUS_M
    lead_in = cell_m / 2 - radius - ENTRY_INSET_M - offset_from
    lead_out = cell_m / 2 - radius + ENTRY_INSET_M + offset_to
    lead_in = max(lead_in, 0.0)
    arc = radius * math.pi / 2
    pieces = [
        np.linspace(a, b, max(1, math.ceil((b - a) / SAMPLE_STEP_M - _TOLERANCE_M)), endpoint=False)
        for a, b in ((0.0, lead_in), (lead_in, lead_in + arc), (lead_in + arc, lead_in + arc + lead_out))
        if b - a > _TOLERANCE_M
    ]
    s = np.concatenate([*pieces, [lead_in + arc + lead_out]])
    angle = np.clip((s - lead_in) / radius, 0.0, math.pi / 2)
    x = np.minimum(s, lead_in) + radius * np.sin(angle)
    y = radius * (1.0 - np.cos(angle)) + np.maximum(s - lead_in - arc, 0.0)
    side = 1.0 if kind is LEFT else -1.0
    return np.column_stack((x, side * y, side * angle)), s


def _pivoted(side: float, cell_m: float) -> tuple[Floats, Floats]:
    """The same for a quarter turn on the spot and a cell ahead."""
    yaws = np.linspace(0.0, math.pi / 2, math.ceil(math.pi / 2 / SAMPLE_STEP_RAD) + 1)
    way = np.linspace(0.0, cell_m, math.ceil(cell_m / SAMPLE_STEP_M - _TOLERANCE_M) + 1)[1:]
    points = np.zeros((len(yaws) + len(way), 3))
    points[: len(yaws), 2] = side * yaws
    points[len(yaws) :, 1], points[len(yaws) :, 2] = side * way, side * math.pi / 2
    turned = TURN_M_PER_RAD * yaws
    return points, np.concatenate((turned, turned[-1] + way))


def csr(key: npt.NDArray[Any], n_keys: int) -> tuple[Ints, Ints]:
    """Rows of keys: `order[ptr[k]:ptr[k + 1]]` are the places at which key k stands, ascending."""
    order = np.argsort(key, kind="stable").astype(np.int32)
    ptr = np.concatenate(([0], np.cumsum(np.bincount(key, minlength=n_keys)))).astype(np.int32)
    return ptr, order


def _assemble(
    motion: str,
    cell: npt.NDArray[Any],
    heading: npt.NDArray[Any],
    pose: Floats,
    index: Ints,
    move: npt.NDArray[np.int64],
    length: Floats,
    paths: _Paths,
    beside: list[list[int]] | None = None,
) -> LaneGraph:
    """The graph of states and moves; `beside` are cells that each move sweeps beside those of its ends."""
    n_states = len(cell)
    path_ptr, path_points, path_s = paths
    swept = np.column_stack((cell[move[:, 0]], cell[move[:, 1]]))
    out_ptr, out_move = csr(move[:, 0], n_states)
    in_ptr, in_move = csr(move[:, 1], n_states)
    moved = swept[:, 0] != swept[:, 1]  # a turn on the spot sweeps one cell
    keep = np.column_stack((np.ones(len(move), dtype=np.bool_), moved))
    n_most = max(map(len, beside or ()), default=0)
    more = np.full((len(move), n_most), -1, dtype=np.int64)
    for k, cells in enumerate(beside or ()):
        more[k, : len(cells)] = cells
    swept, keep = np.column_stack((swept, more)), np.column_stack((keep, more >= 0))
    arrays: dict[str, npt.NDArray[Any]] = {
        "state_cell": cell.astype(np.int32),
        "state_heading": heading.astype(np.int8),
        "state_pose": pose,
        "state_index": index,
        "move_from": move[:, 0].astype(np.int32),
        "move_to": move[:, 1].astype(np.int32),
        "move_kind": move[:, 2].astype(np.int8),
        "move_length": length.astype(np.float64),
        "out_ptr": out_ptr,
        "out_move": out_move,
        "in_ptr": in_ptr,
        "in_move": in_move,
        "swept_ptr": np.concatenate(([0], np.cumsum(keep.sum(axis=1)))).astype(np.int32),
        "swept_cell": swept[keep].astype(np.int32),
        "path_ptr": path_ptr.astype(np.int32),
        "path_points": np.ascontiguousarray(path_points),
        "path_s": path_s,
    }
    return LaneGraph(motion=motion, n_states=n_states, n_cells=len(index), n_kinds=1, **arrays)
