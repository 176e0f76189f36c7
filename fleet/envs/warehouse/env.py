"""Warehouse: a PettingZoo environment in which agents drive the cars and move the arms of a running warehouse.

Orders, allocation, right of way and the judgement of transfers are those of any run (`fleet.simulation`); the agents'
actions take the place of the path follower and of the arm planner. An episode begins with all cars parked and
`tasks` deliveries on order. It terminates for all agents when every task is delivered or has failed, and is
truncated for all after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... and `arm_0`, `arm_1`, ... (one arm per station of the site, pick stations first). Arms
beyond `n_arms` and the `classical_cars` behind the agents' are the classical fleet's.

Actions, all in [-1, 1]. Greater ones are clipped, entries that are no finite numbers count as 0, an agent without an
action does nothing (cars brake, arms stand and let go); `infos[agent]["illegal"]` says so. An action of
the wrong shape is refused and changes nothing.

| agent | entries |
|---|---|
| car | steering / 0.8 rad (positive = left), speed / 2 m/s (negative = reverse) |
| arm, `arm_action="joint"` | 7 joint velocities / the joints' limits, grip (> 0 = hold) |
| arm, `arm_action="tip"` | velocity of the tip / 0.5 m/s, turn / 1 rad/s, along and about x, y, z of its frame; grip |

A car does what its task asks for when it follows the granted path, which the observed way-points show, and stands at
its end: within 5 cm and 0.1 rad of the dock's stop pose a transfer begins. A car that leaves its path makes no progress
until it returns. An arm's transfer ends when it has let go of the parcel; one that lies neither in the tray or on the
slot it was meant for nor where it came from is lost, and its task has failed.

Observations, all clipped to [-1, 1]. A car's frame lies at its rear axle, x ahead, y to the left; an arm's is its base,
x towards the dock. A route is a car's granted path and up to two moves of what is planned beyond:

| car | entries |
|---|---|
| 0-1 | estimated position on the floor, -1 = west or south edge, 1 = east or north edge |
| 2-3 | cos, sin of the yaw |
| 4-5 | speed / 2 m/s, steering / 0.8 rad |
| 6-7 | offset to the goal in the car's frame / the floor's diagonal |
| 8-9 | cos, sin of the goal's heading in the car's frame |
| 10-13 | mission: drives to a pick dock, is loaded, drives to a drop dock, is unloaded (0 or 1; none: parks or waits) |
| 14 | carries a parcel (0 or 1) |
| 15 | length of the granted path ahead / 3 m, negative beyond its end |
| 16 | offset from the route, positive to its left [m] |
| 17-18 | cos, sin of the route's direction in the car's frame |
| 19-26 | points of the route 0.4, 0.8, 1.2 and 2.0 m ahead, at most its end, in the car's frame / 3 m |
| 27-44 | the nearest three other cars within 3 m: there is one (0 or 1), offset / 3 m, cos, sin of yaw, speed / 2 m/s |
| 45-48 | its station: there is one, its arm is idle, the arm serves this car, another car is in the dock (0 or 1) |
| 49- | lidar: distances / range from the middle of the car, first ray ahead, then to the left, 1 = nothing met |

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
| 32-36 | the nearest car within 1.5 m: there is one (0 or 1), offset / 1.5 m, cos, sin of its heading |

An arm's parcel is that of its transfer, else the one in its grip, else the nearest within 1.5 m. With `camera`, a
car's observation is a dictionary of its row (`row`) and of what a camera on its nose sees (`image`, height x width x 3,
uint8).

Rewards: the sum of the terms in `RewardWeights`; `infos[agent]` holds each weighted term. `state()` is the rows of all
agents without lidar, one after the other.

Physics runs at `physics_hz` at least; orders, right of way and the other decisions are made once per tick, of which
there are at least 20 a second and a whole number per step. Agents' cars change their speed as fast as motors and tyres
can, by 6 to 9 m/s^2. In fidelity kinematic they gain 1.5 and lose 2.5 m/s^2 at most, nothing is stopped by contacts,
which are counted only, and lidar sees cars, walls, shelves, pedestals and the feet of arms.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.config import Fidelity
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.warehouse.actions import LegalActions, legal_actions
from fleet.envs.warehouse.agent_arm_manager import NoPlanner
from fleet.envs.warehouse.agent_simulation import AgentSimulation
from fleet.envs.warehouse.config import WarehouseConfig
from fleet.envs.warehouse.drawing import RunDrawing
from fleet.envs.warehouse.hands import N_TIP, joint_velocities, move_targets, shares_of
from fleet.envs.warehouse.observations import Observer
from fleet.envs.warehouse.recorded import Recording
from fleet.envs.warehouse.rewards import TERMS, Rewards, RewardWeights
from fleet.envs.warehouse.rows import N_CAR_NUMBERS
from fleet.envs.warehouse.spaces import action_spaces, observation_spaces, state_space
from fleet.robots.iiwa import N_JOINTS
from fleet.run.setup import RunSetup
from fleet.sensors.camera import Camera
from fleet.sensors.lidar import LidarRing
from fleet.simulation import Actions
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.tasks.board import DONE_STATES, TaskState
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.protocol import World

EYE_HEIGHT_M = 0.15
"""Of a car's camera, on its nose [m]."""
_ENDED = frozenset((*DONE_STATES, TaskState.FAILED, TaskState.CANCELLED))


