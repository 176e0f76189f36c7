"""Settings of the physical world: how the engine is reached, how finely it steps, what the arms hold with."""

from __future__ import annotations

import math
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
    n_steps_per_tick: int | None = None
    """Physics steps per tick; None = what a tick of 1/60 s needs, see `n_substeps`.

    Longer ticks have more of them. Arms then go from set-point to set-point along cubics: with constant accelerations
    they jump where a set-point's tick begins, by a thousandth of a radian at 1/30 s.
    """
    visuals: bool = True
    """Whether robots can be seen in images; without it a car takes 5 MB less, and an arm 3 MB."""
    sleeps_after_s: float | None = None
    """Parked cars, arms without a parcel and parcels that rest for so long sleep until they are told something, or
    touched [s]; None = never. Asleep a car costs 2 microseconds a step, and not 70, an arm 7 and not 25."""
    slow: float = 1e-3
    """Speed up to which things rest [m/s, rad/s]: a parcel that lies still rocks by 1e-4 in the solver."""
    n_steps_per_call: int | None = None
    """The engine makes so many steps of every tick in one call; None = one call for each of `n_substeps` steps.

    Saves most of the time that is not the engine's own. Contacts and grips are then looked at once per tick, arms turn
    at one speed from set-point to set-point, and standing cars are held by their wheels alone. The time of a tick must
    be a whole number of its steps to the last bit (see `exact_tick_s`): the engine carries what is left over, and its
    snapshots do not hold that.
    """

    def __post_init__(self) -> None:
        require(self.tick_s > 0, "bullet.tick_s", self.tick_s, "a number > 0")
        force_ok = self.grip_force_n is None or self.grip_force_n > 0
        require(force_ok, "bullet.grip_force_n", self.grip_force_n, "a number > 0, or None")
        require(self.wheels in ("sphere", "cylinder"), "bullet.wheels", self.wheels, "sphere, cylinder")
        for name in ("sleeps_after_s", "slow"):
            value = getattr(self, name)
            require(value is None or value > 0, f"bullet.{name}", value, "a number > 0")
        n = self.n_steps_per_tick
        require(n is None or n >= 1, "bullet.n_steps_per_tick", n, "an integer >= 1, or None")
        n = self.n_steps_per_call
        n_ok = n is None or (n >= 1 and self.tick_s / n * n == self.tick_s)
        require(n_ok, "bullet.n_steps_per_call", n, "an integer >= 1 that divides tick_s exactly, or None")
        alone_ok = n is None or self.grip is not Grip.FRICTION
        require(
            alone_ok,
            "bullet.n_steps_per_call",
            n,
            "None with fingers, of which the second follows the first in every step",
        )

    @property
    def n_substeps(self) -> int:
        """Physics steps per tick: friction lost 2 of 12 parcels at 1/60 s, suction and the cars are fine at 1/120 s."""
        if self.n_steps_per_tick is not None:
            return self.n_steps_per_tick
        return 4 if self.grip is Grip.FRICTION else 2

    @property
    def n_iterations(self) -> int:
        """Solver iterations: with 10, 1 of 12 parcels held by friction was lost, and those under cups crept by 0.35 mm.

        The engine stops sooner when nothing changes any more, so cups cost hardly more with 30, and creep by 0.03 mm.
        Steps that are made at once are half as long or shorter: with 15 as much is computed in a second.
        """
        if self.grip is Grip.FRICTION:
            return 50
        return 30 if self.n_steps_per_call is None else 15

    @property
    def residual(self) -> float:
        """The solver stops when no velocity changes by more than the root of this [m^2/s^2]; the engine's own is 1e-7.

        Steps that are made at once stop sooner, which saves a tenth of them: standing cars, which nothing holds there,
        then creep by 0.11 mm/s instead of 0.05 (decision 33).
        """
        return 1e-7 if self.n_steps_per_call is None else 1e-5

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
        return self.tick_s / (self.n_steps_per_call or self.n_substeps)

    @property
    def limit_share(self) -> float:
        """Part of its limit that a motor or a grip is given.

        In each step of a call the engine lets it push with its limit for the time of the whole call (measured on one
        wheel: 8 steps at once, 8 times the torque).
        """
        return 1.0 / (self.n_steps_per_call or 1)

    @property
    def n_calls(self) -> int:
        """Calls of the engine per tick."""
        return 1 if self.n_steps_per_call is not None else self.n_substeps


def exact_tick_s(n_steps: int, rate_hz: float) -> float:
    """Length of a tick of `n_steps` steps of about `1 / rate_hz`, which is a multiple of its steps to the last bit [s].

    The step is rounded to 2^-40 s, a relative error below 1e-9 at 240 Hz, so that its multiples need no rounding.
    """
    return n_steps * math.ldexp(round(math.ldexp(1.0 / rate_hz, 40)), -40)
