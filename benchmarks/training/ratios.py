"""Ratios: of two means over the same episodes, and where the true one lies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.training.intervals import TAILS, Interval, resamples


def ratio(values: Sequence[float], bases: Sequence[float]) -> Interval:
    """Ratio of the means of pairs, in the same order, with its percentile bootstrap interval.

    Args:
        values: What is counted in each pair.
        bases: What it is a share of; their mean is positive.

    Returns:
        The ratio. A resample whose bases have no positive mean lies beyond all others: above them if its values have
        one, else below, so that an end is infinite where the bases say too little.
    """
    tops, bottoms = np.asarray(values, dtype=np.float64), np.asarray(bases, dtype=np.float64)
    picks = resamples(len(tops))
    top, bottom = tops[picks].mean(axis=1), bottoms[picks].mean(axis=1)
    is_base = bottom > 0.0
    ratios = np.where(is_base, top / np.where(is_base, bottom, 1.0), np.where(top > 0.0, np.inf, -np.inf))
    low, high = np.quantile(ratios, TAILS, method="nearest")  # between infinite ones there is no mean
    return Interval(mean=float(tops.mean() / bottoms.mean()), low=float(low), high=float(high))
