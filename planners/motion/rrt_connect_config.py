"""Settings shared by the RRT-Connect planners."""

from __future__ import annotations

from dataclasses import dataclass

from planners.errors import PlanningError


@dataclass(frozen=True, kw_only=True)
class RrtConnectConfig:
    """Settings of both RRT-Connect planners."""

    range_rad: float = 1.0
    """Longest tree edge in joint space [rad]."""
    shortcut_rounds: int = 12
    """Rounds of shortening after a path is found."""

    def __post_init__(self) -> None:
        if not self.range_rad > 0:
            raise PlanningError(f"RrtConnectConfig.range_rad: {self.range_rad}, expected > 0")
        if self.shortcut_rounds < 0:
            raise PlanningError(f"RrtConnectConfig.shortcut_rounds: {self.shortcut_rounds}, expected >= 0")
