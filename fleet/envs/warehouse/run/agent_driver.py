"""AgentDriver: watches cars that agents drive, and says which of their granted moves they have really made."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.config import EstimateConfig
from fleet.robots.angle import wrapped
from fleet.robots.cars.models import CarModels
from fleet.traffic.drivers import AT_REST_MPS, OFF_LANE_M, OFF_LANE_RAD, RELEASE_M, PathDriver
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph, MoveKind

GATE_M = 0.5
"""Depth of a state's gate along its heading: at 2 m/s and 20 ticks per second no car jumps over it [m]."""
_N_GATES = 8
"""Gates that are watched at once; a car holds grants for fewer moves."""
STOP_M, STOP_RAD = 0.05, 0.1
"""A standing car is at its stop when it is this close and this straight: planned arms served 118 of 120 such trays."""
AT_REST_RADPS = 0.05
"""A car that is told a yaw rate stands when it turns by less than this, too [rad/s]."""


class AgentCars(NamedTuple):
    """Cars that agents drive."""

    by_agent: npt.NDArray[np.bool_]
    """True for each of them, shape (n_cars,)."""
    poses: FloatArray
    """Where cars begin, x, y, yaw, shape (n_cars, 3): beside their states, maybe."""
    docks: frozenset[int] = frozenset()
    """States in which cars are served."""
    stop_m: float = STOP_M
    """A standing car is at its stop when it is this close [m]."""
    stop_rad: float = STOP_RAD
    """And this straight [rad]."""


class AgentDriver(PathDriver):
    """Leaves the cars of agents to their agents and drives the others.

    Nothing is taken for granted about a car that an agent drives. Every state has a gate across its lane: a move
    counts as made, and what it swept is released, when the car passes the gate of its end, roughly straight and near
    the lane's centre. A car that drives elsewhere makes no progress, keeps what it holds, and may come back.

    Args:
        graph: Lane graph whose moves are driven.
        models: Models of the cars.
        start_states: State of each car, shape (n_cars,).
        tick_s: Control period [s].
        config: Quality of the pose estimate.
        rng: Source of measurement noise.
        agents: Cars that agents drive.
    """

    def __init__(
        self,
        graph: LaneGraph,
        models: CarModels,
        start_states: npt.NDArray[np.int32],
        tick_s: float,
        config: EstimateConfig,
        rng: np.random.Generator,
        *,
        agents: AgentCars,
    ) -> None:
        super().__init__(graph, models, graph.state_pose[start_states], tick_s, config, rng)
        self.estimate = agents.poses.copy()
        by_agent = agents.by_agent
        n_cars = len(start_states)
        self._turn_base_m = models.each("turn_base_m")
        self._still_ticks = np.zeros(n_cars)
        self._tick_s = tick_s
        self._stop_m, self._stop_rad = agents.stop_m, agents.stop_rad
        self._by_agent = by_agent
        self._is_agent: list[bool] = by_agent.tolist()
        self._all_agents = bool(by_agent.all())
        self._reached: list[int] = start_states.tolist()
        self.next_states = list(self._reached)
        """State at the end of each agent's car's current granted move; the last one reached if it holds no grant."""
        self._moves: list[deque[int]] = [deque() for _ in self._reached]
        # Of each granted state: pose, 1 if it is driven to backwards, and how far before it the gate is [m].
        self._gates = np.zeros((n_cars, _N_GATES, 5))
        self._docks = agents.docks
        self._n_gates = np.zeros(n_cars, dtype=np.int64)
        self._passed = np.zeros(n_cars, dtype=np.int64)
        self.stale: set[int] = set(range(n_cars))
        """Cars whose granted moves have changed since whoever draws their routes looked last, and took them out."""

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """See `Driver`."""
        by_agent = self._by_agent[cars]
        for car, move in zip(cars[by_agent].tolist(), moves[by_agent].tolist(), strict=True):
            self._moves[car].append(move)
            self._set_gates(car)
        super().append(cars[~by_agent], moves[~by_agent])

    def commands(self, world: World) -> FloatArray:
        """See `Driver`; the car of an agent that says nothing stands."""
        if self._all_agents:
            self.sense(world)
            return np.zeros((len(self._is_agent), 2))
        commands = super().commands(world)
        commands[self._by_agent] = 0.0
        return commands

    def sense(self, world: World) -> None:
        """See `PathDriver`; who turns on the spot does not stand still."""
        super().sense(world)
        rates = np.where(self._turn_base_m > 0.0, 0.0, world.car_steering())
        still = (np.abs(self._speeds) < AT_REST_MPS) & (np.abs(rates) < AT_REST_RADPS)
        self._still_ticks = np.where(still, self._still_ticks + 1.0, 0.0)

    def finished(self) -> CellArray:
        """See `Driver`."""
        done: list[int] = [] if self._all_agents else super().finished().tolist()
        if _count_passed(self.estimate, self._gates, self._n_gates, self._passed):
            for car in np.flatnonzero(self._passed).tolist():
                moves = self._moves[car]
                for _ in range(int(self._passed[car])):
                    self._reached[car] = int(self._graph.move_to[moves.popleft()])
                    done.append(car)
                self._set_gates(car)
        return np.array(done, dtype=np.int32)

    def at_rest(self, car: int) -> bool:
        """See `Driver`."""
        return self.stands(car) if self._is_agent[car] else super().at_rest(car)

    def stands(self, car: int) -> bool:
        """Whether a car stands at its stop, with no move left."""
        if self._moves[car] or self._still_ticks[car] < max(self._settle_ticks[car], 1.0):
            return False
        x, y, yaw = self._graph.state_pose[self._reached[car]].tolist()
        at_x, at_y, at_yaw = self.estimate[car].tolist()
        near = math.hypot(at_x - x, at_y - y) < self._stop_m
        return near and abs(math.remainder(at_yaw - yaw, math.tau)) < self._stop_rad

    def remaining(self, car: int) -> FloatArray:
        """See `Driver`; from the last state reached, so that a car off its lane sees where to come back to."""
        if not self._is_agent[car]:
            return super().remaining(car)
        graph = self._graph
        if not self._moves[car]:
            return graph.state_pose[self._reached[car], None, :2]
        spans = [slice(graph.path_ptr[move], graph.path_ptr[move + 1]) for move in self._moves[car]]
        return np.concatenate([graph.path_points[span, :2] for span in spans])

    def remaining_lines(self) -> tuple[FloatArray, ...]:
        """See `Driver`."""
        return tuple(self.remaining(car) for car in range(len(self._is_agent)))

    def off_lane(self) -> list[int]:
        """See `Driver`; nobody brings back the car of an agent."""
        return [] if self._all_agents else [car for car in super().off_lane() if not self._is_agent[car]]

    def off_stop(self, stops: FloatArray, stands: BoolArray) -> list[int]:
        """See `PathDriver`; nobody brings back the car of an agent."""
        return super().off_stop(stops, stands & ~self._by_agent)

    def poses_now(self, world: World) -> FloatArray:
        """Estimates at the end of the tick, shape (n_cars, 3): `estimate` is as old as the tick's beginning."""
        poses = self.estimate.copy()
        _drive_on(poses, self._speeds, world.car_speeds(), world.car_steering(), self._tick_s, self._turn_base_m)
        return poses

    def moves(self, car: int) -> tuple[int, ...]:
        """Granted moves of an agent's car, the current one first."""
        return tuple(self._moves[car])

    def reached(self, car: int) -> int:
        """State that an agent's car has reached last."""
        return self._reached[car]

    def _set_gates(self, car: int) -> None:
        """Put up the gates of the first granted moves; the others follow when these are passed."""
        graph = self._graph
        near = list(self._moves[car])[:_N_GATES]
        self._n_gates[car] = len(near)
        self.next_states[car] = int(graph.move_to[near[0]]) if near else self._reached[car]
        for k, move in enumerate(near):
            self._gates[car, k, :3] = graph.state_pose[graph.move_to[move]]
            self._gates[car, k, 3] = graph.move_kind[move] == MoveKind.REVERSE
            at_dock = int(graph.move_to[move]) in self._docks
            self._gates[car, k, 4] = max(RELEASE_M, self._stop_m) if at_dock else RELEASE_M
        self.stale.add(car)


