"""Tray: the open box in which a robot carries parcels."""

from __future__ import annotations

from dataclasses import dataclass

Triple = tuple[float, float, float]
TRAY_RGBA = (0.85, 0.60, 0.15, 1.0)


@dataclass(frozen=True, kw_only=True)
class Tray:
    """An open box on a robot."""

    x_m: float
    """Its centre ahead of the robot's frame, for a car the rear axle [m]."""
    floor_z_m: float
    """Top of its floor above the origin of that frame, for a car the ground [m]."""
    inner_m: Triple
    """Inner length, inner width, height of the walls [m]."""
    wall_m: float
    """Thickness of walls and floor [m]."""

    @property
    def outer_m(self) -> tuple[float, float]:
        """Length and width with the walls [m]."""
        length, width, _ = self.inner_m
        return length + 2 * self.wall_m, width + 2 * self.wall_m

    @property
    def top_z_m(self) -> float:
        """Top of the walls above the origin [m]."""
        return self.floor_z_m + self.inner_m[2]

    def plates(self) -> list[tuple[Triple, Triple]]:
        """Size and centre of the four walls in the robot's frame [m]."""
        length, width, wall = self.inner_m
        middle, plates = self.floor_z_m + wall / 2, []
        for side in (1.0, -1.0):
            along, across = side * (length + self.wall_m) / 2, side * (width + self.wall_m) / 2
            plates.append(((self.wall_m, self.outer_m[1], wall), (self.x_m + along, 0.0, middle)))
            plates.append(((length, self.wall_m, wall), (self.x_m, across, middle)))
        return plates

    def floor(self, bottom_z_m: float) -> tuple[Triple, Triple]:
        """Size and centre of a floor that reaches down to a height above the origin [m]."""
        return (*self.outer_m, self.floor_z_m - bottom_z_m), (self.x_m, 0.0, (self.floor_z_m + bottom_z_m) / 2)
