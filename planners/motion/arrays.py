"""The arrays that planners of motion speak in; the shape of each stands in a docstring."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
RowArray: TypeAlias = npt.NDArray[np.uint64]
"""Numbers of rows, for kernels: compiled code need not ask whether an unsigned index counts from the end."""
BoolArray: TypeAlias = npt.NDArray[np.bool_]
Int: TypeAlias = int | np.int64 | np.uint64
"""A whole number in a kernel, where all three are the same."""
Chance: TypeAlias = npt.NDArray[np.uint64]
"""State of a stream of random numbers, shape (1,)."""
