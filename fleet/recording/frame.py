"""Frame: what a recording keeps of one tick, and Recorder: who takes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from fleet.sensors.camera import CameraImage

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(kw_only=True)
class Frame:
    """The visible state of a run at one tick. A recorder copies the arrays, so views of live state are welcome."""

    tick: int
    sim_s: float
    """Simulated time [s]."""
    car_poses: FloatArray
    """Rear-axle poses x, y, yaw [m, m, rad], shape (n_cars, 3)."""
    car_steering: FloatArray
    """Bicycle-equivalent steering angles [rad], shape (n_cars,)."""
    wheel_angle: FloatArray
    """Rolled angle of the wheels, positive forward [rad], shape (n_cars,)."""
    arm_q: FloatArray
    """Joint positions [rad], shape (n_arms, n_joints)."""
    parcel_ids: IntArray
    """Parcels in the world, shape (p,)."""
    parcel_poses: FloatArray
    """Poses x, y, z, qx, qy, qz, qw of the box centres in the order of `parcel_ids`, shape (p, 7)."""
    parcel_size_m: FloatArray
    """Full edges of the boxes in the order of `parcel_ids` [m], shape (p, 3)."""
    car_state: tuple[str, ...]
    """One word per car: idle, driving, waiting, docked, fault, ..."""
    arm_state: tuple[str, ...]
    """One word per arm."""
    task_state: Mapping[str, str] = field(default_factory=dict)
    """Task name -> state; tasks that did not change since the last frame may be left out."""
    task_counts: Mapping[str, float] = field(default_factory=dict)
    """State -> number of tasks in it; the same keys in every frame."""
    paths: tuple[FloatArray, ...] | None = None
    """Granted polyline of every car [m], each (k, 2), k = 0 for none; None = unchanged since the last frame."""
    plans: tuple[FloatArray, ...] | None = None
    """Planned but not granted polyline of every car [m], each (k, 2); None = unchanged since the last frame."""
    plan_epoch: int = 0
    """Number of plans that have landed so far."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Name -> value; the same keys in every frame."""
    views: Mapping[str, CameraImage] = field(default_factory=dict)
    """Station -> what its camera saw; only images that were taken since the last frame, which nobody changes."""

    def copied(self) -> Frame:
        """A frame that shares no array with the simulation."""
        return Frame(
            tick=self.tick,
            sim_s=self.sim_s,
            car_poses=np.array(self.car_poses),
            car_steering=np.array(self.car_steering),
            wheel_angle=np.array(self.wheel_angle),
            arm_q=np.array(self.arm_q),
            parcel_ids=np.array(self.parcel_ids),
            parcel_poses=np.array(self.parcel_poses),
            parcel_size_m=np.array(self.parcel_size_m),
            car_state=self.car_state,
            arm_state=self.arm_state,
            task_state=dict(self.task_state),
            task_counts=dict(self.task_counts),
            paths=_copies(self.paths),
            plans=_copies(self.plans),
            plan_epoch=self.plan_epoch,
            metrics=dict(self.metrics),
            views=dict(self.views),
        )


def _copies(lines: tuple[FloatArray, ...] | None) -> tuple[FloatArray, ...] | None:
    return None if lines is None else tuple(np.array(line) for line in lines)


@dataclass(frozen=True, kw_only=True)
class LogLine:
    """One line of the event log."""

    tick: int
    sim_s: float
    text: str
    level: str = "INFO"
    """'INFO', 'WARN' or 'ERROR'."""


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """The parts of a site that are drawn but do not take part in the physics."""

    name: str
    lanes: FloatArray
    """From and to of every directed lane [m], shape (k, 2, 2)."""
    station_names: tuple[str, ...]
    station_xy: FloatArray
    """Where to write the names: the arms' bases [m], shape (s, 2)."""
    dock_xy: FloatArray
    """Centres of the dock cells in the order of `station_names` [m], shape (s, 2)."""
    parking_xy: FloatArray
    """Centres of the parking cells [m], shape (p, 2)."""


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
