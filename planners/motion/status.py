"""MotionStatus: how a query ended, for one arm, for arms that share a room, and for cars."""

from enum import Enum


class MotionStatus(Enum):
    """How a query ended; "no solution" is a status, not an exception."""

    SOLVED = "solved"
    NO_SOLUTION = "no_solution"
    """The iteration budget is used up; for schedules, which are searched to the end: there is none."""
    INVALID_START = "invalid_start"
    """The start is in collision or outside the joint limits; or arms are too near each other there."""
    INVALID_GOAL = "invalid_goal"
    """Every goal is; or arms are too near each other when all are done."""
