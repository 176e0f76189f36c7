"""Environments: PettingZoo faces on a simulation; importing this package makes them known to `pettingzoo.make`.

Those of a single robot are known to `gymnasium.make`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
from pettingzoo import register

if TYPE_CHECKING:  # heavy, and not everybody wants many environments
    from fleet.envs.vector.vec_env import VecEnv

ENVIRONMENTS: dict[str, int | None] = {
    "warehouse_v1": None,
    "dispatch_v1": 240,
    "traffic_v1": 500,
    "navigate_v1": 600,
    "handover_v0": 600,
}
"""Longest episode of each environment, by module, which has its `parallel_env` and its `env`; None = as its level has
it."""
REPLACED = {"warehouse_v0": 1200, "dispatch_v0": 240, "traffic_v0": 500, "navigate_v0": 600}
"""The same of versions that another one has replaced: to make one is refused, and the message names the new one."""

for _module, _max_cycles in (ENVIRONMENTS | REPLACED).items():
    for _interface, _maker in (("parallel", "parallel_env"), ("aec", "env")):
        _name = f"fleet/{_module.replace('_', '-')}"
        register(_interface, _name, entry_point=f"fleet.envs.{_module}:{_maker}", max_cycles=_max_cycles)
gymnasium.register("fleet/KukaReach-v0", entry_point="fleet.envs.kuka_reach:KukaReachEnv")
gymnasium.register("fleet/CarNavigate-v0", entry_point="fleet.envs.navigate.car_navigate:replaced")
gymnasium.register("fleet/CarNavigate-v1", entry_point="fleet.envs.navigate.car_navigate:CarNavigateEnv")


def make_vec(layer: str, n_envs: int, *, n_threads: int = 1, **arguments: Any) -> VecEnv:
    """Make several environments that are stepped together: arrays in, arrays out.

    Args:
        layer: A name in `ENVIRONMENTS` without its version: `dispatch`, `traffic`, `navigate`, `warehouse`,
            `handover`.
        n_envs: Number of environments, B.
        n_threads: Threads that share the environments, where a kernel steps them; results do not depend on it.
        **arguments: Settings of the environment, as its `parallel_env` takes them.

    Raises:
        ConfigError: There is no such layer, or a number or setting is outside its valid range.
    """
    from fleet.envs.vector.make import make

    return make(layer, n_envs, n_threads, arguments)
