"""Knees where the curve has them, and none where it has not."""

import numpy as np
import pytest

from fleet.study.knee import find_knee


@pytest.mark.parametrize("corner", [3, 5, 8])
def test_a_curve_that_rises_and_then_stays_has_its_knee_at_the_corner(corner: int) -> None:
    sizes = np.arange(1, 13)
    found = find_knee(sizes.tolist(), np.minimum(sizes, corner).tolist())
    assert found is not None
    assert sizes[found] == corner


def test_the_knee_of_the_authors_example() -> None:
    """y = -1 / x + 5 on ten points between 0 and 1: knee at x = 0.222 (the paper's figure 2)."""
    x = np.linspace(0.0, 1.0, 10)
    found = find_knee(x.tolist(), (-1.0 / (x + 0.1) + 5.0).tolist())
    assert found is not None
    assert x[found] == pytest.approx(0.222, abs=0.001)


def test_a_straight_line_with_noise_has_none() -> None:
    sizes = np.arange(2, 21)
    for seed in range(50):
        noise = np.random.default_rng(seed).normal(0.0, 2.0, len(sizes))
        assert find_knee(sizes.tolist(), (20.0 * sizes + noise).tolist()) is None


def test_a_curve_that_falls_after_its_top_has_its_knee_before_the_fall() -> None:
    assert find_knee([1, 2, 3, 4, 5, 6], [10, 20, 29, 30, 22, 12]) == 2


@pytest.mark.parametrize("gains", [[5, 5, 5, 5], [9, 7, 5, 3], [1, 2, 3, 4], [1, 2, 4, 8]])
def test_flat_falling_straight_and_steepening_curves_have_none(gains: list[float]) -> None:
    assert find_knee([1, 2, 3, 4], gains) is None


@pytest.mark.parametrize("n", [1, 2])
def test_too_few_points_have_none(n: int) -> None:
    assert find_knee(list(range(1, n + 1)), list(range(n))) is None
