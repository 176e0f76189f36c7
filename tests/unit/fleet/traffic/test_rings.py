"""Rings against a queue per car."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from fleet.traffic.rings import FIRST_WIDTH, Rings


@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_numbers_leave_in_the_order_in_which_they_came(dtype: type[np.int64] | type[np.float64]) -> None:
    rng = np.random.default_rng(0)
    rings, queues = Rings(3, dtype), [deque[float]() for _ in range(3)]
    for _ in range(200):
        cars = rng.integers(0, 3, size=rng.integers(0, 2 * FIRST_WIDTH)).astype(np.int32)
        values = rng.integers(0, 100, size=len(cars)).astype(dtype)
        rings.put(cars, values)
        for car, value in zip(cars.tolist(), values.tolist(), strict=True):
            queues[car].append(value)
        for car, queue in enumerate(queues):
            for _ in range(min(len(queue), int(rng.integers(0, 4)))):
                queue.popleft()
                rings.arrays().first[car] += 1
        if rng.random() < 0.1:
            rings.clear(1)
            queues[1].clear()
        assert [rings.of(car) for car in range(3)] == [list(queue) for queue in queues]
        assert [rings.is_empty(car) for car in range(3)] == [not queue for queue in queues]
    assert rings.arrays().values.shape[1] > FIRST_WIDTH
