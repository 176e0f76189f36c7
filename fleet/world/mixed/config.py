"""Settings of the mixed world: where physics begins, and how finely it steps."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.config import Grip, require
from fleet.world.bullet.engine.config import BulletConfig

_ENGINE_MB, _ARM_MB, _SEEN_ARM_MB = 30.0, 2.0, 5.0
_LEAST_REGIONS = 8


@dataclass(frozen=True, kw_only=True)
class MixedConfig:
    """Settings of a `MixedWorld`."""

    grip: Grip = Grip.SUCTION
    grip_force_n: float | None = None
    """Most force of a cup, or of each finger [N]; None = the tool's."""
    images: bool = True
    """Whether robots are seen in images, for which a car takes 5 MB and an arm 3 MB more."""
    tick_s: float = 1 / 30
    """Length of one tick [s], that of physics: with 0.05 s arms follow their set-points ten times as coarsely, and
    parcels slip by 0.2 mm instead of 0.02 mm."""
    car_substep_s: float = 0.0125
    """Greatest integration step of cars outside physics [s]."""
    radius_m: float = 0.85
    """A car whose tray's middle is nearer to an arm's base than this drives on its wheels [m].

    At a dock it is 0.6 m away, so physics has the last 0.6 m of the way there and the first of the way from there;
    arms reach for 0.65 m. A car that drives costs four times as much there as one that stands.
    """
    margin_m: float = 0.05
    """How much farther away it is handed back [m], so that no car is handed to and fro."""
    near_m: float = 2.5
    """Walls, shelves, pedestals and obstacles that reach so near to an arm's base are in its region [m]."""
    neighbours_m: float = 1.5
    """Arms that stand nearer to each other than this share a region, as those of one dock do [m]."""
    memory_mb: float = 900.0
    """What all regions may take, see `n_regions`: larger sites have regions of more arms [MB]."""
    n_slots: int = 3
    """Bodies that wait for cars in a region of one arm; one more for each further arm."""
    still_s: float = 0.5
    """What has not moved for so long sleeps, and a region in which nothing did is no longer stepped [s]; fingers have
    closed by then."""
    slow: float = BulletConfig.slow
    """Speed up to which things rest [m/s, rad/s]."""

    def __post_init__(self) -> None:
        for name in (
            "tick_s",
            "car_substep_s",
            "radius_m",
            "margin_m",
            "near_m",
            "neighbours_m",
            "memory_mb",
            "still_s",
            "slow",
        ):
            value = getattr(self, name)
            require(0 < value < 1e6, f"mixed.{name}", value, "a number > 0")
        require(self.near_m >= self.radius_m, "mixed.near_m", self.near_m, f"a number >= radius_m, {self.radius_m:g}")
        require(self.n_slots >= 1, "mixed.n_slots", self.n_slots, "an integer >= 1")

    def n_regions(self, n_arms: int) -> int:
        """Number of regions at most: each has an engine of its own, which takes 30 MB with nothing in it; arms 2 MB."""
        arms_mb = n_arms * (_SEEN_ARM_MB if self.images else _ARM_MB)
        return max(_LEAST_REGIONS, int((self.memory_mb - arms_mb) / _ENGINE_MB))

    @property
    def n_substeps(self) -> int:
        """Physics steps per tick, as many a second as a `BulletWorld` makes with this grip."""
        usual = BulletConfig(grip=self.grip)
        return max(1, round(self.tick_s * usual.n_substeps / usual.tick_s))
