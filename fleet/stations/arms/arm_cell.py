"""ArmCell: what surrounds one arm, in its base frame: plain data that can cross a process border."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.robots.spec import CarSpec
from fleet.tasks.order import MAX_EDGE_M
from fleet.world.scene import Scene, StaticBox
from fleet.world.site_scene import USUAL_TRAY_M, dock_pose
from maps.grid import GridMap
from maps.site import Site
from maps.stations import StationPlace

REACH_M = 1.4
"""Boxes farther from the base than this cannot be touched [m]: arms reach up to 0.86 m, plus tool and parcel."""
FENCE_M = 0.95
"""An arm stays within this of its base along x and along y [m]; bases are at least twice as far apart."""
PASSING_CAR_M = 0.45
"""Height kept free over drivable cells: a car with the usual tray and the highest parcel is 0.31 m tall [m]."""
DOCK_CAR_M = 0.33
"""The same in the dock cell, below which no arm comes but to serve the car there: its via points lie low over the tray,
where a tool reaches down to 0.37 m [m]."""
ASTRAY_M = 0.10
"""A car that passes a dock straight keeps to its centre line within this [m]."""
FLOOR_FRAME = 2
"""Links below this are bolted down and may touch the floor."""


@dataclass(frozen=True, kw_only=True)
class ArmCell:
    """Obstacles and places of one arm.

    Boxes are oriented about z; rows of the arrays belong together.
    """

    car: CarSpec
    """What cars at the dock look like, and their trays."""
    base_pose: FloatArray
    """World pose of the base, x, y, z, yaw, shape (4,)."""
    slots: FloatArray
    """Centres of the slots' top surfaces in the base frame [m], shape (k, 3)."""
    tray: FloatArray
    """Centre of the tray's floor in the base frame for a car exactly at the dock [m], shape (3,)."""
    box_centre: FloatArray
    """Shape (b, 3)."""
    box_half: FloatArray
    """Shape (b, 3)."""
    box_yaw: FloatArray
    """Shape (b,)."""
    box_min_frame: IntArray
    """Links below this number do not count against the box, shape (b,)."""
    box_name: tuple[str, ...]
    """What each box is, if it was drawn: 'shelf at row 5, column 4', 'lane at ...', 'slot 2'; else empty."""
    dock_box: FloatArray
    """Room that cars take on their lane through the dock cell: centre, half extents, shape (2, 3); x along the lane."""
    dock_yaw: float
    """Direction of that lane in the base frame [rad]."""

    def base_from_world(self, points: FloatArray) -> FloatArray:
        """World points (..., 3) in the base frame."""
        return _in_base(self.base_pose, points)

    def geometry_key(self) -> bytes:
        """Equal for cells whose surroundings are the same in their base frames."""
        arrays = (
            self.slots,
            self.tray,
            self.box_centre,
            self.box_half,
            self.box_yaw,
            self.dock_box,
            np.array(self.dock_yaw),
        )
        return b"".join(np.round(a, 6).tobytes() for a in arrays) + self.box_min_frame.tobytes()


class _Box(NamedTuple):
    """A box in the world, turned about z, as `ArmCell` keeps its parts."""

    centre: FloatArray
    half: FloatArray
    yaw: float = 0.0
    min_frame: int = 0
    name: str = ""


def arm_cells(site: Site, scene: Scene) -> tuple[ArmCell, ...]:
    """Surroundings of every station's arm, in the order of the stations; once for each kind of tray that cars have."""
    return tuple(cell for car in scene.cars.hulls for cell in _arm_cells(site, scene, car))


def _arm_cells(site: Site, scene: Scene, car: CarSpec) -> list[ArmCell]:
    """Surroundings of every station's arm when such a car is at the dock."""
    centre = np.array([box.centre_m[:2] for box in scene.boxes]).reshape(-1, 2)
    half = np.array([box.half_m[:2] for box in scene.boxes]).reshape(-1, 2)
    cells = []
    for arm, place in enumerate(site.stations):
        # A first look at all boxes together, since a large floor has thousands for each of hundreds of arms.
        gap = np.abs(centre - np.array(place.arm.pose[:2])) - half
        near = np.flatnonzero((gap < REACH_M).all(axis=1))
        cells.append(_arm_cell(site, scene, arm, place, [scene.boxes[k] for k in near.tolist()], car))
    return cells


