"""Version 1 of the dispatch environment, under the names that PettingZoo's own environments have."""

from fleet.envs.dispatch.env import env, parallel_env, raw_env

__all__ = ["env", "parallel_env", "raw_env"]
