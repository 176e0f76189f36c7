"""Settings of the arms."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.config.settings import Settings, not_negative, require


@dataclass(frozen=True, kw_only=True)
class ArmConfig(Settings):
    """Models, planning and timing of the arms."""

    model: str = "iiwa"
    """Arm of every station whose site names none, a key of `fleet.robots.ARMS`."""

    planner: str = "rrt_connect"
    """Name in `planners.motion.MOTION_PLANNERS`, or one of the names in `OMPL_PLANNERS` there."""
    latency_s: float = 0.1
    """Simulated time from a request to the tick at which its plan lands [s]."""
    iterations_n: int = 20_000
    """Budget of one transit search."""
    workers_n: int = 1
    """Planning processes; 0 plans inside the simulation's own process. The result is the same."""
    velocity_radps: float | None = None
    """Speed limit of every joint [rad/s]; None = those of the real arm, joint by joint."""
    acceleration_radps2: float | None = None
    """The same for accelerations [rad/s^2]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative("arms.latency_s", self.latency_s)
        for name in ("velocity_radps", "acceleration_radps2"):
            limit = getattr(self, name)
            require(limit is None or 0 < limit <= 100, f"arms.{name}", limit, "a number > 0, at most 100, or None")
        require(self.iterations_n >= 1, "arms.iterations_n", self.iterations_n, "an integer >= 1")
        require(self.workers_n in (0, 1), "arms.workers_n", self.workers_n, "0 or 1")
