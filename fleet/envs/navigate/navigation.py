"""Navigation: a PettingZoo environment in which cars drive to one place after the other, among each other.

Every car has a stream of places to visit, drawn from the episode's seed and the same whatever the agents do. Its way
there is the shortest along the lanes of the site; no car is given right of way: to keep clear of the others is the agents'
own affair. A car that gets more than 0.8 m away from its way, or stands off its lane for three seconds, is out of its
agent's hands for a second and a half: it brakes, is towed back to its way, and stands there. Cars stop at each other, at walls and at shelves, in fidelity
`kinematic` too unless `contact` is `pass`: then they drive through each other, and only pay. If it is `hold`, a nose
that meets something head-on is held by friction, as in physics, and its car has to reverse. An episode begins with all cars parked and is truncated for all after
`max_cycles` steps.

Agents: `car_0`, `car_1`, ...

Actions, both in [-1, 1]: steering / 0.8 rad (positive = left) and speed / 2 m/s (negative = reverse). Greater ones are
clipped, nan counts as 0, a missing agent stands; `infos[agent]["illegal"]` says so.

Observations, all clipped to [-1, 1]; a car's frame lies at its rear axle, x ahead, y to the left:

| entries | |
|---|---|
| 0-1 | speed / 2 m/s, steering / 0.8 rad |
| 2-3 | distance to the left of the way / 1 m, way left to the place / 10 m |
| 4-6 | share of the episode that is left, whether it touches another car, whether it is out of its agent's hands (0 or 1) |
| 7-18 | points of the way 0.3, 0.6, 1.0, 1.5, 2.2 and 3.0 m ahead / 3 m |
| 19-34 | the nearest other car within 4 m, see below |
| 35-50, 51-66, 67-82 | the second, third and fourth nearest |

Of another car:

| entries | |
|---|---|
| 0 | there is one (0 or 1) |
| 1-4 | offset / 4 m, cos and sin of its heading |
| 5-7 | its velocity less the own one / 4 m/s, the speed at which both come closer / 4 m/s |
| 8 | how soon they collide if nobody turns or brakes: 1 now, 0 in 3 s or never |
| 9-12 | the point 1 m ahead on its way / 4 m, its place / 10 m |
| 13-14 | where the ways of both meet: the own way to there / 3 m, its way to there / 3 m; 1 each if not within 3 m |
| 15 | whether its number is lower (0 or 1): something by which agents can agree who goes first |

With `knocks_per_min` cars are knocked off their courses now and then, so that agents learn to come back.

Rewards: the sum of the terms in `NavigationWeights`; `infos[agent]` holds each weighted term, and `places`, `touches` and
`tows`, the numbers of places that were reached and of touches and tows that began in this step. `state()` is all observations, one after the other.
"""  # noqa: E501 - a table's row

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from fleet.arrays import FloatArray
from fleet.config import Fidelity, Grip, RunConfig, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.core.choices import row_of
from fleet.envs.core.driven_world import driven_world, ticks_of_step
from fleet.envs.core.env_config import RecordedEnvConfig
from fleet.envs.core.episode_pictures import EpisodePictures
from fleet.envs.core.floor_drawing import FloorDrawing
from fleet.envs.core.weights import check_weights
from fleet.envs.navigate.rows import N_CAR_NUMBERS, CarsSeen, Seen, observe
from fleet.envs.navigate.ways import WayLines, project
from fleet.robots.pursuit import PathBuffer
from fleet.world.kinematic import CONTACTS, STOP
from fleet.world.site_scene import scene_of
from maps.lane_graph import MoveKind, build_lane_graph
from planners.mapf.distance_table import UNREACHABLE, DistanceTable

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.PHYSICS)
OFF_LANE_M = 0.3
"""A car further than this from its way is off its lane [m]: in the middle, its sides are 0.36 m from the walls."""
LOST_M = 0.8
"""A car further than this from its way is towed back [m]."""
STUCK_S, STANDS_MPS = 3.0, 0.1
"""A car that is off its lane and slower than this for so long is towed back, too: it is stuck at a wall."""
BRAKE_S, TOW_S = 1.0, 0.5
"""Times in which a lost car comes to a stand, from any speed, and in which it is then brought back, in physics [s]."""
KNOCK_M, KNOCK_RAD = 0.35, 1.2
"""Greatest shift of a car that is knocked, along x and y [m], and greatest turn [rad]: its nose may meet a wall."""
REACHED_M = 0.1
"""A place counts as reached this far before it [m]."""
TOUCH_M = 0.01
"""Bodies nearer than this touch [m]: physics lets them not overlap."""
_AHEAD_M = 4.0
"""Length of way that is always known [m]."""

Observation = npt.NDArray[np.float32]
_Stop = tuple[float, int]
"""A place on a way: arc length [m], and lane-graph state."""


