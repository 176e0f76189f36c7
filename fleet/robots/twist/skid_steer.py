"""SkidSteer: the command map of wheels that do not steer, from a speed and a yaw rate to two sides of wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class SkidSteer:
    """Wheels left and right whose tyres scrub sideways in turns, so that a turn takes more than it would without.

    Scrubbing is in this map alone, by the multiplier that real controllers use. The contacts of the simulated wheels
    have hardly any sideways hold and do not scrub: what motors are told and what the floor sees differ.

    Source: A. Mandow et al., "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007,
    https://doi.org/10.1109/IROS.2007.4399139: a wider track stands for the slip.
    """

    separation_m: float
    """Distance of the wheels' middles, left to right, as the controller has it [m]."""
    multiplier: float
    """How many times as wide the track is that turns the robot as the wheels do."""
    contact_track_m: float
    """Distance of the contacts of the simulated wheels [m]."""

    @property
    def lever_m(self) -> float:
        """What a yaw rate of 1 rad/s adds to the outer wheels [m]."""
        return 0.5 * self.multiplier * self.separation_m

    def rims(self, commands: FloatArray) -> FloatArray:
        """Rim speeds of the left and the right wheels [m/s] for speeds and yaw rates, both of shape (n, 2)."""
        side = self.lever_m * commands[:, 1]
        return np.stack((commands[:, 0] - side, commands[:, 0] + side), axis=1)

    def twists(self, rims: FloatArray) -> FloatArray:
        """Speeds and yaw rates that rim speeds bring, the other way round; the odometry of such a robot."""
        left, right = rims[:, 0], rims[:, 1]
        return np.stack((0.5 * (left + right), 0.5 * (right - left) / self.lever_m), axis=1)

    def contacts(self, rims: FloatArray) -> FloatArray:
        """Rim speeds with which simulated wheels roll as those of the real robot scrub, shape (n, 2)."""
        half = 0.5 * self.contact_track_m
        twists = self.twists(rims)
        side = half * twists[:, 1]
        return np.stack((twists[:, 0] - side, twists[:, 0] + side), axis=1)
