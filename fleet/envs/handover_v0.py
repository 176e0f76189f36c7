"""Version 0 of the hand-over environment, under the names that PettingZoo's own environments have."""

from fleet.envs.handover.env import env, parallel_env, raw_env

__all__ = ["env", "parallel_env", "raw_env"]
