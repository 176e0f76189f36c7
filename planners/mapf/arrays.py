"""Names of the arrays that path finding works on; docstrings give their shapes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int32]
"""States, cells, moves, agents."""
Int64Array = npt.NDArray[np.int64]
SmallIntArray = npt.NDArray[np.int8]
FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Distances = npt.NDArray[np.uint16]
"""What is left to a goal, a row for each; timesteps unless something else is said."""