@njit(cache=True)
def _drive_on(poses, before, speeds, steering, tick, turn_base):
    """Let cars drive for a tick at the mean of two speeds, with their steering angles or at their yaw rates."""
    for car in range(len(poses)):
        way, yaw = 0.5 * (before[car] + speeds[car]) * tick, poses[car, 2]
        poses[car, 0] += way * math.cos(yaw)
        poses[car, 1] += way * math.sin(yaw)
        if turn_base[car] > 0.0:
            poses[car, 2] += way * math.tan(steering[car]) / turn_base[car]
        else:
            poses[car, 2] += steering[car] * tick


@njit(cache=True)
def _count_passed(estimate, gates, n_gates, passed):
    """Count the gates that each car is through, up to the farthest it passes now: who passes a later gate has cut a
    corner, and is through the earlier ones too. Returns whether any car passes one."""
    some = False
    for car in range(len(estimate)):
        passed[car] = 0
        for k in range(n_gates[car]):
            yaw = gates[car, k, 2]
            cos, sin = math.cos(yaw), math.sin(yaw)
            dx, dy = estimate[car, 0] - gates[car, k, 0], estimate[car, 1] - gates[car, k, 1]
            ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
            turn = wrapped(estimate[car, 2] - yaw)
            beyond = -ahead if gates[car, k, 3] else ahead
            if -gates[car, k, 4] <= beyond <= GATE_M and abs(left) <= OFF_LANE_M and abs(turn) <= OFF_LANE_RAD:
                passed[car] = k + 1
                some = True
    return some
