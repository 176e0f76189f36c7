"""Scene of a site: floor map and stations become boxes and robot poses."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.config import ArmConfig, Grip
from fleet.robots import ARMS
from fleet.robots.cars.models import CarModels, usual_car
from fleet.robots.tools import TOOLS
from fleet.world.scene import Scene, StaticBox
from maps.grid import GridMap
from maps.site import Site

ARM = "iiwa14"
"""Arms of a site, as in `fleet.robots`."""
WALL_HEIGHT_M = 0.6
"""Low, so that a viewer looks over the walls; higher than a loaded car."""
SHELF_HEIGHT_M = 1.2
PEDESTAL_HALF_M = 0.08
SHELF_GAP_M = 0.03
"""Kept free around a shelf inside its cells [m]."""


def scene_of(
    site: Site,
    car_start: FloatArray,
    grip: Grip,
    arms: ArmConfig | None = None,
    cars: CarModels | None = None,
) -> Scene:
    """Build the scene of a site.

    Args:
        site: The site.
        car_start: Rear-axle poses, shape (n_cars, 3).
        grip: Decides the arms' tool.
        arms: May set other speed limits than the real arm's.
        cars: Models of the cars; None = the usual one.

    Returns:
        Walls and shelves merged into as few boxes as rectangles allow, a pedestal for every slot, robots at their
        starts, arms at home.
    """
    boxes = [
        *_merged_boxes(site.grid, site.walls, "wall", WALL_HEIGHT_M, 0.0),
        *_merged_boxes(site.grid, site.shelves, "shelf", SHELF_HEIGHT_M, SHELF_GAP_M),
    ]
    for station in site.stations:
        for x, y, z in station.slots:
            half = (PEDESTAL_HALF_M, PEDESTAL_HALF_M, z / 2)
            boxes.append(StaticBox(kind="pedestal", centre_m=(float(x), float(y), z / 2), half_m=half))
    arm = ARMS[ARM].spec(TOOLS[grip])
    if arms is not None:
        arm = arm.with_limits(arms.velocity_radps, arms.acceleration_radps2)
    return Scene(
        size_m=(site.grid.cols * site.grid.cell_m, site.grid.rows * site.grid.cell_m),
        boxes=tuple(boxes),
        car_kinds=cars.kinds if cars else (usual_car(),),
        car_start=car_start,
        car_kind_of=cars.kind_of if cars else None,
        arm=arm,
        arm_base=np.array([station.arm.pose for station in site.stations]).reshape(-1, 4),
        arm_start=np.tile(arm.home_rad, (len(site.stations), 1)),
    )


def _merged_boxes(grid: GridMap, mask: BoolArray, kind: str, height_m: float, gap_m: float) -> list[StaticBox]:
    """Cover the marked cells with disjoint rectangles, each grown to the right, then down."""
    left = mask.copy()
    boxes = []
    for row, col in np.argwhere(mask):
        if not left[row, col]:
            continue
        end_col = col
        while end_col + 1 < grid.cols and left[row, end_col + 1]:
            end_col += 1
        end_row = row
        while end_row + 1 < grid.rows and left[end_row + 1, col : end_col + 1].all():
            end_row += 1
        left[row : end_row + 1, col : end_col + 1] = False
        x0, y0 = grid.xy(int(row), int(col))
        x1, y1 = grid.xy(int(end_row), int(end_col))
        half_x = (x1 - x0 + grid.cell_m) / 2 - gap_m
        half_y = (y0 - y1 + grid.cell_m) / 2 - gap_m
        centre = ((x0 + x1) / 2, (y0 + y1) / 2, height_m / 2)
        boxes.append(StaticBox(kind=kind, centre_m=centre, half_m=(half_x, half_y, height_m / 2)))
    return boxes
