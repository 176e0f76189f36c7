"""Angles that kernels keep within a turn."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def wrapped(angle: float) -> float:
    """The same direction in [-pi, pi)."""
    turned = angle + math.pi
    # Most angles are within the range already: then the remainder, which is slow, would give the same number.
    if 0.0 <= turned < 2.0 * math.pi:
        return turned - math.pi
    return turned % (2.0 * math.pi) - math.pi
