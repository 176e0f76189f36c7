"""Traffic: a PettingZoo environment in which each car chooses its lane moves, and the classical fleet does the rest.

Which car gets which task, bookings of stations, parking and arms are those of any run. An episode begins with all cars
parked, one order for each car at once, and more that follow as a Poisson stream; it never terminates, and is truncated
for all agents after `max_cycles` steps.

Agents: `car_0`, `car_1`, ... A step is one timestep of 1 s, in which a car goes one move of the lane graph at most. A
car can choose when it has made its last move but one, and is not served at a dock; else its only legal action is 0.

Actions: `Discrete(5)`: 0 = wait, 1 = straight on, 2 = left, 3 = right, 4 = reverse, where the lanes allow it. They are
wishes, which become moves by priority inheritance with backtracking (CS-PIBT: `planners.mapf.pibt.Stepper`): by
priority, each car is given what it wishes for, or the best that is left; a car that stands in its way and has
not decided yet is pushed, which is to decide at once, again by its own wish first. Whatever agents choose, no two cars
meet, and rings of followers stay. The priority is the time since a car was given its goal, 30 s more for a car with a
parcel and 60 s more for an urgent task; cars that are where they should be come last.

Of a car that was not granted its wish, `infos[agent]["waits"]` is True if it stands, and `infos[agent]["pushed"]` if it
goes where it did not wish to. An illegal action counts as 0, and `infos[agent]["illegal"]` is True.

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
| 16 | PIBT would let it wait |
| 17-18 | the best move of another car leads into its cell, and that car has a higher priority |
| 19-54 | nine for each move (straight, left, right, reverse): it is legal; moves it saves / 10; its cell is occupied,
by a car that has no reason to go on by itself; other cars that could enter it / 3; the best move of one of them
does; a car whose best move it is has a higher priority; PIBT would make it; share of the next 6 cells of the way
behind it that are occupied |
| 55-254 | eight for each of the 5 x 5 cells from one behind to three ahead, each row from the left: no lane leads
there; a car is there; its heading (cos, sin); where its best move leads (cos, sin), zeros = it has none; it has
none; its priority less the own one / 60 s |

Directions are relative to the car's own heading, 0 = ahead and anticlockwise. A car's best move is the one that brings
it nearest to its goal if it were alone; locked cars and those that are where they should be have none. What PIBT
would do is the move that the car makes if all cars wish for theirs. The parts are the slices `OWN`, `MOVES` and
`CELLS` of `fleet.envs.traffic.view`, with `N_OWN`, `N_PER_MOVE` and `N_PER_CELL` numbers each.

Rewards: the sum of the terms in `TrafficWeights`; `infos[agent]` holds each weighted term. `state()` is all cars'
numbers, one after the other. Of an episode, `n_delivered`, `n_waits` (wishes to move that came to nothing) and
`jammed` (nothing was delivered in the last 100 s) are told by the environment.

Fidelity: `grid` is `fleet.abstract.fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet, whose cars make granted moves at their own speed. Spaces, orders and rules are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import N_KINDS, TIMESTEP_S, FleetSite
from fleet.abstract.kernel import NONE, Ints
from fleet.arrays import FloatArray
from fleet.config import Fidelity, require
from fleet.config.field_checks import is_number
from fleet.envs.core.base import Infos
from fleet.envs.core.weights import check_weights
from fleet.envs.layers.layer import Bools, Int64Array, LayerEnv
from fleet.envs.layers.layer_config import LayerConfig
from fleet.envs.layers.sites import place_of
from fleet.envs.traffic.fleets import GridTraffic, TrafficFleet
from fleet.envs.traffic.view import N_ROW_NUMBERS, TrafficObserver, TrafficView
from fleet.tasks.order import Delivery
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
    """For a wish that was not granted, to be pushed included."""
    blocking: float = -0.05
    """Per timestep that a car waits by its own choice where another one wished to go, and is not pushed away."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = ("progress", "delivered", "waiting", "lost", "blocking")
"""Names of the terms."""
JAM_S = 100.0
"""Time without a delivery after which a fleet counts as jammed [s]."""


@dataclass(frozen=True, kw_only=True)
class TrafficEnvConfig(LayerConfig):
    """Settings of `TrafficEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "traffic_v1"
    WEIGHTS: ClassVar[type] = TrafficWeights

    max_cycles: int = 500
    """Steps after which an episode is truncated."""
    weights: TrafficWeights | None = None
    """What things are worth; None = as `TrafficWeights` has it."""
    team_share: float = 0.0
    """Share of the reward for a parcel that all cars are given alike, 0 to 1; the rest is its car's."""

    def __post_init__(self) -> None:
        super().__post_init__()
        share_ok = is_number(self.team_share) and 0 <= self.team_share <= 1
        require(share_ok, "team_share", self.team_share, "a number from 0 to 1")

    @property
    def step_s(self) -> float:
        """Simulated time of a step [s]."""
        return TIMESTEP_S

    @property
    def floor(self) -> FleetSite:
        """Site, lane graph and distances."""
        return place_of(self.site)


