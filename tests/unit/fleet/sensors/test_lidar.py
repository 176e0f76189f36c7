"""Rays of a lidar: where they begin and end, and what is made of what they meet."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.sensors.errors import SensorError
from fleet.sensors.lidar import HEIGHT_M, Lidar, LidarRing

CAR = (0.41, 0.09, 0.14)


def ring(noise_m: float = 0.0) -> LidarRing:
    return LidarRing(Lidar(n_rays=36, range_m=4.0, noise_m=noise_m), *CAR)


def test_rays_begin_outside_the_body_and_end_at_the_range() -> None:
    origins, ends = ring().rays(np.array([[1.0, 2.0, np.pi / 2], [0.0, 0.0, 0.0]]))
    # The first car looks north; its middle is 0.16 m ahead of the axle.
    np.testing.assert_allclose(origins[0], [1.0, 2.0 + 0.41 + 0.002, HEIGHT_M])
    np.testing.assert_allclose(ends[0], [1.0, 2.16 + 4.0, HEIGHT_M])
    np.testing.assert_allclose(origins[9], [1.0 - 0.142, 2.16, HEIGHT_M])  # a quarter turn to the left
    x, y = (origins[36:, :2] - [0.16, 0.0]).T
    np.testing.assert_allclose(np.maximum(abs(x) / 0.252, abs(y) / 0.142), 1.0)


def test_distances_are_measured_from_the_middle() -> None:
    rng = np.random.default_rng(0)
    fractions = np.ones(36)
    fractions[0] = 0.5
    distances = ring().distances(fractions, rng)
    assert distances.shape == (1, 36)
    assert distances[0, 0] == pytest.approx((0.252 + 0.5 * (4.0 - 0.252)) / 4.0)
    np.testing.assert_array_equal(distances[0, 1:], 1.0)


def test_noise_is_that_of_what_is_met() -> None:
    fractions = np.full(36 * 400, 0.5)
    fractions[::36] = 1.0
    distances = ring(noise_m=0.02).distances(fractions, np.random.default_rng(0))
    np.testing.assert_array_equal(distances[:, 0], 1.0)
    assert np.std(distances[:, 5]) * 4.0 == pytest.approx(0.02, rel=0.2)


def test_hits_are_where_the_rays_end() -> None:
    def cast(origins: np.ndarray, ends: np.ndarray) -> np.ndarray:
        fractions = np.ones(len(origins))
        fractions[0] = 0.5
        return fractions

    origins, hits = ring().hits(np.zeros((2, 3)), cast)
    np.testing.assert_allclose(origins, [[0.412, 0.0, HEIGHT_M]])
    np.testing.assert_allclose(hits, [[0.412 + 0.5 * (4.16 - 0.412), 0.0, HEIGHT_M]])


@pytest.mark.parametrize(
    ("what", "value"), [("n_rays", 35), ("n_rays", 361), ("range_m", 0.5), ("noise_m", -0.1), ("range_m", np.nan)]
)
def test_lidars_that_cannot_be_are_refused(what: str, value: float) -> None:
    with pytest.raises(SensorError, match=what):
        Lidar(**{what: value})  # type: ignore[arg-type]
