"""TickNotes: when each tick of a run was over, in memory that two processes share and that outlives both."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Self

import numpy as np

from fleet.arrays import FloatArray

MOST_TICKS = 100_000


class TickNotes:
    """Wall times of ticks; `opened` and `made` give one.

    Args:
        table: Length of a tick [s], then when each tick was over, 0 if it was not, shape (1 + MOST_TICKS,) [s].
    """

    def __init__(self, table: FloatArray) -> None:
        self._table = table

    @classmethod
    def made(cls, path: Path) -> Self:
        """Empty notes in a new file."""
        return cls(np.memmap(path, dtype=np.float64, mode="w+", shape=(1 + MOST_TICKS,)))

    @classmethod
    def opened(cls, path: Path) -> Self:
        """Notes in a file that somebody has made."""
        return cls(np.memmap(path, dtype=np.float64, mode="r+", shape=(1 + MOST_TICKS,)))

    def note(self, n_ticks: int, tick_s: float) -> None:
        """Note that so many ticks are over.

        Args:
            n_ticks: At least 1.
            tick_s: Length of a tick [s].
        """
        self._table[0] = tick_s
        # The clock of the system since it was started, which is one for all processes.
        self._table[n_ticks] = time.monotonic()

    @property
    def tick_s(self) -> float:
        """Length of a tick [s]; 0 before the first."""
        return float(self._table[0])

    @property
    def n_ticks(self) -> int:
        """How many ticks are over."""
        return int(np.count_nonzero(self._table[1:]))

    @property
    def over_s(self) -> FloatArray:
        """When each tick was over, by `time.monotonic`, shape (n_ticks,) [s]."""
        return np.array(self._table[1 : 1 + self.n_ticks])

    def age_s(self, n_ticks: int, now_s: float) -> float:
        """How long ago so many ticks were over; 0 if they never were [s].

        Args:
            n_ticks: At least 1.
            now_s: What `time.monotonic` says.
        """
        return max(0.0, now_s - float(self._table[n_ticks])) if n_ticks <= self.n_ticks else 0.0
