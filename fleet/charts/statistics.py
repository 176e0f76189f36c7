"""Statistics: means over seeds, with the interval in which the true value lies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean and its confidence interval."""

    mean: float
    half_width: float
    """Half the length of the interval; infinite for a single value, which says nothing of the spread."""
    n: int
    """Number of values."""

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.mean - self.half_width

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.mean + self.half_width


def estimate(values: Sequence[float], *, least_spread: float = 0.0) -> Estimate | None:
    """Mean and Student's t interval of independent values; None without values.

    Args:
        values: One per seed, finite.
        least_spread: Standard deviation that they have at least, whatever few of them show.

    Source: Student, "The probable error of a mean", Biometrika 6(1), 1908.
    """
    n = len(values)
    if n == 0:
        return None
    if n == 1:
        return Estimate(mean=float(values[0]), half_width=math.inf, n=1)
    spread = max(float(np.std(values, ddof=1)), least_spread)
    quantile = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2.0))
    return Estimate(mean=float(np.mean(values)), half_width=quantile * spread / math.sqrt(n), n=n)


def paired(values: Sequence[float], reference: Sequence[float], *, step: float = 0.0) -> Estimate | None:
    """Mean difference from a reference on the same seeds; what all variants of a seed share cancels out.

    Args:
        values: One per seed.
        reference: Those of the reference, in the same order of seeds.
        step: The least by which values can differ, as they come from counts: a difference of two of them is known no
            better than with the standard deviation of two errors of rounding, ``step / sqrt(6)``.

    Source: common random numbers, e.g. A. M. Law, "Simulation Modeling and Analysis", 5th ed., 2015, section 11.2.
    """
    differences = [value - base for value, base in zip(values, reference, strict=True)]
    return estimate(differences, least_spread=step / math.sqrt(6.0))
