"""Causes: what each robot is about or waits for, and whom it waits for, as one row of whole numbers."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from fleet.tasks.reasons import PairReason, TaskReason

CauseRows = npt.NDArray[np.int32]
"""One row for each robot, cars first, then arms; columns as in `Column`; shape (n_robots, len(Column))."""

NONE = -1
"""Stands in a column for nobody, nowhere, and not known."""


class Cause(IntEnum):
    """What a robot is about. Each robot has exactly one in each tick."""

    DRIVES = 0
    """Moves, and nothing keeps it."""
    SETS_OFF = 1
    """Has what it needs and is about to move, or to be served."""
    CELL = 2
    """Its next cell is granted to another car, or another stands there."""
    TURN = 3
    """Its next cell is free, but another car comes first there."""
    CLOSED = 4
    """Its next cell is a dock over which an arm is still on its way home."""
    BLOCKED = 5
    """A cell on its way is blocked, by a dead car or an obstacle, and there is no other way."""
    YIELDS = 6
    """The planner lets it stand, because another car has or will have the cell that it wants next."""
    PLAN_LATE = 7
    """Waits for a plan that has not landed."""
    HALTED = 8
    """Stands because a car that is off its lane stands in its granted way."""
    STATION_FULL = 9
    """Is held back, because the place it is bound for has no room."""
    ARM_BUSY = 10
    """Is held back, because it would come before the arm is free."""
    ARM = 11
    """Stands at the dock, and the arm is not free."""
    SLOT = 12
    """Stands at the dock, and no slot is free for its parcel."""
    SERVED = 13
    """Stands at the dock, and the arm is at work on it."""
    CHARGER = 14
    """Has to charge, and every charger is taken."""
    CHARGES = 15
    VISITS = 16
    """Stands where a visit takes it."""
    NO_TASK = 17
    FAULT = 18
    """Dead, off its lane, told to stand still, or out of service; an arm that is dead or told to stand still."""
    WORKS = 19
    """An arm that serves a car, or fetches a parcel ahead."""
    AWAITS = 20
    """An arm that waits for a car that is bound for it."""
    OTHER_ARM = 21
    """An arm that waits until the other arm of its dock is out of its way."""


class Column(IntEnum):
    """What a row says."""

    CAUSE = 0
    BY = 1
    """The robot that it waits for: cars from 0, arms from the number of cars."""
    CELL = 2
    """The cell that it cannot enter, or that is blocked."""
    PLACE = 3
    """The station, charger or parking place it is about, as a number among the places that are booked."""
    UNTIL = 4
    """Tick at which it will be over, as far as that is known."""
    TASK = 5
    """Of a robot without a task the one that it could have, else its own."""
    DETAIL = 6
    """Index into `DETAILS`."""


NO_WAIT = frozenset({Cause.DRIVES, Cause.SETS_OFF, Cause.WORKS})
"""Causes of robots that nothing keeps."""
OWN = NO_WAIT | {Cause.CHARGES, Cause.VISITS, Cause.NO_TASK, Cause.FAULT, Cause.SERVED}
"""Causes of robots that are not kept from what they are about, and of those that are about nothing."""
HOLDS_UP = np.array([cause not in OWN for cause in Cause])
"""Whether each cause keeps a robot from what it is about, shape (n_causes,)."""
WITHOUT_TASK = frozenset({Cause.NO_TASK, Cause.CHARGER})
"""Causes that say what keeps a robot from having a task, and nothing of what keeps it where it is: whoever waits until
it is out of the way waits for itself alone."""
NOT_KEPT_BY_PLACE = frozenset(
    {
        Cause.DRIVES,
        Cause.SETS_OFF,
        Cause.CELL,
        Cause.TURN,
        Cause.BLOCKED,
        Cause.YIELDS,
        Cause.PLAN_LATE,
        Cause.HALTED,
        Cause.FAULT,
    }
)
"""Causes that have nothing to do with the place the robot is bound for."""
DETAILS: tuple[str, ...] = tuple(
    dict.fromkeys(
        (
            "",
            "dead",
            "battery_empty",
            "off_lane",
            "tray_loaded",
            "slow",
            "next_round",
            *map(str, PairReason),
            *map(str, TaskReason),
            "stopped",
            "out",
            "lifts",
            "sets_down",
            "pod_loaded",
            "below_arm",
            "station_closed",
        )
    )
)
"""What more there is to say: of a fault which, of an arm its pace, of a robot without a task why it has none."""
DETAIL_OF = {word: number for number, word in enumerate(DETAILS)}


def robot_names(n_cars: int, n_arms: int) -> tuple[str, ...]:
    """Names of all robots, in the order of the rows."""
    return tuple(f"car_{car}" for car in range(n_cars)) + tuple(f"arm_{arm}" for arm in range(n_arms))
