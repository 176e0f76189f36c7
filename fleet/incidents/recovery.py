"""Recovery: a car that has left its lane stops and rejoins a free state nearby; a dead one keeps only its ground."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fleet.missions.roster import CarPhase
from fleet.traffic.drivers import PathDriver
from fleet.world.protocol import FloatArray
from planners.motion.car.reeds_shepp import RejoinResult, plan_rejoin

if TYPE_CHECKING:
    from fleet.robots.spec import CarSpec
    from fleet.simulation import Simulation

TURNING_RADIUS_M = 0.45
"""A little wider than the lanes' arcs, so that the follower has room to correct."""
SEARCH_M = 2.2
"""How far from the car a state to rejoin may be."""
STATES_N, SEARCHED_N = 12, 3
"""States that direct curves are tried to, and how many of them a search is tried to if none is free."""
ITERATIONS = 300
"""Budget of one search; it ends in 0.2 s."""
MARGIN_M = 0.05
"""Kept free around the body in a manoeuvre: the error of the follower and of the estimate."""
WAY_OUT_M = 0.6
"""A car that stands too near something must have left it this far from where it stands, or after twice the depth."""
STILL_MPS, STILL_S = 0.05, 0.5
"""A car has stopped when it was this slow for this long."""
MANOEUVRE_MPS = 0.5
JOIN_M = 0.08
"""A manoeuvre that ends farther than this from its state is repeated."""
SHIFTED_M, SHIFTED_RAD = 0.06, 0.2
"""A dead car that is farther than this from where it came to rest was pushed; noise of the estimate stays below."""
RETRY_S, RETRY_MAX_S = 2.0, 30.0
"""Wait before the next attempt when there is no way back yet; doubles with every attempt."""


class _Stage(StrEnum):
    STOPPING = "stopping"
    DRIVING = "driving"


@dataclass(kw_only=True)
class _Rejoin:
    stage: _Stage
    still_since: int
    retry_tick: int = 0
    retry_s: float = RETRY_S
    target: int = -1
    halted: set[int] = field(default_factory=set)
    """Cars that stand because their granted way leads through this one."""


@dataclass(kw_only=True)
class _Wreck:
    still_since: int
    pose: FloatArray | None = None
    """Where it came to rest; None while it rolls."""
    halted: set[int] = field(default_factory=set)
    """Cars that stand because their granted way leads through it."""


