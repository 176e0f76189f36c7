"""Drivers: granted moves become car commands, by path following in continuous worlds and by states on the grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, CellArray, FloatArray, IntArray
from fleet.config import EstimateConfig
from fleet.robots.cars.models import CarModels
from fleet.robots.estimator import PoseEstimator
from fleet.robots.followers import follower_of
from fleet.robots.pursuit import PathBuffer, Pieces, any_beyond
from fleet.traffic.hindrances import Hindrances
from fleet.traffic.rings import RingArrays, Rings, front
from fleet.world.protocol import World
from maps.lane_graph import REVERSE, LaneGraph

RELEASE_M = 0.05
"""A move counts as done, and what it swept is released, this far before its end [m] (docs/conventions.md)."""
AT_REST_M, AT_REST_MPS = 0.02, 0.02
"""A car stands at its stop when it is this close and this slow."""
OFF_LANE_M, OFF_LANE_RAD = 0.20, 0.6
"""Beyond this cross-track or heading error a car has left its lane; normal following stays below 0.05 m."""
PASS_SPEED_MPS = 1.0
"""Travel speed in aisles."""
MOVE_S = 1.0
"""Time of a move on the grid, and the least elsewhere [s]."""


class Driver(Protocol):
    """Moves cars along what they were granted."""

    estimate: FloatArray
    """Where the cars are believed to be, x, y, yaw, shape (n_cars, 3)."""
    hindrances: Hindrances
    """What keeps cars from driving as they are told."""

    @property
    def paths(self) -> PathDriver | None:
        """The driver, if its cars follow paths and can leave their lanes; else None."""

    def extend_lanes(self, graph: LaneGraph) -> None:
        """Go on with lanes of the same states that have more moves, behind those there are."""

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """Extend cars' paths by granted moves of the lane graph, in this order; a car may stand there more than once.

        Args:
            cars: The cars, shape (k,).
            moves: The move of each, shape (k,).
        """

    def commands(self, world: World) -> FloatArray:
        """Sense, and say what every car does this tick; shape (n_cars, 2)."""

    def finished(self) -> CellArray:
        """Cars whose oldest granted move ended since the last call, shape (k,); one may stand there more than once."""

    def at_rest(self, car: int) -> bool:
        """True when a car stands at the end of what it was granted."""

    def remaining(self, car: int) -> FloatArray:
        """The granted path ahead of a car as points x, y, shape (k, 2)."""

    def remaining_lines(self) -> tuple[FloatArray, ...]:
        """`remaining` of every car."""

    def off_lane(self) -> list[int]:
        """Cars that are not where their path is."""

    def stop(self, car: int) -> None:
        """Stand still from now on, whatever was granted."""

    def give_up(self, car: int) -> None:
        """Stand still for good: what was granted is void."""

    def go(self, car: int) -> None:
        """End a `stop` or a `give_up`."""

    def brake(self, car: int, on: bool) -> None:
        """Let a car that has come to its stop stand there although it is measured a little off it, or no longer."""

    def blur(self, car: int, factor: float) -> None:
        """Measure so many times as badly from now on where a car is, if that is measured."""


class PathDriver:
    """Pure pursuit along granted paths, on an estimated pose.

    Args:
        graph: Lane graph whose moves are driven.
        models: Models of the cars.
        start_poses: Rear-axle poses, shape (n_cars, 3); each on its start state.
        tick_s: Control period [s].
        config: Quality of the pose estimate.
        rng: Source of measurement noise.
    """

    def __init__(
        self,
        graph: LaneGraph,
        models: CarModels,
        start_poses: FloatArray,
        tick_s: float,
        config: EstimateConfig,
        rng: np.random.Generator,
    ) -> None:
        n_cars = len(start_poses)
        self._graph = graph
        self.buffer = PathBuffer(n_cars)
        self.buffer.points[:, 0] = start_poses
        self.follower = follower_of(models, tick_s)
        self.estimator = PoseEstimator(
            models,
            tick_s,
            noise_m=config.noise_m,
            noise_rad=config.noise_rad,
            latency_ticks=config.latency_ticks,
            rng=rng,
        )
        self._pieces = _pieces_of(graph)
        self._ends = Rings(n_cars, np.float64)  # of granted moves, as arc lengths
        self._stop_s = np.zeros(n_cars)
        self._speed_cap = np.full(n_cars, PASS_SPEED_MPS)
        self._speeds = np.zeros(n_cars)
        self._settle_ticks = np.ceil(models.each("settle_s") / tick_s)
        self._slow_ticks = np.zeros(n_cars)
        self.hindrances = Hindrances(n_cars)
        self.estimate = start_poses.copy()

    @property
    def paths(self) -> PathDriver | None:
        """See `Driver`."""
        return self

    def extend_lanes(self, graph: LaneGraph) -> None:
        """See `Driver`."""
        self._graph = graph
        self._pieces = _pieces_of(graph)

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """See `Driver`."""
        ends = self.buffer.append_all(cars, self._pieces, moves)
        self._stop_s[cars] = ends  # of a car's moves the last one counts
        self._ends.put(cars, ends)

    def append_points(self, car: int, points: FloatArray, s_m: FloatArray, direction: int) -> None:
        """Extend a car's path by free points (a manoeuvre), without a move of the lane graph."""
        self.buffer.trim(car)
        self.buffer.append(car, points, s_m, direction)
        self._stop_s[car] = self.buffer.end_s(car)

    def restart(self, car: int, pose: FloatArray | None = None) -> None:
        """Forget a car's path and begin anew at a pose x, y, yaw; by default where it is believed to stand."""
        self.buffer.reset(car, self.estimate[car] if pose is None else pose)
        self.follower.reset(car)
        self._ends.clear(car)
        self._stop_s[car] = self.buffer.end_s(car)
        self._speed_cap[car] = PASS_SPEED_MPS

    def commands(self, world: World) -> FloatArray:
        """See `Driver`."""
        self.sense(world)
        caps = self.hindrances.caps(self._speed_cap)
        if self.estimator.any_in_doubt:
            caps = np.where(self.estimator.in_doubt, 0.0, caps)
        commands = self.follower.commands(self.buffer, self.estimate, self._speeds, self._stop_s, caps)
        return self.hindrances.late(commands)

    def sense(self, world: World) -> None:
        """Take in where the cars are and how fast."""
        self._speeds = world.car_speeds()
        _count_slow(self._speeds, self._slow_ticks)
        self.estimate = self.estimator.update(world.car_poses(), self._speeds, world.car_steering())

    def finished(self) -> CellArray:
        """See `Driver`."""
        return _passed(self._ends.arrays(), self.follower.progress)

    def at_rest(self, car: int) -> bool:
        """See `Driver`."""
        near = abs(self._stop_s[car] - self.follower.progress[car]) < AT_REST_M
        slow = abs(self._speeds[car]) < AT_REST_MPS and self._slow_ticks[car] >= self._settle_ticks[car]
        return bool(near and slow)

    def remaining(self, car: int) -> FloatArray:
        """See `Driver`."""
        count = int(self.buffer.count[car])
        passed = int(self.buffer.s[car, :count].searchsorted(self.follower.progress[car]))
        return self.buffer.points[car, passed:count, :2].copy()

    def remaining_lines(self) -> tuple[FloatArray, ...]:
        """See `Driver`."""
        buffer = self.buffer
        points, bounds = _ahead(buffer.points, buffer.s, buffer.count, self.follower.progress)
        return tuple(points[begin:end] for begin, end in itertools.pairwise(bounds.tolist()))

    def off_lane(self) -> list[int]:
        """See `Driver`."""
        if not any_beyond(self.follower.cross_track, OFF_LANE_M, self.follower.heading_error, OFF_LANE_RAD):
            return []
        off = (np.abs(self.follower.cross_track) > OFF_LANE_M) | (np.abs(self.follower.heading_error) > OFF_LANE_RAD)
        return np.nonzero(off)[0].tolist()

    def off_stop(self, stops: FloatArray, stands: BoolArray) -> list[int]:
        """Cars that stand, but not where they should.

        Args:
            stops: Where each should stand, x, y, yaw, shape (n_cars, 3).
            stands: Which are to be looked at, shape (n_cars,).
        """
        off_m = np.hypot(*(self.estimate - stops)[:, :2].T)
        return np.flatnonzero(stands & (off_m > OFF_LANE_M)).tolist()

    def stop(self, car: int) -> None:
        """See `Driver`."""
        self._speed_cap[car] = 0.0

    def give_up(self, car: int) -> None:
        """See `Driver`."""
        self.restart(car)
        self.stop(car)

    def go(self, car: int, speed_mps: float = PASS_SPEED_MPS) -> None:
        """End a `stop`: drive on along what was granted, at most that fast."""
        self._speed_cap[car] = speed_mps

    def brake(self, car: int, on: bool) -> None:
        """See `Driver`."""
        self.follower.brake(car, on)

    def blur(self, car: int, factor: float) -> None:
        """See `Driver`."""
        self.estimator.blur(car, factor)


