"""ArmMotions: straight lines of the tool and timed motions of one arm, with the physics engine's last word on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fleet.arrays import FloatArray
from fleet.errors import FleetError
from fleet.robots.arms.spec import ArmSpec
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.path.lines import straight_line, tip_pose
from planners.motion.path.trajectory import Trajectory, retime

LINE_SPEED = 0.6
"""Share of the joint speed limits used on straight lines."""
SLOW = 0.5
"""Share of the usual speed at which a motion is tried that touches something when it is faster: what smoothing adds to
its deviation falls with the acceleration."""
CORNER_RAD = (0.1, 0.03, 0.01)
"""How far corners may be cut, largest first [rad]."""
CONFIRM_EVERY = 5
"""One in this many samples of a motion is shown to the physics engine: 0.05 s apart."""
SAMPLE_S = 0.01
"""Sample period of trajectories; between samples they are interpolated [s]."""


@dataclass(frozen=True, kw_only=True)
class Held:
    """A parcel in the grip."""

    size_m: tuple[float, float, float]
    below_tip_m: float
    """Its centre lies this far beyond the tool tip [m]."""


class Confirm(Protocol):
    """The physics engine's last word on a motion."""

    def __call__(self, boxes: Boxes, path: FloatArray, held: Held | None) -> str:
        """Check a path (k, n) among boxes in the arm's base frame; returns what is wrong, empty if nothing."""


class UnreachableError(FleetError):
    """An arm cannot serve a place of its station."""


class TouchingError(UnreachableError):
    """A motion along a free path would touch something."""


class ArmMotions:
    """Makes motions of one arm; everything in the base frame.

    Args:
        spec: The arm with its tool.
        confirm: The physics engine's last word, if there is an engine.
    """

    def __init__(self, spec: ArmSpec, confirm: Confirm | None) -> None:
        self.inverse = inverse_kinematics(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
        self._descent = NumericInverse.from_joints(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
        self._spec, self._tool_m, self._confirm = spec, spec.tool_length_m, confirm

    def tip(self, q: FloatArray) -> FloatArray:
        """Pose of the tool's tip for q (n,), shape (4, 4)."""
        return tip_pose(self.inverse, q, self._tool_m)

    def line(self, q: FloatArray, tip: FloatArray) -> FloatArray | None:
        """Straight way of the tip to a pose, shape (k, n); None if there is none."""
        return straight_line(self.inverse, self._descent, q, tip, self._tool_m)

    def timed(self, path: FloatArray, speed: float, checker: CollisionChecker) -> Trajectory:
        """Fastest motion along a path; corners are cut less if cutting them would touch something.

        Args:
            path: Corners [rad], shape (k, n).
            speed: Share of the joint limits.
            checker: What must not be touched.

        Raises:
            TouchingError: However little is cut, something is touched.
        """
        spec = self._spec
        for deviation in CORNER_RAD if speed == 1.0 else CORNER_RAD[-1:]:
            trajectory = retime(
                path,
                spec.max_velocity_radps * speed,
                spec.max_acceleration_radps2 * speed,
                dt_s=SAMPLE_S,
                max_deviation_rad=deviation,
            )
            if checker.batch(trajectory.q).all():
                return trajectory
        raise TouchingError("a timed motion leaves its path too far")

    def timed_line(self, path: FloatArray, checker: CollisionChecker) -> Trajectory:
        """Motion along a straight line of the tool, slower if it would touch something.

        Args:
            path: Corners [rad], shape (k, n).
            checker: What must not be touched.

        Raises:
            TouchingError: It does so however slow.
        """
        try:
            return self.timed(path, LINE_SPEED, checker)
        except TouchingError:
            return self.timed(path, SLOW * LINE_SPEED, checker)

    def confirmed(self, trajectory: Trajectory, boxes: Boxes, held: Held | None) -> Trajectory:
        """The same motion, if the physics engine has nothing against it.

        Raises:
            TouchingError: It has.
        """
        if self._confirm is not None:
            wrong = self._confirm(boxes, shown(trajectory), held)
            if wrong:
                raise TouchingError(f"the physics engine refuses a motion: {wrong}")
        return trajectory


def shown(motion: Trajectory) -> FloatArray:
    """What the physics engine is shown of a motion: samples 0.05 s apart and its end, shape (k, n)."""
    last = len(motion.q) - 1
    return motion.q[np.append(np.arange(0, last, CONFIRM_EVERY), last)]


def backwards(motion: Trajectory) -> Trajectory:
    """The same motion from its end to its start."""
    return Trajectory(t=motion.t, q=motion.q[::-1].copy(), qd=-motion.qd[::-1])
