"""Ending: why a run is over."""

from enum import StrEnum


class Ending(StrEnum):
    """Why a run is over."""

    DONE = "done"
    """Every task has ended."""
    TIME_UP = "time_up"
    """Its time is over."""
    STALLED = "stalled"
    """Work is open, and nothing has gone on for too long."""
