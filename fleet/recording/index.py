"""Index: the timelines of a recording, for columns of many frames and for single rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import rerun as rr


class Stamped(Protocol):
    """What has a time."""

    @property
    def tick(self) -> int:
        """When, in ticks."""

    @property
    def sim_s(self) -> float:
        """When, in simulated time [s]."""


def index_of(stamped: Sequence[Stamped]) -> list[rr.TimeColumn]:
    """Columns `sim_time` and `tick` of some frames or log lines."""
    nanoseconds = np.rint(np.array([item.sim_s for item in stamped]) * 1e9).astype("timedelta64[ns]")
    ticks = np.array([item.tick for item in stamped])
    return [rr.TimeColumn("sim_time", duration=nanoseconds), rr.TimeColumn("tick", sequence=ticks)]


def set_time(rec: rr.RecordingStream, stamped: Stamped) -> None:
    """Let the rows that follow happen then; forgets other timelines."""
    rec.reset_time()
    rec.set_time("sim_time", duration=stamped.sim_s)
    rec.set_time("tick", sequence=stamped.tick)
