"""Sizes and turning circles of vehicles, measured from the centre of the rear axle, and the cells under their bodies.

Source of the numbers: the usual car (`fleet.robots`), with a wheelbase of 0.325 m; a pure-pursuit controller follows
arcs of 0.4 m radius within 4 cm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

BODY_FRONT_M = 0.41
"""Reach of the body ahead of the rear axle [m]."""
TRAY_AHEAD_M = 0.16
"""Centre of the tray ahead of the rear axle [m]."""
TURN_RADIUS_M = 0.4
"""Radius of the rear axle's arc in a left or right move [m]."""
ENTRY_INSET_M = 0.1
"""Where a car waits: rear axle this far inside the entry side of its cell [m], so that its tail is inside too."""
TURN_M_PER_RAD = 0.25
"""Length on a path that stands for a radian of a turn on the spot [m]; about what the wheels of a small robot roll."""
STRAY_M = 0.001
"""A path is sampled, and a body may be this far outside of its cells between samples [m]."""


@dataclass(frozen=True, kw_only=True)
class Footprint:
    """What a vehicle takes of the floor, and how tightly it turns."""

    front_m: float
    """Reach of the body ahead of the rear axle [m]."""
    rear_m: float
    """Reach behind it [m]."""
    half_width_m: float
    turn_radius_m: float
    """Least radius of the rear axle's arc [m]."""
    pivots: bool = False
    """Whether it turns on the spot, about its reference point. It then waits in the middle of its cell."""

    def inset_m(self, cell_m: float) -> float:
        """How far inside the entry side of its cell its reference point is when it waits [m]."""
        return cell_m / 2 if self.pivots else ENTRY_INSET_M

    def cells(self, poses: npt.NDArray[np.float64], cell_m: float) -> set[tuple[int, int]]:
        """Cells that the body touches at any of some poses.

        Args:
            poses: x, y [m], yaw [rad], shape (k, 3); (0, 0) is the middle of cell (0, 0).
            cell_m: Edge of a cell [m].

        Returns:
            Whole numbers of cells along x and along y.
        """
        found: set[tuple[int, int]] = set()
        length, width = (self.front_m + self.rear_m) / 2 - STRAY_M, self.half_width_m - STRAY_M
        shift, half = (self.front_m - self.rear_m) / 2, cell_m / 2
        for axle_x, axle_y, yaw in poses.tolist():
            cos, sin = math.cos(yaw), math.sin(yaw)
            x, y = axle_x + shift * cos, axle_y + shift * sin
            along, across = abs(cos) * length + abs(sin) * width, abs(sin) * length + abs(cos) * width
            reach = half * (abs(cos) + abs(sin))
            for i in range(round((x - along) / cell_m), round((x + along) / cell_m) + 1):
                for j in range(round((y - across) / cell_m), round((y + across) / cell_m) + 1):
                    dx, dy = i * cell_m - x, j * cell_m - y
                    # The axes of the body; those of the cell part none of the cells that its extent touches.
                    if abs(cos * dx + sin * dy) < length + reach and abs(cos * dy - sin * dx) < width + reach:
                        found.add((i, j))
        return found
