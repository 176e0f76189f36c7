"""Machine: how fast this one is, so that figures of others can be compared."""

from __future__ import annotations

import time

from benchmarks.harness import Row


def machine_row() -> Row:
    """Thousands of turns of an empty Python loop per second of CPU time."""
    best = 0.0
    for _ in range(5):
        began, n = time.process_time(), 0
        while n < 300_000:
            n += 1
        best = max(best, n / (time.process_time() - began) / 1e3)
    return Row(name="this machine: empty Python loop", value=best, unit="1000 turns/s")
