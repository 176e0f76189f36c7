"""Levels: the rungs of a ladder from one car that docks to a whole warehouse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from fleet.envs.warehouse.run.starts import Start
from fleet.tasks.board import DONE_STATES, Task, TaskState


class End(StrEnum):
    """When an episode is over, unless all its tasks have ended."""

    DOCKED = "docked"
    """Every car that set out for a dock stands there."""
    TRANSFERRED = "transferred"
    """Every parcel was set into the tray, or onto the slot, that it was first meant for, or is lost."""
    DONE = "done"
    """All tasks are delivered or have failed."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """What a level makes of settings that are not given."""

    n_cars: int
    n_arms: int | None
    """None = all of the site."""
    with_docks: bool
    """Whether there is a car of the classical fleet for every dock with an agent's arm."""
    max_cycles: int
    start: Start
    end: End


LEVELS = {
    "dock": Level(
        n_cars=1,
        n_arms=0,
        with_docks=False,
        max_cycles=300,
        start=Start(cars="near", side_m=0.05, turn_rad=0.1),
        end=End.DOCKED,
    ),
    "transfer": Level(
        n_cars=0,
        n_arms=None,
        with_docks=True,
        max_cycles=300,
        start=Start(cars="docked", side_m=0.02, turn_rad=0.05),
        end=End.TRANSFERRED,
    ),
    "pair": Level(
        n_cars=1,
        n_arms=None,
        with_docks=False,
        max_cycles=600,
        start=Start(cars="near", side_m=0.05, turn_rad=0.1),
        end=End.TRANSFERRED,
    ),
    "all": Level(n_cars=2, n_arms=None, with_docks=False, max_cycles=1200, start=Start(), end=End.DONE),
}
"""Levels by name: one car docks; arms pick and set; a car docks and its arm serves it; all do everything."""

_ENDED = frozenset((*DONE_STATES, TaskState.FAILED, TaskState.CANCELLED))
_UNDER_WAY = frozenset((TaskState.LOADING, TaskState.UNLOADING))


def is_over(end: End, tasks: Sequence[Task], loaded: Sequence[bool]) -> bool:
    """Whether an episode is over.

    Args:
        end: When it is.
        tasks: All tasks.
        loaded: Of the tasks whose cars began on their way to a station, whether they had the parcel then.
    """
    if end is End.DONE or not loaded:
        return all(task.state in _ENDED for task in tasks)
    done = _ENDED if end is End.TRANSFERRED else _ENDED | _UNDER_WAY
    return all(
        task.state in done or (not began_loaded and TaskState.CARRIED in task.since_s)
        for task, began_loaded in zip(tasks, loaded, strict=True)
    )
