"""Commands: what the agents' actions of a step make their cars and arms do, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, FloatArray
from fleet.envs.warehouse.control.actions import LegalActions
from fleet.envs.warehouse.control.hands import N_TIP, hands_of, lead_tips, move_targets
from fleet.envs.warehouse.control.latch import Latches
from fleet.envs.warehouse.control.plans import Plans
from fleet.envs.warehouse.control.pursuit import Pursuit
from fleet.envs.warehouse.control.ramp import CarRamp
from fleet.envs.warehouse.rows import NEAR_M, Rows
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.simulation import Actions

_GRANTED, _LOADS, _UNLOADS = 15, 11, 13  # entries of a car's observation
RESIDUAL_RAD = 0.2
"""Joints are moved away from the classical plan by up to the residual's share of this [rad]."""
BEYOND_M, BRAKES_MPS2 = 0.03, 1.0
"""A car that is held to its grants is not faster than lets it brake, gently, so far behind their end [m], [m/s2]."""


@dataclass(frozen=True, kw_only=True)
class ActionModel:
    """What actions stand for."""

    car: str
    """A name in `CAR_ACTIONS`."""
    arm: str
    """A name in `ARM_ACTIONS`."""
    speed_mps: float
    """Of a car at full action [m/s]."""
    dead_band: float
    """Smaller shares of the full speed are brakes."""
    residual: float
    """Weight of what is added to the classical controllers."""
    pace: float
    """Weight of what is added to the pace of the classical plans."""
    hold_s: float
    """How long a grip has to be told to open [s]."""
    ramp: bool
    """Whether all cars approach told speeds within their limits of acceleration, or those that do not steer only."""
    grants_hold: bool
    """Whether cars brake where what they were granted ends, and stand while they are served."""


class Commands:
    """Plays the actions of agents.

    Args:
        simulation: The run, before its first tick.
        model: What actions stand for.
        plans: The classical plans, if arms add to them.
    """

    def __init__(self, simulation: AgentSimulation, model: ActionModel, plans: Plans | None) -> None:
        scene, n_arms = simulation.scene, simulation.n_arms
        self._simulation = simulation
        self._model = model
        self.plans = plans
        """The classical plans, if arms add to them."""
        self._team = scene.arms.part(range(n_arms))
        self._hands = hands_of(scene.arms, n_arms)
        self._targets = simulation.world.arm_positions()[:n_arms]
        self._cars = np.zeros((simulation.n_cars, 2))
        cars = scene.cars.some(np.arange(simulation.n_cars))
        self._pursuit = Pursuit(cars, scene.size_m, model.speed_mps, model.dead_band)
        speeds = np.minimum(model.speed_mps, cars.each("max_speed_mps"))
        self._car_limits = np.stack((cars.each("max_turn"), speeds), axis=1)
        self._steers = cars.each("turn_base_m") > 0.0
        self._ramp = CarRamp(cars, simulation.tick_s, of_all=model.ramp)
        self._arms = np.zeros((n_arms, 0))
        self.latches = Latches(n_arms, model.hold_s)
        """The grips of the agents' arms."""

    @property
    def targets(self) -> FloatArray:
        """Set-points of the agents' arms' joints [rad], shape (n_arms, n_joints)."""
        return self._targets

    def take(self, actions: LegalActions, car_rows: Rows, in_order: npt.NDArray[np.bool_]) -> None:
        """Take in the actions of a step.

        Args:
            actions: Of all agents.
            car_rows: What cars observed, shape (n_cars, >= N_CAR_NUMBERS).
            in_order: False for a car that does not do what it is told, and brakes, shape (n_cars,).
        """
        model = self._model
        shares = actions.cars
        if model.car == "residual":
            shares = self._pursuit.actions(car_rows, np.arange(len(car_rows)))
            shares += model.residual * actions.cars
        _drive(shares, self._car_limits, self._steers, model.dead_band, in_order, self._cars)
        if model.grants_hold:
            left_m = car_rows[:, _GRANTED].astype(np.float64) * NEAR_M
            on_mps = np.sqrt(2.0 * BRAKES_MPS2 * np.maximum(0.0, left_m + BEYOND_M))
            self._cars[:, 1] = np.minimum(self._cars[:, 1], on_mps)
            # Who is served was granted nothing: it need not drive to the end of its grant below the arm.
            self._cars[(car_rows[:, _LOADS] > 0.0) | (car_rows[:, _UNLOADS] > 0.0)] = 0.0
        self._arms = actions.arms
        if self.plans is not None:
            for arm, pace in enumerate(actions.arms[:, -1].tolist()):
                self.plans.pace(arm, 1.0 + model.pace * pace)

    def tick(self) -> Actions:
        """What the robots are to do in the coming tick."""
        simulation = self._simulation
        world, team, n_arms = simulation.world, self._team, len(self._targets)
        cars = self._ramp.tick(self._cars, world)
        if not n_arms:
            return Actions(cars=cars)
        if self.plans is not None:
            self.plans.ask(simulation)
            self.plans.tick(world.held())
            away = self._model.residual * RESIDUAL_RAD * self._arms[:, : team.width]
            self._targets = np.clip(self.plans.q[:n_arms] + away, team.lower_rad, team.upper_rad)
            qd, grip = self.plans.qd[:n_arms].copy(), self.plans.grip[:n_arms].copy()
            return Actions(cars=cars, arms=self._targets, arms_qd=qd, grip=grip)
        q = world.arm_positions()[:n_arms]
        if self._model.arm == "joint":
            qd = self._arms[:, : team.width] * team.max_velocity_radps
        else:
            qd = np.zeros_like(q)
            for hands in self._hands:
                own = np.ascontiguousarray(q[hands.arms, : hands.spec.n_joints])
                moved = np.empty_like(own)
                lead_tips(hands.model, own, np.ascontiguousarray(self._arms[hands.arms, :N_TIP]), moved)
                qd[hands.arms, : hands.spec.n_joints] = moved
        limits = team.lower_rad, team.upper_rad, team.max_velocity_radps
        move_targets(self._targets, qd, q, *limits, simulation.tick_s)
        self.latches.tick(self._arms[:, -1], world.held()[:n_arms], simulation.tick_s)
        return Actions(cars=cars, arms=self._targets, arms_qd=qd, grip=self.latches.closed)


@njit(cache=True)
def _drive(
    shares: FloatArray,
    limits: FloatArray,
    steers: BoolArray,
    dead_band: float,
    in_order: npt.NDArray[np.bool_],
    out: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fill in steering [rad] or yaw rate [rad/s], and speed [m/s], of cars; those in the dead band, and those that are
    out, brake. Who turns on the spot is in it when both numbers are."""
    for car in range(len(out)):
        share = min(max(shares[car, 1], -1.0), 1.0)
        turn = min(max(shares[car, 0], -1.0), 1.0)
        goes = abs(share) >= dead_band and in_order[car]
        out[car, 1] = share * limits[car, 1] if goes else 0.0
        stands = not goes and not steers[car] and (abs(turn) < dead_band or not in_order[car])
        out[car, 0] = 0.0 if stands else turn * limits[car, 0]
