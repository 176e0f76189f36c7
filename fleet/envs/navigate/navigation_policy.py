"""PursuitPolicy: the scripted driver of the navigation environment."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from fleet.envs.navigate.rows import FIRST_OTHER, N_OTHERS, N_OWN, N_PER_OTHER, NEAR_M
from fleet.robots.cars.models import usual_car

AIM = 1
"""Number of the way-point that is steered at."""
LATERAL_MPS2 = 2.6
"""Sideways acceleration in curves, that of the fleet's own path follower [m/s^2]."""
BRAKE_MPS2 = 1.5
"""Planned deceleration, 0.6 of the car's [m/s^2]."""
CORRIDOR_M = 0.35
"""Half width of the strip ahead in which another car is waited for [m]."""
GAP_M = 0.75
"""From rear axle to rear axle, kept to a car ahead: a body is 0.5 m long [m]."""


class PursuitPolicy:
    """Drives at the next way-point, as fast as the curve allows, and brakes for a car that stands in the strip ahead.

    Greedy: it looks at what is near and ahead, and neither gives way nor plans.

    Source: R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992.
    """

    def __init__(self) -> None:
        spec = usual_car()
        self._wheelbase_m = spec.wheelbase_m
        self._max_steering_rad = spec.max_steering_rad
        self._max_speed_mps = spec.max_speed_mps

    def act(
        self, env: object, observations: Mapping[str, npt.NDArray[np.float32]]
    ) -> dict[str, npt.NDArray[np.float32]]:
        """Actions of all agents that observe.

        Args:
            env: Not used.
            observations: By agent.
        """
        del env
        if not observations:
            return {}
        return dict(zip(observations, self.actions(np.stack(list(observations.values()))), strict=True))

    def actions(self, rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Actions for observations of shape (n, N_CAR_NUMBERS), shape (n, 2)."""
        points = 3.0 * rows[:, N_OWN:FIRST_OTHER].reshape(len(rows), -1, 2).astype(np.float64)
        curvature = 2.0 * points[..., 1] / np.maximum((points**2).sum(axis=2), 1e-6)
        steering = np.arctan(self._wheelbase_m * curvature[:, AIM])
        sharpest = np.abs(curvature[:, : AIM + 2]).max(axis=1)
        speed = np.minimum(self._max_speed_mps, np.sqrt(LATERAL_MPS2 / np.maximum(sharpest, 1e-6)))
        others = rows[:, FIRST_OTHER:].reshape(len(rows), N_OTHERS, N_PER_OTHER)
        ahead, left = NEAR_M * others[..., 1], NEAR_M * others[..., 2]
        in_way = (others[..., 0] > 0.0) & (ahead > 0.0) & (np.abs(left) < CORRIDOR_M)
        free_m = np.where(in_way, np.maximum(ahead - GAP_M, 0.0), np.inf).min(axis=1)
        speed = np.minimum(speed, np.sqrt(2.0 * BRAKE_MPS2 * free_m))
        acts = np.column_stack((steering / self._max_steering_rad, speed / self._max_speed_mps))
        return np.clip(acts, -1.0, 1.0).astype(np.float32)
