"""Version 0 of the warehouse environment, which version 1 has replaced: to make one is refused by name."""

from fleet.envs.core.versions import Replaced

parallel_env = raw_env = env = Replaced(
    "warehouse_v0", "warehouse_v1", "which has levels, brakes, latches and other observations and defaults"
)

__all__ = ["env", "parallel_env", "raw_env"]
