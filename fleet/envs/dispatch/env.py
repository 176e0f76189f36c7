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
most pressing one, nearer stations first, until all places are taken; listed by distance, the nearest first. An order
that can be had at several pick stations (`stream.sources_n`) has a task at each, and who is given one of them has the
order: the others are gone. So cars choose where to fetch it; two that choose tasks of one order choose the same.

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
| | what waits at its pick station (tasks that nobody has; r of them are told as r / (r + cars)): all of them; the |
| | least time to spare of any if the arm did nothing but serve the cars under way to it and then these, one after the |
| | other, the most pressing first (1 = plenty); late ones; those with less than two minutes to spare by the same |
| | reckoning; the place of the first late one in this line |
| | the first three of these of its drop station |
| the fleet | share of cars without a task, r / (r + cars) for r ready tasks |
| | share of cars with a parcel, share of the ready tasks that are late, share of the episode that is left |

Breakdowns (`breakdowns_per_h`; none as it comes, and none of a car that is served): a car stands where it is for a time
that nobody knows, on average `repair_s`, and who is behind it waits. It gives back the task that it has not picked yet,
which other cars can choose again, keeps a parcel that it has, and sees none of the phases. After some of the breakdowns
(`lost_share`) a car parks instead, and takes no task any more. They are the seed's, whatever the agents do.

Batteries (`battery_s`; none as it comes): a car uses its charge up while it has a task and is not held back, or else,
without one, goes to a charger of the site if one is left and its battery is not full. So 0 is also to charge, and cars
choose when. Who has less than 20 % when its task is done can choose nothing until it has 60 %, sees none of the phases,
and takes the charger of one that could choose. Two more numbers stand behind those of the fleet: the car's charge, and
the share of the chargers that nobody has. The first car begins full, the last one with 60 %, those between in steps.

Rewards: the sum of the terms in `DispatchWeights`; `infos[agent]` holds each weighted term. `state()` is all cars'
numbers, one after the other.

Fidelity: `grid` is `fleet.abstract.fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet. Spaces, orders and rules are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import NO_BATTERY, NONE, Battery, Faults
from fleet.arrays import FloatArray
from fleet.config import Fidelity, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.base import Infos, in_order, turn_based
from fleet.envs.core.choices import resolve_choices
from fleet.envs.core.weights import check_weights
from fleet.envs.dispatch.fleets import DispatchFleet, GridDispatch
from fleet.envs.dispatch.view import DispatchObserver, DispatchView
from fleet.envs.layers.layer import Bools, Int64Array, LayerEnv
from fleet.envs.layers.layer_config import LayerConfig
from fleet.envs.layers.sites import place_of
from fleet.tasks.order import Delivery


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

    def __post_init__(self) -> None:
        check_weights(self)


MOST_PER_H, MOST_REPAIR_S = 3600.0, 1e6
"""The greatest rate of breakdowns [1/h] and the longest repair [s]."""
MOST_BATTERY_S = 1e6
"""The longest time that a battery lasts or is charged [s]."""
ONLY_GRID = "0 but for fidelity grid"
TERMS = ("delivered", "late", "empty", "waiting", "lost")
"""Names of the terms."""


@dataclass(frozen=True, kw_only=True)
class DispatchConfig(LayerConfig):
    """Settings of `DispatchEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "dispatch_v1"
    WEIGHTS: ClassVar[type] = DispatchWeights

    candidates_n: int = 8
    """Tasks that a car can choose from."""
    decision_s: float = 5.0
    """Simulated time of a step [s], a whole number."""
    breakdowns_per_h: float = 0.0
    """Breakdowns of each car in an hour, on average; fidelity `grid` alone."""
    repair_s: float = 120.0
    """For how long a car stands then, on average [s]."""
    lost_share: float = 0.0
    """Part of the breakdowns of cars without a parcel after which the car takes no task any more."""
    battery_s: float = 0.0
    """Time with tasks for which a full battery lasts [s]; 0 = cars have no batteries. Fidelity `grid` alone."""
    charge_s: float = 300.0
    """Time in which an empty battery is charged [s]."""
    max_cycles: int = 240
    """Steps after which an episode is truncated."""
    weights: DispatchWeights | None = None
    """What things are worth; None = as `DispatchWeights` has it."""

    def __post_init__(self) -> None:
        candidates_ok = is_whole(self.candidates_n) and 1 <= self.candidates_n <= 64
        require(candidates_ok, "candidates_n", self.candidates_n, "1 to 64")
        decision_s = self.decision_s
        whole = is_number(decision_s) and decision_s >= TIMESTEP_S and decision_s % TIMESTEP_S == 0
        require(whole, "decision_s", decision_s, "a whole number of seconds, >= 1")
        rate_ok = is_number(self.breakdowns_per_h) and 0 <= self.breakdowns_per_h <= MOST_PER_H
        require(rate_ok, "breakdowns_per_h", self.breakdowns_per_h, f"a number from 0 to {MOST_PER_H:g}")
        repair_ok = is_number(self.repair_s) and 0 < self.repair_s <= MOST_REPAIR_S
        require(repair_ok, "repair_s", self.repair_s, f"a number > 0, at most {MOST_REPAIR_S:g}")
        lost_ok = is_number(self.lost_share) and 0 <= self.lost_share <= 1
        require(lost_ok, "lost_share", self.lost_share, "a number from 0 to 1")
        battery_ok = is_number(self.battery_s) and 0 <= self.battery_s <= MOST_BATTERY_S
        require(battery_ok, "battery_s", self.battery_s, f"a number from 0 to {MOST_BATTERY_S:g}")
        charge_ok = is_number(self.charge_s) and 0 < self.charge_s <= MOST_BATTERY_S
        require(charge_ok, "charge_s", self.charge_s, f"a number > 0, at most {MOST_BATTERY_S:g}")
        super().__post_init__()
        on_grid = self.fidelity == Fidelity.GRID
        n = self.order_stream.sources_n
        require(on_grid or n == 1, "stream.sources_n", n, "1 but for fidelity grid, where agents choose the source")
        require(on_grid or not self.breakdowns_per_h, "breakdowns_per_h", self.breakdowns_per_h, ONLY_GRID)
        require(on_grid or not self.battery_s, "battery_s", self.battery_s, ONLY_GRID)
        chargers_ok = not self.battery_s or bool(self.place.chargers)
        require(chargers_ok, "battery_s", self.battery_s, f"0 as site {self.place.name} has no chargers")

    @property
    def faults(self) -> Faults:
        """How often cars break down."""
        return Faults(
            rate=self.breakdowns_per_h * TIMESTEP_S / 3600.0,
            mean_steps=self.repair_s / TIMESTEP_S,
            lost_share=float(self.lost_share),
        )

    @property
    def battery(self) -> Battery:
        """How fast batteries empty and fill."""
        if not self.battery_s:
            return NO_BATTERY
        return Battery(drain=TIMESTEP_S / self.battery_s, gain=TIMESTEP_S / self.charge_s)

    @property
    def step_s(self) -> float:
        """Simulated time of a step [s]."""
        return float(self.decision_s)


