"""Executor: a plan becomes grants, in the order its dependency graph allows; no grant, no motion."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.config import TrafficConfig
from fleet.traffic.drivers import Driver
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.precedence.arrays import BoolArray, Int64Array
from planners.precedence.dependency_graph import DependencyGraph
from planners.precedence.errors import UnexecutablePlanError
from planners.precedence.queues import NOBODY, Queues, move_at

RETRY_S = 0.5
"""Time after which a car that could not go first asks again [s]."""


class Executor:
    """Grants moves and drives the cars through them.

    Args:
        graph: Lane graph the plans live on.
        start_states: State of each car, shape (n_cars,); distinct cells.
        driver: Turns granted moves into commands.
        config: How many moves a car may hold at once, and when the order at a crossing may change.
        log: Called as ``log(kind, **facts)`` when a plan cannot be executed as it is.
    """

    def __init__(
        self,
        graph: LaneGraph,
        start_states: npt.NDArray[np.int32],
        driver: Driver,
        config: TrafficConfig,
        log: Callable[..., None],
    ) -> None:
        self.graph = graph
        self.driver = driver
        self.dependencies = DependencyGraph(graph, start_states)
        self.n_reordered = 0
        """How often a car went before one that was late."""
        self._config = config
        self._log = log
        self._n_cars = len(start_states)
        self._waited_s = np.zeros(self._n_cars)  # held up by nothing but the order
        self.still_s = np.zeros(self._n_cars)
        """Time since each car was last granted a move or finished one, shape (n_cars,) [s]."""
        self.n_walkers = np.zeros(graph.n_cells, dtype=np.int64)
        """People in each cell, shape (n_cells,)."""
        self._n_closings = np.zeros(graph.n_cells, dtype=np.int64)
        self._closed = np.zeros(graph.n_cells, dtype=np.bool_)
        self._dirty = True

    def change(self, config: TrafficConfig) -> None:
        """Go on with other settings; what was granted stays so."""
        self._config = config
        self._dirty = True

    def accept(self, plan: Plan) -> None:
        """Append a plan whose first row equals `tail_states`; of one that cannot be executed, the part that can."""
        while True:
            try:
                self.dependencies.extend(plan)
                break
            except UnexecutablePlanError as fault:
                # A bug of the planner: the cars drive on by what is right, and the log tells.
                self._log("plan_cut", timestep=fault.timestep, of=len(plan.states) - 1, cause=str(fault))
                plan = replace(plan, states=plan.states[: fault.timestep + 1])
        self._dirty = True

    def extend_lanes(self, graph: LaneGraph) -> None:
        """Go on with lanes of the same states that have more moves, behind those there are."""
        self.graph = graph
        self.dependencies.extend_lanes(graph)
        self.driver.extend_lanes(graph)

    def cut(self, n_commits: int) -> npt.NDArray[np.int32]:
        """Drop what is not needed until the next plan lands.

        Args:
            n_commits: Moves beyond the granted ones that each car keeps.

        Returns:
            The states plans start from, shape (n_cars,).
        """
        return self.dependencies.commit_cut(n_commits)

    def timesteps_left(self) -> npt.NDArray[np.int64]:
        """Timesteps until each car stands in its tail state, if nobody is late, shape (n_cars,)."""
        return self.dependencies.timesteps_left()

    def tail_states(self) -> npt.NDArray[np.int32]:
        """State each car stands in when all it has is done, shape (n_cars,), read-only."""
        return self.dependencies.tail_states()

    def granted_states(self) -> npt.NDArray[np.int32]:
        """State each car stands in when all it was granted is done, shape (n_cars,), read-only."""
        return self.dependencies.granted_states()

    def holds(self, car: int, cell: int) -> bool:
        """Whether a car holds a cell: it stands there, may enter it, or has reserved it."""
        return self.dependencies.holds(car, cell)

    def is_free(self, cell: int) -> bool:
        """Whether no car holds a cell."""
        return bool(self.dependencies.queues.holder[cell] == NOBODY)

    @property
    def closed(self) -> npt.NDArray[np.bool_]:
        """Cells into which nobody is let at present, shape (n_cells,)."""
        return self._closed

    def close(self, cell: int) -> None:
        """Grant nobody entry to a cell until as many calls of `open`; cars that hold it keep it."""
        self._n_closings[cell] += 1
        self._closed[cell] = True

    def open(self, cell: int) -> None:
        """End a `close`; the cell stays closed while there are others."""
        self._n_closings[cell] -= 1
        self._closed[cell] = self._n_closings[cell] > 0
        self._dirty = True

    def close_if_free(self, cell: int, *, for_a_moment: bool = False) -> bool:
        """Close a cell unless a car holds it; returns whether it was closed.

        Args:
            cell: The cell.
            for_a_moment: Whether what leads through it waits; else it is dropped.
        """
        if not self.is_free(cell):
            return False
        self.close(cell)
        if not for_a_moment:
            self.dependencies.avoid(cell)
        return True

    def halt(self, car: int) -> None:
        """Drop a car's moves that are not granted, and whatever depends on them."""
        self.dependencies.halt(car)
        self._dirty = True

    def planned_lines(self) -> tuple[FloatArray, ...]:
        """Centre lines of the cars' moves that are planned and not granted, points x, y, each (k, 2)."""
        points, bounds = _planned(self.dependencies.queues, self.graph.path_ptr, self.graph.path_points)
        return tuple(points[begin:end] for begin, end in itertools.pairwise(bounds.tolist()))

    def relocate(self, car: int, state: int) -> None:
        """Say that a car stands in another state after a manoeuvre off the lane graph."""
        self.dependencies.relocate(car, state)
        self._dirty = True

    def without_moves(self) -> npt.NDArray[np.bool_]:
        """Whether each car has no move left, shape (n_cars,)."""
        return self.dependencies.without_moves()

    def idle(self, car: int) -> bool:
        """True when a car has no move left and stands still."""
        dependencies = self.dependencies
        nothing = dependencies.n_queued(car) == 0 and dependencies.n_granted(car) == 0
        return nothing and self.driver.at_rest(car)

    def tick(self, world: World) -> FloatArray:
        """Sense, release what was passed, grant what became free.

        Returns:
            Car commands, shape (n_cars, 2).
        """
        commands = self.driver.commands(world)
        self.still_s += world.tick_s
        finished = self.driver.finished()
        if len(finished):
            self.dependencies.finish_all(finished)
            self.still_s[finished] = 0.0
            self._dirty = True
        self._reorder(world.tick_s)
        if self._dirty:
            cars, moves = self.dependencies.grant_all(self._config.grant_moves_n, self._closed)
            if len(cars):
                self.driver.append(cars, moves)
                self.still_s[cars] = 0.0
            self._dirty = False
        return commands

    def _reorder(self, tick_s: float) -> None:
        """Let the car that has waited longest for a late one go first; if it cannot, it asks again later."""
        after_s = self._config.reorder_after_s
        if not self.dependencies.anyone_held_up:
            self._waited_s[:] = 0.0
            return
        car = _wait(self._waited_s, self.dependencies.held_up(), tick_s)
        if self._waited_s[car] >= after_s:
            self._waited_s[car] -= RETRY_S
            if self.dependencies.go_first(car, self.still_s >= after_s):
                self.n_reordered += 1
                self._dirty = True


