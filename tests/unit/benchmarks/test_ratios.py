"""Ratios of means: they hold what they promise, and are open where the bases say too little."""

import numpy as np
import pytest

from benchmarks.training.ratios import ratio


def test_a_ratio_of_means_holds_the_true_one_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    held = []
    for _ in range(200):
        bases = rng.exponential(4.0, 60)
        found = ratio((0.5 * bases + rng.normal(0.0, 1.0, 60)).tolist(), bases.tolist())
        held.append(found.low <= 0.5 <= found.high)
    assert 0.88 <= np.mean(held) <= 0.99
    assert ratio([1.0, 2.0], [2.0, 4.0]).low == pytest.approx(0.5)


def test_bases_that_say_too_little_leave_the_ratio_open() -> None:
    bases = [9.0, -8.0] * 10
    assert ratio([1.0] * 20, bases).high == np.inf
    assert ratio([-1.0] * 20, bases).low == -np.inf
