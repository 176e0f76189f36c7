import math

import numpy as np
import pytest

from maps.errors import MapsError
from maps.grid import DCOL, DROW, EAST, HEADING_YAW, NORTH, SOUTH, WEST, CellOutsideError, GridMap


def test_row_zero_is_the_top_row_so_north_is_up():
    grid = GridMap(np.ones((3, 5), dtype=bool))
    assert grid.xy(0, 0) == (0.5, 2.5)
    assert grid.xy(2, 4) == (4.5, 0.5)
    assert (grid.rows, grid.cols, grid.n_cells) == (3, 5, 15)


def test_cells_and_metres_convert_both_ways():
    grid = GridMap(np.ones((4, 6), dtype=bool), cell_m=1.5)
    for cell in range(grid.n_cells):
        row, col = grid.row_col(cell)
        assert grid.index(row, col) == cell
        assert grid.cell_at(*grid.xy(row, col)) == (row, col)
        np.testing.assert_array_equal(grid.cell_xy(cell)[0], grid.xy(row, col))


def test_headings_point_where_their_yaw_points():
    for heading in (EAST, NORTH, WEST, SOUTH):
        assert math.cos(HEADING_YAW[heading]) == pytest.approx(DCOL[heading], abs=1e-15)
        assert math.sin(HEADING_YAW[heading]) == pytest.approx(-DROW[heading], abs=1e-15)


def test_neighbour_stops_at_the_border():
    grid = GridMap(np.ones((2, 3), dtype=bool))
    assert [grid.neighbour(2, heading) for heading in range(4)] == [-1, -1, 1, 5]


def test_point_outside_is_named():
    with pytest.raises(CellOutsideError, match=r"\(3.200, 0.500\) m is outside the floor; valid: x 0 to 3, y 0 to 2"):
        GridMap(np.ones((2, 3), dtype=bool)).cell_at(3.2, 0.5)


@pytest.mark.parametrize(("free", "cell_m"), [(np.ones(3, dtype=bool), 1.0), (np.ones((2, 2), dtype=bool), 0.0)])
def test_malformed_grid_is_refused(free, cell_m):
    with pytest.raises(MapsError):
        GridMap(free, cell_m)


def test_grid_keeps_its_own_read_only_copy():
    free = np.ones((2, 2), dtype=bool)
    grid = GridMap(free)
    free[0, 0] = False
    assert grid.free.all()
    with pytest.raises(ValueError, match="read-only"):
        grid.free[0, 0] = False
