"""Processes: those that a run has started, as Linux lists them, and how they are killed."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path


def children_of(pid: int) -> tuple[int, ...]:
    """Processes that a process has started and that live; none of one that has ended."""
    found: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text(encoding="ascii").split())
    return tuple(child for child in found if lives(child))


def lives(pid: int) -> bool:
    """Whether a process is there and has not ended; one that has ended is there until somebody asks how."""
    try:
        # Its name, which comes before, may hold anything.
        return (
            Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[0] != "Z"
        )
    except OSError:
        return False


def kill(pid: int) -> bool:
    """Kill a process; False if it has ended already."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True
