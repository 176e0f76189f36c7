"""FloorSheet: a part of a site seen from above, in lines and boxes, with room for what a picture wants to show."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.charts.drawing import Spot, Words
from fleet.charts.floor import FloorFrame
from fleet.robots.cars.models import usual_car
from maps.site import Site

FLOOR, CLOSED, WALL, SHELF = "#f4f4f0", "#e4e4de", "#5a5a60", "#b8aea0"
PICK, DROP, PARKING, CHARGER = "#c8e4c8", "#f0d6be", "#e2e6ee", "#ece2a6"
STORAGE = "#ecdfca"
ARM, LANE, INK, NOSE = "#e1781e", "#9a9a94", "#333333", "#1e1e1e"
EDGE = 0.02
"""Gap between two cells, as a share of a cell."""
HEAD = 0.16
"""Length of an arrow's head [m]."""


class FloorSheet(FloorFrame):
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
        super().__init__(site.grid, px_per_m=px_per_m, rows=rows, cols=cols)
        self.site = site
        self._car = usual_car()

    def cells(self) -> None:
        """All cells, coloured by what they are for, and the arms."""
        site, grid = self.site, self.grid
        colors = np.full(grid.n_cells, CLOSED, dtype=object)
        colors[grid.free.ravel()] = FLOOR
        colors[site.walls.ravel()] = WALL
        colors[site.shelves.ravel()] = SHELF
        colors[list(site.parking)] = PARKING
        colors[list(site.chargers)] = CHARGER
        colors[list(site.storage)] = STORAGE
        for station in site.stations:
            colors[station.dock.cell] = PICK if station.kind == "pick" else DROP
        for cell in range(grid.n_cells):
            self.cell(cell, str(colors[cell]), share=1.0 - EDGE)
        for station in site.stations:
            x, y = station.arm.pose[:2]
            self.square(x, y, 0.36, ARM)

    def lanes(self) -> None:
        """An arrow for each lane, in the middle of the border that it crosses."""
        for begin, end in self.grid.cell_xy(self.site.lanes.ravel()).reshape(-1, 2, 2):
            self.arrow(begin + 0.38 * (end - begin), begin + 0.62 * (end - begin), LANE)

    def station_names(self) -> None:
        """The name of each station beside its arm, inside of the sheet."""
        for station in self.site.stations:
            x, y = station.arm.pose[:2]
            east = x > self.grid.cols * self.grid.cell_m / 2
            at = self.spot(x + (0.4 if east else -0.4), y + 0.62)
            self.words(at, station.name, anchor="end" if east else "start")

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
        width = 2.0 * self._car.half_width_m * self.px_per_m
        tail, front = np.array([x, y]) - self._car.rear_m * ahead, np.array([x, y]) + self._car.front_m * ahead
        self.line(np.array([tail, front]), color, width=width)
        self.line(np.array([front - 0.07 * ahead, front]), NOSE, width=width)

    def words(self, at: Spot, text: str, *, size: float = 12.0, anchor: str = "start", bold: bool = False) -> None:
        """A line of text, by a spot of the sheet."""
        self.drawing.marks.append(Words(at=at, text=text, size=size, color=INK, anchor=anchor, bold=bold))
