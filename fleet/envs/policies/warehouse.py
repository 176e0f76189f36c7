"""Scripted policies of the continuous layer: cars that pursue their path, arms that play plans or follow their eyes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.warehouse.control.hands import (
    N_TIP,
    TIP_MPS,
    TIP_RADPS,
    hand_model,
    is_ahead,
    turning_joints,
)
from fleet.envs.warehouse.control.plans import Plans, planner_of
from fleet.envs.warehouse.control.pursuit import Pursuit
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.rows import AROUND_AT, REACH_M, Rows, around
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.robots.arms.spec import ArmSpec
from fleet.stations.arms.arm_manager import ArmPlanner
from planners.motion.arm.kinematics import link_frames

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
            pursuit = Pursuit(scene.cars, scene.size_m, model.speed_mps, model.dead_band)
            actions = pursuit.actions(_rows(observations, cars), np.array(_numbers(cars)))
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
        n_joints = dict(zip(env.config.arm_names, (kind.n_joints for kind in env.config.arm_kinds), strict=True))
        if env.config.arm_action == "residual" or not agents:
            return {agent: np.zeros(n_joints[agent] + 1, dtype=np.float32) for agent in agents}
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
        return {
            agent: np.append(speeds[arm, : n_joints[agent]], grip[arm]).astype(np.float32)
            for agent, arm in zip(agents, _numbers(agents), strict=True)
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
        arms = [agent for agent in observations if agent.startswith("arm_")]
        actions = np.zeros((len(arms), N_TIP + 1))
        if arms:
            specs = env.simulation.scene.arms.specs
            _point(_rows(observations, arms), np.array([_ways_of(specs[arm]) for arm in _numbers(arms)]), actions)
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


def _numbers(agents: list[str]) -> list[int]:
    """Numbers of the agents' robots."""
    return [int(agent.rpartition("_")[2]) for agent in agents]


def _ways_of(spec: ArmSpec) -> list[float]:
    """How an arm gets about: what the first and the third joint, as they are observed, and 1 are multiplied by, so that
    their sum says to which side it has turned; whether it goes around ahead of its base; and how high its tip is on
    its way with a parcel and at rest, no higher than its model has it at rest [m]."""
    turning, hand = turning_joints(spec), hand_model(spec)
    first, third = (turning * hand.half / hand.half[0])[[0, 2]].tolist()
    to_side = float(turning @ hand.middle) / float(hand.half[0])
    flange = link_frames(spec.base_from_joint, spec.home_rad)[-1]
    high_m = round(float(flange[2, 3] + spec.tool_length_m * flange[2, 2]), 2)
    return [first, third, to_side, float(is_ahead(spec)), min(_TRAVEL_M, high_m), min(_REST_M[1], high_m)]


def _rows(observations: Mapping[str, Any], agents: list[str]) -> npt.NDArray[np.float32]:
    """Rows of agents, shape (n, k)."""
    seen = [observations[agent] for agent in agents]
    return np.stack([one["row"] if isinstance(one, Mapping) else one for one in seen])


@njit(cache=True)
def _point(rows: Rows, ways: FloatArray, out: FloatArray) -> None:  # pragma: no cover - compiled
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
            # By the way it came: the joints that turn it about its base tell which.
            turned = ways[arm, 0] * row[0] + ways[arm, 1] * row[2] + ways[arm, 2]
            if ways[arm, 3] > 0.0:
                turn = math.copysign(math.pi, turned) - around(x, y, turned, True)
            else:
                turn = -math.atan2(-y, -x)
                if abs(turn) > 0.5 * math.pi and turn * turned > 0.0:
                    turn += -2.0 * math.pi if turn > 0.0 else 2.0 * math.pi
            up = ways[arm, 5] - z
        else:
            holds = row[_HOLDS] > 0.0
            at = AROUND_AT + 3 if holds else AROUND_AT
            away, turn, up = row[at], row[at + 1] * math.pi, row[at + 2]
            is_over = math.hypot(away, radius * turn) < _OVER_M
            grip = 1.0
            if not is_over:
                up = ways[arm, 4] - z if holds else up + _HOVER_M
                if up > 0.05:
                    away, turn = 0.0, 0.0
            elif holds and up > -_TOUCH_M:
                grip = -1.0
        out[arm, 0] = min(max(_GAIN_PER_S * away / TIP_MPS, -1.0), 1.0)
        out[arm, 1] = min(max(_GAIN_PER_S * turn / TIP_RADPS, -1.0), 1.0)
        out[arm, 2] = min(max(_GAIN_PER_S * up / TIP_MPS, -1.0), 1.0)
        out[arm, 3] = 0.0
        out[arm, 4] = grip