class TrafficEnv(LayerEnv[TrafficView]):
    """A fleet whose cars choose their moves; see the module's description.

    Args:
        config: All settings.
    """

    config: TrafficEnvConfig
    fleet: TrafficFleet | None

    def __init__(self, config: TrafficEnvConfig) -> None:
        place = config.floor
        super().__init__(config, place, n_terms=len(TERMS), n_numbers=N_ROW_NUMBERS, n_actions=1 + N_KINDS)
        self.n_waits = 0
        """Timesteps of cars that stood although they wished to move, of the episode."""
        self._delivered_step = 0
        self._observer = TrafficObserver(place, config.n_cars)
        self._weights = config.weights or TrafficWeights()
        self._pushed = np.zeros(config.n_cars, dtype=np.bool_)

    @property
    def jammed(self) -> bool:
        """Whether nothing was delivered in the last `JAM_S` of the episode."""
        return self.n_steps - self._delivered_step >= JAM_S / TIMESTEP_S

    def _begin(self, seed: int) -> Infos:
        self.n_waits = self._delivered_step = 0
        self._pushed[:] = False
        return super()._begin(seed)

    def _quick(self) -> Any:
        quick = super()._quick()
        return quick and (*quick, self.n_waits, self._delivered_step)

    def _restore(self, quick: Any) -> bool:
        self.n_waits, self._delivered_step = quick[3:]
        return super()._restore(quick)

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> TrafficFleet:
        if self.config.fidelity == Fidelity.GRID:
            return GridTraffic(self.place, self._n_cars, orders)
        from fleet.envs.traffic.simulation import SimulatedTraffic

        site, fidelity = str(self.config.site), Fidelity(self.config.fidelity)
        return SimulatedTraffic.begun(site, self._n_cars, orders, seed, fidelity, duration_s)

    def _look(self) -> TrafficView:
        assert self.fleet is not None
        return self.fleet.view()

    def _rows_now(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        return self._observer.look(self.view)

    def _play(self, choice: Int64Array) -> tuple[FloatArray, Bools]:
        fleet, view, weights = self.fleet, self.view, self._weights
        assert fleet is not None
        # Copies: on the grid the view shows the fleet itself, which is about to change.
        state, goal, locked = view.state.copy(), view.goal.copy(), view.locked.copy()
        wanted = np.where(choice > 0, self.place.move_to[state, choice - 1], state)
        after = fleet.move(wanted)
        granted, stands = after == wanted, after == state
        waits, delivered = stands & ~granted, fleet.counts.delivered
        self.n_waits += int(waits.sum())
        if delivered.any():
            self._delivered_step = self.n_steps + 1
        share = float(self.config.team_share)
        terms = np.empty((self._n_cars, len(TERMS)))
        terms[:, 0] = weights.progress * self._gains(state, after, goal)
        terms[:, 1] = weights.delivered * ((1.0 - share) * delivered + share * delivered.mean())
        terms[:, 2] = weights.waiting * (stands & (state != goal) & ~locked)
        terms[:, 3] = weights.lost * ~granted
        terms[:, 4] = weights.blocking * (stands & granted & ~locked & self._in_the_way(state, wanted))
        self._pushed = ~stands & ~granted
        return terms, waits

    def _infos(self, terms: FloatArray, waits: Bools, illegal: Bools) -> Infos:
        # Written out: with a thousand agents, naming the terms in a loop takes longer than all the rest of a step.
        columns = (terms, waits, self._pushed, illegal)
        told = zip(self.possible_agents, *(column.tolist() for column in columns), strict=True)
        return {
            agent: {
                "progress": own[0],
                "delivered": own[1],
                "waiting": own[2],
                "lost": own[3],
                "blocking": own[4],
                "waits": stays,
                "pushed": pushed,
                "illegal": wrong,
            }
            for agent, own, stays, pushed, wrong in told
        }

    def _in_the_way(self, state: Ints, wanted: Ints) -> Bools:
        """Cars that stand where another one wished to go, shape (n_cars,)."""
        cell = self.place.graph.state_cell
        asked = np.zeros(self.place.graph.n_cells, dtype=np.bool_)
        asked[cell[wanted[wanted != state]]] = True
        in_the_way: Bools = asked[cell[state]]
        return in_the_way

    def _gains(self, state: Ints, after: Ints, goal: Ints) -> npt.NDArray[np.int64]:
        """Moves by which each car is nearer to its goal than before, shape (n_cars,)."""
        row = np.where(goal != NONE, self.place.goal_row[goal], NONE)
        distance = self.place.floor.distance
        before, now = distance[row, state].astype(np.int64), distance[row, after].astype(np.int64)
        gains: npt.NDArray[np.int64] = np.where((row != NONE) & (now < UNREACHABLE), before - now, 0)
        return gains


def parallel_env(**settings: Any) -> TrafficEnv:
    """Make the environment; the settings are those of `TrafficEnvConfig`."""
    return TrafficEnv(TrafficEnvConfig.of(settings))
