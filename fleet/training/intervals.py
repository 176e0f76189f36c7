"""Intervals: where a true mean or share lies with 95 % confidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

CONFIDENCE = 0.95
N_RESAMPLES = 10_000
_TAIL = (1.0 - CONFIDENCE) / 2.0
TAILS = (_TAIL, 1.0 - _TAIL)
"""Shares of what lies below the ends of an interval."""


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean and where the true one lies with 95 % confidence."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.4g} [{self.low:.4g}, {self.high:.4g}]"

    def of(self, n: int) -> str:
        """In words, of so many episodes: one says nothing of the spread."""
        return str(self) if n > 1 else f"{self.mean:.4g}"


def heading(n: int) -> str:
    """What stands over a table of `Interval.of` so many episodes."""
    return "one episode" if n == 1 else f"mean of {n} episodes [95 % interval]"


def interval(values: Sequence[float], *, is_share: bool = False) -> Interval:
    """Mean of independent values with its interval.

    Args:
        values: One per episode.
        is_share: By what they mean, all are 0 or some weight: Wilson's interval of the share that is not 0, else the
            bootstrap's. Counts that happen to be 0 or 1 in few episodes are no share.
    """
    return share(int(np.count_nonzero(values)), len(values)) if is_share else bootstrap(values)


def difference(values: Sequence[float], reference: Sequence[float], *, is_share: bool = False) -> Interval:
    """Mean difference from a reference on the same seeds: what a seed brings to both cancels out.

    Args:
        values: One per episode.
        reference: Those of the reference, in the same order.
        is_share: See `interval`.
    """
    if is_share:
        return share_difference(values, reference)
    return bootstrap([one - other for one, other in zip(values, reference, strict=True)])


def bootstrap(values: Sequence[float]) -> Interval:
    """Mean of independent values with its percentile bootstrap interval.

    The resamples are the same for equal numbers of values, so that an interval can be computed again.

    Source: B. Efron, R. J. Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    array = np.asarray(values, dtype=np.float64)
    low, high = np.quantile(array[resamples(len(array))].mean(axis=1), TAILS)
    return Interval(mean=float(array.mean()), low=float(low), high=float(high))


def resamples(n: int) -> npt.NDArray[np.int64]:
    """Which of `n` values each resample takes, shape (N_RESAMPLES, n); the same for equal numbers of values."""
    return np.random.default_rng(0).integers(n, size=(N_RESAMPLES, n))


def share(n_successes: int, n: int) -> Interval:
    """Share of successes; its interval is honest also where all of them succeeded.

    Args:
        n_successes: Successes, from 0 to `n`.
        n: Independent trials, >= 1.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22(158), 1927.
    """
    square = _quantile() ** 2
    middle = (n_successes + square / 2.0) / (n + square)
    half = math.sqrt(square * (n_successes * (n - n_successes) / n + square / 4.0)) / (n + square)
    return Interval(mean=n_successes / n, low=max(0.0, middle - half), high=min(1.0, middle + half))


def share_difference(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """Difference of two shares of successes on the same trials.

    Args:
        values: Of each trial, 0 = it failed.
        reference: The same of the other, in the same order.

    Source: R. G. Newcombe, "Improved confidence intervals for the difference between binomial proportions based on
    paired data", Statistics in Medicine 17, 1998, method 10: Wilson's intervals, correlated as the trials are.
    """
    ours, theirs = np.asarray(values) != 0.0, np.asarray(reference) != 0.0
    n = len(ours)
    one, other = share(int(ours.sum()), n), share(int(theirs.sum()), n)
    both, none = int((ours & theirs).sum()), int((~ours & ~theirs).sum())
    only, others = int((ours & ~theirs).sum()), int((~ours & theirs).sum())
    spread = math.sqrt(float((both + only) * (others + none) * (both + others) * (only + none)))
    excess = float(both * none - only * others)
    if excess > 0.0:
        excess = max(excess - n / 2.0, 0.0)
    correlation = excess / spread if spread > 0.0 else 0.0
    gap = one.mean - other.mean

    def reach(mine: float, its: float) -> float:
        return math.sqrt(max(0.0, mine**2 - 2.0 * correlation * mine * its + its**2))

    low = gap - reach(one.mean - one.low, other.high - other.mean)
    high = gap + reach(one.high - one.mean, other.mean - other.low)
    return Interval(mean=gap, low=low, high=high)


def _quantile() -> float:
    return float(ndtri(0.5 + CONFIDENCE / 2.0))
