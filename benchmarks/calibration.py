"""Calibration: how fast this machine is now, so that times can be compared with those measured elsewhere."""

from __future__ import annotations

import time

REFERENCE_S = 0.3
"""CPU time of `calibrate` on the machine that the targets of all benchmarks hold for [s]."""


def calibrate() -> float:
    """CPU time of a plain Python function that adds up ten million integers [s]."""
    begin = time.process_time()
    _add_up(10_000_000)
    return time.process_time() - begin


def _add_up(n: int) -> int:
    total = 0
    for k in range(n):
        total += k
    return total
