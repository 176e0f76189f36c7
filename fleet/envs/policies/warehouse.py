"""Scripted policies of the continuous layer: cars that pursue their path, arms that play plans or follow their eyes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.warehouse.control.hands import N_TIP, TIP_MPS, TIP_RADPS
from fleet.envs.warehouse.control.plans import Plans, planner_of
from fleet.envs.warehouse.control.pursuit import Wheel, pursue
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.rows import AROUND_AT, N_JOINTS, REACH_M, Rows
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.stations.arms.arm_manager import ArmPlanner

_TIP, _ASKED, _HOLDS = 14, 29, 30  # entries of an arm's observation
_TRAVEL_M, _HOVER_M = 0.5, 0.12
"""Height of the tip on its way with a parcel, and above a parcel that it comes for [m]."""
_OVER_M, _TOUCH_M = 0.015, 0.008
"""So near to the axis of what it comes for the tip goes down, and so near to the place a parcel is let go [m]."""
_SET_M = 0.02
"""A parcel that lies so near to the height of its place has been set [m]."""
_REST_M = (0.40, 0.62)
"""Where the tip waits, behind the base: out and up [m]."""
_GAIN_PER_S = 4.0


class PursuitCars:
    """Every car pursues its observed way-points and stops at its path's end; arms do nothing.

    Residual cars add nothing to the classical controller, which does the same.

    Args:
        seed: Not used; every policy of the table takes one.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        cars = [agent for agent in observations if agent.startswith("car_")]
        actions = np.zeros((len(cars), 2))
        if cars and env.config.car_action == "drive":
            scene, model = env.simulation.scene, env.config.action_model
            wheel = Wheel(
                diagonal_m=math.hypot(*scene.size_m),
                wheelbase_m=scene.car.wheelbase_m,
                max_steering_rad=scene.car.max_steering_rad,
                max_speed_mps=model.speed_mps,
                dead_band=model.dead_band,
            )
            pursue(_rows(observations, cars), wheel, actions)
        return dict(zip(cars, actions.astype(np.float32), strict=True))


class PlannedArms:
    """Every arm plays the plan that the classical fleet makes for its transfer; cars do nothing.

    The environment's arms must take joint velocities, or add to the plan: they then add nothing. A policy is for one
    episode after the other, not for two environments at once.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        self._simulation: AgentSimulation | None = None
        self._planner: ArmPlanner | None = None
        self._planned_for: object = None

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        agents = [agent for agent in observations if agent.startswith("arm_")]
        if env.config.arm_action == "residual" or not agents:
            return {agent: np.zeros(N_JOINTS + 1, dtype=np.float32) for agent in agents}
        simulation = env.simulation
        if simulation is not self._simulation:
            self._begin(simulation)
        plans, step_s = self._plans, env.config.step_s
        before, held = plans.q.copy(), simulation.world.held()
        plans.ask(simulation)
        for _ in range(env.config.n_ticks):
            plans.tick(held)
        speeds = (plans.q - before) / step_s / simulation.scene.arms.max_velocity_radps
        grip = np.where(plans.grip, 1.0, -1.0)
        arms = [int(agent.rpartition("_")[2]) for agent in agents]
        return {
            agent: np.append(speeds[arm], grip[arm]).astype(np.float32) for agent, arm in zip(agents, arms, strict=True)
        }

    def _begin(self, simulation: AgentSimulation) -> None:
        if self._planner is None or self._planned_for is not simulation.site:
            self._planner, self._planned_for = planner_of(simulation), simulation.site
        self._simulation, self._plans = simulation, Plans(simulation, self._planner)


class PointingArms:
    """Every arm leads its tip over what it observes, down, and over to the place; cars do nothing.

    Up, around the base and down, as arms that pick and set do; nothing is planned. The environment's arms must take
    velocities of the tip.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        arms = [agent for agent in observations if agent.startswith("arm_")]
        actions = np.zeros((len(arms), N_TIP + 1))
        if arms:
            _point(_rows(observations, arms), actions)
        return dict(zip(arms, actions.astype(np.float32), strict=True))


class Classical:
    """The classical fleet's way, whatever actions are: cars pursue their paths, arms play plans.

    Arms that take velocities of the tip follow what they observe instead.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        self._cars, self._planned, self._pointing = PursuitCars(seed), PlannedArms(seed), PointingArms(seed)

    def act(self, env: WarehouseEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        arms = self._pointing if env.config.arm_action == "tip" else self._planned
        return self._cars.act(env, observations) | arms.act(env, observations)


def _rows(observations: Mapping[str, Any], agents: list[str]) -> npt.NDArray[np.float32]:
    """Rows of agents, shape (n, k)."""
    seen = [observations[agent] for agent in agents]
    return np.stack([one["row"] if isinstance(one, Mapping) else one for one in seen])


@njit(cache=True)
def _point(rows: Rows, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the actions of arms that go up, around and down."""
    for arm in range(len(rows)):
        row = rows[arm].astype(np.float64)
        x, y, z = row[_TIP] * REACH_M, row[_TIP + 1] * REACH_M, row[_TIP + 2] * REACH_M
        radius = math.hypot(x, y)
        grip = -1.0
        is_set = (
            math.hypot(row[AROUND_AT + 3], row[AROUND_AT + 4] * math.pi) < _OVER_M and abs(row[AROUND_AT + 5]) < _SET_M
        )
        if row[_ASKED] == 0.0 or (is_set and row[_HOLDS] == 0.0):
            away = _REST_M[0] - radius
            # By the way it came: joints 1 and 3 tell which.
            turn = -math.atan2(-y, -x)
            if abs(turn) > 0.5 * math.pi and turn * (row[0] + row[2]) > 0.0:
                turn += -2.0 * math.pi if turn > 0.0 else 2.0 * math.pi
            up = _REST_M[1] - z
        else:
            holds = row[_HOLDS] > 0.0
            at = AROUND_AT + 3 if holds else AROUND_AT
            away, turn, up = row[at], row[at + 1] * math.pi, row[at + 2]
            is_over = math.hypot(away, radius * turn) < _OVER_M
            grip = 1.0
            if not is_over:
                up = _TRAVEL_M - z if holds else up + _HOVER_M
                if (holds and up > 0.05) or (not holds and up > 0.05):
                    away, turn = 0.0, 0.0
            elif holds and up > -_TOUCH_M:
                grip = -1.0
        out[arm, 0] = min(max(_GAIN_PER_S * away / TIP_MPS, -1.0), 1.0)
        out[arm, 1] = min(max(_GAIN_PER_S * turn / TIP_RADPS, -1.0), 1.0)
        out[arm, 2] = min(max(_GAIN_PER_S * up / TIP_MPS, -1.0), 1.0)
        out[arm, 3] = 0.0
        out[arm, 4] = grip