class StateDriver:
    """Steps from state to state on the grid.

    Args:
        graph: Lane graph whose moves are driven.
        start_states: State ids, shape (n_cars,).
        states: Tells the state of each car, shape (n_cars,); a car that was pushed is still in its state.
    """

    def __init__(
        self,
        graph: LaneGraph,
        start_states: npt.NDArray[np.int32],
        states: Callable[[], npt.NDArray[np.int64]],
    ) -> None:
        self._graph = graph
        self._reached = states
        self._state = start_states.astype(np.int64)
        self.estimate = graph.state_pose[start_states]
        self._targets = Rings(len(start_states), np.int64)  # states at the ends of granted moves
        self._done = np.empty(0, dtype=np.int32)
        self._stopped = np.zeros(len(start_states), dtype=np.bool_)
        self.hindrances = Hindrances(len(start_states))
        self._rests = np.zeros(len(start_states), dtype=np.int64)  # ticks that slow cars still wait

    @property
    def paths(self) -> PathDriver | None:
        """See `Driver`."""
        return None

    def extend_lanes(self, graph: LaneGraph) -> None:
        """See `Driver`."""
        self._graph = graph

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """See `Driver`."""
        self._targets.put(cars, self._graph.move_to[moves])

    def commands(self, world: World) -> FloatArray:
        """See `Driver`."""
        self.estimate = world.car_poses()
        done = _arrived(self._targets.arrays(), self._reached(), self._state)
        if len(done):
            self._done = np.concatenate((self._done, done))
        commands = np.zeros((len(self._state), 2))
        _aim(self._targets.arrays(), self._state, self._stand(done, world), commands)
        return commands

    def finished(self) -> CellArray:
        """See `Driver`."""
        done, self._done = self._done, self._done[:0]
        return done

    def at_rest(self, car: int) -> bool:
        """See `Driver`; a car that was pushed is not at rest before it is back in its state."""
        if not self._targets.is_empty(car):
            return False
        offset = self.estimate[car] - self._graph.state_pose[self._state[car]]
        return bool(np.hypot(offset[0], offset[1]) <= OFF_LANE_M)

    def remaining(self, car: int) -> FloatArray:
        """See `Driver`."""
        return self._graph.state_pose[[int(self._state[car]), *self._targets.of(car)], :2]

    def remaining_lines(self) -> tuple[FloatArray, ...]:
        """See `Driver`."""
        return tuple(self.remaining(car) for car in range(len(self._state)))

    def off_lane(self) -> list[int]:
        """See `Driver`."""
        return []

    def stop(self, car: int) -> None:
        """See `Driver`."""
        self._stopped[car] = True

    def give_up(self, car: int) -> None:
        """See `Driver`."""
        self._targets.clear(car)
        self._state[car] = self._reached()[car]
        self.stop(car)

    def go(self, car: int) -> None:
        """See `Driver`."""
        self._stopped[car] = False

    def brake(self, car: int, on: bool) -> None:
        """See `Driver`; a car without moves stands in its state."""

    def blur(self, car: int, factor: float) -> None:
        """See `Driver`; nothing is measured here."""

    def _stand(self, done: CellArray, world: World) -> BoolArray:
        """Which cars make no move now, shape (n_cars,); a slow one rests between two moves, and none is told late."""
        if not self.hindrances.any:
            self._rests[:] = 0
            return self._stopped
        caps = self.hindrances.caps(np.ones(len(self._state)))
        self._rests = np.maximum(self._rests - 1, 0)
        self._rests[caps >= 1.0] = 0
        slow = done[(caps[done] > 0.0) & (caps[done] < 1.0)]
        self._rests[slow] = np.round((1.0 / caps[slow] - 1.0) * MOVE_S / world.tick_s)
        return self._stopped | (caps == 0.0) | (self._rests > 0)