class Recovery:
    """Brings cars back onto the lane graph.

    Args:
        simulation: The run whose cars are watched.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._rejoining: dict[int, _Rejoin] = {}
        self._wrecks: dict[int, _Wreck] = {}

    def abandon(self, car: int) -> None:
        """A car died: it rolls out, and then only the cells it stands in are lost, wherever it is pushed later."""
        rejoin = self._rejoining.pop(car, None)
        driver = self._simulation.driver
        if rejoin is not None and isinstance(driver, PathDriver):
            self._let_go(driver, rejoin.halted)
        self._simulation.traffic.set_dead(car, [])
        self._wrecks.setdefault(car, _Wreck(still_since=self._simulation.now))

    @property
    def active(self) -> bool:
        """True when a car is off its lane or dead."""
        return bool(self._rejoining or self._wrecks)

    def halted_by(self) -> dict[int, int]:
        """Cars that stand because their granted way leads through another one, and that one."""
        stopped: dict[int, _Rejoin | _Wreck] = {**self._wrecks, **self._rejoining}
        return {other: car for car, obstacle in stopped.items() for other in obstacle.halted}

    def tick(self, tick: int) -> None:
        """Notice cars that are off their lane, and move those that are being recovered on by one step."""
        driver = self._simulation.driver
        for car, wreck in self._wrecks.items():
            self._watch(car, wreck, tick)
        if not isinstance(driver, PathDriver):
            return
        for car in driver.off_lane():
            if self._simulation.dispatcher.roster.phase[car] is CarPhase.DEAD:
                continue
            rejoin = self._rejoining.get(car)
            if rejoin is None:
                self._begin(driver, car, tick)
            elif rejoin.stage is _Stage.DRIVING:
                driver.stop(car)
                rejoin.stage, rejoin.still_since = _Stage.STOPPING, tick
        for car, rejoin in list(self._rejoining.items()):
            if rejoin.stage is _Stage.STOPPING:
                self._hold_ground(driver, car, rejoin)
                self._try(driver, car, rejoin, tick)
            elif driver.at_rest(car):
                self._end(driver, car, rejoin, tick)

    def _begin(self, driver: PathDriver, car: int, tick: int) -> None:
        simulation = self._simulation
        driver.stop(car)
        simulation.executor.halt(car)
        simulation.traffic.set_fixed(car, True)
        simulation.dispatcher.retire(car, CarPhase.RECOVERING, simulation.sim_s, f"car_{car} left its lane")
        x, y, yaw = (round(float(v), 3) for v in driver.estimate[car])
        simulation.log("off_lane", car=f"car_{car}", x=x, y=y, yaw=yaw)
        self._rejoining[car] = _Rejoin(stage=_Stage.STOPPING, still_since=tick)

    def _watch(self, car: int, wreck: _Wreck, tick: int) -> None:
        """Let a dead car roll out, or slide after a push, and then give back all cells but those under it."""
        simulation = self._simulation
        driver, pose = simulation.driver, simulation.driver.estimate[car]
        if wreck.pose is not None:
            turned = abs(np.arctan2(np.sin(pose[2] - wreck.pose[2]), np.cos(pose[2] - wreck.pose[2])))
            if np.hypot(*(pose - wreck.pose)[:2]) < SHIFTED_M and turned < SHIFTED_RAD:
                return
            wreck.pose, wreck.still_since = None, tick
        if isinstance(driver, PathDriver):
            self._hold_ground(driver, car, wreck)
        if np.abs(simulation.world.car_speeds()[car]) > STILL_MPS:
            wreck.still_since = tick
        if (tick - wreck.still_since) * simulation.tick_s < STILL_S or simulation.dispatcher.is_served(car):
            return
        wreck.pose = pose.copy()
        self._settle(car)
        if isinstance(driver, PathDriver):
            # Their way leads through the wreck: they have to find another.
            for other in wreck.halted - self._rejoining.keys():
                self._begin(driver, other, tick)
            wreck.halted = set()

    def _settle(self, car: int) -> None:
        """Make the cells under a dead car that nobody else holds all that it has."""
        simulation = self._simulation
        dependencies, graph = simulation.executor.dependencies, simulation.graph
        pose = simulation.driver.estimate[car]
        ground = self._cells_of(pose[None])
        dependencies.unreserve(car)
        own = [cell for cell in ground if dependencies.reserve(car, (cell,))]
        states = np.flatnonzero(np.isin(graph.state_cell, own))
        if states.size:
            offset = graph.state_pose[states, :2] - pose[:2]
            simulation.driver.give_up(car)
            simulation.executor.relocate(car, int(states[np.argmin(np.hypot(*offset.T))]))
        # Pushed off all lanes it keeps its last cell there: the graph knows no other place for it.
        taken = sorted({*ground, *dependencies.held_cells(car)})
        for cell in taken:
            dependencies.avoid(cell)
        simulation.traffic.set_dead(car, taken)
        simulation.log("wreck", car=f"car_{car}", cells=taken)

    def _hold_ground(self, driver: PathDriver, car: int, stopped: _Rejoin | _Wreck) -> None:
        """Let nobody into the cells a car has come to stand in; those who were granted one already have to wait."""
        dependencies = self._simulation.executor.dependencies
        halted = set()
        for cell in self._cells_of(driver.estimate[car][None]):
            if not dependencies.reserve(car, (cell,)):
                halted |= {other for other in self._others(car) if cell in dependencies.held_cells(other)}
        before, stopped.halted = stopped.halted, halted - self._rejoining.keys() - self._wrecks.keys()
        for other in stopped.halted - before:
            driver.stop(other)
        self._let_go(driver, before - stopped.halted)

    def _let_go(self, driver: PathDriver, cars: set[int]) -> None:
        """Let cars go on, but for those that are in trouble themselves or wait for yet another."""
        stopped: list[_Rejoin | _Wreck] = [*self._rejoining.values(), *self._wrecks.values()]
        for other in cars - self._rejoining.keys() - self._wrecks.keys():
            if not any(other in obstacle.halted for obstacle in stopped):
                driver.go(other)

    def _try(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        simulation = self._simulation
        speeds = np.abs(simulation.world.car_speeds())
        if speeds[[car, *rejoin.halted]].max() > STILL_MPS:
            rejoin.still_since = tick
        if (tick - rejoin.still_since) * simulation.tick_s < STILL_S or tick < rejoin.retry_tick:
            return
        if simulation.dispatcher.is_served(car):
            return
        found = self._plan(driver, car, simulation.config.seed + tick)
        if found is None:
            simulation.log("rejoin_impossible", car=f"car_{car}", retry_s=rejoin.retry_s)
            rejoin.retry_tick = tick + round(rejoin.retry_s / simulation.tick_s)
            rejoin.retry_s = min(2 * rejoin.retry_s, RETRY_MAX_S)
            return
        rejoin.target, way = found
        self._drive(driver, car, way)
        rejoin.stage = _Stage.DRIVING
        simulation.log("rejoin", car=f"car_{car}", state=rejoin.target, length_m=round(way.length_m, 2))

    def _plan(self, driver: PathDriver, car: int, seed: int) -> tuple[int, RejoinResult] | None:
        """A state to rejoin and a way to it whose cells are the car's from now on; None if there is none at present."""
        simulation = self._simulation
        start = driver.estimate[car]
        room = Room(simulation, car, start, self._usable_cells(car))
        states = self._near_states(start, room.usable)
        for iterations, tried in ((0, states), (ITERATIONS, states[:SEARCHED_N])):
            for state in tried:
                way = plan_rejoin(
                    start,
                    simulation.graph.state_pose[state],
                    TURNING_RADIUS_M,
                    room.valid,
                    seed=seed,
                    max_iterations=iterations,
                )
                if not way.solved:
                    continue
                cells = [cell for cell in self._cells_of(way.poses) if cell not in room.ground]
                if simulation.executor.dependencies.reserve(car, cells):
                    return state, way
        return None

    def _drive(self, driver: PathDriver, car: int, way: RejoinResult) -> None:
        driver.restart(car)
        cusps = np.nonzero(np.diff(way.directions))[0] + 1
        bounds = [0, *cusps.tolist(), len(way.poses) - 1]
        for a, b in pairwise(bounds):
            part = way.poses[a : b + 1]
            if len(part) > 1:
                s_m = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(part[:, 0]), np.diff(part[:, 1])))))
                driver.append_points(car, part, s_m, int(way.directions[a]))
        driver.go(car, MANOEUVRE_MPS)

    def _end(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        simulation = self._simulation
        goal = simulation.graph.state_pose[rejoin.target]
        if np.hypot(*(driver.estimate[car] - goal)[:2]) > JOIN_M:
            rejoin.stage, rejoin.still_since = _Stage.STOPPING, tick
            return
        del self._rejoining[car]
        self._let_go(driver, rejoin.halted)
        driver.restart(car, goal)
        simulation.executor.relocate(car, rejoin.target)
        simulation.executor.dependencies.unreserve(car)
        simulation.traffic.set_fixed(car, False)
        simulation.dispatcher.resume(car, tick, simulation.sim_s)
        simulation.log("rejoined", car=f"car_{car}", state=rejoin.target)

    def _others(self, car: int) -> list[int]:
        return [other for other in range(self._simulation.world.n_cars) if other != car]

    def _usable_cells(self, car: int) -> npt.NDArray[np.bool_]:
        """Free cells that no other car holds, shape (rows, cols)."""
        simulation = self._simulation
        grid = simulation.site.grid
        usable = grid.free.copy().ravel()
        usable &= ~simulation.traffic.blocked
        for other in self._others(car):
            usable[simulation.executor.dependencies.held_cells(other)] = False
        return usable.reshape(grid.rows, grid.cols)

    def _near_states(self, pose: FloatArray, usable: npt.NDArray[np.bool_]) -> list[int]:
        graph = self._simulation.graph
        offset = graph.state_pose - pose
        distance = np.hypot(offset[:, 0], offset[:, 1])
        turn = np.abs(np.arctan2(np.sin(offset[:, 2]), np.cos(offset[:, 2])))
        near = np.nonzero((distance < SEARCH_M) & usable.ravel()[graph.state_cell])[0]
        order = np.lexsort((near, distance[near] + 0.5 * turn[near]))
        return near[order][:STATES_N].tolist()

    def _cells_of(self, poses: FloatArray) -> list[int]:
        """Cells under the body at any of the poses."""
        grid = self._simulation.site.grid
        row, col = _cell_of(_outline(poses, self._simulation.scene.car, 0.0).reshape(-1, 2), grid.rows, grid.cell_m)
        on_map = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
        return np.unique((row * grid.cols + col)[on_map]).tolist()


class Room:
    """Where a car may be while it manoeuvres.

    The body stays in usable cells and in those it stands in, and `MARGIN_M` from walls, obstacles and other cars. Where
    it stands nearer than that, or inside, it must get out: what it may be too near falls to nothing over `WAY_OUT_M`.

    Args:
        simulation: Site, cars, obstacles.
        car: The car.
        start: Where it stands, x, y, yaw.
        usable: Cells nobody else holds, shape (rows, cols).
    """

    def __init__(self, simulation: Simulation, car: int, start: FloatArray, usable: npt.NDArray[np.bool_]) -> None:
        grid = simulation.site.grid
        self._spec, self._cell_m, self._rows = simulation.scene.car, grid.cell_m, grid.rows
        open_cells = grid.free & ~simulation.traffic.blocked.reshape(grid.rows, grid.cols)
        # One more cell all around, so that neighbours need no special case.
        self._open = np.pad(open_cells, 1)
        self._start = start
        row, col = _cell_of(_outline(start[None], self._spec, 0.0)[0], grid.rows, grid.cell_m)
        self.usable = usable
        allowed = np.pad(usable, 1)
        allowed[np.clip(row + 1, 0, grid.rows + 1), np.clip(col + 1, 0, grid.cols + 1)] = True
        self._allowed = allowed
        self.ground = frozenset((row * grid.cols + col).tolist())
        bodies = np.delete(simulation.driver.estimate, car, axis=0)
        self._bodies = bodies[np.hypot(*(bodies - start)[:, :2].T) < 2 * SEARCH_M]
        self._depth = float(self._too_near(start[None])[0])

    def valid(self, poses: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the poses (k, 3) the car may take, shape (k,)."""
        row, col = self._cells(_outline(poses, self._spec, 0.0))
        held_by_nobody = (self._allowed | ~self._open)[row, col].all(axis=1)
        away = np.hypot(poses[:, 0] - self._start[0], poses[:, 1] - self._start[1])
        way_out_m = max(WAY_OUT_M, 2.0 * self._depth)
        bearable = self._depth * np.maximum(0.0, 1.0 - away / way_out_m) + 0.002
        return held_by_nobody & (self._too_near(poses) <= bearable)

    def _cells(self, points: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        row, col = _cell_of(points, self._rows, self._cell_m)
        height, width = self._open.shape
        return np.clip(row + 1, 0, height - 1), np.clip(col + 1, 0, width - 1)

    def _too_near(self, poses: FloatArray) -> FloatArray:
        """How far the body and its margin reach into what they must not touch [m], shape (k,)."""
        points = _outline(poses, self._spec, MARGIN_M)
        depth = self._into_walls(points)
        for body in self._bodies:
            inside = _depth_in_body(points, body[None, None], self._spec)
            corners = _outline(body[None], self._spec, MARGIN_M)
            inside = np.maximum(inside.max(axis=1), _depth_in_body(corners, poses[:, None], self._spec).max(axis=1))
            depth = np.maximum(depth, inside)
        return depth

    def _into_walls(self, points: FloatArray) -> FloatArray:
        """Greatest distance of a point from the nearest open cell [m]; at most a cell, shape (k,)."""
        row, col = self._cells(points)
        centre_x = (col - 0.5) * self._cell_m
        centre_y = (self._rows - row + 0.5) * self._cell_m
        height, width = self._open.shape
        nearest = np.full(row.shape, self._cell_m)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                is_open = self._open[np.clip(row + down, 0, height - 1), np.clip(col + right, 0, width - 1)]
                dx = np.abs(points[..., 0] - centre_x - right * self._cell_m) - self._cell_m / 2
                dy = np.abs(points[..., 1] - centre_y + down * self._cell_m) - self._cell_m / 2
                gap = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
                nearest = np.where(is_open, np.minimum(nearest, gap), nearest)
        return nearest.max(axis=1)


def _outline(poses: FloatArray, car: CarSpec, margin_m: float) -> FloatArray:
    """Points around the body and a margin at each pose, at most 0.15 m apart along its sides, shape (k, 12, 2)."""
    along = np.linspace(-car.rear_m - margin_m, car.front_m + margin_m, 5)
    side = car.half_width_m + margin_m
    ahead = np.concatenate([along, along, along[[0, -1]]])
    left = np.concatenate([np.full(5, side), np.full(5, -side), np.zeros(2)])
    cos, sin = np.cos(poses[:, 2:3]), np.sin(poses[:, 2:3])
    return np.stack([poses[:, 0:1] + cos * ahead - sin * left, poses[:, 1:2] + sin * ahead + cos * left], axis=-1)


def _depth_in_body(points: FloatArray, poses: FloatArray, car: CarSpec) -> FloatArray:
    """How far points (k, m, 2) are inside the bodies at poses (k or 1, 1, 3) [m], shape (k, m)."""
    middle = (car.front_m - car.rear_m) / 2
    dx, dy = points[..., 0] - poses[..., 0], points[..., 1] - poses[..., 1]
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    ahead = (car.front_m + car.rear_m) / 2 - np.abs(cos * dx + sin * dy - middle)
    left = car.half_width_m - np.abs(cos * dy - sin * dx)
    return np.maximum(np.minimum(ahead, left), 0.0)


def _cell_of(points: FloatArray, rows: int, cell_m: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Row and column of points (..., 2); outside the map they are out of range."""
    col = np.floor(points[..., 0] / cell_m).astype(np.int64)
    return rows - 1 - np.floor(points[..., 1] / cell_m).astype(np.int64), col
