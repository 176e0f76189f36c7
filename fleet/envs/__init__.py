"""Environments: PettingZoo faces on a simulation; importing this package makes them known to `pettingzoo.make`.

Those of a single robot are known to `gymnasium.make`.
"""

import gymnasium
from pettingzoo import register

ENVIRONMENTS = {
    "warehouse-v0": 1200,
    "dispatch-v0": 240,
    "traffic-v0": 500,
    "navigate-v0": 600,
    "navigate-v1": 600,
}
"""Longest episode of each environment, by name; `NAME_VERSION.py` has its `parallel_env` and its `env`."""

for _name, _max_cycles in ENVIRONMENTS.items():
    for _interface, _maker in (("parallel", "parallel_env"), ("aec", "env")):
        _entry_point = f"fleet.envs.{_name.replace('-', '_')}:{_maker}"
        register(_interface, f"fleet/{_name}", entry_point=_entry_point, max_cycles=_max_cycles)
gymnasium.register("fleet/KukaReach-v0", entry_point="fleet.envs.kuka_reach:KukaReachEnv")
gymnasium.register("fleet/CarNavigate-v0", entry_point="fleet.envs.navigate.car_navigate:replaced")
gymnasium.register("fleet/CarNavigate-v1", entry_point="fleet.envs.navigate.car_navigate:CarNavigateEnv")
