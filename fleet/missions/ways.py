"""Ways: how far cars are from places, how long that takes, and what can be reached; and where cars are sent."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.missions.nearest_place import PlaceSearch
from fleet.missions.places import Place
from fleet.traffic.replanning import Traffic
from planners.mapf.distance_table import UNREACHABLE

STEP_S = 1.0
"""Time of one move in traffic [s]: cells are 1 m, and cars in traffic average 1 m/s."""
MOVE_S = 1.1
"""Time of a move without traffic that has to be kept: a cell of 1 m at 1 m/s, and some turns [s]."""
SLOW_MOVE_S = 3.3
"""Time of a move in dense traffic, three times that without [s]; what a battery has to last for."""
LOADED_RANK_S = 30.0
"""Head start of a loaded car over an empty one in the right of way, as seconds of waiting."""
EMERGENCY_RANK_S = 60.0
"""Head start of a car with a task of the class `emergency` [s]."""

States = npt.NDArray[np.int32] | npt.NDArray[np.int64]


class Ways:
    """Distances in moves on the lane graph past all that is blocked, for cars as they will stand when they have made
    the moves that are planned for them.

    Rules know places: states of the first kind of cars. Here these become states of a car's own kind, and back; ways
    from places, of whatever car, are those of the first kind.

    Args:
        traffic: Knows goals, blocked cells and distances.
        move_m: Length of a move: one cell [m].
    """

    def __init__(self, traffic: Traffic, move_m: float) -> None:
        self.move_m = move_m
        """Length of a move [m]."""
        self._traffic = traffic
        self._executor = traffic.executor
        self._n_places = traffic.graph.n_places
        self._alike = traffic.graph.n_kinds == 1
        kinds = self._executor.tail_states() // self._n_places
        self._first_of: npt.NDArray[np.int64] = kinds.astype(np.int64) * self._n_places
        """State of each car's kind that is place 0, shape (n_cars,)."""

    @property
    def n_states(self) -> int:
        """Places of the lane graph: states of one kind of cars."""
        return self._n_places

    # --- how far

    @property
    def tails(self) -> npt.NDArray[np.int32]:
        """State each car stands in when all its moves are done, shape (n_cars,), read-only."""
        return self._places(self._executor.tail_states())

    @property
    def ahead(self) -> npt.NDArray[np.int32]:
        """State up to which each car was granted moves: from there it can go anywhere, shape (n_cars,)."""
        return self._places(self._executor.granted_states())

    def _places(self, states: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """Places of states, each of a car's own kind; -1 stays."""
        return states if self._alike else np.where(states < 0, states, states % self._n_places).astype(np.int32)

    def _own(self, car: int, place: int) -> int:
        """The state of a car's kind at a place."""
        return place if self._alike else place + int(self._first_of[car])

    def moves(self, states: States, goal: int) -> npt.NDArray[np.uint16]:
        """Moves from each of some states to a goal, `UNREACHABLE` where there is no way, shape of `states`."""
        return self._traffic.tables.to(goal)[states]

    def moves_to(self, states: States, goals: npt.NDArray[np.int32]) -> npt.NDArray[np.uint16]:
        """Moves from all of some states to each of some goals, shape (n_goals, n_states), as `moves` has them."""
        rows, row = self._traffic.tables.rows(goals)
        found = [rows[of_goal].take(states) for of_goal in row.tolist()]
        return np.array(found, dtype=np.uint16).reshape(len(goals), len(states))

    def moves_each(self, states: States, goals: npt.NDArray[np.int32]) -> npt.NDArray[np.uint16]:
        """Moves from each state to the goal beside it, `UNREACHABLE` where there is no way, shape (n,)."""
        rows, row = self._traffic.tables.rows(goals)
        found: npt.NDArray[np.uint16] = rows[row, states]
        return found

    def reaches_each(self, states: States, goals: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Whether there is a way from each state to the goal beside it, past all that is blocked now, shape (n,)."""
        if not self._traffic.blocked.any():
            return self.joins(states, goals)  # which takes no row of distances for every goal
        reached: npt.NDArray[np.bool_] = self.moves_each(states, goals) < UNREACHABLE
        return reached

    def between(self, state: int, goal: int) -> int:
        """Moves from one state to another, `UNREACHABLE` if there is no way."""
        return int(self._traffic.tables.to(goal)[state])

    def of_car(self, car: int, goal: int) -> int:
        """Moves from where a car's way ends as far as it is planned to a goal, `UNREACHABLE` if there is no way."""
        return int(self._traffic.tables.to(self._own(car, goal))[self._executor.tail_states()[car]])

    def reaches(self, car: int, goal: int) -> bool:
        """Whether a car has a way to a goal."""
        return self.of_car(car, goal) < UNREACHABLE

    def place_search(self) -> PlaceSearch:
        """Searches for places past all that is blocked now."""
        return PlaceSearch(self._traffic.tables.graph, self._traffic.blocked)

    # --- how far from places

    def to_place(self, place: Place, states: States) -> npt.NDArray[np.float64]:
        """Moves from each of some states to a place, `UNREACHABLE` where there is no way, shape of `states`."""
        rows = [self._traffic.tables.to(goal)[states] for goal in place.states]
        return np.minimum.reduce(rows).astype(np.float64)

    def nearest_state(self, place: Place, state: int) -> int:
        """The state in which a car comes to a place soonest."""
        return min(place.states, key=lambda goal: (int(self._traffic.tables.to(goal)[state]), goal))

    def reaches_place(self, car: int, place: Place) -> bool:
        """Whether a car has a way to a place."""
        return any(self.reaches(car, goal) for goal in place.states)

    # --- where cars are sent

    @property
    def goals(self) -> npt.NDArray[np.int32]:
        """State each car was sent to, -1 = none, shape (n_cars,)."""
        return self._places(self._traffic.goals)

    @property
    def blocked(self) -> npt.NDArray[np.bool_]:
        """Cells nobody may be sent into, shape (n_cells,)."""
        return self._traffic.blocked

    @property
    def n_cuts(self) -> int:
        """Grows whenever something blocks cells for good, or does not any more."""
        return self._traffic.lanes.n_changes

    def joins(self, states: States, goals: States) -> npt.NDArray[np.bool_]:
        """Whether there is a way from each state to the goal beside it, but for what is blocked for now, shape (n,)."""
        return self._traffic.lanes.joins(states, goals)

    def cut_off(self, car: int, goal: int) -> bool:
        """Whether a car will never have a way to a goal, as far as is known."""
        return not bool(self.joins(self.tails[[car]], np.array([goal]))[0])

    def in_the_way(self, state: int, goal: int) -> int:
        """The first blocked cell on what would be the shortest way from a state to a goal, -1 if it is not known."""
        return self._traffic.obstacle(state, goal)

    def wreck_in(self, cell: int) -> int:
        """The dead car that blocks a cell, -1 if none does."""
        return int(self._traffic.wreck_of[cell])

    def send(self, car: int, goal: int, *, rank_s: float, stay: bool, tick: int) -> None:
        """Send a car to a goal.

        Args:
            car: The car.
            goal: A state.
            rank_s: Its head start in the right of way, as seconds of waiting.
            stay: Whether nobody may push it when it is there.
            tick: Present tick.
        """
        self._traffic.rank[car] = rank_s
        self._traffic.send(car, self._own(car, goal), stay=stay, tick=tick)

    def wait(self, car: int) -> None:
        """Leave a car where it comes to stand, until somebody pushes it on."""
        self._traffic.rank[car] = 0.0
        self._traffic.let_wait(car)

    def let_push(self, cars: npt.NDArray[np.intp]) -> None:
        """Let others push cars from their goals."""
        self._traffic.stay[cars] = False

    def has_come(self, car: int) -> bool:
        """Whether a car stands where it was sent."""
        return self.stands_at(car, int(self.goals[car]))

    def at_goals(self) -> npt.NDArray[np.bool_]:
        """Whether each car has made all its moves and is where it was sent, moving or not, shape (n_cars,)."""
        there: npt.NDArray[np.bool_] = (self.tails == self.goals) & self._executor.without_moves()
        return there

    def stands_at(self, car: int, state: int) -> bool:
        """Whether a car stands in a state, with no move left."""
        return bool(self._executor.tail_states()[car] == self._own(car, state)) and self._executor.idle(car)

    def idle(self, car: int) -> bool:
        """Whether a car has no move left and stands still."""
        return self._executor.idle(car)
