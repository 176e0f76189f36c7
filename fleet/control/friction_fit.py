"""FrictionFit: damping and dry friction of joints from a motion, by replaying it with other values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.control.standard_errors import errors_of_normal

Replay = Callable[[FloatArray, FloatArray], FloatArray]
"""Joint positions (k, n) that a simulated arm has with damping (n,) and dry friction (n,)."""

_LEAST_STEP = (0.02, 0.01)
"""Smallest change of damping [N m s/rad] and friction [N m] that a slope is taken over."""
_LONGEST = 10.0
"""No step is longer than so many times that, plus the value itself."""
_LEAST_SLOPE = 1e-6
"""Part of the steepest value's curvature that every value is taken to have: one that hardly matters stays put."""
_STEP_SHARE = 0.05
_CONVERGED = 1e-3
"""A step that lowers the squares by less than this part ends the fit."""
_NO_SLOPE = 1e-10
"""Below this part of the steepest value's curvature a value cannot be told."""
_EASED, _BRAKED, _MOST_BRAKED = 0.2, 6.0, 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionFit:
    """What a fit found."""

    damping: FloatArray
    """Viscous damping [N m s/rad], shape (n,)."""
    friction: FloatArray
    """Dry friction [N m], shape (n,)."""
    rms_before_rad: FloatArray
    """Root mean square error of each joint with the values the fit began with, shape (n,)."""
    rms_rad: FloatArray
    """The same with the values found, shape (n,)."""
    damping_sigma: FloatArray
    """Standard deviation of the damping, if the rest is noise; infinite where the motion does not tell, shape (n,)."""
    friction_sigma: FloatArray
    """The same of the friction, shape (n,)."""
    n_replays: int
    """Replays made."""


def rms(error: FloatArray) -> FloatArray:
    """Root mean square of each column (k, n); shape (n,)."""
    values: FloatArray = np.sqrt(np.mean(error * error, axis=0))
    return values


def fit_friction(
    replay: Replay,
    measured: FloatArray,
    damping: FloatArray,
    friction: FloatArray,
    *,
    most_rounds: int = 15,
    progress: Callable[[int, FloatArray], None] | None = None,
) -> FrictionFit:
    """Find the damping and friction whose replay is nearest to a measured motion.

    Damped least squares on the positions of all joints at once; slopes are differences of replays, and no value falls
    below zero.

    Args:
        replay: Simulates the arm.
        measured: Joint positions [rad], shape (k, n).
        damping: First guess [N m s/rad], shape (n,).
        friction: First guess [N m], shape (n,).
        most_rounds: Slopes are taken at most so often, each of 2 n replays.
        progress: Told the round and the errors (n,) [rad] after each.

    Source: D. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, SIAM J. 11(2), 1963.
    """
    n = measured.shape[1]
    values = np.concatenate([damping, friction]).astype(np.float64)
    least = np.repeat(_LEAST_STEP, n)
    error = replay(values[:n], values[n:]) - measured
    replays, before = 1, rms(error)
    cost = float(np.sum(error**2))
    normal = np.zeros((2 * n, 2 * n))
    brake = 1e-2
    for number in range(most_rounds):
        step = np.maximum(_STEP_SHARE * values, least)
        slope = np.empty((error.size, 2 * n))
        for i in range(2 * n):
            moved = values.copy()
            moved[i] += step[i]
            other = replay(moved[:n], moved[n:]) - measured
            slope[:, i] = (other - error).ravel() / step[i]
        replays += 2 * n
        normal, pull = slope.T @ slope, slope.T @ error.ravel()
        gain = 0.0
        while brake < _MOST_BRAKED:
            curvature = np.maximum(np.diag(normal), _LEAST_SLOPE * np.diag(normal).max() + 1e-12)
            change = -np.linalg.solve(normal + brake * np.diag(curvature), pull)
            longest = values + _LONGEST * least
            trial = np.maximum(values + np.clip(change, -longest, longest), 0.0)
            other = replay(trial[:n], trial[n:]) - measured
            replays += 1
            changed = float(np.sum(other**2))
            if changed < cost:
                gain = (cost - changed) / cost
                values, error, cost = trial, other, changed
                brake *= _EASED
                break
            brake *= _BRAKED
        if progress is not None:
            progress(number + 1, rms(error))
        if gain < _CONVERGED:
            break
    sigma = errors_of_normal(normal, cost / error.size, least=_NO_SLOPE)
    return FrictionFit(
        damping=values[:n],
        friction=values[n:],
        rms_before_rad=before,
        rms_rad=rms(error),
        damping_sigma=sigma[:n],
        friction_sigma=sigma[n:],
        n_replays=replays,
    )