class DispatchEnv(LayerEnv[DispatchView]):
    """A fleet whose cars choose their tasks; see the module's description.

    Args:
        config: All settings.
    """

    config: DispatchConfig
    fleet: DispatchFleet | None

    def __init__(self, config: DispatchConfig) -> None:
        place = place_of(config.site)
        self.observer = DispatchObserver(place, config.candidates_n, batteries=bool(config.battery_s))
        """Describes the fleet, and prices its tasks."""
        super().__init__(
            config,
            place,
            n_terms=len(TERMS),
            n_numbers=self.observer.n_numbers,
            n_actions=config.candidates_n + 1,
        )
        self.candidates = np.full((config.n_cars, config.candidates_n), NONE, dtype=np.int32)
        """The task that each candidate of each car is, -1 for none, shape (n_cars, candidates_n)."""
        self._weights = config.weights or DispatchWeights()
        self._idle_steps = np.zeros(config.n_cars, dtype=np.int64)

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> DispatchFleet:
        self._idle_steps[:] = 0
        if self.config.fidelity == Fidelity.GRID:
            return GridDispatch(self.place, self._n_cars, orders, seed, self.config.faults, self.config.battery)
        from fleet.envs.dispatch.simulation import SimulatedDispatch

        site, fidelity = str(self.config.site), Fidelity(self.config.fidelity)
        return SimulatedDispatch.begun(self.place, site, self._n_cars, orders, seed, fidelity, duration_s)

    def _look(self) -> DispatchView:
        assert self.fleet is not None
        return self.fleet.view(max(0.0, 1.0 - self.n_steps / self.max_cycles))

    def _rows_now(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        rows, masks, self.candidates = self.observer.look(self.view)
        return rows, masks

    def _play(self, choice: Int64Array) -> tuple[FloatArray, Bools]:
        fleet, weights = self.fleet, self._weights
        assert fleet is not None
        wanted = np.where(choice > 0, self.candidates[self._cars, choice - 1], NONE)
        order, choosing = wanted.copy(), np.flatnonzero(wanted != NONE)
        order[choosing] = self.view.order[np.searchsorted(self.view.task, wanted[choosing])]
        won = resolve_choices(order, self._idle_steps)
        lost = (wanted != NONE) & ~won
        self._idle_steps = np.where(self.view.free & ~won, self._idle_steps + 1, 0)
        fleet.give([(int(car), int(wanted[car])) for car in np.flatnonzero(won)])
        fleet.run(self.config.step_s)
        counts, minutes = fleet.counts, TIMESTEP_S / 60.0
        terms = np.empty((self._n_cars, len(TERMS)))
        terms[:, 0] = weights.delivered * counts.delivered
        terms[:, 1] = weights.late * counts.late * minutes
        terms[:, 2] = weights.empty * counts.empty
        terms[:, 3] = weights.waiting * counts.open[0] * minutes / self._n_cars
        terms[:, 4] = weights.lost * lost
        return terms, lost

    def _infos(self, terms: FloatArray, waits: Bools, illegal: Bools) -> Infos:
        told = zip(self.possible_agents, terms.tolist(), waits.tolist(), illegal.tolist(), strict=True)
        # Written out: naming the terms in a loop takes three times as long.
        return {
            agent: {
                "delivered": own[0],
                "late": own[1],
                "empty": own[2],
                "waiting": own[3],
                "lost": own[4],
                "waits": has_lost,
                "illegal": wrong,
            }
            for agent, own, has_lost, wrong in told
        }

    def _quick(self) -> Any:
        quick = super()._quick()
        return quick and (*quick, self._idle_steps.copy())

    def _restore(self, quick: Any) -> bool:
        self._idle_steps = quick[3].copy()
        return super()._restore(quick)


def parallel_env(**settings: Any) -> DispatchEnv:
    """Make the environment; the settings are those of `DispatchConfig`."""
    return DispatchEnv(DispatchConfig.of(settings))


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `DispatchConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))
