"""Lifelong: robots on an open floor, each sent from one cell to the next for as long as the episode lasts.

The floor of a published map becomes what the traffic layer knows of a site: its lane graph is that of pebbles, whose
moves are called straight (east), left (north), right (south) and reverse (west), since a pebble has no heading and all
of them count as heading east.
"""

from __future__ import annotations

import copy
from typing import Self

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import FleetSite
from fleet.abstract.kernel import NONE, Counts, Floor, Ints, Phase
from fleet.arrays import FloatArray
from fleet.config import require
from fleet.envs.traffic.view import TrafficView
from maps.formats.pogema import OpenFloor
from maps.grid import DCOL, DROW, EAST, NORTH, SOUTH, WEST, GridMap
from maps.lane_graph import grid_lane_graph
from maps.site import Site
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.multi_step.priorities import Priorities
from planners.mapf.pibt import Stepper

MOST_CELLS = 8000
"""Free cells of a floor: every cell may be a goal, and the distances of all pairs are kept (128 MB)."""
_KINDS = (EAST, NORTH, SOUTH, WEST)
"""Heading of each kind of move: straight, left, right, reverse."""


def open_place(floor: OpenFloor) -> FleetSite:
    """What the traffic layer needs to know of an open floor: its connected parts in which there are goals.

    Raises:
        ConfigError: It has too many cells, or nowhere to go.
    """
    part = connected_parts(floor.grid)
    n_goals = np.bincount(part[floor.goals], minlength=part.max() + 1)
    n_goals[0] = 0  # the obstacles
    used = n_goals[part] >= 2
    n_cells = int(used.sum())
    require(n_cells <= MOST_CELLS, "map", f"{floor.name}, {n_cells} free cells", f"at most {MOST_CELLS}")
    starts = np.flatnonzero((floor.starts & used).ravel())
    require(len(starts) > 0, "map", floor.name, "a map with two goals and a start that are connected")
    graph = grid_lane_graph(GridMap(used), "pebble")
    every = np.arange(graph.n_states, dtype=np.int32)
    distance, row = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)).rows(every)
    nothing = np.zeros(0, dtype=np.int32)
    site = Site(
        name=floor.name,
        grid=GridMap(used),
        walls=~used,
        shelves=np.zeros_like(used),
        lanes=np.zeros((0, 2), dtype=np.int32),
        stations=(),
        parking=tuple(starts.tolist()),
        chargers=(),
        cut_cells=(),
        allow_reverse=True,
        plan=(),
    )
    goals = graph.state_index[np.flatnonzero((floor.goals & used).ravel()), EAST]
    return FleetSite(
        site=site,
        graph=graph,
        floor=Floor(
            distance=distance,
            dock_state=nothing,
            dock_row=nothing,
            spot_state=goals.astype(np.int32),
            spot_row=row[goals].astype(np.int32),
            charger_state=nothing,
            charger_row=nothing,
            service_steps=0,
            load_steps=nothing,
            unload_steps=nothing,
            cycle_steps=nothing,
            station_cap=nothing,
            near_moves=0,
            loaded_rank=0,
            urgent_rank=0,
        ),
        goal_row=row.astype(np.int32),
        move_to=_neighbours(graph.state_cell, graph.state_index[:, EAST], used.shape),
        far_steps=int(distance[distance < UNREACHABLE].max()),
    )


def connected_parts(grid: GridMap) -> npt.NDArray[np.int32]:
    """Number of the connected part of each free cell, from 1 on, 0 for obstacles, shape (rows, cols)."""
    from scipy.ndimage import label

    part: npt.NDArray[np.int32] = label(grid.free)[0]
    return part


