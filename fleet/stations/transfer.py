"""Transfer: what an arm does to move one parcel between a slot and a tray, as data."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from fleet.world.protocol import FloatArray
from planners.motion.trajectory import Trajectory

TRAY = -1
"""Via index of the dock's tray; slots are 0, 1, ..."""


class Signal(StrEnum):
    """A step that is not a motion."""

    GRIP = "grip"
    RELEASE = "release"
    CLEAR = "clear"
    """Takes no time: from here on the arm no longer needs the car."""


Step = Trajectory | Signal
"""One step of a transfer."""


@dataclass(frozen=True, kw_only=True)
class TransferRequest:
    """Question to the arm planner; plain data, so that it can cross a process border."""

    arm: int
    parcel: int
    size_m: tuple[float, float, float]
    pick_pose: FloatArray
    """World pose of the parcel's centre, shape (7,)."""
    pick_via: int
    """Slot index or `TRAY`."""
    place_via: int
    """Slot index or `TRAY`."""
    car_pose: FloatArray
    """Estimated pose x, y, yaw of the car at the dock."""


@dataclass(frozen=True, kw_only=True)
class HomeRequest:
    """Question: the way home from where a failed transfer left the arm."""

    arm: int
    q: FloatArray
    """Joint positions now [rad], shape (n_joints,)."""


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Answer: the steps, or the reason why there are none."""

    arm: int
    parcel: int
    steps: tuple[Step, ...]
    reason: str = ""
    """Empty when the steps are valid."""
