"""Laws of joint control: torques from errors, on arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.control.errors import ControlError


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Stiffness and damping of each joint's control."""

    stiffness: FloatArray
    """Torque per position error [N m/rad], shape (n,)."""
    damping: FloatArray
    """Torque per velocity error [N m s/rad], shape (n,)."""


def gains_from_mass(
    mass: npt.ArrayLike, frequency_radps: float, damping_ratio: float = 1.0, rotor_kgm2: float = 0.0
) -> Gains:
    """Gains that let every joint alone, with the inertia it moves, answer like one oscillator.

    Args:
        mass: Joint-space inertia, shape (n, n) [kg m^2].
        frequency_radps: Natural frequency of each joint's answer [rad/s], > 0.
        damping_ratio: 1 comes to rest without overshoot, >= 0.
        rotor_kgm2: Inertia of each motor behind its gear, which descriptions leave out: without it, the gains of a
            light last joint are too small to overcome any friction; >= 0.

    Raises:
        ControlError: The matrix is not square with a positive diagonal, or a number is out of range.

    Source: B. Siciliano et al., Robotics: Modelling, Planning and Control, Springer 2009, section 8.3 (independent
        joint control).
    """
    matrix = np.asarray(mass, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.all(np.diag(matrix) > 0):
        raise ControlError(f"mass: shape {matrix.shape}; valid: a square matrix with a positive diagonal [kg m^2]")
    if not (math.isfinite(frequency_radps) and frequency_radps > 0):
        raise ControlError(f"frequency_radps is {frequency_radps}; valid: a number > 0")
    if not (math.isfinite(damping_ratio) and damping_ratio >= 0):
        raise ControlError(f"damping_ratio is {damping_ratio}; valid: a number >= 0")
    if not (math.isfinite(rotor_kgm2) and rotor_kgm2 >= 0):
        raise ControlError(f"rotor_kgm2 is {rotor_kgm2}; valid: a number >= 0")
    inertia = np.diag(matrix) + rotor_kgm2
    return Gains(stiffness=frequency_radps**2 * inertia, damping=2.0 * damping_ratio * frequency_radps * inertia)


def pd_torque(
    gains: Gains,
    mass: FloatArray,
    bias: FloatArray,
    feed_forward: FloatArray,
    q_error: FloatArray,
    qd_error: FloatArray,
    step_s: float,
) -> FloatArray:
    """Torque of each joint by its own errors, which are taken where the arm will be at the end of the step; (n,) [N m].

    So it is stable for any gains and any step, also on joints of little inertia.

    Args:
        gains: Stiffness and damping.
        mass: Joint-space inertia, shape (n, n) [kg m^2].
        bias: Torque for zero acceleration: gravity, Coriolis, friction, shape (n,) [N m].
        feed_forward: Torque that is known to be needed, such as that against gravity, shape (n,) [N m].
        q_error: Target at the end of the step minus position at its end if the velocity stays, shape (n,) [rad].
        qd_error: Target at the end of the step minus velocity, shape (n,) [rad/s].
        step_s: Length of the step [s].

    Source: J. Tan, K. Liu and G. Turk, Stable proportional-derivative controllers, IEEE Computer Graphics and
        Applications 31(4), 2011.
    """
    torque = gains.stiffness * q_error + gains.damping * qd_error + feed_forward
    acceleration = np.linalg.solve(mass + step_s * np.diag(gains.damping), torque - bias)
    stable: FloatArray = torque - step_s * gains.damping * acceleration
    return stable


def computed_torque(
    mass: FloatArray,
    bias: FloatArray,
    acceleration: FloatArray,
    q_error: FloatArray,
    qd_error: FloatArray,
    frequency_radps: float,
    damping_ratio: float = 1.0,
) -> FloatArray:
    """Torque that moves the arm as wanted and lets errors die out like those of one oscillator; (n,) [N m].

    Args:
        mass: Joint-space inertia, shape (n, n) [kg m^2].
        bias: Torque for zero acceleration: gravity, Coriolis, friction, shape (n,) [N m].
        acceleration: Wanted acceleration [rad/s^2], shape (n,).
        q_error: Target minus position [rad], shape (n,).
        qd_error: Target minus velocity [rad/s], shape (n,).
        frequency_radps: Natural frequency of the errors [rad/s].
        damping_ratio: 1 lets them die out without overshoot.

    Source: B. Siciliano et al., Robotics: Modelling, Planning and Control, Springer 2009, section 8.5.2 (inverse
        dynamics control).
    """
    corrected = acceleration + frequency_radps**2 * q_error + 2.0 * damping_ratio * frequency_radps * qd_error
    torque: FloatArray = mass @ corrected + bias
    return torque