class LifelongTraffic:
    """A `TrafficFleet` on an open floor: who reaches its goal is given another one at once.

    Every robot has a stream of goals of its own, which does not depend on when it arrives. As in POGEMA, closed rings
    of robots may move on. The longer a robot has had its goal, the earlier it chooses, in dead ends much earlier.

    Args:
        place: Of `open_place`; its spots are the cells that are goals, its parking the cells where robots begin.
        n_cars: Number of robots.
        seed: Of starts, goals and tie-breaking.
    """

    def __init__(self, place: FleetSite, n_cars: int, seed: int) -> None:
        self.place = place
        of_starts, of_ties, of_ranks, *of_goals = np.random.SeedSequence(seed).spawn(3 + n_cars)
        starts = np.random.default_rng(of_starts).choice(place.site.parking, size=n_cars, replace=False)
        self.counts = Counts.of(n_cars, np.int32)
        self._streams = [np.random.default_rng(stream) for stream in of_goals]
        self._stepper = Stepper(
            place.graph, np.zeros(place.graph.n_cells, dtype=np.bool_), seed=np.random.default_rng(of_ties)
        )
        self._salt = self._stepper.salt
        part = connected_parts(place.site.grid).ravel()[place.graph.state_cell]
        goals = place.floor.spot_state
        self._goals = {number: goals[part[goals] == number] for number in np.unique(part).tolist()}
        self._part = part
        self._state = place.graph.state_index[starts, EAST].astype(np.int32)
        self._goal = np.array([self._next(car) for car in range(n_cars)], dtype=np.int32)
        self._priorities = Priorities(place.graph, n_cars, seed=np.random.default_rng(of_ranks))

    def view(self) -> TrafficView:
        """See `TrafficFleet`."""
        n = len(self._state)
        nobody = np.zeros(n, dtype=np.bool_)
        return TrafficView(
            state=self._state,
            goal=self._goal,
            phase=np.full(n, Phase.TO_PICK, dtype=np.int8),
            held=nobody,
            locked=nobody,
            priority=self._priorities.values,
            proposed=self._step(None),
        )

    def move(self, wanted: Ints) -> Ints:
        """See `TrafficFleet`."""
        self._state = self._step(wanted.astype(np.int32))
        self._salt = self._stepper.salt
        self._priorities.advance(self._state, self._goal)
        for car in np.flatnonzero(self._state == self._goal).tolist():
            self.counts.delivered[car] += 1
            self._goal[car] = self._next(car)
        return self._state

    def poses(self) -> FloatArray:
        """See `Fleet`."""
        poses: FloatArray = self.place.graph.state_pose[self._state]
        return poses

    def forget(self) -> None:
        """See `Fleet`."""
        self.counts.forget()

    def copy(self) -> Self:
        """See `Fleet`."""
        twin = copy.copy(self)
        twin.counts = Counts(*(count.copy() for count in self.counts))
        twin._streams = copy.deepcopy(self._streams)
        twin._priorities, twin._goal = copy.copy(self._priorities), self._goal.copy()
        return twin

    def close(self) -> None:
        """See `Fleet`."""

    def _step(self, wished: Ints | None) -> Ints:
        """Where PIBT lets every robot go, shape (n_cars,)."""
        after = np.empty_like(self._state)
        self._stepper.salt = self._salt
        self._stepper.step(
            self._state,
            after,
            distances=self.place.floor.distance,
            row=self.place.goal_row[self._goal],
            order=self._priorities.order(),
            locked=np.zeros(len(after), dtype=np.bool_),
            allow_rotation=True,
            wished=wished,
        )
        return after

    def _next(self, car: int) -> int:
        """The next goal of a robot, another cell than the one it is in, of the part of the floor that it is in."""
        here = self._state[car]
        goals = self._goals[int(self._part[here])]
        goal = here
        while goal == here:
            goal = goals[self._streams[car].integers(len(goals))]
        return int(goal)


def _neighbours(cell: Ints, state_of: Ints, shape: tuple[int, ...]) -> npt.NDArray[np.int32]:
    """State that each kind of move leads to, `NONE` where there is none, shape (n_states, 4)."""
    row, col = np.divmod(cell, shape[1])
    to = np.full((len(cell), len(_KINDS)), NONE, dtype=np.int32)
    for kind, heading in enumerate(_KINDS):
        next_row, next_col = row + DROW[heading], col + DCOL[heading]
        inside = (next_row >= 0) & (next_row < shape[0]) & (next_col >= 0) & (next_col < shape[1])
        to[:, kind] = np.where(inside, state_of[np.where(inside, next_row * shape[1] + next_col, 0)], NONE)
    return to