@dataclass(frozen=True, kw_only=True)
class NavigationWeights:
    """What things are worth."""

    progress: float = 1.0
    """Per metre along the way."""
    place: float = 1.0
    """Per place reached."""
    touch: float = -3.0
    """Per time the car begins to touch another; a touch that lasts counts once."""
    off_lane: float = -0.05
    """Per step off the lane."""
    towed: float = -2.0
    """Per time the car was towed."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = ("progress", "place", "touch", "off_lane", "towed")
"""Names of the terms."""
COUNTED = ("places", "touches", "tows")
"""What is counted beside them."""


@dataclass(frozen=True, kw_only=True)
class NavigationConfig(RecordedEnvConfig):
    """Settings of `NavigationEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "navigate_v1"
    WEIGHTS: ClassVar[type] = NavigationWeights

    site: str = "small"
    """Name of a shipped site or path of a site file."""
    n_cars: int = 6
    """Number of cars."""
    fidelity: str = "kinematic"
    """`kinematic` or `physics`."""
    contact: str = STOP
    """What a collision does in fidelity `kinematic`: `pass`, `stop` or `hold`, see
    `fleet.world.kinematic.KinematicConfig`."""
    knocks_per_min: float = 0.0
    """Times per minute that each car is knocked off its course: by up to `KNOCK_M` and `KNOCK_RAD`, for training."""
    control_hz: float = 10.0
    """Steps per simulated second; the world's tick rate (kinematic 20, physics 60) is a multiple."""
    max_cycles: int = 600
    """Steps after which an episode is truncated."""
    weights: NavigationWeights | None = None
    """What things are worth; None = as `NavigationWeights` has it."""

    def __post_init__(self) -> None:
        require(isinstance(self.site, str | Path), "site", self.site, "a name or a path")
        n_spots = len(self.place.parking)
        cars_ok = is_whole(self.n_cars) and 1 <= self.n_cars <= n_spots
        require(cars_ok, "n_cars", self.n_cars, f"1 to {n_spots} on site {self.place.name}")
        require(self.fidelity in FIDELITIES, "fidelity", self.fidelity, ", ".join(FIDELITIES))
        require(self.contact in CONTACTS, "contact", self.contact, ", ".join(CONTACTS))
        knocks_ok = is_number(self.knocks_per_min) and self.knocks_per_min >= 0
        require(knocks_ok, "knocks_per_min", self.knocks_per_min, "a number >= 0")
        hz_ok = is_number(self.control_hz) and self.control_hz > 0
        require(hz_ok, "control_hz", self.control_hz, "a number > 0")
        super().__post_init__()

    @property
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""
        return self.control_hz


class NavigationEnv(FleetEnv):
    """Cars that drive to places; see the module's description.

    Args:
        config: All settings.

    Raises:
        ConfigError: A lane of the site is driven in reverse, or the world's tick rate is no multiple of `control_hz`.
    """

    config: NavigationConfig

    def __init__(self, config: NavigationConfig) -> None:
        super().__init__(
            config,
            # Spaces of their own: seeding one must not seed another.
            observation_spaces={car: _box(N_CAR_NUMBERS) for car in config.car_names},
            action_spaces={car: _box(2) for car in config.car_names},
        )
        n_cars = config.n_cars
        self.state_space = _box(n_cars * N_CAR_NUMBERS)
        self._weights = config.weights or NavigationWeights()
        self._drawing: FloorDrawing | None = None
        self._pictures = EpisodePictures(config.recordings, f"{config.NAME}, {n_cars} cars")
        self._figures = {"places": 0.0, "touches": 0.0}
        """Sums over team and episode, for recordings."""

        graph = self._graph = build_lane_graph(config.place)
        forward = not (graph.move_kind == MoveKind.REVERSE).any()
        require(forward, "site", config.site, "a site on which no lane is driven in reverse")
        self._starts = [int(graph.states_of_cell(cell)[0]) for cell in config.place.parking[:n_cars]]
        self._tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
        back = np.array([self._tables.to(state)[self._starts[0]] for state in range(graph.n_states)])
        self._places = np.flatnonzero((back < UNREACHABLE) & (self._tables.to(self._starts[0]) < UNREACHABLE))
        scene = scene_of(config.place, graph.state_pose[self._starts], Grip.SUCTION)
        # Arms would only stand about.
        scene = replace(scene, arms=scene.arms.part(()), arm_base=scene.arm_base[:0], arm_start=scene.arm_start[:0])
        run = RunConfig(site=config.site, robots=config.n_cars, fidelity=Fidelity(config.fidelity))
        self._world = driven_world(scene, graph, run, config.contact)
        self._n_ticks = ticks_of_step(self._world, config.control_hz)
        self._parked = self._world.save(settle=True)
        self._no_joints = np.zeros((0, scene.arms.width))
        self._no_grip = np.zeros(0, dtype=np.bool_)
        half_m = ((scene.car.front_m + scene.car.rear_m + TOUCH_M) / 2, scene.car.half_width_m + TOUCH_M / 2)
        self._body = np.array([(scene.car.front_m - scene.car.rear_m) / 2, *half_m])
        self._limits = np.array([scene.car.max_steering_rad, scene.car.max_speed_mps])
        self._aside_m = np.zeros(n_cars)
        self._seen = Seen(
            rows=np.zeros((n_cars, N_CAR_NUMBERS), dtype=np.float32),
            touches=np.zeros(n_cars, dtype=np.bool_),
        )

    def state(self) -> Observation:
        """All observations, one after the other; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self._seed < 0:
            raise EpisodeError("state: there was no episode yet; valid: reset() first")
        return self._seen.rows.ravel().copy()

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._world.close()
        self._pictures.close()
        super().close()

    def _begin(self, seed: int) -> Infos:
        n_cars = len(self.possible_agents)
        *self._streams, self._knocks = np.random.default_rng(seed).spawn(n_cars + 1)
        self._world.load(self._parked)
        self._paths = PathBuffer(n_cars)
        self._ends = list(self._starts)
        self._stops: list[deque[_Stop]] = [deque() for _ in range(n_cars)]
        self._end_m, self._stop_m = np.zeros(n_cars), np.zeros(n_cars)
        """Arc lengths at which each car's way ends, and its next place lies [m]."""
        self._goals = np.zeros((n_cars, 2))
        """The places that cars drive to, x, y."""
        for car, state in enumerate(self._starts):
            self._paths.reset(car, self._graph.state_pose[state])
            self._extend(car)
        self._ticks_towed = np.zeros(n_cars, dtype=np.int64)
        """Ticks for which each car is still out of its agent's hands."""
        self._ticks_stuck = np.zeros(n_cars, dtype=np.int64)
        """Ticks for which each car has been standing off its lane."""
        self._aside_m[:] = 0.0
        self._look(0)
        self._figures = dict.fromkeys(self._figures, 0.0)
        if self.render_mode == "rerun":
            self._pictures.begin()
        return {agent: {**dict.fromkeys((*TERMS, *COUNTED), 0.0), "illegal": False} for agent in self.possible_agents}

    def _resolved(self, actions: Mapping[str, Any]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Shares of steering and speed, shape (n_cars, 2), and which cars' actions were illegal or missing."""
        rows = np.full((len(self.possible_agents), 2), np.nan)
        for car, agent in enumerate(self.possible_agents):
            action = actions.get(agent)
            if action is None:
                continue
            rows[car] = row_of(agent, action, 2)
        legal = np.clip(np.nan_to_num(rows, nan=0.0), -1.0, 1.0)
        return legal, (legal != rows).any(axis=1)

    def _advance(self, resolved: tuple[FloatArray, npt.NDArray[np.bool_]]) -> tuple[dict[str, float], bool, Infos]:
        shares, illegal = resolved
        commands = np.where((self._ticks_towed > 0)[:, None], 0.0, shares * self._limits)
        if self.config.knocks_per_min:
            self._knock()
        before_m = self._paths.progress.copy()
        for _ in range(self._n_ticks):
            self._world.step(commands, self._no_joints, self._no_joints, self._no_grip)
        project(self._world.car_poses(), self._ways())
        reached = self._arrive()
        towed = self._tow()
        touched = self._seen.touches.copy()
        self._look(self.n_steps + 1)
        touches = self._seen.touches & ~touched
        self._figures["places"] += int(reached.sum())
        self._figures["touches"] += int(touches.sum())
        off_lane = np.abs(self._aside_m) > OFF_LANE_M
        weights = self._weights
        terms = np.column_stack(
            (
                weights.progress * (self._paths.progress - before_m),
                weights.place * reached,
                weights.touch * touches,
                weights.off_lane * off_lane,
                weights.towed * towed,
            )
        )
        rewards = dict(zip(self.possible_agents, terms.sum(axis=1).tolist(), strict=True))
        infos: Infos = {
            agent: {**dict(zip((*TERMS, *COUNTED), row, strict=True)), "illegal": wrong}
            for agent, row, wrong in zip(
                self.possible_agents,
                np.column_stack((terms, reached, touches, towed)).tolist(),
                illegal.tolist(),
                strict=True,
            )
        }
        return rewards, False, infos

    def _observations(self) -> dict[str, Observation]:
        return dict(zip(self.possible_agents, self._seen.rows.copy(), strict=True))

    def _picture(self) -> Picture:
        self._drawing = self._drawing or FloorDrawing(self.config.place)
        poses = self._world.car_poses()
        return self._drawing.picture(poses, np.zeros(len(poses), dtype=np.bool_), self._goals)

    def _record(self) -> None:
        self._pictures.show(self._picture(), self.n_steps / self.config.control_hz, self._figures)

    def _extend(self, car: int) -> None:
        """Lengthen a car's way by the places that come next, until enough of it is known."""
        paths, graph = self._paths, self._graph
        while paths.end_s(car) - paths.progress[car] < _AHEAD_M:
            state = self._ends[car]
            goal = state
            while goal == state:
                goal = int(self._streams[car].choice(self._places))
            to_goal = self._tables.to(goal)
            while state != goal:
                moves = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
                move = int(moves[np.argmin(to_goal[graph.move_to[moves]])])
                span = slice(graph.path_ptr[move], graph.path_ptr[move + 1])
                paths.append(car, graph.path_points[span], graph.path_s[span])
                state = int(graph.move_to[move])
            self._ends[car] = state
            self._end_m[car] = paths.end_s(car)
            self._stops[car].append((float(self._end_m[car]), state))
        self._stop_m[car], state = self._stops[car][0]
        self._goals[car] = graph.state_pose[state, :2]

    def _arrive(self) -> npt.NDArray[np.int64]:
        """Tick off the places that cars have reached, and see that their ways go on; returns how many, (n_cars,)."""
        progress, on_lane = self._paths.progress, np.abs(self._aside_m) <= OFF_LANE_M
        reached = np.zeros(len(progress), dtype=np.int64)
        there = on_lane & (progress >= self._stop_m - REACHED_M)
        for car in np.flatnonzero(there | (self._end_m - progress < _AHEAD_M)).tolist():
            stops = self._stops[car]
            while there[car] and stops and progress[car] >= stops[0][0] - REACHED_M:
                stops.popleft()
                reached[car] += 1
            self._extend(car)
        return reached

    def _ways(self) -> WayLines:
        """The ways as they are now: the path buffer makes new arrays when it grows."""
        paths = self._paths
        return WayLines(
            points=paths.points,
            s=paths.s,
            counts=paths.count,
            cursor=paths.cursor,
            progress=paths.progress,
            aside=self._aside_m,
        )

    def _knock(self) -> None:
        """Knock some cars off their courses."""
        n_cars = len(self.possible_agents)
        chance = self.config.knocks_per_min / (60.0 * self.config.control_hz)
        hit = self._knocks.random(n_cars) < chance
        sizes = self._knocks.uniform(-1.0, 1.0, (n_cars, 3)) * (KNOCK_M, KNOCK_M, KNOCK_RAD)
        for car in np.flatnonzero(hit & (self._ticks_towed == 0)).tolist():
            self._world.push_car(car, *sizes[car].tolist())

    def _tow(self) -> npt.NDArray[np.bool_]:
        """Stop lost cars and bring them back to where their way is nearest; returns which got lost now, (n_cars,)."""
        tow, brake = (round(time_s / self._world.tick_s) for time_s in (TOW_S, BRAKE_S))
        left = np.maximum(self._ticks_towed - self._n_ticks, 0)
        stands = (self._ticks_towed > tow) & (left <= tow)
        aside_m = np.abs(self._aside_m)
        sticks = (aside_m > OFF_LANE_M) & (np.abs(self._world.car_speeds()) < STANDS_MPS)
        self._ticks_stuck = np.where(sticks, self._ticks_stuck + self._n_ticks, 0)
        is_stuck = self._ticks_stuck * self._world.tick_s > STUCK_S
        lost: npt.NDArray[np.bool_] = ((aside_m > LOST_M) | is_stuck) & (self._ticks_towed == 0)
        self._ticks_towed = np.where(lost, brake + tow, left)
        poses = self._world.car_poses()
        for car in np.flatnonzero(stands).tolist():
            x, y, yaw = self._paths.points[car, self._paths.cursor[car]] - poses[car]
            self._world.push_car(car, float(x), float(y), math.remainder(yaw, 2.0 * math.pi))
        return lost

    def _look(self, n_steps: int) -> None:
        """Look at all cars, after so many steps of the episode."""
        world = self._world
        cars = CarsSeen(
            poses=world.car_poses(),
            speeds=world.car_speeds() / self._limits[1],
            steering=world.car_steering() / self._limits[0],
            left_m=self._stop_m - self._paths.progress,
            places=self._goals,
            in_tow=self._ticks_towed > 0,
            body=self._body,
            max_speed_mps=float(self._limits[1]),
            time_left=max(0.0, 1.0 - n_steps / self.max_cycles),
        )
        observe(cars, self._ways(), self._seen)


def parallel_env(**settings: Any) -> NavigationEnv:
    """Make the environment; the settings are those of `NavigationConfig`."""
    return NavigationEnv(NavigationConfig.of(settings))


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `NavigationConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))


def _box(n: int) -> Box:
    return Box(-1.0, 1.0, (n,), np.float32)
