"""FloorPicture: a site from above, on which ways, places and cars are drawn in metres; FloorFrame is its frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from fleet.charts.drawing import Box, Dot, Drawing, Line, MovingDot, Spot, Words
from maps.grid import GridMap
from maps.site import Site

WALL, SHELF, DOCK, PARKING, CHARGER, ARM = "#8a97a6", "#c8a878", "#dfe8f2", "#eeeeee", "#e3f0e3", "#404040"
STORAGE = "#ecdfca"
LANE = "#c4ccd4"
MARGIN_PX, TITLE_PX = 8.0, 30.0
_HEAD = 0.13
"""Half width of the arrow head of a lane [cells]."""


class FloorFrame:
    """A sheet on which the points of a floor, or of a part of it, are given in metres.

    Args:
        grid: The floor.
        px_per_m: Pixels of a metre.
        rows: First row and the one behind the last; None = all.
        cols: The same of the columns.
        margin_px: Room round the floor [px].
        title_px: More room above it [px].
    """

    def __init__(
        self,
        grid: GridMap,
        *,
        px_per_m: float,
        rows: tuple[int, int] | None = None,
        cols: tuple[int, int] | None = None,
        margin_px: float = 0.0,
        title_px: float = 0.0,
    ) -> None:
        top, bottom = rows or (0, grid.rows)
        left, right = cols or (0, grid.cols)
        self.grid, self.px_per_m = grid, px_per_m
        self._west_m, self._north_m = left * grid.cell_m, (grid.rows - top) * grid.cell_m
        self._left_px, self._top_px = margin_px, margin_px + title_px
        cell_px = px_per_m * grid.cell_m
        self.drawing = Drawing(
            width=round((right - left) * cell_px + 2 * margin_px),
            height=round((bottom - top) * cell_px + 2 * margin_px + title_px),
        )

    def spot(self, x_m: float, y_m: float) -> Spot:
        """Where a point of the floor is on the sheet [px]."""
        return self._left_px + (x_m - self._west_m) * self.px_per_m, self._top_px + (
            self._north_m - y_m
        ) * self.px_per_m

    def square(
        self, x_m: float, y_m: float, edge_m: float, color: str, *, opacity: float = 1.0, title: str = ""
    ) -> None:
        """A square by its centre."""
        at = self.spot(x_m - edge_m / 2, y_m + edge_m / 2)
        size = (edge_m * self.px_per_m, edge_m * self.px_per_m)
        self.drawing.marks.append(Box(at=at, size=size, color=color, opacity=opacity, title=title))

    def cell(self, cell: int, color: str, *, share: float = 1.0, opacity: float = 1.0, title: str = "") -> None:
        """A square in the middle of a cell, whose edge is a share of that of the cell."""
        ((x, y),) = self.grid.cell_xy([cell]).tolist()
        self.square(x, y, share * self.grid.cell_m, color, opacity=opacity, title=title)

    def line(self, points_m: npt.ArrayLike, color: str, *, width: float = 2.5, dashed: bool = False) -> None:
        """A line through points x, y [m], shape (k, 2) or wider."""
        points = [self.spot(x, y) for x, y in np.asarray(points_m)[:, :2].tolist()]
        self.drawing.marks.append(Line(points=points, color=color, width=width, dashed=dashed))


class FloorPicture(FloorFrame):
    """A sheet with the walls, shelves, docks, arms, parking places and lanes of a site.

    Args:
        site: The site.
        title: Over the picture.
        cell_px: Edge of a cell [px].
        lanes: Whether lanes are drawn.
    """

    def __init__(self, site: Site, title: str = "", *, cell_px: float = 40.0, lanes: bool = True) -> None:
        grid, self._cell_px = site.grid, cell_px
        title_px = TITLE_PX if title else 0.0
        super().__init__(grid, px_per_m=cell_px / grid.cell_m, margin_px=MARGIN_PX, title_px=title_px)
        if title:
            self.drawing.marks.append(Words(at=(MARGIN_PX, 22), text=title, size=15, bold=True))
        for mask, color in ((site.walls, WALL), (site.shelves, SHELF)):
            self.cells(np.flatnonzero(mask).tolist(), color)
        self.cells([station.dock.cell for station in site.stations], DOCK)
        self.cells(site.parking, PARKING)
        self.cells(site.chargers, CHARGER)
        self.cells(site.storage, STORAGE)
        if lanes:
            for start, end in grid.cell_xy(site.lanes.ravel()).reshape(-1, 2, 2):
                self._lane(start, end)
        for station in site.stations:
            x, y = station.arm.pose[:2]
            self.dot((x, y), ARM, radius_m=0.16)
            self.words((x, y + 0.35 * grid.cell_m), station.name)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self.drawing._repr_html_()

    def cells(self, cells: Iterable[int], color: str, *, opacity: float = 1.0, title: str = "") -> None:
        """Paint cells, given by index."""
        for cell in cells:
            self.cell(cell, color, opacity=opacity, title=title)

    def dot(self, point_m: Sequence[float], color: str, *, radius_m: float = 0.2, title: str = "") -> None:
        """Draw a dot at x, y [m]."""
        radius = radius_m * self.px_per_m
        self.drawing.marks.append(Dot(at=self.spot(point_m[0], point_m[1]), color=color, radius=radius, title=title))

    def words(self, point_m: Sequence[float], text: str, *, color: str = "#222222", bold: bool = False) -> None:
        """Write a word over x, y [m], wholly on the sheet."""
        (x, y), size = self.spot(point_m[0], point_m[1]), max(0.3 * self._cell_px, 10.0)
        half = 0.3 * size * len(text)
        x = min(max(x, half + 2), self.drawing.width - half - 2)
        self.drawing.marks.append(Words(at=(x, y), text=text, size=size, color=color, anchor="middle", bold=bold))

    def mover(self, points_m: npt.ArrayLike, color: str, *, lasts_s: float, text: str = "") -> None:
        """Let a car drive through points x, y [m], which it reaches after equal times, over and over."""
        points = [self.spot(x, y) for x, y in np.asarray(points_m)[:, :2].tolist()]
        radius = 0.3 * self._cell_px
        self.drawing.marks.append(MovingDot(points=points, lasts_s=lasts_s, color=color, radius=radius, text=text))

    def _lane(self, start: npt.NDArray[np.float64], end: npt.NDArray[np.float64]) -> None:
        """An arrow between two cells."""
        ahead = end - start
        aside = np.array([-ahead[1], ahead[0]])
        tip = start + 0.58 * ahead
        back = tip - 1.3 * _HEAD * ahead
        self.line([start + 0.5 * _HEAD * ahead, end], LANE, width=1.0)
        self.line([back + _HEAD * aside, tip, back - _HEAD * aside], LANE, width=1.5)
