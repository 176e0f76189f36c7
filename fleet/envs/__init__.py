"""Environments: PettingZoo faces on a simulation; importing this package makes them known to `pettingzoo.make`.

Those of a single robot are known to `gymnasium.make`.
"""

import gymnasium
from pettingzoo import register

ENVIRONMENTS = {
    "warehouse_v1": 1200,
    "dispatch_v0": 240,
    "traffic_v1": 500,
    "navigate_v0": 600,
}
"""Longest episode of each environment, by module, which has its `parallel_env` and its `env`."""
REPLACED = {"warehouse_v0": 1200, "traffic_v0": 500}
"""The same of versions that another one has replaced: to make one is refused, and the message names the new one."""

for _module, _max_cycles in (ENVIRONMENTS | REPLACED).items():
    for _interface, _maker in (("parallel", "parallel_env"), ("aec", "env")):
        _name = f"fleet/{_module.replace('_', '-')}"
        register(_interface, _name, entry_point=f"fleet.envs.{_module}:{_maker}", max_cycles=_max_cycles)
gymnasium.register("fleet/KukaReach-v0", entry_point="fleet.envs.kuka_reach:KukaReachEnv")
gymnasium.register("fleet/CarNavigate-v0", entry_point="fleet.envs.navigate.car_navigate:CarNavigateEnv")
