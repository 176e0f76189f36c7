"""Settings shared by the RRT-Connect planners."""

from __future__ import annotations

from dataclasses import dataclass

from planners.motion import checks


@dataclass(frozen=True, kw_only=True)
class RrtConnectConfig:
    """Settings of both RRT-Connect planners."""

    range_rad: float = 1.0
    """Longest tree edge in joint space [rad]."""
    shortcut_rounds: int = 12
    """Rounds of shortening after a path is found."""

    def __post_init__(self) -> None:
        checks.positive("RrtConnectConfig.range_rad", self.range_rad)
        checks.whole("RrtConnectConfig.shortcut_rounds", self.shortcut_rounds, 0, 1_000_000)
