"""Pace: how fast a run goes at most, which may change while it goes."""

from __future__ import annotations

import time
from collections.abc import Sequence

NAP_S = 0.1
"""Longest single sleep of a run that is held back [s]."""


class Pace:
    """Holds a run back to a speed; the run's outcome does not depend on it.

    Args:
        speed: Simulated seconds per second of wall time; 0 = as fast as possible.
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._since = time.perf_counter(), 0.0

    def change(self, speed: float, sim_s: float) -> None:
        """Go on at another speed from now, a moment of simulated time [s], also after a pause."""
        self.speed = speed
        self._since = time.perf_counter(), sim_s

    def wait(self, sim_s: float, interrupted: Sequence[int]) -> None:
        """Sleep until a simulated time [s] has come.

        In short naps: an interrupt only fills the list, and must not have to wait for the end of a long one.
        """
        if self.speed <= 0:
            return
        wall_s, from_s = self._since
        until = wall_s + (sim_s - from_s) / self.speed
        while not interrupted and (left_s := until - time.perf_counter()) > 0:
            time.sleep(min(left_s, NAP_S))
