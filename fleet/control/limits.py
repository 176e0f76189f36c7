"""JointLimits: what an arm may do, and the nearest allowed command to any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.control.errors import ControlError, checked

_RETURN_STEPS = 10
"""A joint beyond its end stop is led back within about so many steps."""
_SLACK_RADPS2 = 1e-6
_SHARES = (1.0, 0.5, 0.25, 0.0)
"""Parts of the wanted acceleration that are tried where the motors are too weak to keep the limits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLimits:
    """Limits of an arm's joints; every array has shape (n,)."""

    lower_rad: FloatArray
    upper_rad: FloatArray
    max_velocity_radps: FloatArray
    """Greatest speed; may be infinite."""
    max_torque_nm: FloatArray
    """Greatest torque of the motor; may be infinite."""
    braking_radps2: FloatArray
    """Deceleration that joints are stopped with before they meet their ends."""

    def __post_init__(self) -> None:
        n = np.size(self.lower_rad)
        for name in ("lower_rad", "upper_rad", "max_velocity_radps", "max_torque_nm", "braking_radps2"):
            values = getattr(self, name)
            if not isinstance(values, np.ndarray) or values.shape != (n,) or np.any(np.isnan(values)):
                raise ControlError(f"JointLimits.{name}: {values}; valid: an array of {n} numbers")
        if not np.all(self.lower_rad < self.upper_rad):
            joint = int(np.argmin(self.lower_rad < self.upper_rad))
            raise ControlError(
                f"JointLimits: joint {joint} from {self.lower_rad[joint]} to {self.upper_rad[joint]} rad; "
                "valid: lower < upper"
            )
        for name in ("max_velocity_radps", "max_torque_nm", "braking_radps2"):
            if not np.all(getattr(self, name) > 0):
                raise ControlError(f"JointLimits.{name}: {getattr(self, name)}; valid: numbers > 0")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.lower_rad)

    def position(self, q: npt.ArrayLike) -> FloatArray:
        """The nearest position inside the limits [rad]; shape (n,)."""
        return np.clip(checked("position", q, self.n, "rad"), self.lower_rad, self.upper_rad)

    def velocity(self, q: FloatArray, qd: npt.ArrayLike, step_s: float) -> FloatArray:
        """The nearest velocity that keeps the speed limits and from which the arm can stop before its end stops.

        Args:
            q: Where the joints are [rad], shape (n,).
            qd: Wanted velocity [rad/s], shape (n,).
            step_s: How long it is kept [s].

        Raises:
            ControlError: A malformed velocity.
        """
        low, high = self.velocity_range(q, step_s)
        return np.clip(checked("velocity", qd, self.n, "rad/s"), low, high)

    def velocity_range(self, q: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
        """Velocities from which the arm can stop before its end stops, lowest and highest; each (n,) [rad/s].

        Source: F. Flacco, A. De Luca and O. Khatib, Control of redundant robots under hard joint constraints:
            saturation in the null space, IEEE T-RO 31(3), 2015, equation (9).
        """
        return (-self._towards(q - self.lower_rad, step_s), self._towards(self.upper_rad - q, step_s))

    def torque(
        self, torque: npt.ArrayLike, mass: FloatArray, bias: FloatArray, q: FloatArray, qd: FloatArray, step_s: float
    ) -> FloatArray:
        """The torque to send in place of a wanted one, so that the coming step keeps all limits.

        The wanted torque is turned into the acceleration it would give to the free arm. Joints whose acceleration would
        break a speed limit or run into an end stop get the torque that makes it the nearest one that does not, as far
        as their motors can; the others keep theirs. If a motor is too weak to hold its joint against the others, all
        accelerations are taken back by parts. So a very light joint that presses against something gets no more
        torque than would be safe if that gave way.

        Args:
            torque: Wanted torque of the motors [N m], shape (n,).
            mass: Joint-space inertia, shape (n, n) [kg m^2].
            bias: Torque that makes the acceleration zero: gravity, Coriolis and friction, shape (n,) [N m].
            q: Joint positions [rad], shape (n,).
            qd: Joint velocities [rad/s], shape (n,).
            step_s: How long it acts [s].

        Raises:
            ControlError: A malformed torque.
        """
        wanted = checked("torque", torque, self.n, "N m")
        low, high = self.velocity_range(q + qd * step_s, step_s)
        low, high = (low - qd) / step_s, (high - qd) / step_s
        given = wanted
        for share in _SHARES:
            given, kept = self._bounded(bias + share * (wanted - bias), mass, bias, low, high)
            if kept:
                break
        return given

    def _bounded(
        self, wanted: FloatArray, mass: FloatArray, bias: FloatArray, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, bool]:
        """Torques with which accelerations stay between bounds, and whether the motors are strong enough for that."""
        given = np.clip(wanted, -self.max_torque_nm, self.max_torque_nm)
        bound = np.zeros(self.n, dtype=np.bool_)
        fixed = np.zeros(self.n)
        for _ in range(self.n + 1):
            acceleration = np.linalg.solve(mass, given - bias)
            outside = (acceleration < low - _SLACK_RADPS2) | (acceleration > high + _SLACK_RADPS2)
            if not outside.any():
                return given, True
            if not (outside & ~bound).any():
                break
            fixed = np.where(outside & ~bound, np.clip(acceleration, low, high), fixed)
            bound |= outside
            free = ~bound
            held = mass[:, bound] @ fixed[bound] + bias
            rest = np.zeros(self.n)
            rest[free] = np.linalg.solve(mass[np.ix_(free, free)], (given - held)[free])
            needed = mass @ rest + held
            given = np.where(bound, np.clip(needed, -self.max_torque_nm, self.max_torque_nm), given)
        return given, False

    def _towards(self, room: FloatArray, step_s: float) -> FloatArray:
        """Highest speed towards an end stop that is `room` away; negative beyond it."""
        stopping = np.sqrt(2.0 * self.braking_radps2 * np.maximum(room, 0.0))
        near = np.where(room > 0.0, room / step_s, room / (_RETURN_STEPS * step_s))
        return np.maximum(np.minimum(np.minimum(stopping, near), self.max_velocity_radps), -self.max_velocity_radps)
