"""Settings of traffic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fleet.config.choices import Fidelity
from fleet.config.settings import Settings, SettingValue, not_negative, positive, require
from planners.mapf import DEFAULT_PLANNER, planner_named

if TYPE_CHECKING:
    from planners.mapf.planner import MapfPlanner

ABSTRACT_PLANNER = "pibt"
"""Who decides the moves of abstract runs, timestep by timestep."""


@dataclass(frozen=True, kw_only=True)
class TrafficConfig(Settings):
    """Multi-agent path finding and its execution."""

    planner: str = DEFAULT_PLANNER
    """Name in `planners.mapf.PLANNERS`, or `package.module.Class` of one's own."""
    planner_settings: Mapping[str, SettingValue] = field(default_factory=dict)
    """Settings of that planner, by name; the others keep their defaults."""
    horizon_n: int = 12
    """Timesteps a plan looks ahead."""
    period_s: float = 1.0
    """Simulated time between two planning requests [s]."""
    latency_s: float = 0.1
    """Simulated time from a request to the tick at which its plan lands [s]."""
    iterations_n: int = 1000
    """Budget of one request, in the planner's own unit; what is not planned then is left to the next request."""
    commit_moves_n: int | None = None
    """Moves beyond the granted ones that a car may still execute while a request is under way; None = as many as keep
    it from running dry, for a planner that heeds when cars come to where its plan begins, and 2 for others."""
    grant_moves_n: int = 3
    """Moves a car may hold a grant for at once: enough to brake from full speed inside them."""
    reorder_after_s: float = 2.0
    """A car that waits that long at a free cell for one that comes first and is late may go first [s]; inf = never."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.horizon_n >= 1, "traffic.horizon_n", self.horizon_n, "an integer >= 1")
        positive("traffic.period_s", self.period_s)
        not_negative("traffic.latency_s", self.latency_s)
        require(self.iterations_n >= 1, "traffic.iterations_n", self.iterations_n, "an integer >= 1")
        commit_ok = self.commit_moves_n is None or self.commit_moves_n >= 0
        require(commit_ok, "traffic.commit_moves_n", self.commit_moves_n, "an integer >= 0")
        require(self.grant_moves_n >= 1, "traffic.grant_moves_n", self.grant_moves_n, "an integer >= 1")
        require(self.reorder_after_s > 0, "traffic.reorder_after_s", self.reorder_after_s, "a number > 0, or inf")

    @classmethod
    def usual(cls, fidelity: Fidelity) -> TrafficConfig:
        """What runs of a fidelity have unless told otherwise: abstract ones know one planner alone."""
        return cls(planner=ABSTRACT_PLANNER) if fidelity is Fidelity.ABSTRACT else cls()

    def make_planner(self, seed: int) -> MapfPlanner:
        """The planner that is named, with its settings.

        Raises:
            PlanningError: There is no such planner, or it has no such settings.
        """
        return planner_named(self.planner, self.planner_settings, seed=seed, what="--planner")
