"""Projection: from coordinates of the earth to metres in a plane, for which pyproj is needed (the extra `rmf`).

Source: Open-RMF, rmf_building_map_tools (wgs84_transform, web_mercator_transform),
https://github.com/open-rmf/rmf_traffic_editor. There the first axis of every plane is north, so planes whose first axis
is east come out mirrored, and all are in metres. Here x is east, y is north, and feet become metres.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.layouts.layout import LayoutError
from maps.layouts.rmf.yaml_file import EXTRA
from maps.reading.shown import shown

Floats = npt.NDArray[np.float64]

_EARTH = "EPSG:4326"
_TILES = "EPSG:3857"
_EQUATOR_M = 6378137.0 * math.pi
"""Half the equator of EPSG:3857 [m], which is half the edge of its tile."""
_HALF_TILE = 128.0
"""Half the edge of the tile in coordinates of a file."""


class Projection:
    """One of the plane of a file.

    Args:
        plane: Name of a projected coordinate reference system, such as `EPSG:3414`.
        tiles: Whether places are on the tile of the whole earth, 256 wide and high with y down, instead of longitude
            and latitude in degrees.
        where: Opens every message.

    Raises:
        LayoutError: There is no such plane, or pyproj is not installed.
    """

    def __init__(self, plane: str, *, tiles: bool, where: str) -> None:
        pyproj = _pyproj()
        self._tiles = tiles
        valid = "a projected coordinate reference system, such as EPSG:3414"
        try:
            made = pyproj.CRS(plane)
        except pyproj.exceptions.CRSError as error:
            raise LayoutError(f"{where} is {shown(plane)}; valid: {valid}") from error
        if not made.is_projected:
            raise LayoutError(f"{where} is {shown(plane)}, which is no plane; valid: {valid}")
        self._unit_m = float(made.axis_info[0].unit_conversion_factor)
        self._way = pyproj.Transformer.from_crs(_TILES if tiles else _EARTH, made, always_xy=True)

    def __call__(self, xy: Floats) -> Floats:
        """Places in the plane [m], shape (n, 2); infinite where the plane does not reach.

        Args:
            xy: Of the file, shape (n, 2): longitude and latitude [deg], or a place on the tile.
        """
        if self._tiles:
            xy = (xy - _HALF_TILE) * (1.0, -1.0) * (_EQUATOR_M / _HALF_TILE)
        return np.column_stack(self._way.transform(xy[:, 0], xy[:, 1])) * self._unit_m


def _pyproj() -> Any:
    try:
        import pyproj
        import pyproj.exceptions
    except ImportError as error:
        raise LayoutError(f"coordinates of the earth need pyproj, which is not installed; valid: {EXTRA}") from error
    return pyproj
