"""Scripted policies of the continuous layer: cars that pursue their path, arms that play the classical plans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.config import ArmConfig
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.rows import NEAR_M, WAY_POINTS_M
from fleet.simulation import Simulation
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.stations.arms.transfer import TransferRequest

LOOKAHEAD = 0
"""Way-point that a car steers for: 0.4 m ahead, the wheelbase and a little more."""
AT_GOAL_M = 0.4
"""Nearer to its goal than this a car steers for a point beyond it, so that it ends straight [m]."""
CRUISE_MPS, BACK_MPS, GAIN_PER_S = 0.9, 0.3, 1.5
"""Speed on the way, back to a stop that was passed, and per metre that is left to go."""
_AHEAD, _WAY, _GOAL, _TURN, _LOADS, _UNLOADS = 15, 19, 6, 8, 11, 13  # entries of a car's observation


class PursuitCars:
    """Every car pursues its observed way-points and stops at its path's end; arms do nothing.

    Source: R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992.

    Args:
        seed: Not used; every policy of the table takes one.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        scene = env.simulation.scene
        diagonal_m = math.hypot(*scene.size_m)
        rows = {agent: _row(seen) for agent, seen in observations.items() if agent.startswith("car_")}
        car = scene.car
        return {
            agent: pursue(row, diagonal_m, car.wheelbase_m, car.max_steering_rad, car.max_speed_mps)
            for agent, row in rows.items()
        }


class PlannedArms:
    """Every arm plays the plan that the classical fleet makes for its transfer; cars do nothing.

    The environment's arms must take joint velocities. A policy is for one episode after the other, not for two
    environments at once.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        self._simulation: Simulation | None = None
        self._asked: dict[int, TransferRequest] = {}

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        agents = [agent for agent in observations if agent.startswith("arm_")]
        simulation = env.simulation
        if not agents:
            return {}
        if simulation is not self._simulation:
            self._begin(simulation)
        arm_manager, step_s = self._arm_manager, 1.0 / env.metadata["render_fps"]
        before, held = arm_manager.q.copy(), simulation.world.held()
        for agent in agents:
            arm = int(agent.rpartition("_")[2])
            transfer = simulation.arm_manager.transfer(arm)
            if transfer is not None and transfer is not self._asked.get(arm) and arm_manager.is_idle(arm):
                self._asked[arm] = transfer
                arm_manager.submit(transfer, self._tick)
        for _ in range(round(step_s / simulation.tick_s)):
            arm_manager.tick(self._tick, held)
            self._tick += 1
        speeds = (arm_manager.q - before) / step_s / simulation.scene.arm.max_velocity_radps
        grip = np.where(arm_manager.grip, 1.0, -1.0)
        return {
            agent: np.append(speeds[arm], grip[arm]).astype(np.float32)
            for agent, arm in ((agent, int(agent.rpartition("_")[2])) for agent in agents)
        }

    def _begin(self, simulation: Simulation) -> None:
        scene, names = simulation.scene, tuple(station.name for station in simulation.stations)
        planner = make_arm_planner(arm_cells(simulation.site, scene), names, scene.arm, simulation.config)
        self._arm_manager = ArmManager(planner, ArmConfig(latency_s=0.0), scene.car, scene.arm_start, simulation.tick_s)
        self._simulation, self._asked, self._tick = simulation, {}, 0


class Classical:
    """The classical fleet's way: cars pursue their paths, arms play plans.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        self._cars, self._arms = PursuitCars(seed), PlannedArms(seed)

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        return self._cars.act(env, observations) | self._arms.act(env, observations)


def pursue(
    row: npt.NDArray[np.float32], diagonal_m: float, wheelbase_m: float, max_steering_rad: float, max_speed_mps: float
) -> npt.NDArray[np.float32]:
    """Action of one car.

    Args:
        row: Its observation.
        diagonal_m: Of the floor.
        wheelbase_m: Of the car.
        max_steering_rad: At full action.
        max_speed_mps: At full action.
    """
    points = row[_WAY : _WAY + 2 * len(WAY_POINTS_M)].reshape(-1, 2) * NEAR_M
    goal = row[_GOAL : _GOAL + 2] * diagonal_m
    at_goal = math.hypot(*goal) < AT_GOAL_M
    x, y = goal + AT_GOAL_M * row[_TURN : _TURN + 2] if at_goal else points[LOOKAHEAD]
    steering = math.atan(2.0 * wheelbase_m * y / max(x * x + y * y, 0.04))
    # Near the goal, where it lies ahead; on the way, how far is granted.
    left_m = float(goal[0]) if at_goal else float(row[_AHEAD]) * NEAR_M
    is_served = row[_LOADS] > 0 or row[_UNLOADS] > 0
    stands = is_served or abs(left_m) < 0.01
    speed = 0.0 if stands else min(max(GAIN_PER_S * left_m, -BACK_MPS), CRUISE_MPS)
    return np.clip([steering / max_steering_rad, speed / max_speed_mps], -1.0, 1.0).astype(np.float32)


def _row(seen: Any) -> npt.NDArray[np.float32]:
    row: npt.NDArray[np.float32] = seen["row"] if isinstance(seen, Mapping) else seen
    return row