def _arm_cell(
    site: Site, scene: Scene, arm: int, place: StationPlace, near_boxes: list[StaticBox], car: CarSpec
) -> ArmCell:
    base = np.array(scene.arm_base[arm], dtype=np.float64)
    grid, docked = site.grid, dock_pose(site, place, car)
    passing_m = PASSING_CAR_M + max(scene.cars.most("tray_floor_z_m") - USUAL_TRAY_M, 0.0)
    dock_m = DOCK_CAR_M + max(car.tray_floor_z_m - USUAL_TRAY_M, 0.0)
    boxes: list[_Box] = [_Box(np.array([base[0], base[1], -0.05]), np.array([3.0, 3.0, 0.05]), 0.0, FLOOR_FRAME)]
    for box in near_boxes:
        centre, half = np.array(box.centre_m), np.array(box.half_m)
        own = box.kind == "stand" and np.allclose(centre[:2], base[:2])
        name = "" if own else _name(grid, place, box.kind, centre, half)
        boxes.append(_Box(centre, half, min_frame=FLOOR_FRAME if own else 0, name=name))
    for number, (x, y, z) in enumerate(place.slots, start=1):
        # Always as if the rack were full of the largest parcels, so that a plan holds whatever lies there.
        top = np.array([x, y, z + MAX_EDGE_M / 2])
        boxes.append(_Box(top, np.full(3, MAX_EDGE_M / 2), name=f"slot {number}"))
    boxes += _car_boxes(car, docked)
    for lane_cell in _lane_cells_around(grid, base):
        if lane_cell == place.dock.cell:
            continue
        x, y = grid.xy(*grid.row_col(lane_cell))
        half = np.array([grid.cell_m / 2, grid.cell_m / 2, passing_m / 2])
        if np.hypot(x - base[0], y - base[1]) < REACH_M + grid.cell_m:
            name = f"lane at {_at(grid, x, y)}"
            boxes.append(_Box(np.array([x, y, passing_m / 2]), half, name=name))
    near = [box for box in boxes if _gap(box, base) < REACH_M] + _fence(base)
    dock_x, dock_y = grid.xy(*grid.row_col(place.dock.cell))
    dock_centre = _in_base(base, np.array([dock_x, dock_y, dock_m / 2]))
    x, y, yaw = docked
    ahead = car.tray_x_m
    tray = np.array([x + ahead * np.cos(yaw), y + ahead * np.sin(yaw), car.tray_floor_z_m])
    return ArmCell(
        car=car,
        base_pose=base,
        slots=_in_base(base, np.asarray(place.slots, dtype=np.float64)),
        tray=_in_base(base, tray),
        box_centre=_in_base(base, np.array([box.centre for box in near])),
        box_half=np.array([box.half for box in near]),
        box_yaw=np.array([box.yaw - base[3] for box in near]),
        box_min_frame=np.array([box.min_frame for box in near], dtype=np.int64),
        box_name=tuple(box.name for box in near),
        dock_box=np.array([dock_centre, (grid.cell_m / 2, car.half_width_m + ASTRAY_M, dock_m / 2)]),
        dock_yaw=yaw - base[3],
    )


def _in_base(base_pose: FloatArray, points: FloatArray) -> FloatArray:
    """World points (..., 3) in the frame of a base at (x, y, z, yaw)."""
    x, y, z, yaw = base_pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    offset = points - np.array([x, y, z])
    turned = offset.copy()
    turned[..., 0] = cos * offset[..., 0] + sin * offset[..., 1]
    turned[..., 1] = -sin * offset[..., 0] + cos * offset[..., 1]
    return turned


def _name(grid: GridMap, place: StationPlace, kind: str, centre: FloatArray, half: FloatArray) -> str:
    """What a box of the scene was drawn as: walls and shelves by their cell that is nearest to the arm."""
    if kind == "pedestal":
        own = np.flatnonzero(np.abs(np.asarray(place.slots)[:, :2] - centre[:2]).max(axis=1) < 1e-6)
        return f"slot {own[0] + 1}" if len(own) else ""
    inside = half[:2] - min(1e-6, float(half[:2].min()))
    x, y = np.clip(place.arm.pose[:2], centre[:2] - inside, centre[:2] + inside).tolist()
    return f"{kind} at {_at(grid, x, y)}"


def _lane_cells_around(grid: GridMap, base: FloatArray) -> list[int]:
    """Free cells in the square around a base that holds all which it could reach, ascending."""
    away = int(REACH_M / grid.cell_m) + 2
    row, col = grid.cell_at(float(base[0]), float(base[1]))
    first_row, first_col = max(row - away, 0), max(col - away, 0)
    rows, cols = np.nonzero(grid.free[first_row : row + away + 1, first_col : col + away + 1])
    return np.asarray(grid.index(rows + first_row, cols + first_col)).tolist()


def _at(grid: GridMap, x: float, y: float) -> str:
    return grid.words(grid.index(*grid.cell_at(x, y)))


def _fence(base: FloatArray) -> list[_Box]:
    """Imaginary walls around the cell, so that two arms can never meet."""
    away = FENCE_M + 0.5
    return [
        _Box(np.array([base[0] + away * dx, base[1] + away * dy, 1.0]), np.array([hx, hy, 1.0]))
        for dx, dy, hx, hy in ((1, 0, 0.5, away), (-1, 0, 0.5, away), (0, 1, away, 0.5), (0, -1, away, 0.5))
    ]


def _car_boxes(car: CarSpec, pose: tuple[float, float, float]) -> list[_Box]:
    """Body and tray walls of a car at a pose."""
    x, y, yaw = pose
    length, width, wall_height = car.tray_size_m
    middle = (car.front_m - car.rear_m) / 2
    half_body = np.array([(car.front_m + car.rear_m) / 2, car.half_width_m, car.tray_floor_z_m / 2])
    parts = [((middle, 0.0, car.tray_floor_z_m / 2), half_body)]
    wall_z = car.tray_floor_z_m + wall_height / 2
    thick = car.tray_wall_m / 2
    for side in (-1.0, 1.0):
        along = np.array([length / 2, thick, wall_height / 2])
        across = np.array([thick, width / 2, wall_height / 2])
        parts.append(((car.tray_x_m, side * width / 2, wall_z), along))
        parts.append(((car.tray_x_m + side * length / 2, 0.0, wall_z), across))
    cos, sin = np.cos(yaw), np.sin(yaw)
    return [
        _Box(np.array([x + cos * dx - sin * dy, y + sin * dx + cos * dy, dz]), half, yaw)
        for (dx, dy, dz), half in parts
    ]


def _gap(box: _Box, base: FloatArray) -> float:
    """Horizontal distance from the base to a box's circumscribed rectangle [m]; at least that far."""
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    dx, dy = base[0] - box.centre[0], base[1] - box.centre[1]
    u, v = abs(cos * dx + sin * dy) - box.half[0], abs(-sin * dx + cos * dy) - box.half[1]
    return float(np.hypot(max(u, 0.0), max(v, 0.0)))