@njit(cache=True)
def _wait(waited_s: FloatArray, held_up: BoolArray, tick_s: float) -> int:  # pragma: no cover - compiled
    """Let time pass for the cars that are held up, and start anew for the others; returns who has waited longest."""
    longest = 0
    for car in range(len(waited_s)):
        waited_s[car] = waited_s[car] + tick_s if held_up[car] else 0.0
        if waited_s[car] > waited_s[longest]:
            longest = car
    return longest


@njit(cache=True)
def _planned(q: Queues, path_ptr: npt.NDArray[np.integer], path_points: FloatArray) -> tuple[FloatArray, Int64Array]:
    """Points of all queued moves, (k, 2), car by car, and where each car's begin among them, (n_cars + 1,)."""
    n_cars = len(q.granted)
    bounds = np.zeros(n_cars + 1, np.int64)
    for car in range(n_cars):
        bounds[car + 1] = bounds[car]
        for number in range(q.granted[car], q.queued[car]):
            move = move_at(q, car, number)
            bounds[car + 1] += path_ptr[move + 1] - path_ptr[move]
    points = np.empty((bounds[n_cars], 2))
    n = 0
    for car in range(n_cars):
        for number in range(q.granted[car], q.queued[car]):
            move = move_at(q, car, number)
            for k in range(path_ptr[move], path_ptr[move + 1]):
                points[n, 0], points[n, 1] = path_points[k, 0], path_points[k, 1]
                n += 1
    return points, bounds
