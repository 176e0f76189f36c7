"""Split: which part of the floor belongs to which tile."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import maximum_filter

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.world.arm_groups import arm_groups
from fleet.world.scene import Scene
from fleet.world.tiled.config import TiledConfig

CELL_M = 1.0
"""Length of the squares that tiles are made of [m]."""


@dataclass(frozen=True, kw_only=True)
class Split:
    """Tiles of a floor."""

    tile_at: IntArray
    """Tile of each square, shape (rows, cols); row 0 lies at y = 0."""
    tile_of_arm: IntArray
    """Shape (n_arms,)."""
    n_tiles: int

    def near(self, tile: int) -> BoolArray:
        """Squares of a tile and those around it, shape (rows, cols)."""
        near: BoolArray = maximum_filter(self.tile_at == tile, size=3)
        return near

    def at(self, x_m: float, y_m: float) -> int:
        """The tile of a place; beside the floor, that of the nearest square."""
        return int(_at_place(self.tile_at, x_m, y_m))

    def bounds(self, tile: int) -> FloatArray:
        """Lowest and highest corner of a tile, x, y, shape (2, 2) [m]."""
        rows, cols = np.nonzero(self.tile_at == tile)
        low, high = (cols.min(), rows.min()), (cols.max() + 1, rows.max() + 1)
        return CELL_M * np.array([low, high], dtype=np.float64)


def split_floor(scene: Scene, config: TiledConfig) -> Split:
    """Cut the floor in halves until no tile has more than its share of it, and give each arm the floor around it.

    Args:
        scene: Size of the floor, number of cars, and where arms stand.
        config: Cars of a tile.
    """
    cols, rows = (max(1, math.ceil(size / CELL_M - 1e-9)) for size in scene.size_m)
    tile_at = np.zeros((rows, cols), dtype=np.int64)
    n_wanted = min(math.ceil(len(scene.car_start) / config.n_cars), rows * cols)
    n_tiles = _cut(tile_at, max(1, n_wanted), 0)
    xy = np.asarray(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2]
    tile_of_arm = np.zeros(len(xy), dtype=np.int64)
    for arms in arm_groups(xy, config.arm_m):
        tile_of_arm[arms] = _at_place(tile_at, *xy[arms[0]].tolist())
    if len(xy):
        y, x = (np.indices(tile_at.shape) + 0.5) * CELL_M
        away = np.full(tile_at.shape, config.arm_m)
        for arm, (at_x, at_y) in enumerate(xy.tolist()):
            gap = np.hypot(x - at_x, y - at_y)
            tile_at[gap < away] = tile_of_arm[arm]
            away = np.minimum(away, gap)
    kept, numbers = np.unique(tile_at, return_inverse=True)
    renumbered = np.searchsorted(kept, tile_of_arm)
    return Split(tile_at=numbers.reshape(tile_at.shape), tile_of_arm=renumbered, n_tiles=min(n_tiles, len(kept)))


def _cut(tile_at: npt.NDArray[np.int64], n_tiles: int, first: int) -> int:
    """Cut a rectangle across its longer side into tiles of about the same area; returns how many there are."""
    if n_tiles == 1 or tile_at.size == 1:
        tile_at[:] = first
        return 1
    n_low = n_tiles // 2
    axis = int(tile_at.shape[1] > tile_at.shape[0])
    at = min(max(1, round(tile_at.shape[axis] * n_low / n_tiles)), tile_at.shape[axis] - 1)
    low, high = np.split(tile_at, [at], axis=axis)
    n = _cut(low, n_low, first)
    return n + _cut(high, n_tiles - n_low, first + n)


def tile_scene(scene: Scene, split: Split, tile: int, cars: list[int], near_m: float) -> Scene:
    """The part of a scene that a tile is made of.

    Args:
        scene: The whole.
        split: The tiles.
        tile: Which of them.
        cars: Those that start there.
        near_m: Boxes that reach so near to it belong to it too [m].
    """
    arms = np.flatnonzero(split.tile_of_arm == tile)
    kind_of = scene.car_kind_of
    bounds = split.bounds(tile)
    boxes = [box for box in scene.boxes if reaches(bounds, np.array(box.centre_m), np.array(box.half_m), near_m)]
    return replace(
        scene,
        boxes=tuple(boxes),
        car_start=np.asarray(scene.car_start, dtype=np.float64).reshape(-1, 3)[cars],
        arms=scene.arms.part(arms),
        car_kind_of=None if kind_of is None else kind_of[cars],
        arm_base=scene.arm_base[arms],
        arm_start=scene.arm_start[arms],
    )


def reaches(bounds: FloatArray, centre_m: FloatArray, half_m: FloatArray, near_m: float) -> bool:
    """Whether a box comes nearer than `near_m` to a rectangle, lowest and highest corner (2, 2), seen from above."""
    low, high = centre_m[:2] - half_m[:2], centre_m[:2] + half_m[:2]
    return bool(((low <= bounds[1] + near_m) & (high >= bounds[0] - near_m)).all())


@njit(cache=True)
def _at_place(squares: npt.NDArray[np.generic], x: float, y: float) -> int:
    """What stands for the square at a place; beside the floor, for the nearest one."""
    rows, cols = squares.shape
    return squares[min(max(int(y // CELL_M), 0), rows - 1), min(max(int(x // CELL_M), 0), cols - 1)]


@njit(cache=True)
def _middle(pose: FloatArray, middle_m: float) -> tuple[float, float]:
    """Where the middle of a car is that stands at a pose x, y, yaw."""
    return pose[0] + middle_m * math.cos(pose[2]), pose[1] + middle_m * math.sin(pose[2])


@njit(cache=True)
def find_tiles(poses: FloatArray, middle_m: float, tile_at: IntArray, border_m: float, tile_of: IntArray) -> IntArray:
    """Tile that each car should be in: the one it is in, unless it is `border_m` across its border, shape (n,).

    Args:
        poses: Of the rear axles, x, y, yaw, shape (n, 3).
        middle_m: From the rear axle to the middle of a car [m].
        tile_at: Tile of each square, shape (rows, cols).
        border_m: How far across [m].
        tile_of: Tile that each is in, -1 for none yet, shape (n,).
    """
    wanted = tile_of.copy()
    for car in range(len(poses)):
        x, y = _middle(poses[car], middle_m)
        here = _at_place(tile_at, x, y)
        if here == tile_of[car]:
            continue
        across = True
        for side in (-border_m, border_m):
            for ahead in (-border_m, border_m):
                across = across and _at_place(tile_at, x + ahead, y + side) != tile_of[car]
        if across or tile_of[car] < 0:
            wanted[car] = here
    return wanted


@njit(cache=True)
def find_guests(poses: FloatArray, middle_m: float, near: BoolArray, tile_of: IntArray, tile: int) -> IntArray:
    """Cars of other tiles that are near to a tile, ascending, shape (g,).

    Args:
        poses: Of the rear axles, x, y, yaw, shape (n, 3).
        middle_m: From the rear axle to the middle of a car [m].
        near: Squares that count as near, shape (rows, cols).
        tile_of: Tile that each car is in, shape (n,).
        tile: The tile.
    """
    guests = np.empty(len(poses), dtype=np.int64)
    n = 0
    for car in range(len(poses)):
        if tile_of[car] == tile:
            continue
        x, y = _middle(poses[car], middle_m)
        if _at_place(near, x, y):
            guests[n] = car
            n += 1
    return guests[:n]
