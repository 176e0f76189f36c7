"""Settings of the physical world: how the engine is reached, how finely it steps, what the arms hold with."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.config import Connect, Grip, require
from fleet.robots.model import WheelShape


@dataclass(frozen=True, kw_only=True)
class BulletConfig:
    """Settings of a `BulletWorld`."""

    connect: Connect = Connect.DIRECT
    shared_memory_key: int = 12347
    """Key of a running physics server; used with SHARED_MEMORY only."""
    grip: Grip = Grip.SUCTION
    wheels: WheelShape = "sphere"
    """Collision shape of the wheels."""
    tick_s: float = 1 / 60
    """Length of one tick [s]."""
    grip_force_n: float | None = None
    """Most force of a cup, less for light parcels (see `SuctionGrip`), or of each finger [N]; None = the tool's."""

    def __post_init__(self) -> None:
        require(self.tick_s > 0, "bullet.tick_s", self.tick_s, "a number > 0")
        force_ok = self.grip_force_n is None or self.grip_force_n > 0
        require(force_ok, "bullet.grip_force_n", self.grip_force_n, "a number > 0, or None")
        require(self.wheels in ("sphere", "cylinder"), "bullet.wheels", self.wheels, "sphere, cylinder")

    @property
    def substeps_n(self) -> int:
        """Physics steps per tick: friction lost 2 of 12 parcels at 1/60 s, suction and the cars are fine at 1/120 s."""
        return 4 if self.grip is Grip.FRICTION else 2

    @property
    def iterations_n(self) -> int:
        """Solver iterations: with 10, 1 of 12 parcels held by friction was lost, and those under cups crept by 0.35 mm.

        The engine stops sooner when nothing changes any more, so cups cost hardly more with 30, and creep by 0.03 mm.
        """
        return 50 if self.grip is Grip.FRICTION else 30

    @property
    def contact_breaking_m(self) -> float:
        """Distance from which contacts are dropped [m].

        The engine's 2 cm keep four points under every rolling wheel, 1 mm one, which halves the cost of a car. But pads
        grip with anchored friction (`FrictionGrip`), and an anchor must outlive a rattle: with 1 mm it does not, and
        parcels slid by 9 mm.
        """
        return 0.02 if self.grip is Grip.FRICTION else 0.001

    @property
    def substep_s(self) -> float:
        """Length of one physics step [s]."""
        return self.tick_s / self.substeps_n
