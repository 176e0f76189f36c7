"""Traffic: a PettingZoo environment in which each car chooses its lane moves, and the classical fleet does the rest.

Which car gets which task, bookings of stations, parking and arms are those of any run. An episode begins with all cars
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

Fidelity: `grid` is `fleet.envs.grid.fleet`, thousands of times faster than real time; `kinematic` and `physics` run
the whole fleet, whose cars make granted moves at their own speed. Spaces, orders and rules are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.config import Fidelity
from fleet.envs.core.base import Infos, in_order, turn_based
from fleet.envs.core.weights import check_weights
from fleet.envs.grid.fleet import N_KINDS, TIMESTEP_S
from fleet.envs.grid.kernel import NONE, Ints
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
    """For a move that was not granted."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = ("progress", "delivered", "waiting", "lost")
"""Names of the terms."""


@dataclass(frozen=True, kw_only=True)
class TrafficEnvConfig(LayerConfig):
    """Settings of `TrafficEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "traffic_v0"
    WEIGHTS: ClassVar[type] = TrafficWeights

    max_cycles: int = 500
    """Steps after which an episode is truncated."""
    weights: TrafficWeights | None = None
    """What things are worth; None = as `TrafficWeights` has it."""

    @property
    def step_s(self) -> float:
        """Simulated time of a step [s]."""
        return TIMESTEP_S


class TrafficEnv(LayerEnv[TrafficView]):
    """A fleet whose cars choose their moves; see the module's description.

    Args:
        config: All settings.
    """

    config: TrafficEnvConfig
    fleet: TrafficFleet | None

    def __init__(self, config: TrafficEnvConfig) -> None:
        place = place_of(config.site)
        super().__init__(config, place, n_terms=len(TERMS), n_numbers=N_ROW_NUMBERS, n_actions=1 + N_KINDS)
        self._observer = TrafficObserver(place)
        self._weights = config.weights or TrafficWeights()

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
        granted = fleet.move(wanted)
        after = np.where(granted, wanted, state)
        terms = np.empty((self._n_cars, len(TERMS)))
        terms[:, 0] = weights.progress * self._gains(state, after, goal)
        terms[:, 1] = weights.delivered * fleet.counts.delivered
        terms[:, 2] = weights.waiting * ((after == state) & (state != goal) & ~locked)
        terms[:, 3] = weights.lost * ~granted
        return terms, ~granted

    def _infos(self, terms: FloatArray, waits: Bools, illegal: Bools) -> Infos:
        # Written out: with a thousand agents, naming the terms in a loop takes longer than all the rest of a step.
        told = zip(self.possible_agents, terms.tolist(), waits.tolist(), illegal.tolist(), strict=True)
        return {
            agent: {
                "progress": own[0],
                "delivered": own[1],
                "waiting": own[2],
                "lost": own[3],
                "waits": has_lost,
                "illegal": wrong,
            }
            for agent, own, has_lost, wrong in told
        }

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


def raw_env(**settings: Any) -> Any:
    """Make the environment in turn-based (AEC) form; the settings are those of `TrafficEnvConfig`."""
    return turn_based(parallel_env(**settings))


def env(**settings: Any) -> Any:
    """Make the turn-based environment that complains about calls in a wrong order."""
    return in_order(raw_env(**settings))
