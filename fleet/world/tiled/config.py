"""Settings of the tiled world."""

from __future__ import annotations

from dataclasses import dataclass, field

from fleet.config import require
from fleet.world.bullet.engine.config import BulletConfig


@dataclass(frozen=True, kw_only=True)
class TiledConfig:
    """Settings of a `TiledWorld`."""

    bullet: BulletConfig = field(default_factory=BulletConfig)
    """Of each tile's engine."""
    n_cars: int = 70
    """Cars of a tile, on average: with more of them each costs more, with fewer the engines (30 MB each)."""
    arm_m: float = 1.5
    """Floor so near to an arm's base belongs to that arm's tile, and arms as near to each other share one [m]."""
    border_m: float = 0.1
    """A car is handed over when it is so far across a border [m], so that none is handed to and fro."""
    near_m: float = 2.5
    """Walls, shelves and obstacles that reach so near to a tile stand in it too [m]."""
    n_workers: int = 1
    """Processes that share the tiles; 1 = none but this one."""

    def __post_init__(self) -> None:
        require(self.n_cars >= 1, "tiled.n_cars", self.n_cars, "an integer >= 1")
        require(self.n_workers >= 1, "tiled.n_workers", self.n_workers, "an integer >= 1")
        for name in ("arm_m", "border_m", "near_m"):
            value = getattr(self, name)
            require(0 < value < 1e6, f"tiled.{name}", value, "a number > 0")