def _pieces_of(graph: LaneGraph) -> Pieces:
    """The paths of all moves."""
    return Pieces(
        bounds=graph.path_ptr.astype(np.int64),
        points=graph.path_points,
        s_m=graph.path_s,
        direction=np.where(graph.move_kind == REVERSE, -1, 1).astype(np.int8),
    )


@njit(cache=True)
def _count_slow(speeds: FloatArray, slow_ticks: FloatArray) -> None:  # pragma: no cover - compiled
    """Count one more tick of cars that are slow, and begin anew with the others."""
    for car in range(len(speeds)):
        slow_ticks[car] = slow_ticks[car] + 1.0 if abs(speeds[car]) < AT_REST_MPS else 0.0


@njit(cache=True)
def _ahead(
    points: FloatArray, s_m: FloatArray, count: IntArray, progress: FloatArray
) -> tuple[FloatArray, IntArray]:  # pragma: no cover - compiled
    """Points x, y of all paths that are still ahead, (k, 2), car by car, and where each car's begin, (n_cars + 1,)."""
    n_cars = len(count)
    first, bounds = np.empty(n_cars, np.int64), np.zeros(n_cars + 1, np.int64)
    for car in range(n_cars):
        first[car] = np.searchsorted(s_m[car, : count[car]], progress[car])
        bounds[car + 1] = bounds[car] + count[car] - first[car]
    ahead = np.empty((bounds[n_cars], 2))
    for car in range(n_cars):
        for k in range(first[car], count[car]):
            ahead[bounds[car] + k - first[car], 0] = points[car, k, 0]
            ahead[bounds[car] + k - first[car], 1] = points[car, k, 1]
    return ahead, bounds


