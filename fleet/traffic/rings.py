"""Rings: a short queue of numbers for every car, in arrays of common width."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import CellArray, IntArray

FIRST_WIDTH = 4
"""Numbers a queue has room for at first, a power of two; it doubles when one needs more."""

Numbers: TypeAlias = npt.NDArray[Any]
"""Of the type that the queues are made with."""


class RingArrays(NamedTuple):
    """The arrays of `Rings`, as kernels take them.

    What is queued is counted from the beginning; number k of a car lies at `values[car, k % width]`.
    """

    values: Numbers
    """Shape (n_cars, width), the width a power of two."""
    first: IntArray
    """Count of the first number that is queued, shape (n_cars,)."""
    end: IntArray
    """Count of the next number to come, shape (n_cars,)."""


class Rings:
    """Queues of all cars; numbers are put behind and taken from the front.

    Args:
        n_cars: Number of cars; nothing is queued.
        dtype: Type of the numbers.
    """

    def __init__(self, n_cars: int, dtype: type[np.float64] | type[np.int64]) -> None:
        self._arrays = RingArrays(
            values=np.zeros((n_cars, FIRST_WIDTH), dtype=dtype),
            first=np.zeros(n_cars, dtype=np.int64),
            end=np.zeros(n_cars, dtype=np.int64),
        )

    def arrays(self) -> RingArrays:
        """All arrays as they are now; `put` may replace them."""
        return self._arrays

    def put(self, cars: CellArray, values: Numbers) -> None:
        """Queue a number for each of some cars; a car may stand there more than once."""
        done = _put(self._arrays, cars, values, 0)
        while done < len(cars):
            self._widen()
            done = _put(self._arrays, cars, values, done)

    def clear(self, car: int) -> None:
        """Forget what is queued for a car."""
        self._arrays.first[car] = self._arrays.end[car]

    def is_empty(self, car: int) -> bool:
        """Whether nothing is queued for a car."""
        return bool(self._arrays.first[car] == self._arrays.end[car])

    def of(self, car: int) -> list[int] | list[float]:
        """What is queued for a car, the first in front."""
        values, first, end = self._arrays
        found: list[int] | list[float] = values[car, np.arange(first[car], end[car]) % values.shape[1]].tolist()
        return found

    def _widen(self) -> None:
        old, first, _ = self._arrays
        n_cars, width = old.shape
        counts = first[:, None] + np.arange(width)
        values = np.zeros((n_cars, 2 * width), dtype=old.dtype)
        cars = np.arange(n_cars)[:, None]
        values[cars, counts % (2 * width)] = old[cars, counts % width]
        self._arrays = self._arrays._replace(values=values)


@njit(cache=True)
def front(rings: RingArrays, car: int) -> float:  # pragma: no cover - compiled
    """The first number that is queued for a car, which has one."""
    return rings.values[car, rings.first[car] & (rings.values.shape[1] - 1)]


@njit(cache=True)
def _put(rings: RingArrays, cars: CellArray, values: Numbers, begin: int) -> int:  # pragma: no cover - compiled
    """Queue numbers from `begin` on; returns how many are done before a queue is full."""
    width = rings.values.shape[1]
    for k in range(begin, len(cars)):
        car = cars[k]
        if rings.end[car] - rings.first[car] == width:
            return k
        rings.values[car, rings.end[car] & (width - 1)] = values[k]
        rings.end[car] += 1
    return len(cars)
