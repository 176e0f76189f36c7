"""Transfer: what an arm does to move one parcel between a slot and a tray, as data."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from fleet.arrays import FloatArray
from planners.motion.path.trajectory import Trajectory

TRAY = -1
"""Via index of the dock's tray; slots are 0, 1, ..."""
LOOSE = -3
"""In place of a via index: the parcel lies where no via point leads to."""


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
    """Slot index, `TRAY` or `LOOSE`."""
    place_via: int
    """Slot index or `TRAY`."""
    car_pose: FloatArray
    """Estimated pose x, y, yaw of the car at the dock."""
    tray: int = 0
    """Which kind of tray that car has."""
    tray_at_m: tuple[float, float] = (0.0, 0.0)
    """Where in it a parcel is set down, ahead of its centre and to the left of it [m]."""


@dataclass(frozen=True, kw_only=True)
class FetchRequest:
    """Question: the way to a parcel, and up again with it, before it is known where a car will stand."""

    arm: int
    parcel: int
    size_m: tuple[float, float, float]
    pick_pose: FloatArray
    """World pose of the parcel's centre, shape (7,)."""
    pick_via: int
    """Slot index."""
    tray: int = 0
    """Which kind of tray the car has that comes for it."""


@dataclass(frozen=True, kw_only=True)
class DeliverRequest:
    """Question: the rest of a transfer whose parcel was fetched."""

    arm: int
    parcel: int
    size_m: tuple[float, float, float]
    pick_via: int
    """Slot index over which the arm waits."""
    place_via: int
    """Slot index or `TRAY`."""
    car_pose: FloatArray
    """Estimated pose x, y, yaw of the car at the dock."""
    grip_height_m: float
    """The tip's height over the parcel's underside [m]."""
    tray: int = 0
    """Which kind of tray that car has; the one for which the parcel was fetched."""
    tray_at_m: tuple[float, float] = (0.0, 0.0)
    """As in `TransferRequest`."""


@dataclass(frozen=True, kw_only=True)
class HomeRequest:
    """Question: the way home from where a failed transfer left the arm."""

    arm: int
    q: FloatArray
    """Joint positions now [rad], shape (n_joints,)."""
    tray: int = 0
    """All trays have the same rest."""


ArmRequest = TransferRequest | FetchRequest | DeliverRequest | HomeRequest
"""What an arm planner answers."""


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Answer: the steps, or the reason why there are none."""

    arm: int
    parcel: int
    steps: tuple[Step, ...]
    reason: str = ""
    """Empty when the steps are valid."""
    back: tuple[Step, ...] = ()
    """Of a fetched parcel: how it is put back and the arm comes home; empty for what ends at home."""
    grip_height_m: float = 0.0
    """Of a fetched parcel: the tip's height over its underside [m]."""
    trees: FloatArray | None = None
    """Edges of the search trees behind the steps, as the tool's tip in the world [m], shape (e, 2, 3); None unless
    they were asked for."""
