"""Names of the arrays and numbers that allocation works on; docstrings give their shapes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int32]
"""Vehicles, tasks, places."""
Int64Array: TypeAlias = npt.NDArray[np.int64]
Distances: TypeAlias = npt.NDArray[np.uint16]
"""A row for each goal."""
Int: TypeAlias = int | np.integer
"""A whole number in a kernel, where both are the same."""
Number: TypeAlias = float | np.float64
