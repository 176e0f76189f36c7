"""FloorPicture: a site from above, on which ways, places and cars are drawn in metres."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from fleet.charts.drawing import Box, Dot, Drawing, Line, MovingDot, Spot, Words
from maps.site import Site

WALL, SHELF, DOCK, PARKING, CHARGER, ARM = "#8a97a6", "#c8a878", "#dfe8f2", "#eeeeee", "#e3f0e3", "#404040"
LANE = "#c4ccd4"
MARGIN_PX, TITLE_PX = 8.0, 30.0
_HEAD = 0.13
"""Half width of the arrow head of a lane [cells]."""


class FloorPicture:
    """A sheet with the walls, shelves, docks, arms, parking places and lanes of a site.

    Args:
        site: The site.
        title: Over the picture.
        cell_px: Edge of a cell [px].
        lanes: Whether lanes are drawn.
    """

    def __init__(self, site: Site, title: str = "", *, cell_px: float = 40.0, lanes: bool = True) -> None:
        self._site, self._cell_px = site, cell_px
        self._top = MARGIN_PX + (TITLE_PX if title else 0.0)
        grid = site.grid
        width = round(grid.cols * cell_px + 2 * MARGIN_PX)
        self.sheet = Drawing(width=width, height=round(grid.rows * cell_px + self._top + MARGIN_PX))
        if title:
            self.sheet.marks.append(Words(at=(MARGIN_PX, 22), text=title, size=15, bold=True))
        for mask, color in ((site.walls, WALL), (site.shelves, SHELF)):
            self.cells(np.flatnonzero(mask).tolist(), color)
        self.cells([station.dock.cell for station in site.stations], DOCK)
        self.cells(site.parking, PARKING)
        self.cells(site.chargers, CHARGER)
        if lanes:
            for start, end in grid.cell_xy(site.lanes.ravel()).reshape(-1, 2, 2):
                self._lane(start, end)
        for station in site.stations:
            x, y = station.arm.pose[:2]
            self.dot((x, y), ARM, radius_m=0.16)
            self.words((x, y + 0.35 * grid.cell_m), station.name)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self.sheet._repr_html_()

    def spot(self, point: Sequence[float]) -> Spot:
        """Where a point x, y [m] is on the sheet [px]."""
        scale = self._cell_px / self._site.grid.cell_m
        height_m = self._site.grid.rows * self._site.grid.cell_m
        return MARGIN_PX + scale * float(point[0]), self._top + scale * (height_m - float(point[1]))

    def cells(self, cells: Iterable[int], color: str, *, opacity: float = 1.0, title: str = "") -> None:
        """Paint cells, given by index."""
        size = (self._cell_px, self._cell_px)
        for cell in cells:
            row, col = self._site.grid.row_col(cell)
            at = (MARGIN_PX + col * self._cell_px, self._top + row * self._cell_px)
            self.sheet.marks.append(Box(at=at, size=size, color=color, opacity=opacity, title=title))

    def line(self, points_m: npt.ArrayLike, color: str, *, width: float = 2.5, dashed: bool = False) -> None:
        """Draw a line through points x, y [m], shape (k, 2) or wider."""
        points = [self.spot(point) for point in np.asarray(points_m)]
        self.sheet.marks.append(Line(points=points, color=color, width=width, dashed=dashed))

    def dot(self, point_m: Sequence[float], color: str, *, radius_m: float = 0.2, title: str = "") -> None:
        """Draw a dot at x, y [m]."""
        radius = radius_m * self._cell_px / self._site.grid.cell_m
        self.sheet.marks.append(Dot(at=self.spot(point_m), color=color, radius=radius, title=title))

    def words(self, point_m: Sequence[float], text: str, *, color: str = "#222222", bold: bool = False) -> None:
        """Write a word over x, y [m], wholly on the sheet."""
        (x, y), size = self.spot(point_m), max(0.3 * self._cell_px, 10.0)
        half = 0.3 * size * len(text)
        x = min(max(x, half + 2), self.sheet.width - half - 2)
        self.sheet.marks.append(Words(at=(x, y), text=text, size=size, color=color, anchor="middle", bold=bold))

    def mover(self, points_m: npt.ArrayLike, color: str, *, lasts_s: float, text: str = "") -> None:
        """Let a car drive through points x, y [m], which it reaches after equal times, over and over."""
        points = [self.spot(point) for point in np.asarray(points_m)]
        radius = 0.3 * self._cell_px
        self.sheet.marks.append(MovingDot(points=points, lasts_s=lasts_s, color=color, radius=radius, text=text))

    def _lane(self, start: npt.NDArray[np.float64], end: npt.NDArray[np.float64]) -> None:
        """An arrow between two cells."""
        ahead = end - start
        aside = np.array([-ahead[1], ahead[0]])
        tip = start + 0.58 * ahead
        back = tip - 1.3 * _HEAD * ahead
        self.line([start + 0.5 * _HEAD * ahead, end], LANE, width=1.0)
        self.line([back + _HEAD * aside, tip, back - _HEAD * aside], LANE, width=1.5)
