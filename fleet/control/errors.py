"""Errors of control."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.errors import FleetError


class ControlError(FleetError):
    """A command, a gain or a limit cannot be used."""


def checked(name: str, values: npt.ArrayLike, n: int, unit: str) -> FloatArray:
    """Give numbers as an array of n finite values.

    Raises:
        ControlError: Another shape, or a value that is not finite.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ControlError(f"{name}: {values!r}; valid: {n} finite values [{unit}]") from None
    if array.shape != (n,) or not np.all(np.isfinite(array)):
        raise ControlError(f"{name}: {array.tolist()} of shape {array.shape}; valid: {n} finite values [{unit}]")
    return array
