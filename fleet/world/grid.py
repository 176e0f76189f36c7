"""Grid world: cars step from state to state of the lane graph, one state per timestep; all else is kinematic."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.errors import ConfigError, FleetError
from fleet.robots.angle import wrapped_all
from fleet.world.kinematic import CommandError, PlanarWorld
from fleet.world.scene import Scene
from maps.lane_graph import LaneGraph, MoveKind

START_TOLERANCE_M, START_TOLERANCE_RAD = 0.05, 0.05
"""A car may be put up this far from the pose of the state it starts in."""


class NotOnLaneError(FleetError):
    """A car does not start on a state of the lane graph."""


@dataclass(frozen=True, kw_only=True)
class GridConfig:
    """Time steps of the grid world."""

    tick_s: float = 0.05
    timestep_s: float = 1.0
    """Time a car takes from state to state [s]; a whole number of ticks."""

    def __post_init__(self) -> None:
        for name in ("tick_s", "timestep_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"grid world: {name} is {value!r}; valid: a number > 0")
        if self.n_ticks < 1 or abs(self.n_ticks * self.tick_s - self.timestep_s) > 1e-6:
            raise ConfigError(f"grid world: timestep_s is {self.timestep_s!r}; valid: a multiple of {self.tick_s} s")

    @property
    def n_ticks(self) -> int:
        """Ticks in a timestep."""
        return round(self.timestep_s / self.tick_s)


class _Moves(NamedTuple):
    """Moves as compressed rows: those from state k are `ptr[k]` to before `ptr[k + 1]`."""

    ptr: IntArray
    to: IntArray
    """States that they lead to, ascending in each row."""
    speed: FloatArray
    """Mean speed, negative in reverse [m/s]."""


class GridCars:
    """Cars that are always in one state of the lane graph.

    All cars move together when a timestep ends: until then a car stands at its old state, then it is at the new one,
    with no pose in between. The command of the last tick of a timestep decides. While a car is under way to its next
    state its speed is the mean one, the length of the move by the timestep; it is negative in reverse.

    Attributes:
        states: State of each car, shape (n_cars,).

    Args:
        graph: The lane graph.
        start: Poses x, y, yaw, each that of a state, shape (n_cars, 3).
        kind_of: Which kind of vehicles each car is, if the graph has several, shape (n_cars,).
        config: Time steps.

    Raises:
        NotOnLaneError: A start pose is nowhere near a state.
    """

    def __init__(self, graph: LaneGraph, start: FloatArray, kind_of: IntArray, config: GridConfig) -> None:
        self._n_places = graph.n_places
        self._first_of = (kind_of if graph.n_kinds > 1 else np.zeros_like(kind_of)) * graph.n_places
        self._state_pose = np.asarray(graph.state_pose, dtype=np.float64)
        self._n_states = len(self._state_pose)
        # Every move can be driven backwards, too; where there is a move for it, that one counts.
        ends = np.stack((graph.move_from, graph.move_to), axis=1).astype(np.int64)
        codes = np.concatenate((ends, ends[:, ::-1])) @ (self._n_states, 1)
        codes, first = np.unique(codes, return_index=True)
        direction = np.where(graph.move_kind == MoveKind.REVERSE, -1.0, 1.0) / config.timestep_s
        speed = direction * graph.move_length
        self._moves = _Moves(
            ptr=np.searchsorted(codes, np.arange(self._n_states + 1) * self._n_states),
            to=codes % self._n_states,
            speed=np.append(speed, -np.abs(speed))[first],
        )
        self._n_ticks = config.n_ticks
        self._tick = np.zeros(1, dtype=np.int64)
        self.states = np.array([self._state_at(car, pose) for car, pose in enumerate(start)], dtype=np.int64)
        self.poses = self._state_pose[self.states]
        self.speeds = np.zeros(len(start))
        self.steering = np.zeros(len(start))
        self._found = np.zeros(len(start), dtype=np.int64)

    def step(self, commands: FloatArray) -> None:
        """See `CarMotion`; the first column of `commands` names each car's next state.

        Raises:
            CommandError: A car is sent to a state that no move leads to.
        """
        refused = _find_moves(self._moves, commands, self.states, self._found)
        if refused >= 0:
            here, target = int(self.states[refused]), int(commands[refused, 0])
            valid = [here, *self._moves.to[self._moves.ptr[here] : self._moves.ptr[here + 1]].tolist()]
            raise CommandError(f"car {refused} in state {here} is sent to state {target}; valid: {valid}")
        self._tick += 1
        ends = int(self._tick[0]) % self._n_ticks == 0
        _move(self._moves, self._found, ends, self._state_pose, self.states, self.poses, self.speeds)

    def push(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `CarMotion`; the car keeps its state, so its next move takes it back to the lane."""
        self.poses[car] += (dx_m, dy_m, dyaw_rad)

    def put(self, car: int, pose: FloatArray) -> None:
        """See `CarMotion`; the pose is that of a state."""
        self.states[car] = self._state_at(car, pose)
        self.poses[car] = self._state_pose[self.states[car]]

    def save(self) -> tuple[npt.NDArray[np.generic], ...]:
        """See `CarMotion`."""
        return self._tick.copy(), self.states.copy(), self.poses.copy(), self.speeds.copy()

    def load(self, snapshot: tuple[npt.NDArray[np.generic], ...]) -> None:
        """See `CarMotion`."""
        self._tick[:], self.states[:], self.poses[:], self.speeds[:] = snapshot

    def _state_at(self, car: int, pose: FloatArray) -> int:
        first = int(self._first_of[car])
        offset = self._state_pose[first : first + self._n_places] - pose
        turn = np.abs(wrapped_all(offset[:, 2]))
        distance = np.hypot(offset[:, 0], offset[:, 1])
        distance[turn > START_TOLERANCE_RAD] = np.inf
        state = int(np.argmin(distance))
        if distance[state] > START_TOLERANCE_M:
            raise NotOnLaneError(
                f"car {car} starts at x, y, yaw = {np.round(pose, 3).tolist()}; valid: within "
                f"{START_TOLERANCE_M} m and {START_TOLERANCE_RAD} rad of the pose of a lane-graph state"
            )
        return first + state


