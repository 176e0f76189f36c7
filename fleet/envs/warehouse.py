"""Warehouse: a PettingZoo environment in which agents drive the cars and move the arms of a running warehouse.

Orders, allocation, right of way and the judgement of transfers are those of any run (`fleet.simulation`); the agents'
actions take the place of the path follower and of the arm planner. An episode begins with all cars parked and
`tasks` deliveries on order. It terminates for all agents when every task is delivered or has failed, and is
truncated for all after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... and `arm_0`, `arm_1`, ... (one arm per station of the site, pick stations first).

Actions, all in [-1, 1] (greater ones are clipped, nan counts as 0, a missing agent does nothing):

| agent | entries |
|---|---|
| car | steering / 0.8 rad (positive = left), speed / 2 m/s (negative = reverse) |
| arm | 7 joint velocities / the joints' limits, grip (> 0 = hold) |

A car does what its task asks for when it follows the granted path, which the observed way-points show, and stands at
its end: within 5 cm and 0.1 rad of the dock's stop pose a transfer begins. A car that leaves its path makes no progress
until it returns. An arm's transfer ends when it has let go of the parcel; one that lies neither in the tray or on the
slot it was meant for nor where it came from is lost, and its task has failed.

Observations, all clipped to [-1, 1]. A car's frame lies at its rear axle, x ahead, y to the left; an arm's is its base,
x towards the dock:

| car | entries |
|---|---|
| 0-1 | estimated position on the floor, -1 = west or south edge, 1 = east or north edge |
| 2-3 | cos, sin of the yaw |
| 4-5 | speed / 2 m/s, steering / 0.8 rad |
| 6-7 | offset to the goal in the car's frame / the floor's diagonal |
| 8-9 | cos, sin of the goal's heading in the car's frame |
| 10-13 | mission: drives to a pick dock, is loaded, drives to a drop dock, is unloaded (0 or 1; none: parks or waits) |
| 14 | carries a parcel (0 or 1) |
| 15 | length of the granted path ahead / 3 m |
| 16-23 | points of that path 0.4, 0.8, 1.2 and 2.0 m ahead, at most its end, in the car's frame / 3 m |
| 24-28 | the nearest other car within 3 m: there is one (0 or 1), offset / 3 m, cos, sin of its heading |

| arm | entries |
|---|---|
| 0-6 | joint positions, -1 = lower limit, 1 = upper limit |
| 7-13 | joint velocities / limits |
| 14-16 | tool tip in the arm's frame / 1.5 m |
| 17-19 | direction in which the tool points, in the arm's frame |
| 20-22 | from the tip to the middle of the parcel's top / 1.5 m |
| 23-25 | from the parcel to the place it should have / 1.5 m; zero without a transfer |
| 26-28 | the parcel's edges / 0.1 m |
| 29 | transfer asked for: 1 = slot to tray, -1 = tray to slot, 0 = none |
| 30-31 | something is in the grip, a parcel is in view (0 or 1) |

An arm's parcel is that of its transfer, else the one in its grip, else the nearest within 1.5 m.

Rewards: the sum of the terms in `RewardWeights`; `infos[agent]` holds each weighted term. `state()` is all cars'
and all arms' observations, one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.utils import EzPickle
from pettingzoo.utils import ParallelEnv, parallel_to_aec
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from fleet.config import ArmConfig, Fidelity, RunConfig, require
from fleet.envs.agent_simulation import AgentSimulation
from fleet.envs.drawing import Drawing, Picture
from fleet.envs.observations import CAR_N, Observer, arm_n
from fleet.envs.rewards import TERMS, Rewards, RewardWeights
from fleet.envs.window import Window
from fleet.errors import FleetError
from fleet.robots.iiwa import N_JOINTS
from fleet.simulation import Actions
from fleet.tasks.board import DONE_STATES, TaskState
from maps.site import load_site

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.PHYSICS)
CONTROL = ("all", "cars", "arms")
RENDER_MODES = ("human", "rgb_array")
WIND_UP_RAD = 0.1
"""A joint's target runs at most this far ahead of the joint, so that a blocked arm does not wind up [rad]."""

Observation = npt.NDArray[np.float32]
Infos = dict[str, dict[str, float]]


class EpisodeError(FleetError):
    """The environment was asked for something that its episode does not allow now."""


