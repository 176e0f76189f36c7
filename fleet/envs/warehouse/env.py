"""Warehouse: a PettingZoo environment in which agents drive the cars and move the arms of a running warehouse.

Orders, allocation, right of way and the judgement of transfers are those of any run (`fleet.simulation`); the agents'
actions take the place of the path follower and of the arm planner. An episode begins with all cars parked and
`tasks` deliveries on order. It terminates for all agents when every task is delivered or has failed, and is
truncated for all after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... and `arm_0`, `arm_1`, ... (one arm per station of the site, pick stations first). Arms
beyond `n_arms` and the `classical_cars` behind the agents' are the classical fleet's.

Actions, all in [-1, 1]. Greater ones are clipped, entries that are no finite numbers count as 0, an agent without an
action does nothing (cars brake, arms stand and let go); `infos[agent]["illegal"]` is 1 then, else 0. An action of
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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Space

from fleet.config import ArmConfig, Fidelity, RunConfig, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.core.choices import row_of
from fleet.envs.core.weights import require_weights
from fleet.envs.warehouse.agent_arm_manager import NoPlanner
from fleet.envs.warehouse.agent_simulation import AgentSimulation
from fleet.envs.warehouse.drawing import Drawing
from fleet.envs.warehouse.hands import TIP_N, joint_velocities, move_targets, shares_of
from fleet.envs.warehouse.observations import Observer
from fleet.envs.warehouse.recorded import Recording
from fleet.envs.warehouse.rewards import TERMS, Rewards, RewardWeights
from fleet.envs.warehouse.rows import ARM_N, CAR_N, make_legal
from fleet.robots.iiwa import N_JOINTS
from fleet.run.setup import RunSetup
from fleet.sensors.camera import Camera
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.simulation import Actions
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.tasks.board import DONE_STATES, TaskState
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.protocol import FloatArray, World
from maps.site import load_site

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.PHYSICS)
ARM_ACTIONS = {"joint": N_JOINTS, "tip": TIP_N}
"""Ways to move an arm, and how many entries each has, without the grip."""
TICKS_HZ = 20.0
"""Least rate of ticks: the car of the classical fleet steers well at it."""
EYE_HEIGHT_M = 0.15
"""Of a car's camera, on its nose [m]."""
_INFOS = (*TERMS, "illegal")
_ENDED = frozenset((*DONE_STATES, TaskState.FAILED, TaskState.CANCELLED))


@dataclass(kw_only=True)
class Episode:
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

    episode: Episode
    world: World
    """Where it was."""
    moment: object
    """The world's own snapshot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Resolved:
    """Legal decisions of all agents."""

    cars: FloatArray
    """In [-1, 1], shape (n_agent_cars, 2)."""
    arms: FloatArray
    """In [-1, 1], shape (n_agent_arms, n_entries + 1)."""
    illegal_cars: npt.NDArray[np.bool_]
    """Whether a car's action had to be made legal, shape (n_agent_cars,)."""
    illegal_arms: npt.NDArray[np.bool_]
    """The same of the arms."""


