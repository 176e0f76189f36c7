"""HandoverDrawing: cars, arms and parcels seen from above, as a picture in an array; for any fidelity."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.envs.core.base import Picture
from fleet.envs.core.floor_drawing import FloorDrawing
from maps.site import Site

ARM, PARCEL, LINE_M = (225, 120, 30), (120, 80, 40), 0.05
"""Colours of arms and parcels, and width of an arm [m]."""


class HandoverDrawing:
    """Draws an episode; the floor is drawn once.

    Args:
        site: The floor.
        arm_base: Feet of the arms, x, y, z, yaw, shape (m, 4).
    """

    def __init__(self, site: Site, arm_base: FloatArray) -> None:
        self._floor = FloorDrawing(site)
        self._feet = arm_base[:, :2]

    def picture(
        self, cars: FloatArray, loaded: npt.NDArray[np.bool_], tips: FloatArray, parcels: FloatArray
    ) -> Picture:
        """The episode now, north up.

        Args:
            cars: Poses of the rear axles, x, y, yaw, shape (n, 3).
            loaded: Which cars carry a parcel, shape (n,).
            tips: Where the arms' tools are, shape (m, 3).
            parcels: Where parcels are, shape (p, 7).

        Returns:
            Shape (height, width, 3).
        """
        # Nobody is told where cars go.
        image = self._floor.picture(cars, loaded, cars[:, :2])
        for foot, tip in zip(self._feet, tips[:, :2], strict=True):
            self._floor.line(image, foot, tip, LINE_M, ARM)
        for x, y in parcels[:, :2]:
            self._floor.line(image, np.array([x - 0.03, y]), np.array([x + 0.03, y]), 0.06, PARCEL)
        return image
