"""Environments: PettingZoo faces on a simulation; importing this package makes them known to `pettingzoo.make`.

Those of a single robot are known to `gymnasium.make`.
"""

import gymnasium
from pettingzoo import register

register("parallel", "fleet/warehouse-v0", entry_point="fleet.envs.warehouse_v0:parallel_env", max_cycles=1200)
register("aec", "fleet/warehouse-v0", entry_point="fleet.envs.warehouse_v0:env", max_cycles=1200)
register("parallel", "fleet/dispatch-v0", entry_point="fleet.envs.dispatch_v0:parallel_env", max_cycles=240)
register("aec", "fleet/dispatch-v0", entry_point="fleet.envs.dispatch_v0:env", max_cycles=240)
register("parallel", "fleet/traffic-v0", entry_point="fleet.envs.traffic_v0:parallel_env", max_cycles=500)
register("aec", "fleet/traffic-v0", entry_point="fleet.envs.traffic_v0:env", max_cycles=500)
register("parallel", "fleet/navigate-v0", entry_point="fleet.envs.navigate_v0:parallel_env", max_cycles=600)
register("aec", "fleet/navigate-v0", entry_point="fleet.envs.navigate_v0:env", max_cycles=600)
gymnasium.register("fleet/KukaReach-v0", entry_point="fleet.envs.kuka_reach:KukaReachEnv")
gymnasium.register("fleet/CarNavigate-v0", entry_point="fleet.envs.navigate.car_navigate:CarNavigateEnv")
