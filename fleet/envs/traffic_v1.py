"""Version 1 of the traffic environment, under the names that PettingZoo's own environments have."""

from __future__ import annotations

from typing import Any

from fleet.envs.core.base import in_order, turn_based
from fleet.envs.traffic import env as on_site
from fleet.envs.traffic import on_map
from fleet.envs.traffic.env import TrafficEnv

__all__ = ["env", "parallel_env", "raw_env"]


def parallel_env(**settings: Any) -> TrafficEnv:
    """Make the environment: the settings are those of `TrafficEnvConfig`, or with `map` those of `MapTrafficConfig`."""
    return on_map.parallel_env(**settings) if "map" in settings else on_site.parallel_env(**settings)


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `parallel_env`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))
