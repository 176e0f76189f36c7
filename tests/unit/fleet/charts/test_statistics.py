"""Intervals against published quantiles of Student's distribution, and by hand."""

import math

import numpy as np
import pytest

from fleet.charts.statistics import estimate, paired


def test_the_interval_of_known_values() -> None:
    found = estimate([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found is not None
    # t(0.975, 4) = 2.776; standard deviation 1.5811
    assert found.mean == 3.0
    assert found.half_width == pytest.approx(2.776 * 1.5811 / math.sqrt(5), rel=1e-3)
    assert (found.low, found.high) == (found.mean - found.half_width, found.mean + found.half_width)


def test_one_value_says_nothing_of_the_spread_and_none_says_nothing() -> None:
    one = estimate([7.0])
    assert one is not None
    assert (one.mean, one.half_width) == (7.0, math.inf)
    assert estimate([]) is None


def test_the_interval_holds_the_true_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(2000):
        found = estimate(rng.normal(10.0, 3.0, 5).tolist())
        assert found is not None
        held += found.low <= 10.0 <= found.high
    assert held / 2000 == pytest.approx(0.95, abs=0.015)


def test_pairing_cancels_what_both_share() -> None:
    base = [100.0, 200.0, 300.0]
    found = paired([value + gain for value, gain in zip(base, [4.0, 5.0, 6.0], strict=True)], base)
    assert found is not None
    assert found.mean == 5.0
    assert found.half_width == pytest.approx(4.303 / math.sqrt(3), rel=1e-3)


def test_a_pair_that_lacks_its_partner_is_an_error() -> None:
    with pytest.raises(ValueError, match="zip"):
        paired([1.0], [1.0, 2.0])