class WarehouseEnv(FleetEnv):
    """A warehouse whose cars and arms are agents; see the module's description.

    World, site and arm planner last from episode to episode: a reset takes milliseconds.

    Args:
        site: Name of a shipped site or path of a site file.
        n_cars: Cars that are agents.
        n_arms: Arms that are agents, first ones first; None = all of the site.
        fidelity: `kinematic` or `physics`.
        control_hz: Steps per simulated second.
        max_cycles: Steps after which an episode is truncated.
        render_mode: `rgb_array`, `human` (a window, if there is a display), `rerun` (a recording in `record_to` per
            episode) or None.
        tasks: Deliveries on order in an episode; None = one per car.
        classical_cars: Cars of the classical fleet, beside those of agents.
        arm_action: `joint` or `tip`.
        lidar: Lidar of the agents' cars: True = 36 rays of 5 m, False = none, or a description.
        camera: Height and width of the images that the agents' cars see, in fidelity physics [px]; None = none.
        physics_hz: Least rate of physics steps.
        seed: Decides the episodes until `reset` is given a seed.
        weights: What things are worth.
        record_to: Folder for recordings of render mode `rerun`; None = `runs/warehouse_v0`.

    Raises:
        ConfigError: An argument is outside its valid range.
        SensorError: The lidar is.
        SiteError: The site cannot be read.
    """

    def __init__(
        self,
        site: str = "small",
        n_cars: int = 2,
        n_arms: int | None = None,
        fidelity: str = "physics",
        control_hz: float = 10.0,
        max_cycles: int = 1200,
        render_mode: str | None = None,
        *,
        tasks: int | None = None,
        classical_cars: int = 0,
        arm_action: str = "joint",
        lidar: bool | Lidar = True,
        camera: tuple[int, int] | None = None,
        physics_hz: float = 240.0,
        seed: int = 0,
        weights: RewardWeights | None = None,
        record_to: str | Path | None = None,
    ) -> None:
        arguments = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        require(isinstance(site, str | Path), "site", site, "a name or a path")
        require(isinstance(record_to, str | Path | None), "record_to", record_to, "a path")
        place = load_site(site)
        cars_most, arms_most = len(place.parking), len(place.stations)
        _require_whole("n_cars", n_cars, 0, cars_most, f" on site {place.name}")
        n_arms = arms_most if n_arms is None else n_arms
        _require_whole("n_arms", n_arms, 0, arms_most, f" on site {place.name}, or None for all")
        require(n_cars + n_arms >= 1, "n_cars + n_arms", n_cars + n_arms, "at least one agent")
        _require_whole(
            "classical_cars", classical_cars, 0, cars_most - n_cars, f" with n_cars {n_cars} on site {place.name}"
        )
        robots_n = n_cars + classical_cars
        require(robots_n >= 1, "n_cars + classical_cars", robots_n, "at least one car")
        require(fidelity in FIDELITIES, "fidelity", fidelity, ", ".join(FIDELITIES))
        _require_number("control_hz", control_hz, 0.1, 1000.0)
        _require_number("physics_hz", physics_hz, 60.0, 10_000.0)
        require(arm_action in list(ARM_ACTIONS), "arm_action", arm_action, ", ".join(ARM_ACTIONS))
        lidar_ok = isinstance(lidar, bool | Lidar)
        require(lidar_ok, "lidar", lidar, "True, False or a fleet.sensors.lidar.Lidar")
        if tasks is not None:
            _require_whole("tasks", tasks, 1, 10_000, "")
        require_weights(weights, RewardWeights)
        if camera is not None:
            sizes_ok = isinstance(camera, tuple | list) and all(is_whole(size) and 8 <= size <= 1024 for size in camera)
            camera_ok = sizes_ok and len(camera) == 2
            require(camera_ok, "camera", camera, "height and width from 8 to 1024, or None")
            require(
                fidelity == Fidelity.PHYSICS, "camera", camera, "None in fidelity kinematic, which has nothing to see"
            )
        self._lidar = (Lidar() if lidar else None) if isinstance(lidar, bool) else lidar
        cars = [f"car_{car}" for car in range(n_cars)]
        arms = [f"arm_{arm}" for arm in range(n_arms)]
        self._car_box = _box(CAR_N, 0 if self._lidar is None else self._lidar.rays_n)
        self._camera_px = camera
        car_space: Space[Any] = self._car_box
        if camera is not None:
            car_space = Dict({"row": car_space, "image": Box(0, 255, (*camera, 3), np.uint8)})
        # Spaces of their own: seeding one must not seed another.
        observation_spaces = {car: copy.deepcopy(car_space) for car in cars} | {arm: _box(ARM_N) for arm in arms}
        entries_n = ARM_ACTIONS[arm_action]
        super().__init__(
            name="warehouse_v0",
            arguments=arguments,
            observation_spaces=observation_spaces,
            action_spaces={car: _box(2) for car in cars} | {arm: _box(entries_n + 1) for arm in arms},
            max_cycles=max_cycles,
            fps=control_hz,
            seed=seed,
            render_mode=render_mode,
        )
        self.state_space = _box(n_cars * CAR_N + n_arms * ARM_N)
        self._cars, self._arms = cars, arms
        self._entries_n = entries_n
        self._weights = weights or RewardWeights()
        self._step_s = 1.0 / control_hz
        self._ticks_n = max(1, math.ceil(TICKS_HZ / control_hz - 1e-9))
        self._physics_hz = physics_hz
        self._record_to = Path("runs/warehouse_v0" if record_to is None else record_to)
        self._config = RunConfig(
            site=site,
            robots=robots_n,
            tasks=robots_n if tasks is None else tasks,
            fidelity=Fidelity(fidelity),
            arms=ArmConfig(workers_n=0),
        )
        self._ground: RunSetup | None = None
        self._start_of_world: object = None
        self._start_hits: FloatArray | None = None  # what all rays meet there
        self._planner: ArmPlanner = NoPlanner()
        self._episode: Episode | None = None
        self._drawing: Drawing | None = None
        self._recording: Recording | None = None
        self._episodes_n = 0

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
        return np.concatenate((observer.car_rows[:, :CAR_N].ravel(), observer.arm_rows.ravel()))

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
            self._config.seeded(orders),
            setup=ground,
            planner=self._planner,
            cars_n=len(self._cars),
            arms_n=len(self._arms),
        )
        car = simulation.scene.car
        ring = None
        if self._lidar is not None:
            ring = LidarRing(self._lidar, car.front_m, car.rear_m, car.half_width_m)
        observer = Observer(simulation, ring, np.random.default_rng(lidar))
        observer.look(self._start_hits)
        self._start_hits = observer.hits
        self._episode = Episode(
            simulation=simulation,
            observer=observer,
            rewards=Rewards(simulation, observer, self._weights, self._step_s),
            targets=world.arm_positions()[: len(self._arms)],
            car_limits=np.array([car.max_steering_rad, car.max_speed_mps]),
        )
        self._drawing = None
        self._episodes_n += 1
        if self.render_mode == "rerun":
            simulation.counts_figures = True
            self._recording = Recording(simulation, self._record_to / f"episode_{self._episodes_n - 1:04}.rrd")
        nothing = dict.fromkeys((*TERMS, "illegal"), 0.0)
        return {agent: nothing.copy() for agent in self.possible_agents}

    def _resolved(self, actions: Mapping[str, Any]) -> Resolved:
        cars, no_car = _legal(actions, self._cars, 2)
        arms, no_arm = _legal(actions, self._arms, self._entries_n + 1)
        return Resolved(cars=cars, arms=arms, illegal_cars=no_car, illegal_arms=no_arm)

    def _advance(self, resolved: Resolved) -> tuple[dict[str, float], bool, Infos]:
        episode = self._now()
        simulation = episode.simulation
        for _ in range(self._ticks_n):
            simulation.tick(self._commands(episode, resolved))
            if self._recording is not None:
                self._recording.look()
        episode.observer.look()
        rows = episode.rewards.step(resolved.cars, resolved.arms, resolved.illegal_cars, resolved.illegal_arms).tolist()
        rewards = {agent: row.pop() for agent, row in zip(self.agents, rows, strict=True)}
        infos: Infos = {
            agent: dict(zip(_INFOS, row, strict=True)) for agent, row in zip(self.agents, rows, strict=True)
        }
        done = all(task.state in _ENDED for task in simulation.board.tasks)
        return rewards, done, infos

    def _observations(self) -> dict[str, Any]:
        observer = self._now().observer
        # One copy for all: nobody else has a view of it.
        cars, arms = observer.car_rows.copy(), observer.arm_rows.copy()
        seen: dict[str, Any] = dict(zip(self._cars, cars, strict=True))
        if self._camera_px is not None:
            seen = {agent: {"row": seen[agent], "image": self._image(car)} for car, agent in enumerate(self._cars)}
        seen.update(zip(self._arms, arms, strict=True))
        return seen

    def _picture(self) -> Picture:
        self._drawing = self._drawing or Drawing(self.simulation)
        return self._drawing.picture()

    def _quick(self) -> _Quick | None:
        episode, world = self._now(), _world(self._opened())
        if self._config.fidelity is Fidelity.PHYSICS or episode.simulation.arm_manager.awaits_plans:
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

    def _copied(self, episode: Episode) -> Episode:
        """A copy that shares what lasts from episode to episode."""
        ground = self._opened()
        lasting = (ground.site, ground.graph, ground.scene, ground.tables, ground.world, self._planner, self._config)
        return copy.deepcopy(episode, {id(thing): thing for thing in lasting})

    def _now(self) -> Episode:
        if self._episode is None:
            raise EpisodeError("there was no episode yet; valid: reset() first")
        return self._episode

    def _opened(self) -> RunSetup:
        """Site, world and arm planner, made once."""
        if self._ground is None:
            ground = RunSetup.of(self._config)
            world = self._made_world(ground)
            self._ground = replace(ground, world=world)
            # Also the first episode begins as a return to the start, so that it is like all others.
            self._start_of_world = world.save(settle=True)
            if len(self._arms) < world.n_arms:
                names = tuple(station.name for station in ground.site.stations)
                cells = arm_cells(ground.site, ground.scene)
                self._planner = make_arm_planner(cells, names, ground.scene.arm, self._config)
        return self._ground

    def _made_world(self, ground: RunSetup) -> World:
        tick_s = self._step_s / self._ticks_n
        if self._config.fidelity is Fidelity.KINEMATIC:
            return KinematicWorld(ground.scene, KinematicConfig(tick_s=tick_s))
        # The engine takes a moment to load and is needed by this world alone.
        from fleet.world.bullet.engine.config import BulletConfig, exact_tick_s
        from fleet.world.bullet.world import BulletWorld

        steps_n = max(1, math.ceil(self._physics_hz * tick_s - 1e-6))
        exact_s = exact_tick_s(steps_n, steps_n / tick_s)
        return BulletWorld(ground.scene, BulletConfig(tick_s=exact_s, at_once_n=steps_n))

    def _commands(self, episode: Episode, resolved: Resolved) -> Actions:
        """The actions of one tick; joint velocities become targets that move on."""
        simulation = episode.simulation
        world, arm = simulation.world, simulation.scene.arm
        cars = np.empty_like(resolved.cars)
        shares_of(episode.car_limits, resolved.cars, cars)
        if not self._arms:
            return Actions(cars=cars)
        q = world.arm_positions()[: len(self._arms)]
        if self._entries_n == N_JOINTS:
            qd = np.empty_like(q)
            shares_of(arm.max_velocity_radps, resolved.arms, qd)
        else:
            qd = joint_velocities(arm, q, resolved.arms[:, :TIP_N])
        move_targets(episode.targets, qd, q, arm.lower_rad, arm.upper_rad, simulation.tick_s)
        return Actions(cars=cars, arms=episode.targets, arms_qd=qd, grip=resolved.arms[:, -1] > 0.0)

    def _image(self, car: int) -> npt.NDArray[np.uint8]:
        """What the camera on a car's nose sees, shape (height, width, 3)."""
        height, width = self._camera_px or (1, 1)
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


