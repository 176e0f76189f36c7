"""DelayStream: which robots are delayed in each tick."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray
from maps.formats.lorr import Ints
from maps.formats.lorr_2026 import BERNOULLI, UNIFORM, Delays


class DelayStream:
    """Draws delays tick by tick.

    The laws are those of the League's own simulator, the numbers are not: its stream of random numbers is that of a
    C++ library.

    Args:
        delays: The laws.
        n: Number of robots.

    Source: DelayGenerator.cpp of https://github.com/MAPF-Competition/Start-Kit, tag v3.1.0.
    """

    def __init__(self, delays: Delays, n: int) -> None:
        self._delays = delays
        self._rng = np.random.default_rng(delays.seed)
        self._end = np.zeros(n, dtype=np.int64)
        self._tick = 0
        self._drawn: list[Ints] = [np.empty((0, 3), dtype=np.int32)]

    def next(self) -> BoolArray:
        """Who stands still in the next tick, shape (n,)."""
        able = np.flatnonzero(self._end <= self._tick)
        robots = self._draw(able)
        if len(robots):
            self._end[robots] = self._tick + self._durations(len(robots))
            self._drawn.append(
                np.column_stack((robots, np.full(len(robots), self._tick), self._end[robots])).astype(np.int32)
            )
        self._tick += 1
        return self._end >= self._tick

    def drawn(self) -> Ints:
        """Robot, first tick and the tick after the last one of all delays so far, shape (k, 3); tick 0 is the first."""
        return np.concatenate(self._drawn)

    def _draw(self, able: np.ndarray) -> np.ndarray:
        if self._delays.events == BERNOULLI:
            return able[self._rng.random(len(able)) < self._delays.chance]
        count = int(self._rng.poisson(self._delays.chance * len(self._end)))
        return self._rng.permutation(able)[:count]

    def _durations(self, count: int) -> np.ndarray:
        shortest, longest = self._delays.shortest, self._delays.longest
        if self._delays.durations == UNIFORM:
            return self._rng.integers(shortest, longest, size=count, endpoint=True)
        mean = shortest + self._delays.mean * (longest - shortest)
        drawn = self._rng.normal(mean, self._delays.spread * (longest - shortest), size=count)
        return np.clip(np.rint(drawn), shortest, longest).astype(np.int64)
