"""What is learnt about arms: means, percentiles, and what does not count."""

import math

import numpy as np
import pytest

from fleet.robots.arms.spec import UsualService
from fleet.stations.service_time import (
    N_RECENT_TRANSFERS,
    Direction,
    ServiceTime,
    ServiceTimes,
)

USUAL = UsualService(mean_s=7.0, p90_s=8.0)


def test_the_prior_holds_before_the_first_sample() -> None:
    learnt = ServiceTime.before(USUAL)
    assert (learnt.mean_s, learnt.p90_s, learnt.n) == (USUAL.mean_s, USUAL.p90_s, 0)
    learnt.add(3.0)
    assert (learnt.mean_s, learnt.p90_s, learnt.n) == (3.0, 3.0, 1)


@pytest.mark.parametrize("count", [1, 5, 10, 31, 32, 33, 100])
def test_mean_and_percentile_are_those_of_the_last_samples(count: int) -> None:
    samples = np.random.default_rng(count).exponential(7.0, count).round(1).tolist()
    learnt = ServiceTime.before(USUAL)
    for sample in samples:
        learnt.add(sample)
    last = sorted(samples[-N_RECENT_TRANSFERS:])
    assert learnt.n == count
    assert learnt.mean_s == pytest.approx(np.mean(last))
    assert learnt.p90_s == last[math.ceil(0.9 * len(last)) - 1]


def test_an_arm_that_has_become_slow_is_noticed() -> None:
    learnt = ServiceTime.before(USUAL)
    for sample in [7.0] * 500 + [21.0] * N_RECENT_TRANSFERS:
        learnt.add(sample)
    assert (learnt.mean_s, learnt.p90_s) == (21.0, 21.0)


def test_a_service_counts_for_its_direction_until_the_arm_is_home() -> None:
    times = ServiceTimes([USUAL] * 2)
    times.begin(1, Direction.TO_CAR, 10.0)
    times.complete(1)
    times.end(1, 18.5)
    assert times.of(1, Direction.TO_CAR).mean_s == 8.5
    assert times.of(1, Direction.FROM_CAR).n == 0
    assert times.of(0, Direction.TO_CAR).n == 0


def test_a_service_that_failed_teaches_nothing() -> None:
    times = ServiceTimes([USUAL])
    times.begin(0, Direction.FROM_CAR, 0.0)
    times.end(0, 1.0)
    assert times.of(0, Direction.FROM_CAR).n == 0


def test_the_time_left_runs_down_to_zero() -> None:
    times = ServiceTimes([USUAL])
    assert times.left_s(0, 5.0) == 0.0
    times.begin(0, Direction.TO_CAR, 5.0)
    assert times.left_s(0, 7.0) == USUAL.mean_s - 2.0
    assert times.left_s(0, 99.0) == 0.0


def test_the_time_that_is_left_is_told_of_all_arms() -> None:
    times = ServiceTimes([USUAL] * 3)
    times.begin(1, Direction.TO_CAR, 10.0)
    assert times.all_left_s(12.0).tolist() == [times.left_s(arm, 12.0) for arm in range(3)]
    assert times.left_s(1, 12.0) == USUAL.mean_s - 2.0
