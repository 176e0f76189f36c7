"""Settings of contact physics on large floors."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.config.settings import Settings, require

MOST_WORKERS = 64


@dataclass(frozen=True, kw_only=True)
class PhysicsConfig(Settings):
    """How the floor is shared by physics engines; with another way, runs differ in last bits."""

    plain_cars_n: int = 60
    """Fleets of up to so many cars have one engine; so have all with a window or a physics server."""
    tile_cars_n: int = 70
    """Larger ones have one for every so many, each with its part of the floor."""
    workers_n: int = 1
    """Processes that share these engines, 1 = the run's own. The result is the same."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("plain_cars_n", "tile_cars_n"):
            require(getattr(self, name) >= 1, f"physics.{name}", getattr(self, name), "an integer >= 1")
        fits = 1 <= self.workers_n <= MOST_WORKERS
        require(fits, "--workers", self.workers_n, f"an integer from 1 to {MOST_WORKERS}")
