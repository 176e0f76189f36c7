"""Dispatch: a PettingZoo environment in which each car chooses its own tasks, and the classical fleet does the rest.

Routes, right of way, arms, parking and bookings of stations are those of any run. An episode begins with all cars
parked, one order for each car at once, and more that follow as a Poisson stream; it never terminates, and is truncated
for all agents after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... A step lasts `decision_s` of simulated time, so that episodes of all policies are equally
long. A car can choose when it has no task and a candidate is on offer; else its only legal action is 0.

Actions: `Discrete(candidates_n + 1)`: 0 = take nothing now, k = take the k-th candidate. Of cars that choose the same
task the one that waits longest for one gets it, of these the one with the lowest index; `infos[loser]["waits"]` is then
True. An illegal action counts as 0, and `infos[agent]["illegal"]` is True.

Candidates: of each pick station its most pressing ready task (by class, due date, release), then of each its second
most pressing one, nearer stations first, until all places are taken; listed by distance, the nearest first.

Observations: `{"observation": ..., "action_mask": ...}`. The mask holds 1 for each legal action. The numbers are all
clipped to [-1, 1]; distances in units of the longest way between any two places of the site, times in units of 300 s:

| about | entries |
|---|---|
| the car | x, y on the floor (-1 = west or south edge, 1 = east or north edge), cos and sin of its heading |
| | its phase, one-hot: has no task, drives to a pick station, is loaded, drives to a drop station, is unloaded |
| | waits for room at its station, distance to its goal, can choose |
| each candidate | there is one, distance to its pick station, distance from there to its drop station, age |
| | has a due date, time to spare if all went well (negative = it will be late), is urgent, is of the idle class |
| | tasks under way to its pick station and to its drop station / those it has room for |
| | cars without a task that are nearer to its pick station / 4 |
| the fleet | share of cars without a task, r / (r + cars) for r ready tasks and for r tasks that wait for a slot |
| | share of cars with a parcel, share of the ready tasks that are late, share of the episode that is left |

Rewards: the sum of the terms in `DispatchWeights`; `infos[agent]` holds each weighted term. `state()` is all cars'
numbers, one after the other.

Fidelity: `grid` is `fleet.envs.grid_fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet. Spaces, orders and rules are the same.
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
from fleet.envs.choices import resolve_choices, whole_numbers
from fleet.envs.dispatch_fleets import DispatchFleet, GridDispatch
from fleet.envs.dispatch_view import DispatchObserver, DispatchView
from fleet.envs.floor_drawing import FloorDrawing
from fleet.envs.grid_fleet import TIMESTEP_S
from fleet.envs.grid_kernel import NONE, Phase
from fleet.envs.order_streams import episode_orders
from fleet.envs.sites import check_site, is_whole, place_of
from fleet.world.protocol import FloatArray
from maps.site import Site


@dataclass(frozen=True, kw_only=True)
class DispatchWeights:
    """What things are worth."""

    delivered: float = 1.0
    """Per parcel that the car has delivered."""
    late: float = -0.1
    """Per minute by which a parcel that the car has delivered was late."""
    empty: float = -0.01
    """Per move that the car made on its way to a pick station."""
    waiting: float = -0.01
    """Per minute that an order has waited to be picked, shared by all cars."""
    lost: float = -0.01
    """For a choice that another car got."""


TERMS = ("delivered", "late", "empty", "waiting", "lost")
"""Names of the terms."""
LOADED = (Phase.TO_DROP, Phase.UNLOADING)
"""Phases of a car with a parcel."""


class DispatchEnv(FleetEnv):
    """A fleet whose cars choose their tasks; see the module's description.

    Args:
        site: Name of a shipped site, path of a site file, or, with fidelity `grid`, a site.
        n_cars: Number of cars.
        candidates_n: Tasks that a car can choose from.
        fidelity: `grid`, `kinematic` or `physics`.
        load: Orders, as a multiple of what the cars could carry if none was ever in the way of another.
        decision_s: Simulated time of a step [s], a whole number.
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
        candidates_n: int = 8,
        fidelity: str = "grid",
        load: float = 1.5,
        decision_s: float = 5.0,
        max_cycles: int = 240,
        seed: int = 0,
        weights: DispatchWeights | None = None,
        render_mode: str | None = None,
    ) -> None:
        arguments = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        check_site(site, fidelity, n_cars)
        require(is_whole(candidates_n) and 1 <= candidates_n <= 64, "candidates_n", candidates_n, "1 to 64")
        require(math.isfinite(load) and 0 < load <= 100, "load", load, "a number > 0, at most 100")
        whole = math.isfinite(decision_s) and decision_s >= TIMESTEP_S and decision_s % TIMESTEP_S == 0
        require(whole, "decision_s", decision_s, "a whole number of seconds, >= 1")
        self.place = place_of(site)
        """Site, lane graph and distances."""
        self.observer = DispatchObserver(self.place, candidates_n)
        space = Dict(
            {
                "observation": Box(-1.0, 1.0, (self.observer.row_n,), np.float32),
                "action_mask": Box(0, 1, (candidates_n + 1,), np.int8),
            }
        )
        cars = [f"car_{car}" for car in range(n_cars)]
        super().__init__(
            name="dispatch_v0",
            arguments=arguments,
            observation_spaces=dict.fromkeys(cars, space),
            action_spaces={car: Discrete(candidates_n + 1) for car in cars},
            max_cycles=max_cycles,
            fps=1.0,
            seed=seed,
            render_mode=render_mode,
        )
        self.state_space = Box(-1.0, 1.0, (n_cars * self.observer.row_n,), np.float32)
        self.fleet: DispatchFleet | None = None
        """The episode's fleet; None before the first `reset`."""
        self.delivered_n = 0
        """Deliveries of the episode."""
        self.late_s = 0.0
        """Time by which they were late, together [s]."""
        self._fidelity = Fidelity(fidelity)
        self._site, self._n_cars, self._load, self._decision_s = site, n_cars, load, decision_s
        self._weights = weights or DispatchWeights()

    def state(self) -> npt.NDArray[np.float32]:
        """All cars' numbers; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self.fleet is None:
            raise EpisodeError("state: there was no episode yet; valid: reset() first")
        return self.observer.look(self._view)[0].ravel()

    @property
    def view(self) -> DispatchView:
        """The fleet at the last observation, for policies that are not told by rows of numbers."""
        return self._view

    @property
    def candidates(self) -> npt.NDArray[np.int32]:
        """The task that each candidate of each car is, -1 for none, shape (n_cars, candidates_n)."""
        return self._candidates

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
        duration_s = self.max_cycles * self._decision_s
        orders = episode_orders(self.place, self._n_cars, self._load, duration_s, np.random.default_rng(of_orders))
        fleet_seed = int(of_fleet.generate_state(1)[0])
        if self._fidelity is Fidelity.GRID:
            self.fleet = GridDispatch(self.place, self._n_cars, orders, fleet_seed)
        else:
            from fleet.envs.dispatch_simulation import SimulatedDispatch

            self.fleet = SimulatedDispatch(
                self.place, str(self._site), self._n_cars, orders, fleet_seed, self._fidelity, duration_s
            )
        self.delivered_n, self.late_s = 0, 0.0
        self._idle_n = np.zeros(self._n_cars, dtype=np.int64)
        nobody = np.zeros(self._n_cars, dtype=np.bool_)
        return self._infos(np.zeros((self._n_cars, len(TERMS))), nobody, nobody)

    def _resolved(self, actions: Mapping[str, Any]) -> npt.NDArray[np.int64]:
        return whole_numbers(actions, self.possible_agents)

    def _advance(self, resolved: npt.NDArray[np.int64]) -> tuple[dict[str, float], bool, Infos]:
        fleet = self.fleet
        assert fleet is not None
        n, cars = self._n_cars, np.arange(self._n_cars)
        inside = (resolved >= 0) & (resolved < self._mask.shape[1])
        legal = inside & (self._mask[cars, np.where(inside, resolved, 0)] == 1)
        choice = np.where(legal, resolved, 0)
        wanted = np.where(choice > 0, self._candidates[cars, choice - 1], NONE)
        won = resolve_choices(wanted, self._idle_n)
        lost = (wanted != NONE) & ~won
        self._idle_n = np.where(self._view.free & ~won, self._idle_n + 1, 0)
        fleet.forget()
        fleet.give([(int(car), int(wanted[car])) for car in np.flatnonzero(won)])
        fleet.run(self._decision_s)
        counts, weights = fleet.counts, self._weights
        self.delivered_n += int(counts.delivered.sum())
        self.late_s += float(counts.late.sum()) * TIMESTEP_S
        terms = np.empty((n, len(TERMS)))
        terms[:, 0] = weights.delivered * counts.delivered
        terms[:, 1] = weights.late * counts.late * (TIMESTEP_S / 60.0)
        terms[:, 2] = weights.empty * counts.empty
        terms[:, 3] = weights.waiting * counts.open[0] * (TIMESTEP_S / 60.0) / n
        terms[:, 4] = weights.lost * lost
        rewards = dict(zip(self.possible_agents, terms.sum(axis=1).tolist(), strict=True))
        return rewards, False, self._infos(terms, lost, ~legal)

    def _infos(self, terms: FloatArray, lost: npt.NDArray[np.bool_], illegal: npt.NDArray[np.bool_]) -> Infos:
        told = zip(self.possible_agents, terms.tolist(), lost.tolist(), illegal.tolist(), strict=True)
        return {
            agent: {**dict(zip(TERMS, own, strict=True)), "waits": waits, "illegal": wrong}
            for agent, own, waits, wrong in told
        }

    def _observations(self) -> dict[str, Any]:
        assert self.fleet is not None
        self._view = self.fleet.view(max(0.0, 1.0 - self.steps_n / self.max_cycles))
        rows, masks, self._candidates = self.observer.look(self._view)
        self._mask = masks.copy()
        told = zip(self.possible_agents, rows, masks, strict=True)
        return {agent: {"observation": row, "action_mask": mask} for agent, row, mask in told}

    def _quick(self) -> Any:
        fleet = self.fleet.copy() if self.fleet is not None else None
        return fleet and (fleet, self.delivered_n, self.late_s, self._idle_n.copy())

    def _restore(self, quick: Any) -> bool:
        fleet, self.delivered_n, self.late_s, idle_n = quick
        self._end()
        self.fleet, self._idle_n = fleet.copy(), idle_n.copy()
        return True

    def _picture(self) -> Picture:
        view = self._view
        goals = self.place.graph.state_pose[np.where(view.goal >= 0, view.goal, view.state), :2]
        return self._drawing.picture(view.pose, np.isin(view.phase, LOADED), goals)


parallel_env = DispatchEnv
"""The name that PettingZoo's modules have for it."""


def raw_env(**arguments: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the arguments are those of `DispatchEnv`."""
    return turn_based(DispatchEnv(**arguments))


def env(**arguments: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**arguments))
