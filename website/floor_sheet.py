"""FloorSheet: a part of a site seen from above, in lines and boxes, with room for what a picture wants to show."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.charts.drawing import Box, Drawing, Line, Spot, Words
from fleet.robots.racecar import racecar_spec
from maps.grid import GridMap
from maps.site import Site

FLOOR, CLOSED, WALL, SHELF = "#f4f4f0", "#e4e4de", "#5a5a60", "#b8aea0"
PICK, DROP, PARKING, CHARGER = "#c8e4c8", "#f0d6be", "#e2e6ee", "#ece2a6"
ARM, LANE, INK, NOSE = "#e1781e", "#9a9a94", "#333333", "#1e1e1e"
EDGE = 0.02
"""Gap between two cells, as a share of a cell."""
HEAD = 0.16
"""Length of an arrow's head [m]."""


class FloorSheet:
    """Draws a floor, or a part of it.

    Args:
        site: The floor.
        px_per_m: Pixels of a metre.
        rows: First row and the one behind the last; None = all.
        cols: The same of the columns.
    """

    def __init__(
        self,
        site: Site,
        *,
        px_per_m: float,
        rows: tuple[int, int] | None = None,
        cols: tuple[int, int] | None = None,
    ) -> None:
        self.site = site
        self._grid: GridMap = site.grid
        self._px = px_per_m
        top, bottom = rows or (0, site.grid.rows)
        left, right = cols or (0, site.grid.cols)
        self._west_m = left * site.grid.cell_m
        self._north_m = (site.grid.rows - top) * site.grid.cell_m
        cell_px = px_per_m * site.grid.cell_m
        self.drawing = Drawing(width=round((right - left) * cell_px), height=round((bottom - top) * cell_px))
        self._car = racecar_spec()

    def spot(self, x_m: float, y_m: float) -> Spot:
        """Where a point of the floor is on the sheet."""
        return (x_m - self._west_m) * self._px, (self._north_m - y_m) * self._px

    def cells(self) -> None:
        """All cells, coloured by what they are for, and the arms."""
        site, grid = self.site, self._grid
        colors = np.full(grid.n_cells, CLOSED, dtype=object)
        colors[grid.free.ravel()] = FLOOR
        colors[site.walls.ravel()] = WALL
        colors[site.shelves.ravel()] = SHELF
        colors[list(site.parking)] = PARKING
        colors[list(site.chargers)] = CHARGER
        for station in site.stations:
            colors[station.dock.cell] = PICK if station.kind == "pick" else DROP
        for cell in range(grid.n_cells):
            self.cell(cell, str(colors[cell]))
        for station in site.stations:
            x, y = station.arm.pose[:2]
            self.square(x, y, 0.36, ARM)

    def cell(self, cell: int, color: str, *, share: float = 1.0 - EDGE, opacity: float = 1.0, title: str = "") -> None:
        """A square in the middle of a cell."""
        ((x, y),) = self._grid.cell_xy([cell]).tolist()
        self.square(x, y, share * self._grid.cell_m, color, opacity=opacity, title=title)

    def square(
        self, x_m: float, y_m: float, edge_m: float, color: str, *, opacity: float = 1.0, title: str = ""
    ) -> None:
        """A square by its centre."""
        at = self.spot(x_m - edge_m / 2, y_m + edge_m / 2)
        size = (edge_m * self._px, edge_m * self._px)
        self.drawing.marks.append(Box(at=at, size=size, color=color, opacity=opacity, title=title))

    def lanes(self) -> None:
        """An arrow for each lane, in the middle of the border that it crosses."""
        for begin, end in self._grid.cell_xy(self.site.lanes.ravel()).reshape(-1, 2, 2):
            self.arrow(begin + 0.38 * (end - begin), begin + 0.62 * (end - begin), LANE)

    def station_names(self) -> None:
        """The name of each station beside its arm, inside of the sheet."""
        for station in self.site.stations:
            x, y = station.arm.pose[:2]
            east = x > self._grid.cols * self._grid.cell_m / 2
            at = self.spot(x + (0.4 if east else -0.4), y + 0.62)
            self.words(at, station.name, anchor="end" if east else "start")

    def line(self, points: FloatArray, color: str, *, width: float = 2.0, dashed: bool = False) -> None:
        """A line through points x, y [m], shape (k, 2)."""
        spots = [self.spot(x, y) for x, y in points.tolist()]
        self.drawing.marks.append(Line(points=spots, color=color, width=width, dashed=dashed))

    def arrow(self, begin: FloatArray, end: FloatArray, color: str, *, width: float = 1.5) -> None:
        """An arrow from one point to another, x, y [m]."""
        along = (end - begin) / max(float(np.hypot(*(end - begin))), 1e-9)
        aside = np.array([-along[1], along[0]])
        back = end - HEAD * along
        head = np.array([back + 0.5 * HEAD * aside, end, back - 0.5 * HEAD * aside])
        self.line(np.array([begin, end]), color, width=width)
        self.line(head, color, width=width)

    def car(self, pose: FloatArray, color: str) -> None:
        """A car by the pose of its rear axle, x, y, yaw; its nose is dark."""
        x, y, yaw = pose.tolist()
        ahead = np.array([math.cos(yaw), math.sin(yaw)])
        width = 2.0 * self._car.half_width_m * self._px
        tail, front = np.array([x, y]) - self._car.rear_m * ahead, np.array([x, y]) + self._car.front_m * ahead
        self.line(np.array([tail, front]), color, width=width)
        self.line(np.array([front - 0.07 * ahead, front]), NOSE, width=width)

    def words(self, at: Spot, text: str, *, size: float = 12.0, anchor: str = "start", bold: bool = False) -> None:
        """A line of text, by a spot of the sheet."""
        self.drawing.marks.append(Words(at=at, text=text, size=size, color=INK, anchor=anchor, bold=bold))
