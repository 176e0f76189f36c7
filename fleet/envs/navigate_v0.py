"""Version 0 of the navigation environment, which version 1 has replaced: to make one is refused by name."""

from fleet.envs.core.versions import Replaced

parallel_env = raw_env = env = Replaced(
    "navigate_v0", "navigate_v1", "whose cars stop at each other and see more of each other"
)

__all__ = ["env", "parallel_env", "raw_env"]
