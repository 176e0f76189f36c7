"""ToSite: a layout whose nodes lie on a square grid becomes a site with the same lanes."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from maps.grid import DCOL, DROW, GridMap
from maps.lane_graph import build_lane_graph
from maps.layouts.lattice import CELL_M, Lattice, fit_lattice
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation, one_level
from maps.orientation import orient_lanes, path_lengths
from maps.plan import parse_plan
from maps.site import Site, site_from_plan
from maps.stations import REACH_M, StationOptions, match_arms, name_stations

_ROOM = 2
"""Cells round the nodes of a layout from elsewhere: for arms and a wall."""
_KEPT = 3
"""A floor whose first node is in one of so many first rows or columns keeps its coordinates."""
_MOST_CELLS = 4_000_000
_SAME_M = 1e-3
"""What is nearer than this to where a site would have it by itself was meant so: files hold whole millimetres."""

Cell = tuple[int, int]
"""Row and column."""


@dataclass(frozen=True, kw_only=True)
class ImportedSite:
    """A site that was made from a layout."""

    site: Site
    """With what its stations are called in the layout, where that is something else."""
    path_ratio: float
    """Mean way over its one-way lanes by that over two-way lanes."""
    names: dict[str, str]
    """Name of each station in the site -> its name in the layout."""
    notes: tuple[str, ...]
    """What is not as in the layout, a line each."""


def site_of_layout(layout: FloorLayout, *, name: str, where: str) -> ImportedSite:
    """Make a site.

    Nodes become cells, edges lanes; an edge along a row or a column is as many cells long as it has to be. Where edges
    lead both ways and no vehicle reverses, lanes get one direction each, see `maps.orientation`.

    Args:
        layout: As a format gave it.
        name: Name of the site.
        where: Opens every message.

    Raises:
        LayoutError: It has several levels, does not lie on a grid, an edge leads along no row and no column, passes
            another node or crosses another edge, or a station has no room for its arm or several ways in.
        SiteError: The site cannot work, see `maps.site.site_from_plan`.
    """
    layout = one_level(layout, None, where)
    lattice = fit_lattice(layout, where)
    floor = _Floor(layout, lattice, where)
    floor.draw_edges()
    floor.place_stations()
    lines = floor.lines()
    lanes, notes = _lanes(floor, lines, where)
    floor.check_docks(lanes)
    site = site_from_plan(lines, name=name, allow_reverse=floor.backwards, lanes=lanes, where=where)
    stations = floor.names(site)
    names = {own: foreign.name for own, foreign in stations.items()}
    options = floor.options(site, stations)
    theirs = {own: foreign for own, foreign in names.items() if own != foreign}
    if options or theirs:
        site = site_from_plan(
            lines,
            name=name,
            allow_reverse=floor.backwards,
            options=options,
            lanes=lanes,
            names=theirs,
            where=where,
        )
    notes += floor.notes + floor.added_moves(site)
    return ImportedSite(
        site=site,
        path_ratio=path_lengths(site.lanes, site.grid).ratio,
        names=names,
        notes=tuple(notes),
    )


class _Floor:
    """The cells of a layout, while its parts are put on them.

    Args:
        layout: The layout.
        lattice: Where its nodes are.
        where: Opens every message.
    """

    def __init__(self, layout: FloorLayout, lattice: Lattice, where: str) -> None:
        self._layout, self._lattice, self._where = layout, lattice, where
        self.notes: list[str] = []
        left, below = (self._margin(values) for values in (lattice.col, lattice.up))
        kept = left >= 0 and below >= 0 and lattice.whole
        room = 1 if kept else _ROOM
        left, below = (left, below) if kept else (_ROOM, _ROOM)
        col = lattice.col - lattice.col.min() + left
        up = lattice.up - lattice.up.min() + below
        self.cols, self.rows = int(col.max()) + 1 + room, int(up.max()) + 1 + room
        if self.cols * self.rows > _MOST_CELLS:
            raise LayoutError(
                f"{where}: {self.cols} x {self.rows} cells of {lattice.pitch_m:g} m; valid: {_MOST_CELLS} in all"
            )
        cells = zip((self.rows - 1 - up).tolist(), col.tolist(), strict=True)
        self._cell: dict[str, Cell] = dict(zip((node.name for node in layout.nodes), cells, strict=True))
        self._nodes: dict[str, LayoutNode] = {node.name: node for node in layout.nodes}
        self.backwards = any(edge.backwards for edge in layout.edges)
        self.lanes: set[tuple[Cell, Cell]] = set()
        self._marks: dict[Cell, str] = {}
        self._at_cell: dict[Cell, list[LayoutStation]] = defaultdict(list)
        self._arm_side: dict[str, int] = {}
        self._kept = kept
        self._say_what_moved()

    @staticmethod
    def _margin(values: npt.NDArray[np.int64]) -> int:
        """Cells before the first one on a floor that keeps its coordinates, -1 if it cannot."""
        first = int(values.min())
        return first if 0 <= first <= _KEPT else -1

    def _say_what_moved(self) -> None:
        lattice = self._lattice
        if lattice.pitch_m != CELL_M:
            self.notes.append(f"nodes lie {lattice.pitch_m:g} m apart and are drawn {CELL_M:g} m apart")
        if not self._kept:
            self.notes.append("the floor begins elsewhere: coordinates are not those of the file")
        if lattice.moved_m > _SAME_M:
            self.notes.append(f"nodes were moved to the middle of their cells, by up to {lattice.moved_m:.3f} m")

    def draw_edges(self) -> None:
        """Lanes under the edges.

        Raises:
            LayoutError: An edge leads along no row and no column, over a node, or across another edge.
        """
        node_at = {cell: name for name, cell in self._cell.items()}
        passed: dict[Cell, LayoutEdge] = {}
        for edge in self._layout.edges:
            way = self._way(edge)
            for cell in way[1:-1]:
                if cell in node_at:
                    raise LayoutError(
                        f"{self._where}: edge {edge.name!r} leads over node {node_at[cell]!r}; valid: edges that end "
                        "at the nodes they touch"
                    )
                other = passed.setdefault(cell, edge)
                if {other.start, other.end} != {edge.start, edge.end}:
                    raise LayoutError(
                        f"{self._where}: edges {other.name!r} and {edge.name!r} cross where there is no node; valid: a "
                        "node at each crossing"
                    )
            if not edge.backwards:
                self.lanes.update(pairwise(way))
        if self._lattice.deeper_m is not None:
            # A node is where a car stands that has come from behind, also where no edge leads to it.
            for cell, heading in zip(self._cell.values(), self._lattice.heading.tolist(), strict=True):
                behind = _beside(cell, (heading + 2) % 4)
                if behind in node_at:
                    self.lanes.add((behind, cell))

    def _way(self, edge: LayoutEdge) -> list[Cell]:
        """Cells of an edge, in a row or a column."""
        (row, col), (to_row, to_col) = start, end = self._cell[edge.start], self._cell[edge.end]
        if start == end or (row != to_row and col != to_col):
            a, b = self._nodes[edge.start], self._nodes[edge.end]
            raise LayoutError(
                f"{self._where}: edge {edge.name!r} leads from ({a.x:.2f}, {a.y:.2f}) to ({b.x:.2f}, {b.y:.2f}) m, "
                + ("within one cell" if start == end else "along no row and no column of the grid")
                + "; valid: edges along x or y from one cell to another"
            )
        n = abs(to_row - row) + abs(to_col - col)
        step = (to_row - row) // n, (to_col - col) // n
        return [(row + k * step[0], col + k * step[1]) for k in range(n + 1)]

    def place_stations(self) -> None:
        """Docks with their arms, parking and chargers.

        Raises:
            LayoutError: No edge joins a station, or there is no room for its arm.
        """
        open_cells = {cell for lane in self.lanes for cell in lane}
        for name, node in self._nodes.items():
            if node.parking or node.charger:
                self._marks[self._cell[name]] = "C" if node.charger else "K"
        for station in self._layout.stations:
            cell = self._cell[station.node]
            if cell not in open_cells:
                raise LayoutError(
                    f"{self._where}: station {station.name!r} is at node {station.node!r}, which no edge joins; valid: "
                    "a node on a way"
                )
            others = self._at_cell[cell]
            if others and others[0].use != station.use:
                self.notes.append(f"station {station.name!r} is left out: {others[0].name!r} has the same place")
                continue
            side = self._arm_side_of(station, cell, open_cells)
            if side is None and not others:
                raise LayoutError(
                    f"{self._where}: station {station.name!r} at {_cell_name(cell)} has no room for an arm; valid: a "
                    "cell beside it without edges"
                )
            if side is None or (others and side != (self._arm_side[others[0].name] + 2) % 4):
                self.notes.append(f"station {station.name!r} is left out: no room for another arm")
                continue
            others.append(station)
            self._arm_side[station.name] = side
            self._marks[cell] = station.use[0].upper()
            self._marks[_beside(cell, side)] = "A"

    def _arm_side_of(self, station: LayoutStation, cell: Cell, open_cells: set[Cell]) -> int | None:
        """The heading in which a station has room for an arm: beside the lane, and where the layout has the station."""
        entered = {heading for heading in range(4) if (_beside(cell, (heading + 2) % 4), cell) in self.lanes}
        left = {heading for heading in range(4) if (cell, _beside(cell, heading)) in self.lanes}
        node = self._nodes[station.node]
        found = []
        for heading in range(4):
            row, col = beside = _beside(cell, heading)
            if not (0 <= row < self.rows and 0 <= col < self.cols) or beside in open_cells or beside in self._marks:
                continue
            before_nose = heading % 2 in {way % 2 for way in entered}
            # Where the way out is a turn, cars stand farther back, and so does the arm with its slots.
            crowded = not entered & left and any(
                _beside(beside, (heading + quarter) % 4) in open_cells for quarter in (1, 3)
            )
            towards = 0.0
            if station.x is not None and station.y is not None:
                towards = (station.x - node.x) * DCOL[heading] - (station.y - node.y) * DROW[heading]
            found.append((before_nose, crowded, -round(towards, 3), (heading + 2) % 4 in left, heading))
        return min(found)[-1] if found else None

    def check_docks(self, lanes: npt.NDArray[np.int32]) -> None:
        """Docks have one way in.

        Raises:
            LayoutError: One has several.
        """
        for (row, col), stations in self._at_cell.items():
            n_entries = int((lanes[:, 1] == row * self.cols + col).sum())
            if stations and n_entries > 1:
                raise LayoutError(
                    f"{self._where}: station {stations[0].name!r} at {_cell_name((row, col))} has {n_entries} ways in; "
                    "valid: one, so that cars come past its arm"
                )

    def lines(self) -> list[str]:
        """The drawing: cells of lanes, what stands there, a wall round all, the rest kept clear."""
        chars = np.full((self.rows, self.cols), "_")
        chars[[0, -1], :] = chars[:, [0, -1]] = "#"
        for (row, col), mark in self._marks.items():
            if mark == "A":
                chars[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2] = "_"
        both = {lane for lane in self.lanes if lane[::-1] in self.lanes} if self.backwards else set()
        ways: dict[Cell, list[bool]] = defaultdict(list)
        for lane in self.lanes:
            for cell in lane:
                ways[cell].append(lane in both)
        for cell, two_way in ways.items():
            chars[cell] = "x" if all(two_way) else "."
        for cell, mark in self._marks.items():
            chars[cell] = mark
        return ["".join(line) for line in chars.tolist()]

    def lane_array(self) -> npt.NDArray[np.int32]:
        """Lanes by the numbers of cells, sorted, shape (n, 2)."""
        found = sorted((a[0] * self.cols + a[1], b[0] * self.cols + b[1]) for a, b in self.lanes)
        return np.array(found, dtype=np.int32).reshape(-1, 2)

    def names(self, site: Site) -> dict[str, LayoutStation]:
        """The station of the layout behind each station of the site."""
        plan = parse_plan(site.plan, where=self._where)
        grid = GridMap(plan.open)
        sides = match_arms(plan, grid, where=self._where)
        found: dict[str, LayoutStation] = {}
        for number, own in name_stations(plan, sides).items():
            row, col = divmod(number, self.cols)
            by_side = {self._arm_side[station.name]: station for station in self._at_cell[row, col]}
            found |= {name: by_side[side] for name, side in zip(own, sides[number], strict=True)}
        return found

    def options(self, site: Site, names: dict[str, LayoutStation]) -> dict[str, StationOptions]:
        """What of the stations is not as a site would have it by itself."""
        found: dict[str, StationOptions] = {}
        deeper = self._lattice.deeper_m
        at = {node.name: k for k, node in enumerate(self._layout.nodes)}
        for place in site.stations:
            station = names[place.name]
            given = StationOptions()
            if deeper is not None:
                offset = float(deeper[at[station.node]])
                if abs(offset - place.dock.stop_offset_m) > _SAME_M:
                    given = replace(given, stop_offset_m=round(offset, 3))
            x, y, _, yaw = place.arm.pose
            if self._kept and station.x is not None and station.y is not None and station.yaw is not None:
                tray = math.dist(place.dock.tray_xy, (station.x, station.y))
                if math.dist((x, y), (station.x, station.y)) > 2 * _SAME_M and REACH_M[0] <= tray <= REACH_M[1]:
                    given = replace(given, arm_xy=(station.x, station.y))
                if abs(math.remainder(station.yaw - yaw, math.tau)) > _SAME_M:
                    given = replace(given, arm_yaw_deg=round(math.degrees(station.yaw), 6))
            if given != StationOptions():
                found[place.name] = given
        return found

    def added_moves(self, site: Site) -> list[str]:
        """Says how many moves cars have on the lanes that the edges of a layout with headings do not."""
        if self._lattice.deeper_m is None:
            return []
        n_moves, n_edges = build_lane_graph(site).n_moves, len(self._layout.edges)
        return [f"cars have {n_moves} moves, the file {n_edges} edges"] if n_moves != n_edges else []


def _lanes(floor: _Floor, lines: list[str], where: str) -> tuple[npt.NDArray[np.int32], list[str]]:
    """Lanes of one direction, and what was done for it."""
    lanes = floor.lane_array()
    known = {(a, b) for a, b in lanes.tolist()}
    n_both = sum((b, a) in known for a, b in known) // 2
    if floor.backwards or not n_both:
        return lanes, []
    plan = parse_plan(lines, where=where)
    oriented = orient_lanes(plan, match_arms(plan, GridMap(plan.open), where=where), lanes)
    notes = [f"{n_both} two-way lanes were given one direction each"]
    left = {int(cell) for cell in lanes.ravel()} - {int(cell) for cell in oriented.lanes.ravel()}
    if left:
        notes.append(
            f"{len(left)} cells are left out, the first at {_cell_name(divmod(min(left), floor.cols))}: a single lane "
            "leads to them"
        )
    return oriented.lanes, notes


def _cell_name(cell: Cell) -> str:
    return f"row {cell[0]}, column {cell[1]}"


def _beside(cell: Cell, heading: int) -> Cell:
    return cell[0] + DROW[heading], cell[1] + DCOL[heading]
