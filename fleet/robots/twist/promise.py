"""TwistPromise: how exactly a robot that is told a speed and a yaw rate drives alone, and by which gains."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.robots.differential import TwistFollowerConfig


@dataclass(frozen=True, kw_only=True)
class TwistPromise:
    """What the proving ground holds a robot to."""

    follower: TwistFollowerConfig
    """Gains that it is driven with."""
    cross_track_m: float
    """What it may be off a course [m]."""
    steady: tuple[tuple[float, float], ...]
    """Speeds [m/s] and yaw rates [rad/s] that are held for a while to see how exactly they are answered."""