parallel_env = WarehouseEnv
"""The name that PettingZoo's modules have for it."""


def raw_env(**arguments: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the arguments are those of `WarehouseEnv`."""
    return turn_based(WarehouseEnv(**arguments))


def env(**arguments: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**arguments))


def _legal(
    actions: Mapping[str, Any], agents: Sequence[str], entries_n: int
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Actions of the agents of a type made legal, shape (n, entries_n), and which were not, shape (n,).

    Raises:
        ActionError: An action is no row of so many numbers.
    """
    rows = np.empty((len(agents), entries_n))
    missing = np.zeros(len(agents), dtype=np.bool_)
    for k, agent in enumerate(agents):
        action = actions.get(agent)
        if action is None:
            missing[k], rows[k] = True, 0.0
            rows[k, -1] = -1.0 if entries_n > 2 else 0.0  # an arm without an action lets go
        else:
            rows[k] = row_of(agent, action, entries_n)
    make_legal(rows, missing)
    return rows, missing


def _world(ground: RunSetup) -> World:
    """The world of an opened ground."""
    if ground.world is None:
        raise EpisodeError("there is no world; valid: reset() first")
    return ground.world


def _box(n: int, distances_n: int = 0) -> Box:
    """Numbers in [-1, 1], and distances in [0, 1] behind them."""
    low = np.full(n + distances_n, -1.0, dtype=np.float32)
    low[n:] = 0.0
    return Box(low, np.ones(n + distances_n, dtype=np.float32), dtype=np.float32)


def _require_whole(what: str, value: object, low: int, high: int, where: str) -> None:
    require(is_whole(value) and low <= value <= high, what, value, f"an integer from {low} to {high}{where}")


def _require_number(what: str, value: object, low: float, high: float) -> None:
    require(is_number(value) and bool(low <= value <= high), what, value, f"a number from {low:g} to {high:g}")
