"""OpenFloorPlan: a way for each car, in legs of one curvature, and how the planning ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import FloatArray
from planners.status import Status


@dataclass(frozen=True, kw_only=True, eq=False)
class CarWay:
    """Where a car is at every time: it drives leg after leg from its start, and stays where the last one ends."""

    start: FloatArray
    """Pose x, y [m], yaw [rad], shape (3,)."""
    legs: FloatArray
    """Duration [s], length [m] (negative backwards, 0 = stand) and curvature [1/m] (positive to the left) of each leg,
    shape (k, 3)."""

    @property
    def duration_s(self) -> float:
        """Time until the car has arrived [s]."""
        return float(self.legs[:, 0].sum())

    def poses(self, times_s: npt.ArrayLike) -> FloatArray:
        """Poses at some times; before 0 that of the start, and after the arrival the last.

        Args:
            times_s: Times from the start [s], shape (k,).

        Returns:
            x, y [m], yaw [rad], shape (k, 3).
        """
        ends = np.concatenate([[0.0], np.cumsum(self.legs[:, 0])])
        bends = np.concatenate([self.start[None], np.zeros((len(self.legs), 3))])
        for k, (_, length, curvature) in enumerate(self.legs):
            bends[k + 1] = _along(bends[k], np.array([length]), np.array([curvature]))[0]
        times = np.clip(np.asarray(times_s, dtype=np.float64), 0.0, ends[-1])
        leg = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, max(len(self.legs) - 1, 0))
        if not len(self.legs):
            return np.repeat(self.start[None], len(times), axis=0)
        duration, length, curvature = self.legs[leg].T
        done = np.divide(times - ends[leg], duration, out=np.ones_like(times), where=duration > 0)
        return _along(bends[leg], np.clip(done, 0.0, 1.0) * length, curvature)


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenFloorPlan:
    """What became of a problem."""

    ways: tuple[CarWay | None, ...]
    """Of each car; None of a car that has none, which is nobody if the status is `feasible`."""
    status: Status
    """`feasible`: everybody arrives; `timeout`: the budget ended; `infeasible`: a start or goal is not legal, or a car
    can come to no pose from which it reaches its goal."""
    step_s: float
    """Time of one step of the search [s]."""
    iterations: int
    """Poses that the searches looked at."""
    repairs: int
    """Ways that were given up for that of another car."""

    @property
    def makespan_s(self) -> float:
        """When the last car arrives [s]."""
        return max((way.duration_s for way in self.ways if way is not None), default=0.0)


def _along(pose: FloatArray, length: FloatArray, curvature: FloatArray) -> FloatArray:
    """Poses after lengths of arcs from poses (k, 3) or from one, shape (k, 3)."""
    x, y, yaw = np.broadcast_to(pose, (len(length), 3)).T
    half = 0.5 * length * curvature
    chord = length * np.sinc(half / np.pi)  # of an arc; sinc is sin(pi x) / (pi x)
    return np.column_stack((x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + 2.0 * half))
