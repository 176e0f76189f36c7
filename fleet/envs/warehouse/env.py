"""Warehouse: a PettingZoo environment in which agents drive the cars and move the arms of a running warehouse.

Orders, allocation, right of way and the judgement of transfers are those of any run (`fleet.simulation`); the agents'
actions take the place of the path follower and of the arm planner. `level` says how much of the work an episode is:

| level | agents, unless others are asked for | an episode begins | and ends when |
|---|---|---|---|
| `dock` | one car | a few metres before a dock, half of the time with a parcel for it | it stands there |
| `transfer` | all arms | with a standing car at each of their docks | each has moved its parcel |
| `pair` | one car, all arms | a few metres before a dock | its parcel was moved |
| `all` | two cars, all arms | with parked cars and `tasks` deliveries on order | all are delivered or lost |

It is terminated for all agents then, and truncated for all after `max_cycles` steps. `start` has cars begin elsewhere
(`fleet.envs.warehouse.run.starts`); each level can be played with any team, start, actions and fidelity.

Agents: `car_0`, `car_1`, ... and `arm_0`, `arm_1`, ... (one arm per station of the site, pick stations first). `cars`
names models of cars, sites name models of arms: a robot of another model than the usual one has it in its name, as
`car_MODEL_2` or `arm_MODEL_0`, so that agents of one type, which is the name without the number, are alike. Arms
beyond `n_arms` and the `classical_cars` behind the agents' are the classical fleet's. With `n_cars=(2, 5)` each episode
has a team of 2 to 5 cars; `possible_agents` has the largest. A car that is lost for good (`breakdowns`, an empty
`battery`) is terminated: it leaves `agents` and is back in the next episode. One that only stops for a while stays an
agent, and is told so (entry 63).

Actions, all in [-1, 1]. Greater ones are clipped, entries that are no finite numbers count as 0, an agent without an
action does nothing (cars brake, arms stand and let go); `infos[agent]["illegal"]` says so. An action of
the wrong shape is refused and changes nothing.

| agent | entries |
|---|---|
| car, `car_action="drive"` | steering / 0.8 rad (positive = left), speed / `speed_mps` (negative = reverse) |
| the same, if it turns on the spot | yaw rate / its model's greatest (positive = left), speed / `speed_mps` |
| car, `"residual"` | the same, times `residual`, added to pure pursuit of its route |
| arm, `arm_action="joint"` | velocities of its joints, 7 of the usual one / their limits, grip (> 0 = hold) |
| arm, `"tip"` | tip outwards from the base / 0.5 m/s, around it / 1 rad/s, up / 0.5 m/s, turn / 1 rad/s; grip |
| arm, `"residual"` | joints away from the plan / 0.2 rad, times `residual`; the plan's pace above 1, times `pace` |

A speed within `dead_band` brakes, of a car that turns on the spot if its yaw rate is so, too. At full action a car that
does not go as fast as `speed_mps` goes as fast as its model. Limits of steering and speed are those of each car's
model; rims or feet that cannot do speed and yaw rate together do as much of both. With `tip` the tool points down. A
grip closes at once, and opens when it was told to for `hold_s` without a break; then it stays open for twice as long. A
plan is played at its pace as far as no joint exceeds its speed limit; accelerations grow with the square of the pace,
up to what the motors can.

Cars that turn on the spot are told yaw rates: theirs stand in the place of steering in observations, too, and their
routes lead from corner to corner. The usual car has a wheelbase of 0.325 m: at a steering angle s its rear axle turns
by speed * tan(s) / 0.325 m.

A car does what its task asks for when it follows the granted path, which the observed way-points show, and stands at
its end: within `stop_m` and `stop_rad` of the dock's stop pose a transfer begins. A car that leaves its path makes no
progress until it returns. An arm's transfer ends when it has let go of the parcel; one that lies neither in the tray or
on the slot it was meant for nor where it came from is asked for twice more, then its task has failed.

Observations, all clipped to [-1, 1]. A car's frame lies at its rear axle, x ahead, y to the left; an arm's is its base,
x towards the dock. A route is a car's granted path and up to two moves of what is planned beyond:

| car | entries |
|---|---|
| 0-1 | estimated position on the floor, -1 = west or south edge, 1 = east or north edge |
| 2-3 | cos, sin of the yaw |
| 4-5 | speed / 2 m/s, steering / 0.8 rad: over the greatest of its model |
| 6-7 | offset to the goal in the car's frame / the floor's diagonal |
| 8-9 | cos, sin of the goal's heading in the car's frame |
| 10-13 | mission: drives to a pick dock, is loaded, drives to a drop dock, is unloaded (0 or 1; none: parks or waits) |
| 14 | carries a parcel (0 or 1) |
| 15 | length of the granted path ahead / 3 m, negative beyond its end |
| 16 | offset from the route, positive to its left [m] |
| 17-18 | cos, sin of the route's direction in the car's frame |
| 19-26 | points of the route 0.4, 0.8, 1.2 and 2.0 m ahead, at most its end, in the car's frame / 3 m |
| 27-50 | the nearest three other cars within 3 m: if any, offset / 3 m, cos, sin of yaw, speed / 2 m/s, goal / 3 m |
| 51-54 | its station: there is one, its arm is idle, the arm serves this car, another car is in the dock (0 or 1) |
| 55-57 | its stop pose: how far ahead and to the left of the car, along the pose's own axes [m], turn to it [rad] |
| 58 | stands (0 or 1) |
| 59 | how long it has been served / 30 s |
| 60 | share of the episode's steps that is left |
| 61-62 | its last action, as it was played |
| 63 | 0 while it has broken down, else 1 |
| 64- | lidar: distances / range from the middle of the car, first ray ahead, then to the left, 1 = nothing met |

| arm | entries |
|---|---|
| 0-6 | joint positions, -1 = lower limit, 1 = upper limit; 0 for joints that it does not have |
| 7-13 | joint velocities / limits, the same way |
| 14-16 | tool tip in the arm's frame / 1.5 m |
| 17-19 | direction in which the tool points, in the arm's frame |
| 20-22 | from the tip to the middle of the parcel's top / 1.5 m |
| 23-25 | from the parcel to the place it should have / 1.5 m; zero without a transfer |
| 26-28 | the parcel's edges / 0.1 m |
| 29 | transfer asked for: 1 = slot to tray, -1 = tray to slot, 0 = none |
| 30-31 | something is in the grip, a parcel is in view (0 or 1) |
| 32-36 | the nearest car within 1.5 m: there is one (0 or 1), offset / 1.5 m, cos, sin of its heading |
| 37-42 | tip to parcel, parcel to place, in cylinder coordinates: out [m], around / pi, up [m] |
| 43-48 | the same when it is small: out, around, up / 0.1 m |
| 49-52 | cos, sin of the parcel's yaw from the tool, and of the yaw of its place from the parcel's |
| 53 | the grip is told to hold (0 or 1) |
| 54 | how much of `hold_s` it has been told to open; negative while it stays open |
| 55 | how long it has held / 10 s |
| 56 | a car is served: it stands in the dock (0 or 1) |
| 57 | how long the transfer has gone on / 30 s |
| 58 | share of the episode's steps that is left |
| 59-66 | its last action, as it was played; grip or pace last, 0 for joints that it does not have |

An arm's parcel is that of its transfer, else the one in its grip, else the nearest within 1.5 m. With `camera`, all
observations are dictionaries with the row (`row`), those of cars also with what a camera on the nose sees (`image`,
height x width x 3, uint8). `car_sensing` and `arm_sensing` shorten sight, and let rows get lost or come late.

Rewards: the sum of the terms in `RewardWeights`; `infos[agent]` holds each weighted term. `state()` is the rows of all
agents without lidar, as they are, one after the other; zeros for cars that are not in this episode.

Physics runs at `physics_hz` at least; orders, right of way and the other decisions are made once per tick, of which
there are at least 20 a second and a whole number per step. Agents' cars change their speed as fast as motors and tyres
can, by 6 to 9 m/s^2, unless `ramp` holds them to what their model gains and loses at most (1.5 and 2.5 m/s^2); those
that turn on the spot are always held to that. In fidelity kinematic it is always so, nothing is stopped by contacts,
which are counted only, and lidar sees cars, walls, shelves, pedestals and the feet of arms. Cars on legs need a
`physics_hz` of 120. Arms stand as high as the highest tray of an episode's cars asks for.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.config import Fidelity
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.warehouse.config import WarehouseConfig
from fleet.envs.warehouse.control.actions import ARM_ACTIONS, N_CAR_ENTRIES, LegalActions, legal_actions
from fleet.envs.warehouse.control.commands import Commands
from fleet.envs.warehouse.control.hands import hands_of
from fleet.envs.warehouse.control.plans import Plans
from fleet.envs.warehouse.control.reach import reach_down
from fleet.envs.warehouse.drawing import RunDrawing
from fleet.envs.warehouse.levels import is_over
from fleet.envs.warehouse.observations import Observer, Told, rings_of
from fleet.envs.warehouse.recorded import Recording
from fleet.envs.warehouse.rewards import TERMS, Rewards, RewardWeights
from fleet.envs.warehouse.rows import N_CAR_NUMBERS, REACH_M, Rows
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.envs.warehouse.run.breakdowns import BreakdownClock
from fleet.envs.warehouse.run.grounds import Ground, Grounds
from fleet.envs.warehouse.run.starts import Errand, draw_beginning
from fleet.envs.warehouse.sensing import Receiver
from fleet.envs.warehouse.spaces import action_spaces, observation_spaces, state_space
from fleet.missions.phases import CarPhase
from fleet.sensors.camera import Camera

EYE_HEIGHT_M = 0.15
"""Of a car's camera, on its nose [m]."""


