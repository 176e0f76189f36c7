"""Latches: grips that close at once and open only when they were told to for a while."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray, IntArray


class Latches:
    """The grips of arms that agents move.

    A grip closes as soon as it is told to. It opens when it was told to for `hold_s` without a break, counted from
    when it got hold of something: who acts by chance, and changes its mind ten times a second, keeps what it holds. A
    grip that has let go of something stays open for twice as long, so that what was set down comes to rest.

    Args:
        n_arms: Number of arms.
        hold_s: How long a grip has to be told to open [s]; 0 = it opens at once.
    """

    def __init__(self, n_arms: int, hold_s: float) -> None:
        self.closed = np.zeros(n_arms, dtype=np.bool_)
        """Whether each grip holds what it gets hold of, shape (n_arms,)."""
        self._hold_s = hold_s
        self._opening_s = np.zeros(n_arms)
        self._held = np.full(n_arms, -1, dtype=np.int64)

    @property
    def opening(self) -> FloatArray:
        """Share of `hold_s` for which each grip has been told to open, shape (n_arms,); negative while it stays open:
        how much of that time is left."""
        return self._opening_s / self._hold_s if self._hold_s > 0.0 else np.zeros_like(self._opening_s)

    def tick(self, wishes: FloatArray, held: IntArray, tick_s: float) -> None:
        """Take in what grips are told for one tick.

        Args:
            wishes: > 0 = hold, shape (n_arms,).
            held: Parcel in each grip, -1 = none, shape (n_arms,).
            tick_s: Length of the tick [s].
        """
        _latch(wishes, held, self._held, self.closed, self._opening_s, self._hold_s, tick_s)


@njit(cache=True)
def _latch(
    wishes: FloatArray,
    held: IntArray,
    held_before: IntArray,
    closed: npt.NDArray[np.bool_],
    opening: FloatArray,
    hold: float,
    tick: float,
) -> None:  # pragma: no cover - compiled
    """Close the grips that are told to, and open those that have been told to for long enough."""
    for arm in range(len(wishes)):
        if opening[arm] < 0.0:
            opening[arm] = min(opening[arm] + 0.5 * tick, 0.0)
        elif wishes[arm] > 0.0:
            closed[arm], opening[arm] = True, 0.0
        elif closed[arm]:
            opening[arm] = 0.0 if held[arm] != held_before[arm] and held[arm] >= 0 else opening[arm] + tick
            if opening[arm] >= hold - 1e-9:
                closed[arm], opening[arm] = False, (-hold if held[arm] >= 0 else 0.0)
        held_before[arm] = held[arm]