class GridWorld(PlanarWorld):
    """A `World` whose cars follow a lane graph in lock step; see `GridCars`.

    Arms, parcels, contacts, clearance and rays are those of the kinematic world, at the poses of the states.

    Args:
        scene: The world at the start; every car stands on a state of the graph.
        graph: The lane graph.
        config: Time steps.

    Raises:
        NotOnLaneError: A start pose is nowhere near a state.
    """

    def __init__(self, scene: Scene, graph: LaneGraph, config: GridConfig | None = None) -> None:
        config = config or GridConfig()
        self._grid_cars = GridCars(graph, scene.car_start, scene.cars.kind_of, config)
        super().__init__(scene, self._grid_cars, config.tick_s)

    def car_states(self) -> IntArray:
        """State of each car, shape (n_cars,); a push does not change it."""
        return self._grid_cars.states.copy()


_STAYS = -1


@njit(cache=True)
def _find_moves(moves: _Moves, commands: FloatArray, states: IntArray, found: IntArray) -> int:
    """Fill in the move that each car is told to make; returns the first car that no such move is open to, or -1."""
    ptr, to, _ = moves
    for car in range(len(states)):
        target = int(commands[car, 0])
        found[car] = _STAYS
        if target == states[car]:
            continue
        for move in range(ptr[states[car]], ptr[states[car] + 1]):
            if to[move] == target:
                found[car] = move
        if found[car] == _STAYS:
            return car
    return -1


@njit(cache=True)
def _move(
    moves: _Moves,
    found: IntArray,
    ends: bool,
    state_pose: FloatArray,
    states: IntArray,
    poses: FloatArray,
    speeds: FloatArray,
) -> None:
    """Give cars the speeds of their moves, and when the timestep ends the states that these lead to."""
    _, to, speed = moves
    for car in range(len(found)):
        speeds[car] = 0.0
        if found[car] == _STAYS:
            continue
        speeds[car] = speed[found[car]]
        if ends:
            states[car] = to[found[car]]
            for axis in range(3):
                poses[car, axis] = state_pose[states[car], axis]
