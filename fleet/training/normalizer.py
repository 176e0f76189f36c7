"""Normalizer: running mean and variance, and numbers brought to mean zero and variance one by them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

CLIP = 10.0
"""Normalised numbers beyond this are cut off."""
_EPSILON = 1e-8


class Normalizer:
    """Mean and variance of all rows seen so far; before the first, zero and one.

    Args:
        n: Numbers in a row.
        fixed: Indices of those that stay as they are.

    Source: T. F. Chan, G. H. Golub, R. J. LeVeque, "Updating formulae and a pairwise algorithm for computing sample
    variances", Stanford CS-TR-79-773, 1979.
    """

    def __init__(self, n: int, fixed: Sequence[int] = ()) -> None:
        self.mean = np.zeros(n)
        self.variance = np.ones(n)
        self.count = 0.0
        self._fixed = np.array(fixed, dtype=np.int64)

    def update(self, rows: npt.NDArray[np.floating]) -> None:
        """Take rows of shape (m, n) into account."""
        mean, variance, count = rows.mean(axis=0, dtype=np.float64), rows.var(axis=0, dtype=np.float64), len(rows)
        total = self.count + count
        gap = mean - self.mean
        spread = self.variance * self.count + variance * count + gap**2 * self.count * count / total
        self.mean, self.variance, self.count = self.mean + gap * count / total, spread / total, total
        self.mean[self._fixed], self.variance[self._fixed] = 0.0, 1.0

    def apply(self, rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Normalise rows of shape (m, n)."""
        scaled = rows - self.mean.astype(np.float32)
        scaled *= (1.0 / np.sqrt(self.variance + _EPSILON)).astype(np.float32)
        return np.clip(scaled, -CLIP, CLIP, out=scaled)

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
