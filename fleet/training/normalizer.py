"""Normalizer: running mean and variance, and numbers brought to mean zero and variance one by them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

CLIP = 10.0
"""Normalised numbers beyond this are cut off."""
_EPSILON = 1e-8
_SAME = 1e-12
"""Numbers of a smaller variance have always been the same, but for rounding."""


class Normalizer:
    """Mean and variance of all rows seen so far; before the first, zero and one.

    A number that has always been the same becomes zero, whatever it is later: nothing was learned about it, and what
    a network would make of it is chance.

    Args:
        n: Numbers in a row.
        fixed: Indices of those that stay as they are.
        unseen: Indices of those that become zero, whatever they are.

    Source: T. F. Chan, G. H. Golub, R. J. LeVeque, "Updating formulae and a pairwise algorithm for computing sample
    variances", Stanford CS-TR-79-773, 1979.
    """

    def __init__(self, n: int, fixed: Sequence[int] = (), unseen: Sequence[int] = ()) -> None:
        self.mean = np.zeros(n)
        self.variance = np.ones(n)
        self.count = 0.0
        self._fixed = np.array(fixed, dtype=np.int64)
        self._unseen = np.array(unseen, dtype=np.int64)

    def update(self, rows: npt.NDArray[np.floating]) -> None:
        """Take rows of shape (m, n) into account."""
        sums, squares = np.zeros((2, len(self.mean)))
        _add_up(rows, self.mean, sums, squares)
        count = len(rows)
        away = sums / count
        mean, variance = self.mean + away, squares / count - away**2
        total = self.count + count
        gap = mean - self.mean
        spread = self.variance * self.count + variance * count + gap**2 * self.count * count / total
        self.mean, self.variance, self.count = self.mean + gap * count / total, spread / total, total
        self.mean[self._fixed], self.variance[self._fixed] = 0.0, 1.0

    def apply(
        self, rows: npt.NDArray[np.float32], out: npt.NDArray[np.float32] | None = None
    ) -> npt.NDArray[np.float32]:
        """Normalise rows of shape (m, n), into an array of this shape if there is one."""
        scaled = np.empty_like(rows) if out is None else out
        factor = np.where(self.is_same(), 0.0, 1.0 / np.sqrt(np.maximum(self.variance, 0.0) + _EPSILON))
        factor[self._unseen] = 0.0
        _scale(rows, self.mean.astype(np.float32), factor.astype(np.float32), np.float32(CLIP), scaled)
        return scaled

    def is_same(self) -> npt.NDArray[np.bool_]:
        """Which numbers have always been the same, shape (n,)."""
        return self.variance < _SAME

    def scale(self) -> float:
        """Standard deviation of a single number."""
        return float(np.sqrt(self.variance[0] + _EPSILON))

    def state(self) -> dict[str, list[float]]:
        """All there is to remember."""
        return {"mean": self.mean.tolist(), "variance": self.variance.tolist(), "count": [float(self.count)]}

    def recall(self, state: dict[str, list[float]]) -> None:
        """Return to a `state`."""
        self.mean, self.variance = np.array(state["mean"]), np.array(state["variance"])
        self.count = state["count"][0]


@njit(cache=True)
def _add_up(
    rows: npt.NDArray[np.floating],
    shift: npt.NDArray[np.float64],
    sums: npt.NDArray[np.float64],
    squares: npt.NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Add up how far rows are from a shift near their mean, and the squares of that: so little is lost in rounding."""
    for row in range(len(rows)):
        for k in range(len(shift)):
            away = np.float64(rows[row, k]) - shift[k]
            sums[k] += away
            squares[k] += away * away


@njit(cache=True)
def _scale(
    rows: npt.NDArray[np.float32],
    mean: npt.NDArray[np.float32],
    factor: npt.NDArray[np.float32],
    most: np.float32,
    out: npt.NDArray[np.float32],
) -> None:  # pragma: no cover - compiled
    """Fill in rows with the mean taken off, times a factor, cut off on both sides."""
    for row in range(len(rows)):
        for k in range(len(mean)):
            out[row, k] = min(max((rows[row, k] - mean[k]) * factor[k], -most), most)
