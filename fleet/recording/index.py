"""Index: the timelines of a recording, for columns of many frames and for single rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import pyarrow as pa
import rerun as rr

_DURATION, _INT64 = pa.duration("ns"), pa.int64()


class Stamped(Protocol):
    """What has a time."""

    @property
    def tick(self) -> int:
        """When, in ticks."""

    @property
    def sim_s(self) -> float:
        """When, in simulated time [s]."""


@dataclass(frozen=True)
class Times:
    """A timeline over the rows of a batch; rerun's own class for it accepts anything, and takes its time over that.

    Both methods are called by rerun's `send_columns`.
    """

    timeline: str
    rows: pa.Array

    def timeline_name(self) -> str:
        """Which timeline."""
        return self.timeline

    def as_arrow_array(self) -> pa.Array:
        """The times, one per row."""
        return self.rows


def index_of(stamped: Sequence[Stamped]) -> list[Times]:
    """Columns `sim_time` and `tick` of some frames or log lines."""
    return list(_index(tuple([(item.sim_s, item.tick) for item in stamped])))


@lru_cache(maxsize=16)
def _index(moments: tuple[tuple[float, int], ...]) -> tuple[Times, Times]:
    """The columns; what is looked at in the same frames has the same ones."""
    nanoseconds = pa.array([round(sim_s * 1e9) for sim_s, _ in moments], _DURATION)
    return Times("sim_time", nanoseconds), Times("tick", pa.array([tick for _, tick in moments], _INT64))


def epochs_of(numbers: Sequence[int]) -> Times:
    """Column `plan_epoch`: how many plans had landed by each row."""
    return Times("plan_epoch", pa.array(numbers, _INT64))


def set_time(rec: rr.RecordingStream, stamped: Stamped) -> None:
    """Let the rows that follow happen then; forgets other timelines."""
    rec.reset_time()
    rec.set_time("sim_time", duration=stamped.sim_s)
    rec.set_time("tick", sequence=stamped.tick)
