"""GridMap: the floor as cells, and the one conversion between cells (row, col) and metres (x, y)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError

BoolGrid = npt.NDArray[np.bool_]
Int = TypeVar("Int", int, npt.NDArray[np.integer])

EAST, NORTH, WEST, SOUTH = 0, 1, 2, 3
DROW = (0, -1, 0, 1)
"""Row step of each heading."""
DCOL = (1, 0, -1, 0)
"""Column step of each heading."""
HEADING_YAW = tuple(heading * math.pi / 2 for heading in range(4))
"""Yaw of each heading [rad], counter-clockwise from +x."""
HEADING_NAMES = ("east", "north", "west", "south")


class CellOutsideError(MapsError):
    """A cell or a point is not on the floor plan."""


@dataclass(frozen=True, eq=False)
class GridMap:
    """Which cells of a rectangular floor a vehicle may stand on.

    Row 0 is the top row, so north is up: a cell's centre lies at x = (col + 0.5) cell_m, y = (rows - row - 0.5) cell_m.
    A cell's index is row * cols + col.
    """

    free: BoolGrid
    """True where a vehicle may stand, shape (rows, cols); made read-only."""
    cell_m: float = 1.0
    """Edge of a cell [m]."""

    def __post_init__(self) -> None:
        free = np.array(self.free, dtype=np.bool_)
        if free.ndim != 2 or free.size == 0:
            raise MapsError(f"grid: shape is {free.shape}; valid: (rows, cols) with at least one cell")
        if not self.cell_m > 0:
            raise MapsError(f"grid: cell_m is {self.cell_m}; valid: a positive length in metres")
        free.setflags(write=False)
        object.__setattr__(self, "free", free)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GridMap):
            return NotImplemented
        return self.cell_m == other.cell_m and np.array_equal(self.free, other.free)

    __hash__ = None  # type: ignore[assignment]

    @property
    def rows(self) -> int:
        return int(self.free.shape[0])

    @property
    def cols(self) -> int:
        return int(self.free.shape[1])

    @property
    def n_cells(self) -> int:
        """Number of cells, free or not."""
        return self.rows * self.cols

    def index(self, row: Int, col: Int) -> Int:
        """Cell index of a row and column; works on integers and on integer arrays."""
        return row * self.cols + col

    def row_col(self, index: Int) -> tuple[Int, Int]:
        """Row and column of a cell index; works on integers and on integer arrays."""
        return index // self.cols, index % self.cols

    def words(self, index: int) -> str:
        """A cell as messages name it; rows count from 0 at the top, columns from 0 at the left, as everywhere."""
        row, col = self.row_col(index)
        return f"row {row}, column {col}"

    def xy(self, row: float, col: float) -> tuple[float, float]:
        """Centre of a cell [m]."""
        return (col + 0.5) * self.cell_m, (self.rows - row - 0.5) * self.cell_m

    def cell_xy(self, index: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Centres [m] of cells given by index, shape (n, 2)."""
        row, col = np.divmod(np.atleast_1d(np.asarray(index, dtype=np.int64)), self.cols)
        return np.column_stack(((col + 0.5) * self.cell_m, (self.rows - row - 0.5) * self.cell_m))

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds a point.

        Raises:
            CellOutsideError: The point [m] is not on the floor.
        """
        col = math.floor(x / self.cell_m)
        row = self.rows - 1 - math.floor(y / self.cell_m)
        if not (0 <= row < self.rows and 0 <= col < self.cols):
            width, height = self.cols * self.cell_m, self.rows * self.cell_m
            raise CellOutsideError(
                f"grid: point ({x:.3f}, {y:.3f}) m is outside the floor; valid: x 0 to {width:g}, y 0 to {height:g}"
            )
        return row, col

    def neighbour(self, cell: int, heading: int) -> int:
        """Index of the next cell in a heading, free or not; -1 beyond the border."""
        row, col = divmod(cell, self.cols)
        row, col = row + DROW[heading], col + DCOL[heading]
        return row * self.cols + col if 0 <= row < self.rows and 0 <= col < self.cols else -1
