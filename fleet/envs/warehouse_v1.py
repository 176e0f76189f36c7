"""Version 1 of the warehouse environment, under the names that PettingZoo's own environments have."""

from fleet.envs.warehouse.env import env, parallel_env, raw_env

__all__ = ["env", "parallel_env", "raw_env"]
