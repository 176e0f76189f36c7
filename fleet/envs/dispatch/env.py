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

Fidelity: `grid` is `fleet.envs.grid.fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet. Spaces, orders and rules are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.config import Fidelity, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.base import Infos, in_order, turn_based
from fleet.envs.core.choices import resolve_choices
from fleet.envs.core.weights import check_weights, require_weights
from fleet.envs.dispatch.fleets import DispatchFleet, GridDispatch
from fleet.envs.dispatch.view import DispatchObserver, DispatchView
from fleet.envs.grid.fleet import TIMESTEP_S
from fleet.envs.grid.kernel import NONE
from fleet.envs.layers.layer import Bools, Int64Array, LayerEnv
from fleet.envs.layers.sites import check_site, place_of
from fleet.tasks.order import Delivery
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

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = ("delivered", "late", "empty", "waiting", "lost")
"""Names of the terms."""


class DispatchEnv(LayerEnv[DispatchView]):
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
        render_mode: `rgb_array`, `human` (a window, if there is a display), `rerun` (a recording in `record_to` per
            episode) or None.
        record_to: Folder for recordings of render mode `rerun`; None = `runs/dispatch_v0`.

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
        record_to: str | Path | None = None,
    ) -> None:
        arguments = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        require_weights(weights, DispatchWeights)
        check_site(site, fidelity, n_cars)
        require(is_whole(candidates_n) and 1 <= candidates_n <= 64, "candidates_n", candidates_n, "1 to 64")
        whole = is_number(decision_s) and decision_s >= TIMESTEP_S and decision_s % TIMESTEP_S == 0
        require(whole, "decision_s", decision_s, "a whole number of seconds, >= 1")
        place = place_of(site)
        self.observer = DispatchObserver(place, candidates_n)
        """Describes the fleet, and prices its tasks."""
        super().__init__(
            name="dispatch_v0",
            arguments=arguments,
            place=place,
            terms_n=len(TERMS),
            row_n=self.observer.row_n,
            n_actions=candidates_n + 1,
            step_s=float(decision_s),
        )
        self.fleet: DispatchFleet | None
        self.candidates = np.full((n_cars, candidates_n), NONE, dtype=np.int32)
        """The task that each candidate of each car is, -1 for none, shape (n_cars, candidates_n)."""
        self._weights = weights or DispatchWeights()
        self._idle_n = np.zeros(n_cars, dtype=np.int64)

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> DispatchFleet:
        self._idle_n[:] = 0
        if self._fidelity is Fidelity.GRID:
            return GridDispatch(self.place, self._n_cars, orders, seed)
        from fleet.envs.dispatch.simulation import SimulatedDispatch

        site = str(self._arguments["site"])
        return SimulatedDispatch(self.place, site, self._n_cars, orders, seed, self._fidelity, duration_s)

    def _look(self) -> DispatchView:
        assert self.fleet is not None
        return self.fleet.view(max(0.0, 1.0 - self.steps_n / self.max_cycles))

    def _rows_now(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        rows, masks, self.candidates = self.observer.look(self.view)
        return rows, masks

    def _play(self, choice: Int64Array) -> tuple[FloatArray, Bools]:
        fleet, weights = self.fleet, self._weights
        assert fleet is not None
        wanted = np.where(choice > 0, self.candidates[self._cars, choice - 1], NONE)
        won = resolve_choices(wanted, self._idle_n)
        lost = (wanted != NONE) & ~won
        self._idle_n = np.where(self.view.free & ~won, self._idle_n + 1, 0)
        fleet.give([(int(car), int(wanted[car])) for car in np.flatnonzero(won)])
        fleet.run(self._step_s)
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
        return quick and (*quick, self._idle_n.copy())

    def _restore(self, quick: Any) -> bool:
        self._idle_n = quick[3].copy()
        return super()._restore(quick)


parallel_env = DispatchEnv
"""The name that PettingZoo's modules have for it."""


def raw_env(**arguments: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the arguments are those of `DispatchEnv`."""
    return turn_based(DispatchEnv(**arguments))


def env(**arguments: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**arguments))
