"""TopView: a floor with cars, their ways and goals, seen from above, as a picture in an array."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from fleet.world.protocol import FloatArray
from fleet.world.scene import Scene

WIDTH_PX = 720
"""Longer side of the largest picture."""
MAX_SCALE_PX = 48
"""Pixels per metre of a small floor."""
FLOOR, WAY, GOAL, CAR, NOSE = (244, 244, 240), (200, 200, 192), (120, 190, 120), (40, 110, 190), (180, 210, 240)
BOXES = {"wall": (90, 90, 96), "shelf": (150, 140, 128), "pedestal": (196, 186, 170)}


class TopView:
    """Draws cars; what never moves is drawn once.

    Args:
        scene: The floor and the model of the cars.
    """

    def __init__(self, scene: Scene) -> None:
        self._car = scene.car
        self._height_m = scene.size_m[1]
        self._scale = max(8, min(MAX_SCALE_PX, int(WIDTH_PX / max(scene.size_m))))
        size = (math.ceil(scene.size_m[0] * self._scale), math.ceil(scene.size_m[1] * self._scale))
        self._background = Image.new("RGB", size, FLOOR)
        pen = ImageDraw.Draw(self._background)
        for box in scene.boxes:
            (x, y, _), (half_x, half_y, _) = box.centre_m, box.half_m
            corners = np.array([(x - half_x, y + half_y), (x + half_x, y - half_y)])
            pen.rectangle(self._pixels(corners), fill=BOXES[box.kind])

    def picture(self, poses: FloatArray, ways: Sequence[FloatArray]) -> npt.NDArray[np.uint8]:
        """Draw one moment, north up.

        Args:
            poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            ways: Points of the way of each car to its goal [m], each (k, 2), k may be 0.

        Returns:
            Shape (height, width, 3).
        """
        image = self._background.copy()
        pen = ImageDraw.Draw(image)
        for way in ways:
            if len(way) > 1:
                pen.line(self._pixels(way), fill=WAY, width=3)
            if len(way):
                (x, y), radius = self._pixels(way[-1:])[0], 0.12 * self._scale
                pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=GOAL)
        car = self._car
        for x, y, yaw in poses:
            turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
            for rear, front, colour in ((-car.rear_m, car.front_m, CAR), (car.front_m - 0.1, car.front_m, NOSE)):
                sides = [(rear, -car.half_width_m), (front, -car.half_width_m)]
                corners = np.array([*sides, *((u, -v) for u, v in reversed(sides))])
                pen.polygon(self._pixels(corners @ turn + (x, y)), fill=colour)
        return np.array(image)

    def _pixels(self, points: FloatArray) -> list[tuple[float, float]]:
        """Pixel coordinates of world points (k, 2)."""
        return [(x * self._scale, (self._height_m - y) * self._scale) for x, y in points.tolist()]
