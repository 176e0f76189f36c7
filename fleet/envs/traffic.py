"""Traffic: a PettingZoo environment in which each car chooses its lane moves, and the classical fleet does the rest.

Who gets which task, bookings of stations, parking and arms are those of any run. An episode begins with all cars
parked, one order for each car at once, and more that follow as a Poisson stream; it never terminates, and is truncated
for all agents after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... A step is one timestep of 1 s, in which a car goes one move of the lane graph at most. A
car can choose when it has made its last move but one, and is not served at a dock; else its only legal action is 0.

Actions: `Discrete(5)`: 0 = wait, 1 = straight on, 2 = left, 3 = right, 4 = reverse, where the lanes allow it. Whatever
agents choose, no two cars meet: of cars that wish to enter one cell the one with the highest priority may, of equal
ones the one with the lowest index; a car follows only into a cell whose car goes on; rings of followers stay. A car
whose choice is not granted waits, and `infos[agent]["waits"]` is True. An illegal action counts as 0, and
`infos[agent]["illegal"]` is True. The priority is the time since a car was given its goal, 30 s more for a car with a
parcel and 60 s more for an urgent task; cars that are where they should be come last.

Observations: `{"observation": ..., "action_mask": ...}`. The mask holds 1 for each legal action. The numbers are all
in [-1, 1], seen from the state in which the car's way ends as far as it is decided:

| entries | about |
|---|---|
| 0-3 | x, y on the floor (-1 = west or south edge, 1 = east or north edge), cos and sin of the heading |
| 4-8 | phase, one-hot: has no task, drives to a pick station, is loaded, drives to a drop station, is unloaded |
| 9 | waits for room at its station |
| 10 | moves to its goal / the longest way to any place |
| 11-12 | offset to the goal, ahead and to the left / the floor's diagonal |
| 13 | priority / 60 s |
| 14-15 | is where it should be, cannot choose |
| 16-39 | for each move (straight, left, right, reverse): it is legal, moves it saves / 10, its cell is occupied, by a
car that will not go on by itself, other cars that could enter it / 3, one of them has a higher priority |
| 40-64 | the 5 x 5 cells from one behind to three ahead, each row from the left: no lane leads there |
| 65-89 | the same cells: a car is there |

Rewards: the sum of the terms in `TrafficWeights`; `infos[agent]` holds each weighted term. `state()` is all cars'
numbers, one after the other.

Fidelity: `grid` is `fleet.envs.grid_fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet, whose cars make granted moves at their own speed. Spaces, orders and rules are the same.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete

from fleet.config import Fidelity, require
from fleet.envs.base import EpisodeError, FleetEnv, Infos, Picture, in_order, turn_based
from fleet.envs.choices import whole_numbers
from fleet.envs.floor_drawing import FloorDrawing
from fleet.envs.grid_fleet import N_KINDS, TIMESTEP_S
from fleet.envs.grid_kernel import NONE, Ints, Phase
from fleet.envs.order_streams import episode_orders
from fleet.envs.sites import check_site, place_of
from fleet.envs.traffic_fleets import GridTraffic, TrafficFleet
from fleet.envs.traffic_view import ROW_N, TrafficObserver, TrafficView
from fleet.world.protocol import FloatArray
from maps.site import Site
from planners.mapf.distance_table import UNREACHABLE


@dataclass(frozen=True, kw_only=True)
class TrafficWeights:
    """What things are worth."""

    progress: float = 0.1
    """Per move by which a car comes nearer to its goal."""
    delivered: float = 1.0
    """Per parcel that the car has delivered."""
    waiting: float = -0.02
    """Per timestep that a car stands although it is not where it should be."""
    lost: float = -0.02
    """For a move that was not granted."""


TERMS = ("progress", "delivered", "waiting", "lost")
"""Names of the terms."""
N_ACTIONS = 1 + N_KINDS


class TrafficEnv(FleetEnv):
    """A fleet whose cars choose their moves; see the module's description.

    Args:
        site: Name of a shipped site, path of a site file, or, with fidelity `grid`, a site.
        n_cars: Number of cars.
        fidelity: `grid`, `kinematic` or `physics`.
        load: Orders, as a multiple of what the cars could carry if none was ever in the way of another.
        max_cycles: Steps after which an episode is truncated.
        seed: Decides the episodes until `reset` is given a seed.
        weights: What things are worth.
        render_mode: `rgb_array`, `human` (a window, if there is a display), `rerun` or None.

    Raises:
        ConfigError: An argument is outside its valid range.
        SiteError: The site cannot be read.
    """

    def __init__(
        self,
        site: str | Site = "medium",
        n_cars: int = 8,
        fidelity: str = "grid",
        load: float = 1.5,
        max_cycles: int = 500,
        seed: int = 0,
        weights: TrafficWeights | None = None,
        render_mode: str | None = None,
    ) -> None:
        arguments = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        check_site(site, fidelity, n_cars)
        require(math.isfinite(load) and 0 < load <= 100, "load", load, "a number > 0, at most 100")
        self.place = place_of(site)
        """Site, lane graph and distances."""
        self._observer = TrafficObserver(self.place)
        space = Dict(
            {"observation": Box(-1.0, 1.0, (ROW_N,), np.float32), "action_mask": Box(0, 1, (N_ACTIONS,), np.int8)}
        )
        cars = [f"car_{car}" for car in range(n_cars)]
        super().__init__(
            name="traffic_v0",
            arguments=arguments,
            observation_spaces=dict.fromkeys(cars, space),
            action_spaces={car: Discrete(N_ACTIONS) for car in cars},
            max_cycles=max_cycles,
            fps=1.0 / TIMESTEP_S,
            seed=seed,
            render_mode=render_mode,
        )
        self.state_space = Box(-1.0, 1.0, (n_cars * ROW_N,), np.float32)
        self.fleet: TrafficFleet | None = None
        """The episode's fleet; None before the first `reset`."""
        self.delivered_n = 0
        """Deliveries of the episode."""
        self.late_s = 0.0
        """Time by which they were late, together [s]."""
        self._fidelity = Fidelity(fidelity)
        self._site, self._n_cars, self._load = site, n_cars, load
        self._weights = weights or TrafficWeights()
        self._cars = np.arange(n_cars)

    @property
    def view(self) -> TrafficView:
        """The fleet at the last observation, for policies that are not told by rows of numbers."""
        return self._view

    def state(self) -> npt.NDArray[np.float32]:
        """All cars' numbers; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self.fleet is None:
            raise EpisodeError("state: there was no episode yet; valid: reset() first")
        return self._observer.look(self._view)[0].ravel()

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._end()
        super().close()

    @functools.cached_property
    def _drawing(self) -> FloorDrawing:
        return FloorDrawing(self.place.site)

    def _end(self) -> None:
        if self.fleet is not None:
            self.fleet.close()
            self.fleet = None

    def _begin(self, seed: int) -> Infos:
        self._end()
        of_orders, of_fleet = np.random.SeedSequence(seed).spawn(2)
        duration_s = self.max_cycles * TIMESTEP_S
        orders = episode_orders(self.place, self._n_cars, self._load, duration_s, np.random.default_rng(of_orders))
        if self._fidelity is Fidelity.GRID:
            self.fleet = GridTraffic(self.place, self._n_cars, orders)
        else:
            from fleet.envs.traffic_simulation import SimulatedTraffic

            fleet_seed = int(of_fleet.generate_state(1)[0])
            self.fleet = SimulatedTraffic(
                self.place, str(self._site), self._n_cars, orders, fleet_seed, self._fidelity, duration_s
            )
        self.delivered_n, self.late_s = 0, 0.0
        nobody = np.zeros(self._n_cars, dtype=np.bool_)
        return self._infos(np.zeros((self._n_cars, len(TERMS))), nobody, nobody)

    def _resolved(self, actions: Mapping[str, Any]) -> npt.NDArray[np.int64]:
        return whole_numbers(actions, self.possible_agents)

    def _advance(self, resolved: npt.NDArray[np.int64]) -> tuple[dict[str, float], bool, Infos]:
        fleet = self.fleet
        assert fleet is not None
        view, place, weights = self._view, self.place, self._weights
        inside = (resolved >= 0) & (resolved < N_ACTIONS)
        legal = inside & (self._mask[self._cars, np.where(inside, resolved, 0)] == 1)
        state, goal, locked = view.state.copy(), view.goal.copy(), view.locked.copy()
        moves = legal & (resolved > 0)
        wanted = np.where(moves, place.move_to[state, np.where(moves, resolved - 1, 0)], state)
        fleet.forget()
        granted = fleet.move(wanted)
        after = np.where(granted, wanted, state)
        lost = moves & ~granted
        counts = fleet.counts
        self.delivered_n += int(counts.delivered.sum())
        self.late_s += float(counts.late.sum()) * TIMESTEP_S
        stands = (after == state) & (state != goal) & ~locked
        terms = np.zeros((self._n_cars, len(TERMS)))
        terms[:, 0] = weights.progress * self._gains(state, after, goal)
        terms[:, 1] = weights.delivered * counts.delivered
        terms[:, 2] = weights.waiting * stands
        terms[:, 3] = weights.lost * lost
        rewards = dict(zip(self.possible_agents, terms.sum(axis=1).tolist(), strict=True))
        return rewards, False, self._infos(terms, lost, ~legal)

    def _infos(self, terms: FloatArray, lost: npt.NDArray[np.bool_], illegal: npt.NDArray[np.bool_]) -> Infos:
        # Written out: with a thousand agents, naming the terms in a loop takes longer than all the rest of a step.
        told = zip(self.possible_agents, terms.tolist(), lost.tolist(), illegal.tolist(), strict=True)
        return {
            agent: {
                "progress": progress,
                "delivered": delivered,
                "waiting": waiting,
                "lost": loss,
                "waits": waits,
                "illegal": wrong,
            }
            for agent, (progress, delivered, waiting, loss), waits, wrong in told
        }

    def _gains(self, state: Ints, after: Ints, goal: Ints) -> npt.NDArray[np.int64]:
        """Moves by which each car is nearer to its goal than before, shape (n_cars,)."""
        row = np.where(goal != NONE, self.place.goal_row[goal], NONE)
        distance = self.place.floor.distance
        before, now = distance[row, state].astype(np.int64), distance[row, after].astype(np.int64)
        gains: npt.NDArray[np.int64] = np.where((row != NONE) & (now < UNREACHABLE), before - now, 0)
        return gains

    def _observations(self) -> dict[str, Any]:
        assert self.fleet is not None
        self._view = self.fleet.view()
        rows, masks = self._observer.look(self._view)
        self._mask = masks.copy()
        told = zip(self.possible_agents, rows, masks, strict=True)
        return {agent: {"observation": row, "action_mask": mask} for agent, row, mask in told}

    def _quick(self) -> Any:
        fleet = self.fleet.copy() if self.fleet is not None else None
        return fleet and (fleet, self.delivered_n, self.late_s)

    def _restore(self, quick: Any) -> bool:
        fleet, self.delivered_n, self.late_s = quick
        self._end()
        self.fleet = fleet.copy()
        return True

    def _picture(self) -> Picture:
        fleet, view = self.fleet, self._view
        assert fleet is not None
        goals = self.place.graph.state_pose[np.where(view.goal >= 0, view.goal, view.state), :2]
        return self._drawing.picture(fleet.poses(), np.isin(view.phase, (Phase.TO_DROP, Phase.UNLOADING)), goals)


parallel_env = TrafficEnv
"""The name that PettingZoo's modules have for it."""


def raw_env(**arguments: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the arguments are those of `TrafficEnv`."""
    return turn_based(TrafficEnv(**arguments))


def env(**arguments: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**arguments))
