"""Version 0 of the dispatch environment, which version 1 has replaced: to make one is refused by name."""

from fleet.envs.core.versions import Replaced

parallel_env = raw_env = env = Replaced("dispatch_v0", "dispatch_v1", "whose cars are told what waits at stations")

__all__ = ["env", "parallel_env", "raw_env"]