@njit(cache=True)
def _passed(ends: RingArrays, progress: FloatArray) -> CellArray:  # pragma: no cover - compiled
    """Take the moves that have ended from their queues; their cars, ascending, shape (k,)."""
    cars = np.empty((ends.end - ends.first).sum(), np.int32)
    n = 0
    for car in range(len(progress)):
        while ends.first[car] < ends.end[car] and progress[car] >= front(ends, car) - RELEASE_M:
            ends.first[car] += 1
            cars[n] = car
            n += 1
    return cars[:n]


@njit(cache=True)
def _arrived(targets: RingArrays, reached: IntArray, state: IntArray) -> CellArray:  # pragma: no cover - compiled
    """Move the cars on that have reached their first target; those cars, ascending, shape (k,)."""
    cars = np.empty(len(state), np.int32)
    n = 0
    for car in range(len(state)):
        if targets.first[car] < targets.end[car] and front(targets, car) == reached[car]:
            state[car] = reached[car]
            targets.first[car] += 1
            cars[n] = car
            n += 1
    return cars[:n]


@njit(cache=True)
def _aim(
    targets: RingArrays, state: IntArray, stopped: BoolArray, commands: FloatArray
) -> None:  # pragma: no cover - compiled
    """Fill in the state each car is to be in: its first target, or where it is."""
    for car in range(len(state)):
        goes = targets.first[car] < targets.end[car] and not stopped[car]
        commands[car, 0] = front(targets, car) if goes else state[car]
