"""Docking by a policy: a policy of the warehouse layer drives cars on the last metre to their stops at stations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from fleet.arrays import CellArray, FloatArray
from fleet.config import EstimateConfig, RunConfig
from fleet.envs.core.base import Infos
from fleet.envs.warehouse.config import WarehouseConfig
from fleet.envs.warehouse.control.actions import N_CAR_ENTRIES
from fleet.envs.warehouse.control.commands import BEYOND_M, BRAKES_MPS2, Commands
from fleet.envs.warehouse.env import WarehouseEnv, WarehouseEpisode
from fleet.envs.warehouse.observations import Observer, Told, rings_of
from fleet.envs.warehouse.rewards import Rewards, RewardWeights
from fleet.envs.warehouse.rows import NEIGHBOURS_AT, REACH_M, STATION_AT, Rows
from fleet.envs.warehouse.run.agent_driver import STOP_M, STOP_RAD, AgentCars, AgentDriver
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.envs.warehouse.run.breakdowns import BreakdownClock, Breakdowns
from fleet.envs.warehouse.sensing import Receiver
from fleet.missions.phases import CarPhase
from fleet.play.policies import PlayedPolicy
from fleet.robots.cars.models import CarModels
from fleet.robots.speed_ramp import SpeedRamp
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.traffic.drivers import AT_REST_MPS
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph
from planners.mapf.problem import NO_GOAL

FROM_M = 1.0
"""The policy drives from here to the stop: as much of the way is left [m]."""
ASIDE_M, ASIDE_PER_M = STOP_M, 0.08
TURNED_RAD, TURNED_RAD_PER_M = STOP_RAD, 0.3
"""A car that is further from its path at the stop, and per metre before it, or is turned more, is given back to the
path follower: the nearer the stop, the less is left to straighten it."""
BACK_M = 0.1
"""Whatever a policy says, a car is not faster than lets it brake, gently, so far back from the furthest that it has
come, or `BEYOND_M` behind its stop [m]: further on it was granted nothing, further back others may have been."""
PATIENCE_S = 10.0
"""A car is given back, too, if it does not stand at its stop after so long [s]."""


class DockingDriver(AgentDriver):
    """Drives all cars along what they were granted, but for those that a policy docks.

    Paths, progress and what is released are found out from where the cars are, whoever drives them. A car that stands
    near enough to its stop stays so until it is granted a move.

    Args:
        graph: Lane graph whose moves are driven.
        models: Models of the cars.
        start_states: State of each car, shape (n_cars,).
        tick_s: Control period [s].
        config: Quality of the pose estimate.
        rng: Source of measurement noise.
    """

    def __init__(
        self,
        graph: LaneGraph,
        models: CarModels,
        start_states: npt.NDArray[np.int32],
        tick_s: float,
        config: EstimateConfig,
        rng: np.random.Generator,
    ) -> None:
        n_cars = len(start_states)
        nobody = AgentCars(by_agent=np.zeros(n_cars, dtype=np.bool_), poses=graph.state_pose[start_states])
        super().__init__(graph, models, start_states, tick_s, config, rng, agents=nobody)
        self.docking = np.zeros(n_cars, dtype=np.bool_)
        """Cars that a policy docks, shape (n_cars,)."""
        self.docked = np.zeros(n_cars, dtype=np.bool_)
        """Cars that a policy has brought to their stop, shape (n_cars,)."""
        self.given_back = np.zeros(n_cars, dtype=np.bool_)
        """Cars that a policy has not brought to their stop, shape (n_cars,)."""
        self._ramp = SpeedRamp(models, tick_s)
        self.wanted = np.zeros((n_cars, 2))
        """Steering [rad] and speed [m/s] that the policy wants, shape (n_cars, 2)."""

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """See `Driver`."""
        super().append(cars, moves)
        self.docked[cars] = self.given_back[cars] = False
        for car, move in zip(cars.tolist(), moves.tolist(), strict=True):
            self._moves[car].append(move)
            self.stale.add(car)

    def restart(self, car: int, pose: FloatArray | None = None) -> None:
        """See `PathDriver`."""
        super().restart(car, pose)
        self._moves[car].clear()
        self.docking[car] = self.docked[car] = self.given_back[car] = False
        self.stale.add(car)

    def commands(self, world: World) -> FloatArray:
        """See `Driver`; the policy's speed ends at the stop, and changes as cars' limits let it."""
        commands = super().commands(world)
        for car in np.flatnonzero(self.docking).tolist():
            left_m, back_m = self.left_m(car), self.back_m(car)
            on_mps = math.sqrt(2.0 * BRAKES_MPS2 * max(0.0, left_m + BEYOND_M))
            back_mps = math.sqrt(2.0 * BRAKES_MPS2 * max(0.0, BACK_M - back_m))
            commands[car] = self.wanted[car, 0], min(max(self.wanted[car, 1], -back_mps), on_mps)
        eased = self._ramp.tick(commands[:, 1], self._speeds)
        commands[self.docking, 1] = eased[self.docking]
        commands[self.docked] = 0.0
        return commands

    def finished(self) -> CellArray:
        """See `Driver`."""
        done = super().finished()
        for car in done.tolist():
            if self._moves[car]:
                self._reached[car] = int(self._graph.move_to[self._moves[car].popleft()])
                self.stale.add(car)
        return done

    def at_rest(self, car: int) -> bool:
        """See `Driver`."""
        if self.docked[car]:
            return bool(abs(self._speeds[car]) < AT_REST_MPS)
        return not self.docking[car] and super().at_rest(car)

    def off_lane(self) -> list[int]:
        """See `PathDriver`; a car that was given back too late to come straight to its stop has to try again."""
        askew = [
            car
            for car in np.flatnonzero(self.given_back).tolist()
            if not self._moves[car] and self.at_rest(car) and not self.stands(car)
        ]
        return sorted({*super().off_lane(), *askew}) if askew else super().off_lane()

    def left_m(self, car: int) -> float:
        """Way to the end of what a car was granted [m]; negative beyond it."""
        return float(self._stop_s[car] - self.follower.progress[car]) + self.back_m(car)

    def back_m(self, car: int) -> float:
        """How far a car is behind the furthest that it has come along its path [m]; negative beyond the path's end."""
        n, progress = int(self.buffer.count[car]), self.follower.progress[car]
        k = min(int(self.buffer.s[car, :n].searchsorted(progress)), n - 1)
        x, y, yaw = self.buffer.points[car, k].tolist()
        at_x, at_y, _ = self.estimate[car].tolist()
        ahead_m = math.cos(yaw) * (x - at_x) + math.sin(yaw) * (y - at_y)
        return float(ahead_m - (self.buffer.s[car, k] - progress))

    def is_aside(self, car: int) -> bool:
        """Whether a car has left the path that a policy is to dock it along."""
        aside, turned = abs(self.follower.cross_track[car]), abs(self.follower.heading_error[car])
        left_m = max(0.0, self.left_m(car))
        return bool(aside > ASIDE_M + ASIDE_PER_M * left_m or turned > TURNED_RAD + TURNED_RAD_PER_M * left_m)


