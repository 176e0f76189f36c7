"""Drivers: granted moves become car commands, by path following in continuous worlds and by states on the grid."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fleet.config import EstimateConfig
from fleet.robots.estimator import PoseEstimator
from fleet.robots.pursuit import Follower, PathBuffer, any_beyond
from fleet.robots.spec import CarSpec
from fleet.world.protocol import FloatArray, World
from maps.lane_graph import LaneGraph, MoveKind

RELEASE_M = 0.05
"""A move counts as done, and what it swept is released, this far before its end [m] (docs/conventions.md)."""
AT_REST_M, AT_REST_MPS = 0.02, 0.02
"""A car stands at its stop when it is this close and this slow."""
OFF_LANE_M, OFF_LANE_RAD = 0.20, 0.6
"""Beyond this cross-track or heading error a car has left its lane; normal following stays below 0.05 m."""
NOWHERE = -1
"""No state, in arrays."""
PASS_SPEED_MPS = 1.0
"""Travel speed in aisles."""


class Driver(Protocol):
    """Moves cars along what they were granted."""

    estimate: FloatArray
    """Where the cars are believed to be, x, y, yaw, shape (n_cars, 3)."""

    @property
    def paths(self) -> PathDriver | None:
        """The driver, if its cars follow paths and can leave their lanes; else None."""

    def append(self, car: int, move: int) -> None:
        """Extend a car's path by a granted move of the lane graph."""

    def commands(self, world: World) -> FloatArray:
        """Sense, and say what every car does this tick; shape (n_cars, 2)."""

    def finished(self) -> list[int]:
        """Cars whose oldest granted move ended since the last call; a car may stand in it more than once."""

    def at_rest(self, car: int) -> bool:
        """True when a car stands at the end of what it was granted."""

    def remaining(self, car: int) -> FloatArray:
        """The granted path ahead of a car as points x, y, shape (k, 2)."""

    def off_lane(self) -> list[int]:
        """Cars that are not where their path is."""

    def stop(self, car: int) -> None:
        """Stand still from now on, whatever was granted."""

    def give_up(self, car: int) -> None:
        """Stand still for good: what was granted is void."""