@dataclass(kw_only=True)
class WarehouseEpisode:
    """All that changes in an episode, but for the world."""

    simulation: AgentSimulation
    observer: Observer
    rewards: Rewards
    targets: FloatArray
    """Set-points of the agents' arms' joints [rad], shape (n_agent_arms, n_joints)."""
    car_limits: FloatArray
    """Greatest steering [rad] and speed [m/s], shape (2,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Quick:
    """What brings a moment back at once."""

    episode: WarehouseEpisode
    world: World
    """Where it was."""
    moment: object
    """The world's own snapshot."""


class WarehouseEnv(FleetEnv):
    """A warehouse whose cars and arms are agents; see the module's description.

    World, site and arm planner last from episode to episode: a reset takes milliseconds.

    Args:
        config: All settings.
    """

    config: WarehouseConfig

    def __init__(self, config: WarehouseConfig) -> None:
        super().__init__(config, observation_spaces(config), action_spaces(config))
        self.state_space = state_space(config)
        self._cars, self._arms = config.cars, config.arms
        self._run_config = config.run_config
        self._lidar = config.car_lidar
        self._weights = config.weights or RewardWeights()
        self._ground: RunSetup | None = None
        self._start_of_world: object = None
        self._start_hits: FloatArray | None = None  # what all rays meet there
        self._planner: ArmPlanner = NoPlanner()
        self._episode: WarehouseEpisode | None = None
        self._drawing: RunDrawing | None = None
        self._recording: Recording | None = None
        self._n_episodes = 0

    @property
    def simulation(self) -> AgentSimulation:
        """The episode's run.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        return self._now().simulation

    def state(self) -> npt.NDArray[np.float32]:
        """The rows of all agents without lidar, cars first; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        observer = self._now().observer
        return np.concatenate((observer.car_rows[:, :N_CAR_NUMBERS].ravel(), observer.arm_rows.ravel()))

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        super().close()
        self._close_recording()
        self._episode = self._drawing = None
        if self._ground is not None and self._ground.world is not None:
            self._ground.world.close()
        self._planner.close()
        self._ground, self._planner = None, NoPlanner()

    def _begin(self, seed: int) -> Infos:
        ground = self._opened()
        world = _world(ground)
        self._close_recording()
        world.load(self._start_of_world)
        orders, lidar = np.random.SeedSequence(seed).generate_state(2).tolist()
        simulation = AgentSimulation(
            self._run_config.seeded(orders),
            setup=ground,
            planner=self._planner,
            n_cars=len(self._cars),
            n_arms=len(self._arms),
        )
        car = simulation.scene.car
        ring = None
        if self._lidar is not None:
            ring = LidarRing(self._lidar, car.front_m, car.rear_m, car.half_width_m)
        observer = Observer(simulation, ring, np.random.default_rng(lidar))
        observer.look(self._start_hits)
        self._start_hits = observer.hits
        self._episode = WarehouseEpisode(
            simulation=simulation,
            observer=observer,
            rewards=Rewards(simulation, observer, self._weights, self.config.step_s),
            targets=world.arm_positions()[: len(self._arms)],
            car_limits=np.array([car.max_steering_rad, car.max_speed_mps]),
        )
        self._drawing = None
        self._n_episodes += 1
        if self.render_mode == "rerun":
            simulation.counts_figures = True
            self._recording = Recording(simulation, self.config.recordings / f"episode_{self._n_episodes - 1:04}.rrd")
        return {agent: {**dict.fromkeys(TERMS, 0.0), "illegal": False} for agent in self.possible_agents}

    def _resolved(self, actions: Mapping[str, Any]) -> LegalActions:
        return legal_actions(actions, self._cars, self._arms, self.config.n_entries)

    def _advance(self, resolved: LegalActions) -> tuple[dict[str, float], bool, Infos]:
        episode = self._now()
        simulation = episode.simulation
        for _ in range(self.config.n_ticks):
            simulation.tick(self._commands(episode, resolved))
            if self._recording is not None:
                self._recording.look()
        episode.observer.look()
        rows = episode.rewards.step(resolved).tolist()
        rewards = {agent: row.pop() for agent, row in zip(self.possible_agents, rows, strict=True)}
        infos: Infos = {
            agent: {**dict(zip(TERMS, row, strict=True)), "illegal": bool(illegal)}
            for agent, (*row, illegal) in zip(self.possible_agents, rows, strict=True)
        }
        done = all(task.state in _ENDED for task in simulation.board.tasks)
        return rewards, done, infos

    def _observations(self) -> dict[str, Any]:
        observer = self._now().observer
        # One copy for all: nothing else has a view of it.
        cars, arms = observer.car_rows.copy(), observer.arm_rows.copy()
        seen: dict[str, Any] = dict(zip(self._cars, cars, strict=True))
        if self.config.camera is not None:
            seen = {agent: {"row": seen[agent], "image": self._image(car)} for car, agent in enumerate(self._cars)}
        seen.update(zip(self._arms, arms, strict=True))
        return seen

    def _picture(self) -> Picture:
        self._drawing = self._drawing or RunDrawing(self.simulation)
        return self._drawing.picture()

    def _quick(self) -> _Quick | None:
        episode, world = self._now(), _world(self._opened())
        if self._run_config.fidelity is Fidelity.PHYSICS or episode.simulation.arm_manager.awaits_plans:
            return None  # what the engine remembers of touches is in no snapshot
        return _Quick(episode=self._copied(episode), world=world, moment=world.save())

    def _restore(self, quick: _Quick) -> bool:
        world = _world(self._opened())
        if self._episode is None or quick.world is not world:
            return False
        self._close_recording()
        world.load(quick.moment)
        self._episode = self._copied(quick.episode)
        self._drawing = None
        return True

    def _copied(self, episode: WarehouseEpisode) -> WarehouseEpisode:
        """A copy that shares what lasts from episode to episode."""
        ground = self._opened()
        parts = ground.site, ground.graph, ground.graph.state_pose, ground.scene, ground.distances, ground.world
        lasting = (*parts, self._planner, self._run_config)
        return copy.deepcopy(episode, {id(thing): thing for thing in lasting})

    def _now(self) -> WarehouseEpisode:
        if self._episode is None:
            raise EpisodeError("there was no episode yet; valid: reset() first")
        return self._episode

    def _opened(self) -> RunSetup:
        """Site, world and arm planner, made once."""
        if self._ground is None:
            ground = RunSetup.of(self._run_config)
            world = self._made_world(ground)
            self._ground = replace(ground, world=world)
            # Also the first episode begins as a return to the start, so that it is like all others.
            self._start_of_world = world.save(settle=True)
            if len(self._arms) < world.n_arms:
                names = tuple(station.name for station in ground.site.stations)
                cells = arm_cells(ground.site, ground.scene)
                self._planner = make_arm_planner(cells, names, ground.scene.arm, self._run_config)
        return self._ground

    def _made_world(self, ground: RunSetup) -> World:
        tick_s = self.config.step_s / self.config.n_ticks
        if self._run_config.fidelity is Fidelity.KINEMATIC:
            return KinematicWorld(ground.scene, KinematicConfig(tick_s=tick_s))
        # The engine takes a moment to load and is needed by this world alone.
        from fleet.world.bullet.engine.config import BulletConfig, exact_tick_s
        from fleet.world.bullet.world import BulletWorld

        n_steps = max(1, math.ceil(self.config.physics_hz * tick_s - 1e-6))
        exact_s = exact_tick_s(n_steps, n_steps / tick_s)
        return BulletWorld(ground.scene, BulletConfig(tick_s=exact_s, n_steps_per_call=n_steps))

    def _commands(self, episode: WarehouseEpisode, resolved: LegalActions) -> Actions:
        """The actions of one tick; joint velocities become targets that move on."""
        simulation = episode.simulation
        world, arm = simulation.world, simulation.scene.arm
        cars = np.empty_like(resolved.cars)
        shares_of(episode.car_limits, resolved.cars, cars)
        if not self._arms:
            return Actions(cars=cars)
        q = world.arm_positions()[: len(self._arms)]
        if self.config.n_entries == N_JOINTS:
            qd = np.empty_like(q)
            shares_of(arm.max_velocity_radps, resolved.arms, qd)
        else:
            qd = joint_velocities(arm, q, resolved.arms[:, :N_TIP])
        move_targets(episode.targets, qd, q, arm.lower_rad, arm.upper_rad, simulation.tick_s)
        return Actions(cars=cars, arms=episode.targets, arms_qd=qd, grip=resolved.arms[:, -1] > 0.0)

    def _image(self, car: int) -> npt.NDArray[np.uint8]:
        """What the camera on a car's nose sees, shape (height, width, 3)."""
        height, width = self.config.camera or (1, 1)
        scene = self.simulation.scene
        x, y, yaw = self.simulation.world.car_poses()[car].tolist()
        ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        eye = np.array([x, y, EYE_HEIGHT_M]) + scene.car.front_m * ahead
        camera = Camera.looking_at(f"car_{car}", eye_m=eye, target_m=eye + ahead, width_px=width, height_px=height)
        return self.simulation.world.image(camera).rgb

    def _record(self) -> None:
        """Every tick is recorded as it is made."""

    def _close_recording(self) -> None:
        if self._recording is not None:
            self._recording.close()
            self._recording = None


def parallel_env(**settings: Any) -> WarehouseEnv:
    """Make the environment; the settings are those of `WarehouseConfig`."""
    return WarehouseEnv(WarehouseConfig.of(settings))


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `WarehouseConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))


def _world(ground: RunSetup) -> World:
    """The world of an opened ground."""
    if ground.world is None:
        raise EpisodeError("there is no world; valid: reset() first")
    return ground.world
