"""Points of rays: what every world wants to know of them before it casts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.sensors.errors import SensorError

FARTHEST_M = 1e5
"""Greatest coordinate of a point: worlds without physics walk along a ray metre by metre [m]."""


def ray_points(origins: npt.ArrayLike, ends: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Check where rays begin and end.

    Args:
        origins: World points, shape (r, 3).
        ends: World points, shape (r, 3).

    Returns:
        The same as contiguous arrays of float64.

    Raises:
        SensorError: Other shapes, or a coordinate that is no finite number or beyond `FARTHEST_M`.
    """
    first = np.ascontiguousarray(origins, dtype=np.float64)
    last = np.ascontiguousarray(ends, dtype=np.float64)
    if first.ndim != 2 or first.shape[1] != 3 or first.shape != last.shape:
        raise SensorError(f"rays have origins of shape {first.shape} and ends of {last.shape}; valid: (r, 3) both")
    ray = _odd(first, last)
    if ray >= 0:
        raise SensorError(
            f"ray {ray} goes from {first[ray].tolist()} to {last[ray].tolist()}; valid: finite numbers up to "
            f"{FARTHEST_M:g} m"
        )
    return first, last


@njit(cache=True)
def _odd(origins: FloatArray, ends: FloatArray) -> int:
    """The first ray that is none, or -1."""
    for ray in range(len(origins)):
        for axis in range(3):
            if not (abs(origins[ray, axis]) <= FARTHEST_M and abs(ends[ray, axis]) <= FARTHEST_M):
                return ray
    return -1
