"""FloorDrawing: cars on a floor seen from above, as a picture in an array; for any fidelity."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.envs.core.base import Picture
from fleet.robots.cars.models import usual_car
from maps.site import Site

LONGER_SIDE_PX = 960
CELL_PX = (4, 40)
"""Least and most pixels of a cell."""
N_LINE_DOTS = 40
"""Dots of the line from a car to its goal."""

Colour = tuple[int, int, int]

FLOOR, WALL, SHELF = (244, 244, 240), (90, 90, 96), (184, 174, 160)
PICK, DROP, PARKING, CHARGER = (200, 228, 200), (240, 214, 190), (226, 230, 238), (236, 226, 160)
EMPTY, LOADED, GOAL = (40, 110, 190), (200, 80, 30), (150, 170, 190)


class FloorDrawing:
    """Draws a fleet; the floor is drawn once.

    Args:
        site: The floor.
    """

    def __init__(self, site: Site) -> None:
        rows, cols = site.grid.rows, site.grid.cols
        low, high = CELL_PX
        self._scale = max(low, min(high, LONGER_SIDE_PX // max(rows, cols)))
        self._pixels_per_m = self._scale / site.grid.cell_m
        self._car = usual_car()
        cells = np.empty((rows, cols, 3), dtype=np.uint8)
        cells[:] = FLOOR
        cells[site.walls], cells[site.shelves] = WALL, SHELF
        flat = cells.reshape(-1, 3)
        flat[list(site.parking)] = PARKING
        flat[list(site.chargers)] = CHARGER
        for station in site.stations:
            flat[station.dock.cell] = PICK if station.kind == "pick" else DROP
        self._floor = cells.repeat(self._scale, axis=0).repeat(self._scale, axis=1)

    def picture(self, poses: FloatArray, loaded: npt.NDArray[np.bool_], goals: FloatArray) -> Picture:
        """The fleet now, north up.

        Args:
            poses: Of the rear axles, x, y, yaw, shape (n, 3).
            loaded: Which cars carry a parcel, shape (n,).
            goals: Where they go, x, y, shape (n, 2).

        Returns:
            Shape (height, width, 3).
        """
        image = self._floor.copy()
        parts = np.linspace(0.0, 1.0, N_LINE_DOTS)[:, None]
        for pose, goal in zip(poses, goals, strict=True):
            self._dots(image, pose[:2] + parts * (goal - pose[:2]), GOAL)
        for pose, has_parcel in zip(poses, loaded.tolist(), strict=True):
            self._body(image, pose, LOADED if has_parcel else EMPTY)
        return image

    def line(self, image: Picture, begin: FloatArray, end: FloatArray, width_m: float, colour: Colour) -> None:
        """Draw a line of a width into a picture, from one point to another, x, y each."""
        step_m = 0.5 / self._pixels_per_m
        along = end - begin
        length = max(float(np.hypot(*along)), step_m)
        aside = np.array([-along[1], along[0]]) / length
        there = np.arange(0.0, 1.0 + step_m / length, step_m / length)
        across = np.arange(-width_m / 2, width_m / 2 + step_m, step_m)
        s, t = (grid.reshape(-1, 1) for grid in np.meshgrid(there, across))
        self._dots(image, begin + s * along + t * aside, colour)

    def _dots(self, image: Picture, points: FloatArray, colour: Colour) -> None:
        col, row = self._pixels(points)
        image[row, col] = colour

    def _body(self, image: Picture, pose: FloatArray, colour: Colour) -> None:
        """Fill the rectangle of a car with dots half a pixel apart; its nose is dark."""
        car, step_m = self._car, 0.5 / self._pixels_per_m
        ahead = np.arange(-car.rear_m, car.front_m, step_m)
        left = np.arange(-car.half_width_m, car.half_width_m, step_m)
        x, y = (grid.ravel() for grid in np.meshgrid(ahead, left))
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        points = np.column_stack((pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y))
        self._dots(image, points, colour)
        self._dots(image, points[x > car.front_m - 0.1], (30, 30, 30))

    def _pixels(self, points: FloatArray) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        height, width = self._floor.shape[:2]
        col = np.clip(points[:, 0] * self._pixels_per_m, 0, width - 1).astype(np.intp)
        row = np.clip(height - points[:, 1] * self._pixels_per_m, 0, height - 1).astype(np.intp)
        return col, row