def docking_driver(setup: RunSetup, world: World, config: RunConfig, rng: np.random.Generator) -> DockingDriver:
    """Makes the driver of a run some of whose cars a policy docks."""
    return DockingDriver(setup.graph, setup.scene.cars, setup.start_states, world.tick_s, config.estimate, rng)


class _Env(WarehouseEnv):
    """A warehouse environment whose one episode is a run that is under way.

    Args:
        config: How cars see and act.
        simulation: The run.
        alone: Whether a car sees nobody else, and an arm that is at home, as in the level `dock`.
    """

    def __init__(self, config: WarehouseConfig, simulation: AgentSimulation, *, alone: bool) -> None:
        super().__init__(config)
        self._run = simulation
        self._alone = alone
        self._told = np.zeros((simulation.n_cars, N_CAR_ENTRIES))

    def look(self) -> dict[str, Any]:
        """What the cars see now."""
        episode = self._now()
        self._look(episode.observer)
        of_cars, of_arms = episode.receivers
        episode.seen = of_cars.receive(episode.observer.car_rows), of_arms.receive(episode.observer.arm_rows)
        return self._observations()

    def commands(self, actions: Mapping[str, Any]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Steering [rad] and speed [m/s] that actions mean, shape (n_cars, 2), and which were illegal, (n_cars,)."""
        episode, resolved = self._now(), self._resolved(actions)
        episode.commands.take(resolved, episode.observer.car_rows, episode.breakdowns.in_order)
        self._told = resolved.cars
        cars = episode.commands.tick().cars
        return np.zeros_like(self._told) if cars is None else cars, resolved.illegal_cars

    def _begin(self, seed: int) -> Infos:
        simulation, config = self._run, self.config
        noise, sights, views, fates = (np.random.default_rng([seed, k]) for k in range(4))
        of_cars, of_arms = config.sensing
        # Policies that dock know one model of cars.
        rings = rings_of(config.car_lidar, CarModels.alike(simulation.scene.car, simulation.n_cars))
        observer = Observer(simulation, rings, noise, (of_cars.range_m, REACH_M), config.step_s)
        self._look(observer)
        receivers = Receiver(of_cars, sights), Receiver(of_arms, views)
        self._episode = WarehouseEpisode(
            simulation=simulation,
            errands=(),
            commands=Commands(simulation, config.action_model, None),
            breakdowns=BreakdownClock(Breakdowns(), simulation.n_cars, fates),
            observer=observer,
            rewards=Rewards(simulation, observer, RewardWeights(), config.team_share, config.step_s),
            receivers=receivers,
            seen=(receivers[0].receive(observer.car_rows), receivers[1].receive(observer.arm_rows)),
        )
        return {agent: {} for agent in self._team()}

    def _look(self, observer: Observer) -> None:
        """Look at the run; an approach is never late."""
        nobody = np.zeros((0, 0))
        in_order = np.ones(len(self._told), dtype=np.bool_)
        told = Told(self._told, nobody, in_order, np.zeros(0, dtype=np.bool_), np.zeros(0), time_left=1.0)
        observer.look(told)
        if self._alone:
            self._leave_out_others(observer.car_rows)

    @staticmethod
    def _leave_out_others(rows: Rows) -> None:
        """What was learned alone knows nothing of others, and need not: a car that is docked was granted its way."""
        rows[:, NEIGHBOURS_AT:STATION_AT] = 0.0
        rows[:, STATION_AT + 1] = 1.0
        rows[:, STATION_AT + 3] = 0.0


class DockingPlayer:
    """Plays the last metre of cars that come to their stations.

    A decision is an approach to a stop. It is the policy's if it brings the car to its stop; the path follower goes on
    if the car leaves its path or does not come to stand in `PATIENCE_S`.

    Args:
        simulation: The run, before its first tick; its driver is a `DockingDriver`.
        played: Decides.

    Raises:
        ConfigError: It knows the fleet by a setting that there is not.
        TrainingError: It has learned to see or do something else.
    """

    def __init__(self, simulation: Simulation, played: PlayedPolicy) -> None:
        self._simulation = simulation
        self._driver = cast(DockingDriver, simulation.driver)
        self._policy = played.policy
        self._decisions = played.decisions
        config = docking_config(simulation, played.settings)
        alone = played.learned is not None and played.learned.arguments.get("level") == "dock"
        self._env = _Env(config, cast(AgentSimulation, simulation), alone=alone)
        played.require_fits(self._env)
        self._env.reset(seed=simulation.config.seed)
        self._period = max(1, round(config.step_s / simulation.tick_s))
        self._begun_s = np.zeros(len(config.car_names))
        self._given_back_at = np.full(len(config.car_names), NO_GOAL, dtype=np.int64)
        """State that each car was bound for when it was given back: the path follower brings it there. The driver
        forgets that a car was given back when it is brought back to its lane; here it still counts."""

    def tick(self) -> None:
        """Take cars over, give them back, and decide for them, if it is time to."""
        driver, now_s = self._driver, self._simulation.sim_s
        for car in np.flatnonzero(driver.docking).tolist():
            self._end(car, now_s)
        if (self._simulation.now - 1) % self._period:
            return
        goals = self._simulation.traffic.goals
        self._given_back_at[self._given_back_at != goals] = NO_GOAL
        mine = self._comes() & ~driver.docking & ~driver.docked & (self._given_back_at == NO_GOAL)
        for car in np.flatnonzero(mine).tolist():
            if STOP_M < driver.left_m(car) <= FROM_M and not driver.is_aside(car):
                driver.docking[car] = True
                self._begun_s[car] = now_s
        if not driver.docking.any():
            return
        seen = self._env.look()
        agents = {f"car_{car}": seen[f"car_{car}"] for car in np.flatnonzero(driver.docking).tolist()}
        wanted, illegal = self._env.commands(self._policy.act(self._env, agents))
        driver.wanted[driver.docking] = wanted[driver.docking]
        for car in np.flatnonzero(illegal & driver.docking).tolist():
            self._give_back(car, "illegal")

    def _comes(self) -> npt.NDArray[np.bool_]:
        """Cars that were granted all of their way to their station, shape (n_cars,)."""
        simulation = self._simulation
        missions, executor = simulation.missions, simulation.executor
        comes = np.zeros(missions.n_cars, dtype=np.bool_)
        docks = missions.stations.dock_states
        for car in missions.cars_in(CarPhase.TO_PICK, CarPhase.TO_DROP):
            goal = simulation.traffic.goals[car]
            comes[car] = goal in docks and executor.granted_states()[car] == goal
        return comes

    def _end(self, car: int, now_s: float) -> None:
        """End the approach of a car that stands, or that its policy does not bring to its stop."""
        driver = self._driver
        if driver.stands(car):
            driver.docking[car], driver.docked[car] = False, True
            self._decisions.decide(1, 1)
        elif driver.is_aside(car):
            self._give_back(car, "left its lane")
        elif now_s - self._begun_s[car] > PATIENCE_S:
            self._give_back(car, "did not come to stand")

    def _give_back(self, car: int, reason: str) -> None:
        self._driver.docking[car] = False
        self._driver.given_back[car] = True
        self._given_back_at[car] = self._simulation.traffic.goals[car]
        self._decisions.fall_back(reason)
        self._simulation.log("policy_replaced", layer="docking", car=f"car_{car}", cause=reason)


def docking_config(simulation: Simulation, settings: Mapping[str, Any]) -> WarehouseConfig:
    """Settings under which a policy of the warehouse layer sees a run.

    Raises:
        ConfigError: A setting is unknown, or outside its valid range.
    """
    config = simulation.config
    of_run = {"site": config.site, "n_cars": config.robots, "n_arms": 0, "fidelity": str(config.fidelity)}
    return WarehouseConfig.of({**settings, **of_run})