class PathDriver:
    """Pure pursuit along granted paths, on an estimated pose.

    Args:
        graph: Lane graph whose moves are driven.
        spec: The car model.
        start_poses: Rear-axle poses, shape (n_cars, 3); each on its start state.
        tick_s: Control period [s].
        config: Quality of the pose estimate.
        rng: Source of measurement noise.
    """

    def __init__(
        self,
        graph: LaneGraph,
        spec: CarSpec,
        start_poses: FloatArray,
        tick_s: float,
        config: EstimateConfig,
        rng: np.random.Generator,
    ) -> None:
        n_cars = len(start_poses)
        self._graph = graph
        self.buffer = PathBuffer(n_cars)
        self.buffer.points[:, 0] = start_poses
        self.follower = Follower(spec, n_cars, tick_s)
        self.estimator = PoseEstimator(
            spec,
            n_cars,
            tick_s,
            noise_m=config.noise_m,
            noise_rad=config.noise_rad,
            latency_ticks=config.latency_ticks,
            rng=rng,
        )
        self._ends: list[deque[float]] = [deque() for _ in range(n_cars)]
        self._next_release = np.full(n_cars, np.inf)
        self._stop_s = np.zeros(n_cars)
        self._speed_cap = np.full(n_cars, PASS_SPEED_MPS)
        self._speeds = np.zeros(n_cars)
        self.estimate = start_poses.copy()

    @property
    def paths(self) -> PathDriver | None:
        """See `Driver`."""
        return self

    def append(self, car: int, move: int) -> None:
        """See `Driver`."""
        graph = self._graph
        a, b = graph.path_ptr[move], graph.path_ptr[move + 1]
        direction = -1 if graph.move_kind[move] == MoveKind.REVERSE else 1
        self.append_points(car, graph.path_points[a:b], graph.path_s[a:b], direction)
        self._ends[car].append(self._stop_s[car])
        self._next_release[car] = self._ends[car][0] - RELEASE_M

    def append_points(self, car: int, points: FloatArray, s_m: FloatArray, direction: int) -> None:
        """Extend a car's path by free points (a manoeuvre), without a move of the lane graph."""
        self.buffer.trim(car)
        self.buffer.append(car, points, s_m, direction)
        self._stop_s[car] = self.buffer.end_s(car)

    def restart(self, car: int, pose: FloatArray | None = None) -> None:
        """Forget a car's path and begin anew at a pose x, y, yaw; by default where it is believed to stand."""
        self.buffer.reset(car, self.estimate[car] if pose is None else pose)
        self.follower.reset(car)
        self._ends[car].clear()
        self._next_release[car] = np.inf
        self._stop_s[car] = self.buffer.end_s(car)
        self._speed_cap[car] = PASS_SPEED_MPS

    def commands(self, world: World) -> FloatArray:
        """See `Driver`."""
        self.sense(world)
        return self.follower.commands(self.buffer, self.estimate, self._speeds, self._stop_s, self._speed_cap)

    def sense(self, world: World) -> None:
        """Take in where the cars are and how fast."""
        self._speeds = world.car_speeds()
        self.estimate = self.estimator.update(world.car_poses(), self._speeds, world.car_steering())

    def finished(self) -> list[int]:
        """See `Driver`."""
        out = []
        for car in (self.follower.progress >= self._next_release).nonzero()[0].tolist():
            ends = self._ends[car]
            while ends and self.follower.progress[car] >= ends[0] - RELEASE_M:
                ends.popleft()
                out.append(car)
            self._next_release[car] = ends[0] - RELEASE_M if ends else np.inf
        return out

    def at_rest(self, car: int) -> bool:
        """See `Driver`."""
        near = abs(self._stop_s[car] - self.follower.progress[car]) < AT_REST_M
        return bool(near and abs(self._speeds[car]) < AT_REST_MPS)

    def remaining(self, car: int) -> FloatArray:
        """See `Driver`."""
        count = int(self.buffer.count[car])
        passed = int(self.buffer.s[car, :count].searchsorted(self.follower.progress[car]))
        return self.buffer.points[car, passed:count, :2].copy()

    def off_lane(self) -> list[int]:
        """See `Driver`."""
        if not any_beyond(self.follower.cross_track, OFF_LANE_M, self.follower.heading_error, OFF_LANE_RAD):
            return []
        off = (np.abs(self.follower.cross_track) > OFF_LANE_M) | (np.abs(self.follower.heading_error) > OFF_LANE_RAD)
        return np.nonzero(off)[0].tolist()

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
        self._targets: list[deque[int]] = [deque() for _ in start_states]
        self._next = np.full(len(start_states), NOWHERE, dtype=np.int64)
        """First target of each car, -1 for none."""
        self._done: list[int] = []
        self._stopped = np.zeros(len(start_states), dtype=np.bool_)

    @property
    def paths(self) -> PathDriver | None:
        """See `Driver`."""
        return None

    def append(self, car: int, move: int) -> None:
        """See `Driver`."""
        self._targets[car].append(int(self._graph.move_to[move]))
        self._next[car] = self._targets[car][0]

    def commands(self, world: World) -> FloatArray:
        """See `Driver`."""
        self.estimate = world.car_poses()
        there = (self._next == self._reached()) & (self._next != NOWHERE)
        for car in there.nonzero()[0].tolist():
            targets = self._targets[car]
            self._state[car] = targets.popleft()
            self._next[car] = targets[0] if targets else NOWHERE
            self._done.append(car)
        go = (self._next != NOWHERE) & ~self._stopped
        commands = np.zeros((len(self._state), 2))
        commands[:, 0] = np.where(go, self._next, self._state)
        return commands

    def finished(self) -> list[int]:
        """See `Driver`."""
        done, self._done = self._done, []
        return done

    def at_rest(self, car: int) -> bool:
        """See `Driver`."""
        return not self._targets[car]

    def remaining(self, car: int) -> FloatArray:
        """See `Driver`."""
        return self._graph.state_pose[[int(self._state[car]), *self._targets[car]], :2]

    def off_lane(self) -> list[int]:
        """See `Driver`."""
        return []

    def stop(self, car: int) -> None:
        """See `Driver`."""
        self._stopped[car] = True

    def give_up(self, car: int) -> None:
        """See `Driver`."""
        self._targets[car].clear()
        self._next[car] = NOWHERE
        self.stop(car)