@dataclass(kw_only=True)
class WarehouseEpisode:
    """All that changes in an episode, but for the world."""

    simulation: AgentSimulation
    errands: tuple[Errand, ...]
    """What cars were about when it began."""
    commands: Commands
    breakdowns: BreakdownClock
    observer: Observer
    rewards: Rewards
    receivers: tuple[Receiver, Receiver]
    """Of what cars and arms observe."""
    seen: tuple[Rows, Rows]
    """What came of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Quick:
    """What brings a moment back at once."""

    episode: WarehouseEpisode
    ground: Ground
    """Where it was."""
    moment: object
    """The world's own snapshot."""
    agents: tuple[list[str], list[str]]
    """Cars and arms of the episode."""


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
        self._cars, self._arms = config.car_names, config.arm_names
        self._lidar = config.car_lidar
        self._weights = config.weights or RewardWeights()
        agents = config.agents(len(self._cars))
        all_by_agents = agents.n_arms + agents.n_still_arms >= len(config.place.stations)
        self._grounds = Grounds(
            config.step_s / config.n_ticks,
            config.physics_hz,
            plans=not all_by_agents or config.arm_action == "residual",
        )
        self._ground: Ground | None = None
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

    @property
    def plans(self) -> Plans | None:
        """What plays the episode's classical plans, if arms add to them.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        return self._now().commands.plans

    def state(self) -> npt.NDArray[np.float32]:
        """The rows of all agents without lidar, cars first; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        observer = self._now().observer
        rows = np.zeros((len(self.config.car_names), N_CAR_NUMBERS), dtype=np.float32)
        rows[: len(self._cars)] = observer.car_rows[:, :N_CAR_NUMBERS]
        return np.concatenate((rows.ravel(), observer.arm_rows.ravel()))

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        super().close()
        self._close_recording()
        self._episode = self._drawing = self._ground = None
        self._grounds.close()

    def _team(self) -> list[str]:
        return self._cars + self._arms

    def _gone(self) -> frozenset[str]:
        phases = self._now().simulation.missions.phase
        return frozenset(agent for agent, phase in zip(self._cars, phases, strict=False) if phase is CarPhase.DEAD)

    def _begin(self, seed: int) -> Infos:
        config = self.config
        orders, lidar, start, senses, fate = _sources(seed)
        rng = np.random.default_rng(start)
        n_cars = _n_cars(config, rng)
        self._cars = config.car_names[:n_cars]
        agents, run_config = config.agents(n_cars), config.run_config(n_cars)
        ground = self._ground = self._grounds.open(run_config)
        world, begins = ground.world, config.begins
        self._close_recording()
        world.load(ground.first)
        stations = range(config.n_arms or len(config.place.stations))
        beginning = draw_beginning(begins, ground.setup, n_cars, stations, rng)
        if begins.is_elsewhere:
            world.place(beginning.poses, world.arm_positions())
        simulation = AgentSimulation(
            run_config.seeded(orders),
            setup=ground.setup,
            planner=ground.planner,
            agents=agents,
            beginning=beginning,
        )
        if begins.reach_m is not None:
            world.place(world.car_poses(), self._postures(simulation, beginning.errands, begins.reach_m, rng))
        rings = rings_of(self._lidar, simulation.scene.cars.some(np.arange(n_cars)))
        of_cars, of_arms = config.sensing
        observer = Observer(
            simulation,
            rings,
            np.random.default_rng(lidar),
            (of_cars.range_m, min(of_arms.range_m, REACH_M)),
            config.step_s,
        )
        plans = Plans(simulation, ground.planner) if config.arm_action == "residual" else None
        commands = Commands(simulation, config.action_model, plans)
        fates, sights, views = (np.random.default_rng(one) for one in (fate, senses, senses + 1))
        clock = BreakdownClock(config.failures, n_cars, fates)
        nothing = Told(
            cars=np.zeros((n_cars, N_CAR_ENTRIES)),
            arms=np.zeros((len(self._arms), ARM_ACTIONS[config.arm_action])),
            in_order=clock.in_order,
            closed=commands.latches.closed,
            opening=commands.latches.opening,
            time_left=1.0,
        )
        observer.look(nothing, None if begins.is_elsewhere else ground.hits)
        if not begins.is_elsewhere:
            ground.hits = observer.hits
        receivers = Receiver(of_cars, sights), Receiver(of_arms, views)
        self._episode = WarehouseEpisode(
            simulation=simulation,
            errands=beginning.errands,
            commands=commands,
            breakdowns=clock,
            observer=observer,
            rewards=Rewards(simulation, observer, self._weights, config.team_share, config.step_s),
            receivers=receivers,
            seen=(receivers[0].receive(observer.car_rows), receivers[1].receive(observer.arm_rows)),
        )
        self._drawing = None
        self._n_episodes += 1
        if self.render_mode == "rerun":
            simulation.counts_figures = True
            self._recording = Recording(simulation, config.recordings / f"episode_{self._n_episodes - 1:04}.rrd")
        return {agent: {**dict.fromkeys(TERMS, 0.0), "illegal": False} for agent in self._team()}

    def _resolved(self, actions: Mapping[str, Any]) -> LegalActions:
        return self._legal(actions, self._cars)

    def _example(self, seed: int) -> LegalActions:
        _, _, start, _, _ = _sources(seed)
        n_cars = _n_cars(self.config, np.random.default_rng(start))
        return self._legal({}, self.config.car_names[:n_cars])

    def _legal(self, actions: Mapping[str, Any], cars: Sequence[str]) -> LegalActions:
        joints = [kind.n_joints for kind in self.config.arm_kinds]
        return legal_actions(actions, cars, self._arms, self.config.arm_action, joints)

    def _advance(self, resolved: LegalActions) -> tuple[dict[str, float], bool, Infos]:
        episode, config = self._now(), self.config
        simulation, observer, commands = episode.simulation, episode.observer, episode.commands
        for car in episode.breakdowns.look(simulation.sim_s):
            simulation.lose_car(car, f"car_{car} has broken down")
        commands.take(resolved, observer.car_rows, episode.breakdowns.in_order)
        for _ in range(config.n_ticks):
            simulation.tick(commands.tick())
            if self._recording is not None:
                self._recording.look()
        told = Told(
            cars=resolved.cars,
            arms=resolved.arms,
            in_order=episode.breakdowns.in_order,
            closed=commands.latches.closed,
            opening=commands.latches.opening,
            time_left=1.0 - (self.n_steps + 1) / self.max_cycles,
        )
        observer.look(told)
        of_cars, of_arms = episode.receivers
        episode.seen = of_cars.receive(observer.car_rows), of_arms.receive(observer.arm_rows)
        rows = episode.rewards.step(resolved).tolist()
        team = self._team()
        rewards = {agent: row.pop() for agent, row in zip(team, rows, strict=True)}
        infos: Infos = {
            agent: {**dict(zip(TERMS, row, strict=True)), "illegal": bool(illegal)}
            for agent, (*row, illegal) in zip(team, rows, strict=True)
        }
        done = is_over(config.end, simulation.board.tasks, [errand.loaded for errand in episode.errands])
        return rewards, done, infos

    def _observations(self) -> dict[str, Any]:
        # One copy for all: nothing else has a view of it.
        cars, arms = (rows.copy() for rows in self._now().seen)
        seen: dict[str, Any] = dict(zip(self._cars, cars, strict=True)) | dict(zip(self._arms, arms, strict=True))
        if self.config.camera is None:
            return seen
        pictured = {agent: {"row": row} for agent, row in seen.items()}
        for car, agent in enumerate(self._cars):
            pictured[agent]["image"] = self._image(car)
        return pictured

    def _picture(self) -> Picture:
        self._drawing = self._drawing or RunDrawing(self.simulation)
        return self._drawing.picture()

    def _quick(self) -> _Quick | None:
        episode, ground = self._now(), self._ground
        if ground is None or Fidelity(self.config.fidelity).has_contact or episode.simulation.arm_manager.awaits_plans:
            return None  # what the engine remembers of touches is in no snapshot
        return _Quick(
            episode=self._copied(episode, ground),
            ground=ground,
            moment=ground.world.save(),
            agents=(self._cars, self._arms),
        )

    def _restore(self, quick: _Quick) -> bool:
        if self._episode is None or not self._grounds.has(quick.ground):
            return False
        self._close_recording()
        quick.ground.world.load(quick.moment)
        self._ground = quick.ground
        self._cars, self._arms = quick.agents
        self._episode = self._copied(quick.episode, quick.ground)
        self._drawing = None
        return True

    def _copied(self, episode: WarehouseEpisode, ground: Ground) -> WarehouseEpisode:
        """A copy that shares what lasts from episode to episode."""
        setup = ground.setup
        parts = setup.site, setup.graph, setup.graph.state_pose, setup.scene, setup.distances, setup.world
        lasting = (*parts, ground.planner, episode.simulation.config)
        return copy.deepcopy(episode, {id(thing): thing for thing in lasting})

    def _now(self) -> WarehouseEpisode:
        if self._episode is None:
            raise EpisodeError("there was no episode yet; valid: reset() first")
        return self._episode

    def _postures(
        self,
        simulation: AgentSimulation,
        errands: tuple[Errand, ...],
        reach_m: tuple[float, float],
        rng: np.random.Generator,
    ) -> FloatArray:
        """Joint positions of all arms [rad]: agents' arms near the parcels that they are to move."""
        world, scene = simulation.world, simulation.scene
        q = world.arm_positions()
        of_arm = {arm: hands for hands in hands_of(scene.arms, len(self._arms)) for arm in hands.arms.tolist()}
        for task, errand in zip(simulation.board.tasks, errands, strict=True):
            if errand.station >= len(self._arms) or task.parcel not in world.parcel_ids():
                continue
            away = np.append(rng.uniform(-1.0, 1.0, 2), rng.uniform(0.3, 1.0))
            away *= rng.uniform(*reach_m) / np.linalg.norm(away)
            top = simulation.view.knowledge.inventory.pose(task)[:3]
            top[2] += task.delivery.size_m[2] / 2
            x, y, z, yaw = scene.arm_base[errand.station].tolist()
            dx, dy, up = (top + away - [x, y, z]).tolist()
            cos, sin = math.cos(yaw), math.sin(yaw)
            hands, point = of_arm[errand.station], np.array([cos * dx + sin * dy, cos * dy - sin * dx, up])
            q[errand.station, : hands.spec.n_joints] = reach_down(hands, point)
        return q

    def _image(self, car: int) -> npt.NDArray[np.uint8]:
        """What the camera on a car's nose sees, shape (height, width, 3)."""
        height, width = self.config.camera or (1, 1)
        scene = self.simulation.scene
        x, y, yaw = self.simulation.world.car_poses()[car].tolist()
        ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        eye = np.array([x, y, EYE_HEIGHT_M]) + scene.cars[car].front_m * ahead
        camera = Camera.looking_at(f"car_{car}", eye_m=eye, target_m=eye + ahead, width_px=width, height_px=height)
        return self.simulation.world.image(camera).rgb

    def _record(self) -> None:
        """Every tick is recorded as it is made."""

    def _close_recording(self) -> None:
        if self._recording is not None:
            self._recording.close()
            self._recording = None


def _sources(seed: int) -> list[int]:
    """Seeds of orders, lidars, the start, the senses and the fates of an episode."""
    return [int(source) for source in np.random.SeedSequence(seed).generate_state(5)]


def _n_cars(config: WarehouseConfig, rng: np.random.Generator) -> int:
    """Cars of an episode, the first that is drawn of its start."""
    least, most = config.team_sizes
    return int(rng.integers(least, most + 1))


def parallel_env(**settings: Any) -> WarehouseEnv:
    """Make the environment; the settings are those of `WarehouseConfig`."""
    return WarehouseEnv(WarehouseConfig.of(settings))


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `WarehouseConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))
