"""Hand-over: a PettingZoo environment in which cars and arms arrange by themselves who takes a parcel from whom.

Parcels come to the slots of pick arms, drawn from the episode's seed and the same whatever agents do; one whose arm
has no free slot waits until it has. A pick arm may set a parcel in any tray that it reaches, of a car that stands or
drives; a drop arm takes parcels out of any tray and sets them on its slots. There is no dispatcher: nobody is told
which car, who is first, or when. A parcel that has lain in a tray for half a second is loaded; on a slot of a drop
arm it is delivered; elsewhere, unless on a slot of a pick arm, it is lost. What is delivered or lost is taken away.

Agents: `car_0`, `car_1`, ... and `arm_0`, `arm_1`, ... (one arm per station of the site, pick stations first). Cars
stop at each other, at walls and at shelves, in fidelity `kinematic`, too. With `late_s` a car's motor starts after a
drawn delay, with `stops_per_min` a car stands for 2 to 6 s now and then: it brakes, whatever it is told. An episode
begins with parked cars and is truncated for all after `max_cycles` steps.

Actions, all in [-1, 1]. Greater ones are clipped, entries that are no finite numbers count as 0, an agent without an
action does nothing (cars brake, arms stand and let go); `infos[agent]["illegal"]` says so.

| agent | entries |
|---|---|
| car | steering / 0.8 rad (positive = left), speed / `speed_mps` (negative = reverse); less than a tenth brakes |
| arm | tip outwards from the base / 0.5 m/s, around it / 1 rad/s, up / 0.5 m/s, turn / 1 rad/s; grip (> 0 = hold) |

Tools point down. A grip closes at once, and opens when it was told to for `hold_s` without a break; then it stays
open for twice as long.

Observations, all clipped to [-1, 1], of a size that does not depend on the team's. A car's frame lies at its rear
axle, x ahead, y to the left:

| car | entries |
|---|---|
| 0-1 | speed / `speed_mps`, steering / 0.8 rad |
| 2-5 | carries a parcel, its motor runs, a contact began in this step (0 or 1), share of the episode that is left |
| 6-22, 23-39 | the two nearest pick arms along lanes, see below |
| 40-56, 57-73 | the two nearest drop arms along lanes |
| 74-81, 82-89, 90-97 | the three nearest other cars within 4 m, see below |

| of an arm | entries |
|---|---|
| 0-1 | there is one (0 or 1), way to its stop along lanes / 20 m, negative just beyond it |
| 2-7 | points of that way 0.4, 0.8 and 1.6 m ahead / 2 m |
| 8-10 | the pose at its stop: how far ahead and to the left, along the pose's own axes [m], turn to it [rad] |
| 11-12 | parcels that wait at a pick arm, free slots of a drop arm / 4; it has a parcel in its grip (0 or 1) |
| 13-15 | its tool from the middle of the own tray's floor: ahead, left, up / 1.5 m |
| 16 | another car is within 1 m of the stop (0 or 1) |

| of another car | entries |
|---|---|
| 0-2 | there is one (0 or 1), offset / 4 m |
| 3-5 | cos and sin of its heading, speed / `speed_mps` |
| 6-7 | it carries a parcel, its number is lower (0 or 1): something by which agents can agree who goes first |

An arm's offsets are in cylinder coordinates about its base, from the tip of its tool: out / 3 m, around / 7.4 rad,
up [m], and the same again when they are small: out, along the arc, up / 0.1 m. Those to where a parcel is to be set
are to where the tip has to be then. What lies before the base, where joints end, is told by the side that is nearer:

| arm | entries |
|---|---|
| 0-6 | joint positions / limits |
| 7-9 | tip: out / 1.5 m, around from straight behind the base / 3.7 rad, up / 1.5 m |
| 10-11 | cos, sin of the tool's yaw from the base |
| 12-13 | holds a parcel (0 or 1), from there down to the parcel's bottom / 0.1 m |
| 14-15 | the grip is told to hold, how much of `hold_s` it has been told to open; negative while it stays open |
| 16-17 | 1 = a pick arm, -1 = a drop arm; share of the episode that is left |
| 18-26, 27-35 | the two nearest parcels to take: on a pick arm's slots, in trays within 3 m of a drop arm; see below |
| 36-49, 50-63 | the two nearest cars within 3 m, see below |
| 64-70, 71-77 | the two nearest free slots: there is one, offset to it (6) |

| of a parcel | entries |
|---|---|
| 0-6 | there is one (0 or 1), offset to the middle of its top (6) |
| 7-8 | its velocity out and around [m/s] |

| of a car | entries |
|---|---|
| 0-6 | there is one (0 or 1), offset to the middle of its tray (6) |
| 7-8 | its velocity out and around [m/s] |
| 9-10 | cos and sin of its heading |
| 11-13 | its tray is loaded, is in reach (0 or 1), its speed / `speed_mps` |

Rewards: the sum of the terms in `HandoverWeights`; `infos[agent]` holds each weighted term, and `n_gripped`,
`n_loaded`, `n_delivered`, `n_lost` and `n_contacts`, what itself was part of in this step. `state()` is all
observations, one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from fleet.arrays import FloatArray
from fleet.config import Fidelity, Grip, RunConfig, StreamConfig
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.core.driven_world import driven_world, ticks_of_step
from fleet.envs.core.episode_pictures import EpisodePictures
from fleet.envs.handover.config import TERMS, HandoverConfig, HandoverWeights
from fleet.envs.handover.drawing import HandoverDrawing
from fleet.envs.handover.motors import Motors
from fleet.envs.handover.observer import HandoverObserver
from fleet.envs.handover.parcels import Happened, ParcelBook, ParcelEvent, places_of
from fleet.envs.handover.rewards import COUNTED, HandoverRewards
from fleet.envs.handover.rows import N_ARM_NUMBERS, N_CAR_NUMBERS
from fleet.envs.handover.ways import lane_ways
from fleet.envs.warehouse.control.actions import LegalActions, legal_actions
from fleet.envs.warehouse.control.hands import N_TIP, agents_arm, hand_model, lead_tips, move_targets
from fleet.envs.warehouse.control.latch import Latches
from fleet.tasks.order import Delivery
from fleet.tasks.stream import stream_orders
from fleet.world.kinematic import STOP
from fleet.world.site_scene import scene_of
from maps.lane_graph import build_lane_graph

DEAD_BAND = 0.1
"""A car brakes when its speed is told to be less than this share of the full one."""
SERVES_M = 0.6
"""An arm may touch the car whose tray is nearest to its tool, up to this distance [m]."""

Observation = npt.NDArray[np.float32]


class HandoverEnv(FleetEnv):
    """Cars and arms that hand parcels over; see the module's description.

    Args:
        config: All settings.

    Raises:
        ConfigError: The world's tick rate is no multiple of `control_hz`.
    """

    config: HandoverConfig

    def __init__(self, config: HandoverConfig) -> None:
        cars, arms = config.car_names, config.arm_names
        super().__init__(
            config,
            # Spaces of their own: seeding one must not seed another.
            observation_spaces={car: _box(N_CAR_NUMBERS) for car in cars} | {arm: _box(N_ARM_NUMBERS) for arm in arms},
            action_spaces={car: _box(2) for car in cars} | {arm: _box(N_TIP + 1) for arm in arms},
        )
        self.state_space = _box(len(cars) * N_CAR_NUMBERS + len(arms) * N_ARM_NUMBERS)
        self._cars, self._arms = cars, arms
        place = config.place
        graph = build_lane_graph(place)
        scene = self._scene = scene_of(
            place, graph.state_pose[graph.first_states(place.parking[: len(cars)])], Grip.SUCTION
        )
        run = RunConfig(site=config.site, robots=config.n_cars, fidelity=Fidelity(config.fidelity))
        self._world = driven_world(scene, graph, run, STOP)
        self._n_ticks = ticks_of_step(self._world, config.control_hz)
        self._first = self._world.save(settle=True)
        self._places = places_of(place.stations, scene.car, len(cars))
        stops = [graph.state_at(station.dock.cell, station.dock.heading) for station in place.stations]
        self._ways = lane_ways(graph, stops)
        self._hand = hand_model(agents_arm(scene))
        self._car_limits = np.array([scene.car.max_steering_rad, config.speed_mps])
        self._weights = config.weights or HandoverWeights()
        self._drawing: HandoverDrawing | None = None
        self._pictures = EpisodePictures(config.recordings, f"{config.NAME}, {len(cars)} cars, {len(arms)} arms")
        self.happened = dict.fromkeys(Happened, 0)
        """How often each thing has happened to a parcel in the episode."""

    def state(self) -> Observation:
        """All observations, one after the other; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self._seed < 0:
            raise EpisodeError("state: there was no episode yet; valid: reset() first")
        return np.concatenate((self._observer.car_rows.ravel(), self._observer.arm_rows.ravel()))

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._world.close()
        self._pictures.close()
        super().close()

    def _begin(self, seed: int) -> Infos:
        config, world, n_arms = self.config, self._world, len(self._arms)
        orders, *of_cars = np.random.default_rng(seed).spawn(1 + len(self._cars))
        duration_s = config.max_cycles * config.step_s
        self._motors = Motors(config.late_s, config.stops_per_min, duration_s, of_cars)
        world.load(self._first)
        self._targets = world.arm_positions()
        self._latches = Latches(n_arms, config.hold_s)
        names = [station.name for station in config.place.stations]
        self._book = ParcelBook(world, self._places, self._orders(duration_s, orders), names)
        self._observer = HandoverObserver(self._scene, self._hand, self._ways, self._places, world)
        self._rewards = HandoverRewards(world, self._weights, config.team_share, config.step_s, self._places)
        self.happened = dict.fromkeys(Happened, 0)
        self._book.arrive(0.0, self._observer.tips)
        self._look(0, [])
        if self.render_mode == "rerun":
            self._pictures.begin()
        return {agent: {**dict.fromkeys((*TERMS, *COUNTED), 0.0), "illegal": False} for agent in self.possible_agents}

    def _resolved(self, actions: Mapping[str, Any]) -> LegalActions:
        return legal_actions(actions, self._cars, self._arms, "tip")

    def _advance(self, resolved: LegalActions) -> tuple[dict[str, float], bool, Infos]:
        world, now_s = self._world, self.n_steps * self.config.step_s
        commands = resolved.cars * self._car_limits
        stands = (np.abs(resolved.cars[:, 1]) < DEAD_BAND) | ~self._motors.run(now_s)
        commands[stands, 1] = 0.0
        for arm, car in enumerate(self._observer.nearest_cars(SERVES_M).tolist()):
            world.set_serving(arm, car)
        for _ in range(self._n_ticks):
            self._tick(commands, resolved.arms)
        happened = self._book.look(self.config.step_s)
        for event in happened:
            self.happened[event.kind] += 1
        n_steps = self.n_steps + 1
        self._observer.find_tips()
        self._book.arrive(n_steps * self.config.step_s, self._observer.tips)
        terms, counts = self._look(n_steps, happened)
        illegal = np.concatenate((resolved.illegal_cars, resolved.illegal_arms))
        rewards = dict(zip(self.possible_agents, terms.sum(axis=1).tolist(), strict=True))
        infos: Infos = {
            agent: {**dict(zip((*TERMS, *COUNTED), row, strict=True)), "illegal": wrong}
            for agent, row, wrong in zip(
                self.possible_agents, np.hstack((terms, counts)).tolist(), illegal.tolist(), strict=True
            )
        }
        return rewards, False, infos

    def _observations(self) -> dict[str, Observation]:
        observer = self._observer
        cars = zip(self._cars, observer.car_rows.copy(), strict=True)
        return dict(cars) | dict(zip(self._arms, observer.arm_rows.copy(), strict=True))

    def _picture(self) -> Picture:
        self._drawing = self._drawing or HandoverDrawing(self.config.place, self._scene.arm_base)
        cars = self._observer.cars
        return self._drawing.picture(cars.poses, cars.loads > 0, self._observer.tips, self._world.parcel_poses())

    def _record(self) -> None:
        figures = {kind.name.lower(): float(n) for kind, n in self.happened.items()}
        self._pictures.show(self._picture(), self.n_steps * self.config.step_s, figures)

    def _tick(self, commands: FloatArray, wishes: FloatArray) -> None:
        """Advance the world by one tick."""
        world, arms = self._world, self._scene.arms
        q = world.arm_positions()
        qd = np.empty_like(q)
        lead_tips(self._hand, q, np.ascontiguousarray(wishes[:, :N_TIP]), qd)
        limits = arms.lower_rad, arms.upper_rad, arms.max_velocity_radps
        move_targets(self._targets, qd, q, *limits, world.tick_s)
        self._latches.tick(wishes[:, -1], world.held(), world.tick_s)
        world.step(commands, self._targets, qd, self._latches.closed)

    def _look(self, n_steps: int, happened: list[ParcelEvent]) -> tuple[FloatArray, FloatArray]:
        """Look at everything after so many steps; returns weighted terms and counts."""
        observer = self._observer
        observer.look(
            self._book,
            self._latches,
            self._motors.run(n_steps * self.config.step_s),
            self._rewards.touches(),
            self._car_limits,
            max(0.0, 1.0 - n_steps / self.max_cycles),
        )
        return self._rewards.step(observer.cars, observer.targets, happened)

    def _orders(self, duration_s: float, rng: np.random.Generator) -> list[Delivery]:
        """What arrives in an episode, as many parcels as cars at once."""
        stream = StreamConfig(rate_per_h=60.0 * self.config.parcels_per_min)
        n_cars = len(self._cars)
        n_mean = self.config.parcels_per_min * duration_s / 60.0
        drawn = stream_orders(self.config.place, stream, 0.0, n_cars + math.ceil(2.0 * n_mean) + 10, rng)
        begin_s = drawn[n_cars - 1].release_s
        return [replace(order, release_s=max(order.release_s - begin_s, 0.0)) for order in drawn]


def parallel_env(**settings: Any) -> HandoverEnv:
    """Make the environment; the settings are those of `HandoverConfig`."""
    return HandoverEnv(HandoverConfig.of(settings))


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `HandoverConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))


def _box(n: int) -> Box:
    return Box(-1.0, 1.0, (n,), np.float32)
