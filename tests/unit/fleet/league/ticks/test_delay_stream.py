"""Delays are drawn by their laws, and last as long as they are said to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.league.ticks.delay_stream import DelayStream
from maps.formats.lorr_2026 import Delays

LAWS: dict[str, Any] = {
    "seed": 1,
    "shortest": 3,
    "longest": 9,
    "events": "bernoulli",
    "chance": 0.02,
    "durations": "uniform",
    "mean": 0.25,
    "spread": 0.1,
}


def drawn(n: int, ticks: int, **changes: Any) -> tuple[np.ndarray, np.ndarray]:
    """Who was delayed in each tick, and the delays."""
    stream = DelayStream(Delays(**LAWS | changes), n)
    return np.array([stream.next() for _ in range(ticks)]), stream.drawn()


@pytest.mark.parametrize("events", ["bernoulli", "poisson"])
@pytest.mark.parametrize("durations", ["uniform", "gaussian"])
def test_a_robot_stands_from_the_first_tick_of_a_delay_to_before_its_end(events: str, durations: str) -> None:
    still, delays = drawn(50, 300, events=events, durations=durations)
    told = np.zeros_like(still)
    for robot, first, end in delays.tolist():
        assert not told[first:end, robot].any(), "a delay begins when the one before is over"
        told[first:end, robot] = True
    assert (still == told).all()
    assert len(delays) > 100


def test_half_the_ticks_are_delayed_where_half_must_be() -> None:
    """Delays of 6 ticks on average and 1 / chance - 1 free ticks between them: 6 of 12 for a chance of 1 / 7."""
    still, _ = drawn(200, 2000, chance=1 / 7)
    assert still[100:].mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("durations", "mean", "spread"), [("uniform", 6.0, 2.0), ("gaussian", 3 + 0.25 * 6, 0.1 * 6 + 0.1)]
)
def test_durations_have_their_mean_and_bounds(durations: str, mean: float, spread: float) -> None:
    _, delays = drawn(400, 500, durations=durations)
    length = delays[:, 2] - delays[:, 1]
    assert length.min() >= 3
    assert length.max() <= 9
    assert length.mean() == pytest.approx(mean, abs=0.1)
    assert length.std() == pytest.approx(spread, abs=0.15)


def test_poisson_delays_a_share_of_the_team_however_few_are_left() -> None:
    _, delays = drawn(100, 1000, events="poisson", chance=0.03, shortest=1, longest=1)
    assert len(delays) / 1000 == pytest.approx(3.0, abs=0.3)
    still, _ = drawn(5, 50, events="poisson", chance=1.0, shortest=50, longest=50)
    assert still[-1].all()


def test_a_gaussian_without_spread_is_its_mean() -> None:
    _, delays = drawn(20, 100, durations="gaussian", spread=0.0, mean=0.5)
    assert set((delays[:, 2] - delays[:, 1]).tolist()) == {6}


def test_the_seed_decides() -> None:
    first, again, other = (drawn(20, 100, seed=seed)[1].tolist() for seed in (4, 4, 5))
    assert first == again != other
