"""Version 0 of the traffic environment, which version 1 has replaced: to make one is refused by name."""

from fleet.envs.core.versions import Replaced

parallel_env = raw_env = env = Replaced(
    "traffic_v0", "traffic_v1", "whose cars push each other out of the way and see more of each other"
)

__all__ = ["env", "parallel_env", "raw_env"]
