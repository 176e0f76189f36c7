"""Clock: simulated time as a whole number of ticks, so that nothing drifts."""

from __future__ import annotations


class Clock:
    """Counts the ticks of a run.

    Args:
        tick_s: Length of a tick [s].
    """

    def __init__(self, tick_s: float) -> None:
        self.tick_s = tick_s
        self.now = 0
        """The present tick."""

    @property
    def sim_s(self) -> float:
        """Simulated time [s]."""
        return self.now * self.tick_s
