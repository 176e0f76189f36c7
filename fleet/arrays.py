"""Types of arrays; shapes are in the docstrings of what takes them."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
CellArray: TypeAlias = npt.NDArray[np.int32]
"""Numbers of cells, cars or rows where there are many."""
SignArray: TypeAlias = npt.NDArray[np.int8]
"""+1 or -1."""
