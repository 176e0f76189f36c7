"""Frame: what a recording keeps of one tick, and Recorder: who takes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

from fleet.arrays import CellArray, FloatArray, IntArray
from fleet.sensors.camera import CameraImage


@dataclass(frozen=True, kw_only=True)
class Wait:
    """Somebody waits for somebody."""

    who: str
    """'car_2', 'arm_0', ..."""
    whom: str
    """Robot, station or cell that lets it wait: 'car_5', 'pick_1', 'charger_2', 'cell (7, 12)'."""
    cause: str
    """Kind of the wait, one or two words."""
    cell: int = -1
    """Where that is, if it is no robot."""


@dataclass(kw_only=True, slots=True)
class Frame:
    """The visible state of a run at one tick. Whoever hands it to a recorder gives its arrays away."""

    tick: int
    sim_s: float
    """Simulated time [s]."""
    car_poses: FloatArray
    """Rear-axle poses x, y, yaw [m, m, rad], shape (n_cars, 3)."""
    car_steering: FloatArray
    """Bicycle-equivalent steering angles [rad], shape (n_cars,)."""
    car_speeds: FloatArray
    """Signed forward speeds [m/s], shape (n_cars,)."""
    arm_q: FloatArray
    """Joint positions [rad], shape (n_arms, n_joints)."""
    parcel_ids: IntArray
    """Parcels in the world, shape (p,)."""
    parcel_poses: FloatArray
    """Poses x, y, z, qx, qy, qz, qw of the box centres in the order of `parcel_ids`, shape (p, 7)."""
    parcel_size_m: FloatArray
    """Full edges of the boxes in the order of `parcel_ids` [m], shape (p, 3)."""
    car_state: tuple[str, ...]
    """What each car is about, in the words of the time accounts: driving loaded, traffic, served, ..."""
    arm_state: tuple[str, ...]
    """One word per arm."""
    pod_poses: FloatArray | None = None
    """Poses x, y, z, qx, qy, qz, qw of the pods' frames, which have x ahead and are at their feet, shape (k, 7);
    None = there are none."""
    task_state: Mapping[str, str] = field(default_factory=dict)
    """Task name -> state; tasks that did not change since the last frame may be left out. Nobody changes it later."""
    task_counts: Mapping[str, float] = field(default_factory=dict)
    """State -> number of tasks in it, the same keys whenever there are any; may be empty between samples."""
    paths: tuple[FloatArray, ...] | None = None
    """Granted polyline of every car [m], each (k, 2), k = 0 for none; None = unchanged since the last frame."""
    plans: tuple[FloatArray, ...] | None = None
    """Planned but not granted polyline of every car [m], each (k, 2); None = unchanged since the last frame."""
    plan_epoch: int = 0
    """Number of plans that have landed so far."""
    held_by: CellArray | None = None
    """Car that holds each cell, by grants and by standing there, -1 = nobody, shape (n_cells,); None = unchanged."""
    next_of: CellArray | None = None
    """Car that is planned to enter each cell next, -1 = nobody, shape (n_cells,); None = unchanged."""
    waits: tuple[Wait, ...] | None = None
    """Who waits for whom; None = unchanged since the last frame."""
    explanations: Mapping[str, str] | None = None
    """Waiting robot -> why, a sentence; None = unchanged."""
    stood_s: Mapping[str, FloatArray] | None = None
    """Cause -> time that cars have stood in each cell because of it so far [s], shape (n_cells,); None = unchanged."""
    scans: FloatArray | None = None
    """What the cars' lidars hit [m], x, y, z, shape (k, 3); None = no new scan."""
    scan_origins: FloatArray | None = None
    """Where these rays began [m], shape (k, 3)."""
    priorities: FloatArray | None = None
    """What the path planner last ranked the cars by, the greatest first to go, shape (n_cars,); None = unchanged."""
    trees: Mapping[int, FloatArray] = field(default_factory=dict)
    """Arm -> edges of the search trees behind its plan, shape (e, 2, 3) [m]; only plans since the last frame."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Name -> value, the same keys whenever there are any; may be empty between samples."""
    views: Mapping[str, CameraImage] = field(default_factory=dict)
    """Station -> what its camera saw; only images that were taken since the last frame, which nobody changes."""


@dataclass(frozen=True, kw_only=True)
class LogLine:
    """One line of the event log."""

    tick: int
    sim_s: float
    text: str
    level: str = "INFO"
    """'INFO', 'WARN' or 'ERROR'."""


class Recorder(Protocol):
    """Takes frames and log lines; use as a context manager, or call `close`."""

    def due(self, tick: int) -> bool:
        """True if a frame of this tick is wanted; building a frame that is not due is wasted time."""

    def record(self, frame: Frame) -> None:
        """Take a frame; returns at once, the work is done elsewhere."""

    def log(self, line: LogLine) -> None:
        """Take a line of the event log."""

    def close(self) -> None:
        """Finish the recording; calling twice is harmless."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class NullRecorder:
    """Records nothing."""

    def due(self, tick: int) -> bool:
        """Never."""
        return False

    def record(self, frame: Frame) -> None:
        """Ignore the frame."""

    def log(self, line: LogLine) -> None:
        """Ignore the line."""

    def close(self) -> None:
        """Nothing to finish."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
