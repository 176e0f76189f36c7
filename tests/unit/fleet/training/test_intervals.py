"""Intervals: they hold what they promise, also where all episodes end alike, and on the same seeds."""

import numpy as np
import pytest

from fleet.training.intervals import bootstrap, difference, interval, share, share_difference


def test_an_interval_holds_the_true_mean_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    found = [bootstrap(rng.normal(1.0, 2.0, 40).tolist()) for _ in range(200)]
    share = np.mean([one.low <= 1.0 <= one.high for one in found])
    assert 0.88 <= share <= 0.99  # 0.95 less what 40 values cost, give or take three deviations of 200 trials


def test_what_a_seed_brings_to_both_cancels_out() -> None:
    rng = np.random.default_rng(0)
    luck = rng.normal(0.0, 100.0, 20)
    ours = [float(value + 1.0) for value in luck]
    theirs = [float(value) for value in luck]
    found = difference(ours, theirs)
    assert found.low == pytest.approx(1.0)
    assert found.high == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("n_won", "n", "low", "high"),
    # By hand, z = 1.96: 20 of 20 gives 20 / (20 + z^2); 1 of 2 lies evenly about one half.
    [(20, 20, 0.8389, 1.0), (0, 20, 0.0, 0.1611), (1, 2, 0.0945, 0.9055)],
)
def test_a_share_of_successes_has_an_interval_even_where_all_succeed(
    n_won: int, n: int, low: float, high: float
) -> None:
    found = share(n_won, n)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4)
    assert interval([1.0] * n_won + [0.0] * (n - n_won), is_share=True) == found


def test_counts_that_happen_to_be_one_or_none_are_no_shares() -> None:
    assert interval([1.0, 0.0, 1.0]) == bootstrap([1.0, 0.0, 1.0])
    assert difference([1.0, 0.0], [0.0, 0.0]) == bootstrap([1.0, 0.0])


def test_a_difference_of_shares_has_an_interval_even_where_both_always_succeed() -> None:
    # By hand: both lie between 54 / (54 + z^2) = 0.9336 and 1.
    found = share_difference([1.0] * 54, [1.0] * 54)
    assert (found.mean, found.low, found.high) == pytest.approx((0.0, -0.0664, 0.0664), abs=1e-4)


def test_a_difference_of_shares_holds_the_true_one_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    held = []
    for _ in range(300):
        luck = rng.uniform(size=40)
        ours, theirs = luck < 0.8, np.where(rng.uniform(size=40) < 0.5, luck, rng.uniform(size=40)) < 0.7
        found = difference(ours.astype(float).tolist(), theirs.astype(float).tolist(), is_share=True)
        held.append(found.low <= 0.1 <= found.high)
    assert 0.92 <= np.mean(held) <= 1.0


def test_a_share_is_that_of_what_is_not_zero_whatever_it_weighs() -> None:
    """Two for each success, as rewards have it, were more successes than trials."""
    assert interval([2.0, 2.0, 0.0], is_share=True) == share(2, 3)
    assert difference([2.0, 0.0], [2.0, 2.0], is_share=True) == share_difference([1.0, 0.0], [1.0, 1.0])
    assert (interval([3.0]).of(1), interval([3.0, 3.0]).of(2)) == ("3", "3 [3, 3]")
