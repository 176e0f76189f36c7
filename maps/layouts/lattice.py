"""Lattice: the square grid on which the nodes of a layout lie, or the node that lies beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.layouts.layout import FloorLayout, LayoutError
from maps.stations import NOSE_GAP_M
from maps.vehicle import BODY_FRONT_M, ENTRY_INSET_M

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CELL_M = 1.0
"""Edge of a cell of a site [m]."""
TOLERANCE = 0.1
"""A node may lie this part of a cell beside the middle of its cell."""
DEEPEST_M = CELL_M - ENTRY_INSET_M - BODY_FRONT_M - NOSE_GAP_M
"""How much deeper than usual a vehicle may stand in a dock's cell [m]."""
_QUARTER_RAD = math.pi / 2
_HEADING_TOLERANCE_RAD = 0.02
_MOST_PHASES = 200
"""Nodes whose place is tried as that of the grid; the others have to lie on it."""
_SAME_M = 1e-3
_ROUNDING_M = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Lattice:
    """Where the nodes of a layout are on a square grid."""

    col: Ints
    """To the east, of each node."""
    up: Ints
    """To the north."""
    pitch_m: float
    """Edge of a square."""
    whole: bool
    """Whether the middle of square (0, 0) is at (0.5, 0.5) m, as on the floor of a site."""
    heading: Ints
    """Of each node, 0 east, 1 north, ...; -1 where a vehicle may stand any way."""
    deeper_m: Floats | None
    """Of nodes that are where rear axles stand: how far beyond the usual place. None = nodes are middles of squares."""
    moved_m: float
    """Greatest distance of a node from its place on the grid."""


def fit_lattice(layout: FloorLayout, where: str) -> Lattice:
    """Find the grid.

    Nodes are the middles of squares, or, if all of them have headings, where the rear axle of a car stands that has
    just entered. Squares of 1 m are tried first, then squares as long as an edge along x or y.

    Args:
        layout: With at least one node.
        where: Opens every message.

    Raises:
        LayoutError: A node lies beside the grid that suits most of them, or stands askew.
    """
    xy = np.array([(node.x, node.y) for node in layout.nodes])
    heading = _headings(layout)
    ahead = np.round(np.column_stack((np.cos(heading * _QUARTER_RAD), np.sin(heading * _QUARTER_RAD))))
    tries = [(pitch, False) for pitch in _pitches(layout)]
    if (heading >= 0).all():
        tries.insert(1, (CELL_M, True))
    grids = []
    for pitch, at_entry in tries:
        grids.append(_grid(xy, ahead, pitch, at_entry=at_entry))
        if not grids[-1].beside_grid.any():
            break
    grid = min(grids, key=lambda grid: grid.beside_grid.sum())
    pitch, place = grid.pitch_m, grid.place
    if grid.beside_grid.any():
        first = int(np.argmax(grid.beside_grid))
        node = layout.nodes[first]
        raise LayoutError(
            f"{where}: node {node.name!r} at ({node.x:.2f}, {node.y:.2f}) m lies {grid.off_m[first]:.2f} m beside the "
            f"grid of {pitch:g} m that suits the other nodes ({grid.beside_grid.sum()} of {len(layout.nodes)} do not); "
            f"valid: at most {TOLERANCE * pitch:g} m, or a floor that is drawn anew (--redraw)"
        )
    square = np.floor(place / pitch + 1e-6).astype(np.int64)
    origin = place[0] - (square[0] + 0.5) * pitch
    return Lattice(
        col=square[:, 0],
        up=square[:, 1],
        pitch_m=pitch,
        whole=pitch == CELL_M and bool((np.abs(origin) < _SAME_M).all()),
        heading=heading,
        deeper_m=grid.deeper_m,
        moved_m=float(grid.off_m.max()),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """A grid that was tried."""

    pitch_m: float
    place: Floats
    """Middle of the square of each node, shape (n, 2)."""
    deeper_m: Floats | None
    off_m: Floats
    """How far each node is from where it should be, along one axis."""

    @property
    def beside_grid(self) -> npt.NDArray[np.bool_]:
        """Nodes that are too far away."""
        return np.asarray(self.off_m > TOLERANCE * self.pitch_m + _ROUNDING_M)


def _grid(xy: Floats, ahead: Floats, pitch: float, *, at_entry: bool) -> _Grid:
    """The grid of this pitch that suits most nodes, if they are middles of squares or where rear axles stand."""
    place, off = _placed(xy + ahead * (pitch / 2 - ENTRY_INSET_M) if at_entry else xy, pitch)
    deeper = None
    if at_entry:
        deeper = np.clip((off * ahead).sum(axis=1), 0.0, DEEPEST_M)
        off = off - ahead * deeper[:, None]
    return _Grid(pitch_m=pitch, place=place, deeper_m=deeper, off_m=np.abs(off).max(axis=1))


def _headings(layout: FloorLayout) -> Ints:
    """Quarter of each node's yaw, -1 for none or where it is none of the four."""
    found = []
    for node in layout.nodes:
        quarter = -1 if node.yaw is None else round(node.yaw / _QUARTER_RAD)
        askew = node.yaw is not None and abs(node.yaw - quarter * _QUARTER_RAD) > _HEADING_TOLERANCE_RAD
        found.append(-1 if node.yaw is None or askew else quarter % 4)
    return np.array(found, dtype=np.int64)


def _pitches(layout: FloorLayout) -> list[float]:
    """A metre, then the lengths of edges along x or y, from the shortest on that has room for a car."""
    at = {node.name: (node.x, node.y) for node in layout.nodes}
    lengths = set()
    for edge in layout.edges:
        dx, dy = (abs(b - a) for a, b in zip(at[edge.start], at[edge.end], strict=True))
        if min(dx, dy) < _SAME_M and max(dx, dy) > CELL_M + _SAME_M:
            lengths.add(round(max(dx, dy), 3))
    return [CELL_M, *sorted(lengths)[:_MOST_PHASES]]


def _placed(middle: Floats, pitch: float) -> tuple[Floats, Floats]:
    """The middle of the square of each node, and how far the node is from it, both (n, 2)."""
    place, off = np.empty_like(middle), np.empty_like(middle)
    for axis in range(2):
        values = middle[:, axis]
        candidates = np.concatenate(([pitch / 2], values[:: max(1, len(values) // _MOST_PHASES)]))
        # Of each candidate: how far every node is from the grid through it.
        away = values[None] - candidates[:, None]
        away -= np.round(away / pitch) * pitch
        fits = (np.abs(away) <= TOLERANCE * pitch + _ROUNDING_M).sum(axis=1)
        exact = (np.abs(away) <= _SAME_M).sum(axis=1)
        exact[2 * exact <= len(values)] = 0
        # As many nodes as can be, then most of them exactly, then the grid of a site, then the nearest.
        other = np.arange(len(candidates)) > 0
        chosen = int(np.lexsort((np.abs(away).mean(axis=1), other, -exact, -fits))[0])
        off[:, axis] = away[chosen]
        place[:, axis] = values - away[chosen]
    return place, off