class WarehouseEnv(ParallelEnv[str, Observation, npt.NDArray[np.float32]], EzPickle):
    """A warehouse whose cars and arms are agents; see the module's description.

    It is pickled and copied by its constructor's arguments: a copy begins before its first episode.

    Args:
        site: Name of a shipped site or path of a site file.
        n_cars: Number of cars.
        tasks: Deliveries on order in an episode; None = one per car.
        fidelity: `kinematic` or `physics`.
        control: Who are agents: `all` robots, the `cars` or the `arms`; the others run as in any run.
        control_hz: Steps per simulated second; the world's tick rate (kinematic 20, physics 60) is a multiple.
        max_cycles: Steps after which an episode is truncated.
        seed: Decides the episodes until `reset` is given a seed.
        weights: What things are worth.
        render_mode: `rgb_array`, `human` (a window, if there is a display) or None.

    Raises:
        ConfigError: An argument is outside its valid range.
        SiteError: The site cannot be read.
    """

    def __init__(
        self,
        site: str = "cell",
        n_cars: int = 1,
        tasks: int | None = None,
        fidelity: str = "kinematic",
        control: str = "all",
        control_hz: float = 10.0,
        max_cycles: int = 600,
        seed: int = 0,
        weights: RewardWeights | None = None,
        render_mode: str | None = None,
    ) -> None:
        EzPickle.__init__(
            self, site, n_cars, tasks, fidelity, control, control_hz, max_cycles, seed, weights, render_mode
        )
        place = load_site(site)
        require(1 <= n_cars <= len(place.parking), "n_cars", n_cars, f"1 to {len(place.parking)} on site {place.name}")
        require(fidelity in FIDELITIES, "fidelity", fidelity, ", ".join(FIDELITIES))
        require(control in CONTROL, "control", control, ", ".join(CONTROL))
        require(math.isfinite(control_hz) and control_hz > 0, "control_hz", control_hz, "a number > 0")
        require(max_cycles >= 1, "max_cycles", max_cycles, "an integer >= 1")
        require(seed >= 0, "seed", seed, "an integer >= 0")
        require(render_mode in (None, *RENDER_MODES), "render_mode", render_mode, f"None, {', '.join(RENDER_MODES)}")
        self.metadata: dict[str, Any] = {
            "name": "warehouse_v0",
            "render_modes": list(RENDER_MODES),
            "render_fps": control_hz,
            "is_parallelizable": True,
        }
        self.max_cycles = max_cycles
        self.render_mode = render_mode
        self.simulation: AgentSimulation | None = None
        """The episode's run; None before the first `reset`."""
        self._config = RunConfig(
            site=site,
            robots=n_cars,
            tasks=n_cars if tasks is None else tasks,
            fidelity=Fidelity(fidelity),
            arms=ArmConfig(workers_n=0),
        )
        self._control_hz = control_hz
        self._weights = weights or RewardWeights()
        self._episodes = np.random.default_rng(seed)
        self._window: Window | None = None
        cars = [f"car_{car}" for car in range(n_cars)] if control != "arms" else []
        arms = [f"arm_{arm}" for arm in range(len(place.stations))] if control != "cars" else []
        self._cars, self._arms = bool(cars), bool(arms)
        self.possible_agents = cars + arms
        self.agents: list[str] = []
        self._observation_spaces = {car: _box(CAR_N) for car in cars} | {arm: _box(arm_n(N_JOINTS)) for arm in arms}
        self._action_spaces = {car: _box(2) for car in cars} | {arm: _box(N_JOINTS + 1) for arm in arms}
        self.state_space = _box(n_cars * CAR_N + len(place.stations) * arm_n(N_JOINTS))

    def observation_space(self, agent: str) -> Box:
        """Space of an agent's observations; the same object every time."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Space of an agent's actions; the same object every time."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], Infos]:
        """Begin an episode.

        Args:
            seed: Decides this episode and those that follow without a seed; None = go on in the present series.
            options: Not used.

        Returns:
            Observations and infos of all agents.

        Raises:
            ConfigError: `control_hz` does not divide the world's tick rate.
        """
        del options
        if seed is not None:
            self._episodes = np.random.default_rng(seed)
        self._end()
        config = replace(self._config, seed=int(self._episodes.integers(2**31)))
        simulation = AgentSimulation(config, cars=self._cars, arms=self._arms)
        self.simulation = simulation
        ticks = 1.0 / (self._control_hz * simulation.tick_s)
        self._ticks_n = round(ticks)
        fits = self._ticks_n >= 1 and math.isclose(ticks, self._ticks_n, rel_tol=1e-6)
        require(fits, "control_hz", self._control_hz, f"{1.0 / simulation.tick_s:.6g} / 1, 2, 3, ...")
        self._steps_n = 0
        self._targets = simulation.world.arm_positions()
        self._observer = Observer(simulation)
        self._rewards = Rewards(simulation, self._observer, self._weights)
        self._drawing: Drawing | None = None
        self.agents = self.possible_agents[:]
        self._look()
        return self._observations(), {agent: dict.fromkeys(TERMS, 0.0) for agent in self.agents}

    def step(
        self, actions: Mapping[str, npt.ArrayLike | None]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Let every agent act for one control period.

        Args:
            actions: By agent.

        Returns:
            Observations, rewards, terminations, truncations and infos of all agents.

        Raises:
            EpisodeError: No episode is under way.
        """
        simulation = self.simulation
        if simulation is None or not self.agents:
            raise EpisodeError("step: no episode is under way; valid: reset() first")
        cars = self._decided(actions, "car", simulation.world.n_cars, 2)
        arms = self._decided(actions, "arm", simulation.world.n_arms, N_JOINTS + 1)
        for _ in range(self._ticks_n):
            simulation.tick(self._commands(simulation, cars, arms))
        self._steps_n += 1
        self._look()
        car_terms, arm_terms = self._rewards.step()
        infos = {
            agent: dict((car_terms if agent.startswith("car") else arm_terms)[_number(agent)]) for agent in self.agents
        }
        rewards = {agent: float(sum(terms.values())) for agent, terms in infos.items()}
        done = all(task.state in _ENDED for task in simulation.board.tasks)
        out_of_time = not done and self._steps_n >= self.max_cycles
        observations = self._observations()
        terminations, truncations = dict.fromkeys(self.agents, done), dict.fromkeys(self.agents, out_of_time)
        if done or out_of_time:
            self.agents = []
        if self.render_mode == "human":
            self.render()
        return observations, rewards, terminations, truncations, infos

    def state(self) -> Observation:
        """All that any robot observes, cars first; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self.simulation is None:
            raise EpisodeError("state: there was no episode yet; valid: reset() first")
        return np.concatenate((self._car_rows.ravel(), self._arm_rows.ravel()))

    def render(self) -> Picture | None:
        """Draw the run from above: an array (height, width, 3) in mode `rgb_array`, else None."""
        if self.simulation is None or self.render_mode is None:
            return None
        self._drawing = self._drawing or Drawing(self.simulation)
        picture = self._drawing.picture()
        if self.render_mode == "rgb_array":
            return picture
        self._window = self._window or Window("fleet")
        self._window.show(picture)
        return None

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._end()
        if self._window is not None:
            self._window.close()
            self._window = None

    def _end(self) -> None:
        self.agents = []
        if self.simulation is not None:
            self.simulation.close()
            self.simulation = None

    def _look(self) -> None:
        self._car_rows, self._arm_rows = self._observer.cars(), self._observer.arms()

    def _observations(self) -> dict[str, Observation]:
        return {
            agent: (self._car_rows if agent.startswith("car") else self._arm_rows)[_number(agent)].copy()
            for agent in self.agents
        }

    def _decided(
        self, actions: Mapping[str, npt.ArrayLike | None], kind: str, n_robots: int, n_entries: int
    ) -> npt.NDArray[np.float64]:
        """Actions of all robots of a kind, made legal, shape (n_robots, n_entries)."""
        rows = np.zeros((n_robots, n_entries))
        for robot in range(n_robots):
            action = actions.get(f"{kind}_{robot}")
            if action is not None:
                rows[robot] = np.asarray(action, dtype=np.float64).reshape(n_entries)
        return np.clip(np.nan_to_num(rows, nan=0.0), -1.0, 1.0)

    def _commands(
        self, simulation: AgentSimulation, cars: npt.NDArray[np.float64], arms: npt.NDArray[np.float64]
    ) -> Actions:
        """The actions of one tick; joint velocities become targets that move on."""
        car, arm = simulation.scene.car, simulation.scene.arm
        qd = arms[:, :N_JOINTS] * arm.max_velocity_radps
        q = simulation.world.arm_positions()
        targets = np.clip(self._targets + qd * simulation.tick_s, q - WIND_UP_RAD, q + WIND_UP_RAD)
        self._targets = np.clip(targets, arm.lower_rad, arm.upper_rad)
        qd[self._targets != targets] = 0.0
        return Actions(
            cars=cars * (car.max_steering_rad, car.max_speed_mps) if self._cars else None,
            arms=self._targets if self._arms else None,
            arms_qd=qd if self._arms else None,
            grip=arms[:, -1] > 0.0 if self._arms else None,
        )


_ENDED = (*DONE_STATES, TaskState.FAILED, TaskState.CANCELLED)


parallel_env = WarehouseEnv
"""The name that PettingZoo's modules have for it."""


def raw_env(**arguments: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the arguments are those of `WarehouseEnv`."""
    return parallel_to_aec(WarehouseEnv(**arguments))


def env(**arguments: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return OrderEnforcingWrapper(raw_env(**arguments))


def _box(n: int) -> Box:
    return Box(-1.0, 1.0, (n,), np.float32)


def _number(agent: str) -> int:
    return int(agent.rpartition("_")[2])
