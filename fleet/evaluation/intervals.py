"""Intervals of 95 % confidence: of means by bootstrap, of shares by Wilson's score."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fleet.evaluation.measures import Measure
from fleet.training.evaluation import Interval, interval

Z = 1.959964
"""97.5 % quantile of the normal distribution."""


def interval_of(values: Sequence[float], measure: Measure) -> Interval:
    """Mean of a figure over episodes, and where the true one lies with 95 % confidence."""
    return wilson(sum(values), len(values)) if measure.is_share else interval(values)


def wilson(successes: float, n: int) -> Interval:
    """A share and Wilson's score interval.

    Args:
        successes: How many of them had it.
        n: Number of episodes, at least 1.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. American
    Statistical Association 22, 1927.
    """
    share, z2 = successes / n, Z * Z
    middle = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = Z / (1 + z2 / n) * math.sqrt(share * (1 - share) / n + z2 / (4 * n * n))
    return Interval(mean=share, low=max(0.0, middle - half), high=min(1.0, middle + half))
