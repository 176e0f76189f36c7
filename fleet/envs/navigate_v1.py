"""Version 1 of the navigation environment, under the names that PettingZoo's own environments have."""

from fleet.envs.navigate.navigation import env, parallel_env, raw_env

__all__ = ["env", "parallel_env", "raw_env"]
