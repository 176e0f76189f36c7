"""Phases: what a car can be about, and in which states its task can be meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

from fleet.tasks.board import TaskState


class CarPhase(StrEnum):
    """What a car is about."""

    IDLE = "idle"
    TO_PICK = "to_pick"
    LOADING = "loading"
    HELD = "held"
    """Waits where it is in nobody's way: its station has no room, or the arm will not be free when it comes."""
    TO_DROP = "to_drop"
    UNLOADING = "unloading"
    TO_CHARGER = "to_charger"
    CHARGING = "charging"
    TO_PLACE = "to_place"
    """On a visit, on the way."""
    STANDING = "standing"
    """On a visit, where it was to go."""
    RECOVERING = "recovering"
    RETIRED = "retired"
    """Drives, but takes no task: it keeps a parcel or a pod that it could not bring away, or has left service."""
    DEAD = "dead"


PHASES = tuple(CarPhase)
NUMBER_OF_PHASE = {phase: number for number, phase in enumerate(PHASES)}
"""Index of each phase in `PHASES`."""
AT_CHARGER = frozenset({CarPhase.TO_CHARGER, CarPhase.CHARGING})
AT_DOCK = frozenset({CarPhase.LOADING, CarPhase.UNLOADING})
"""Phases of a car that an arm is at work on."""
ON_VISIT = frozenset({CarPhase.TO_PLACE, CarPhase.STANDING})
PARKED = frozenset({CarPhase.IDLE, CarPhase.RETIRED, CarPhase.HELD})
"""Phases of a car that waits in a parking place."""
TO_STATION = frozenset({CarPhase.TO_PICK, CarPhase.TO_DROP})
"""Phases of a car on its way to a dock."""
BOUND = TO_STATION | {CarPhase.TO_CHARGER, CarPhase.TO_PLACE}
"""Phases of a car on its way to a station, charger or place."""
BOOKED = AT_CHARGER | AT_DOCK | ON_VISIT | TO_STATION | {CarPhase.HELD}
"""Phases of a car that has a booking or waits for one."""
OUT = frozenset({CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD})
"""Phases of a car that takes no task."""
GONE = frozenset({CarPhase.RETIRED, CarPhase.DEAD})
"""Phases that last until somebody ends them from outside."""
MAY_STAND_DOWN = ON_VISIT | {CarPhase.TO_PICK, CarPhase.HELD, CarPhase.CHARGING}
"""Phases in which a car is free as soon as its task is taken from it."""

STATES_IN: Mapping[CarPhase, frozenset[TaskState | None]] = MappingProxyType(
    {
        CarPhase.IDLE: frozenset({None}),
        CarPhase.TO_PICK: frozenset({TaskState.ASSIGNED}),
        # A task can fail while the arm is still at work; the car is free when the arm is clear of it.
        CarPhase.LOADING: frozenset({TaskState.LOADING, TaskState.FAILED}),
        CarPhase.HELD: frozenset({TaskState.ASSIGNED, TaskState.CARRIED, TaskState.VISITING}),
        CarPhase.TO_DROP: frozenset({TaskState.CARRIED}),
        CarPhase.UNLOADING: frozenset({TaskState.UNLOADING, TaskState.FAILED}),
        CarPhase.TO_CHARGER: frozenset({None, TaskState.CARRIED}),
        CarPhase.CHARGING: frozenset({None, TaskState.CARRIED, TaskState.VISITING}),
        CarPhase.TO_PLACE: frozenset({TaskState.ASSIGNED, TaskState.VISITING}),
        CarPhase.STANDING: frozenset({TaskState.VISITING}),
        CarPhase.RECOVERING: frozenset(
            {
                None,
                TaskState.LOADING,
                TaskState.CARRIED,
                TaskState.UNLOADING,
                TaskState.VISITING,
                TaskState.FAILED,
            }
        ),
        CarPhase.RETIRED: frozenset({None}),
        CarPhase.DEAD: frozenset({None, TaskState.LOADING, TaskState.UNLOADING, TaskState.FAILED}),
    }
)
"""States that the task of a car can have in each phase; None = it has no task."""
