"""The scripted drivers of the navigation environment: `PursuitPolicy`, and `BackingPolicy` that also backs out."""

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
STANDS = 0.02
"""A car slower than this stands [share of the top speed]."""
BLOCKED_RAD, STRAIGHT_RAD = 0.7, 0.25
"""A car that stands and whose way leads off by more than the first has its nose at something; it backs until less than
the second is left [rad]."""
TURNED = 0.3
"""Steering against the way by more than this says that a car has backed already [share of the limit]."""
PRESSED_M, BESIDE_M = 0.9, 0.4
"""Another car is in front of the nose within this, ahead of the rear axle and to either side [m]."""
BACK = 0.4
"""Speed in reverse [share of the top speed]."""


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
        others = _others(rows)
        ahead, left = NEAR_M * others[..., 1], NEAR_M * others[..., 2]
        in_way = (others[..., 0] > 0.0) & (ahead > 0.0) & (np.abs(left) < CORRIDOR_M)
        free_m = np.where(in_way, np.maximum(ahead - GAP_M, 0.0), np.inf).min(axis=1)
        speed = np.minimum(speed, np.sqrt(2.0 * BRAKE_MPS2 * free_m))
        acts = np.column_stack((steering / self._max_steering_rad, speed / self._max_speed_mps))
        return np.clip(acts, -1.0, 1.0).astype(np.float32)


class BackingPolicy(PursuitPolicy):
    """Pursuit that backs out: where its nose is at a wall, or at a car that is not to give way.

    It remembers nothing: that a car is backing is read from its speed, and that it has backed enough from where its way
    leads. Of two cars nose to nose the one backs that has the greater number; one that has run into another from behind
    backs, whatever the numbers.
    """

    def actions(self, rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Actions for observations of shape (n, N_CAR_NUMBERS), shape (n, 2)."""
        acts = super().actions(rows)
        speed, steering, touches = rows[:, 0], rows[:, 1], rows[:, 5] > 0.0
        aim_x, aim_y = rows[:, N_OWN + 2 * AIM], rows[:, N_OWN + 2 * AIM + 1]
        off_rad = np.arctan2(aim_y, aim_x)
        side = np.sign(off_rad)
        stands, turns = np.abs(speed) < STANDS, np.abs(off_rad) > STRAIGHT_RAD
        yields = _yields(rows)
        at_wall = stands & (np.abs(off_rad) > BLOCKED_RAD) & (steering * side > -TURNED)
        backs = (speed <= -STANDS) & (turns | yields)
        back = at_wall | (stands & touches & yields) | backs
        acts[back] = np.column_stack((np.where(turns, -side, 0.0), np.full(len(rows), -BACK)))[back]
        return acts


def _others(rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """What cars are told of others, shape (n, N_OTHERS, N_PER_OTHER)."""
    return rows[:, FIRST_OTHER:].reshape(len(rows), N_OTHERS, N_PER_OTHER)


def _yields(rows: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Whether a car is to back off from another in front of its nose, shape (n,)."""
    others = _others(rows)
    x, y, cos, sin = NEAR_M * others[..., 1], NEAR_M * others[..., 2], others[..., 3], others[..., 4]
    in_front = (others[..., 0] > 0.0) & (x > 0.0) & (x < PRESSED_M) & (np.abs(y) < BESIDE_M)
    faces = cos * x + sin * y < 0.0
    has_lower_number = others[..., 15] > 0.0
    found: npt.NDArray[np.bool_] = (in_front & (has_lower_number | ~faces)).any(axis=1)
    return found
