"""Recovery: a car that has left its lane stops, and rejoins a free state nearby on a Reeds-Shepp path."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fleet.dispatcher import CarPhase
from fleet.driving import PathDriver
from fleet.world.protocol import FloatArray
from planners.motion.reeds_shepp import RejoinStatus, plan_rejoin

if TYPE_CHECKING:
    from fleet.simulation import Simulation

TURNING_RADIUS_M = 0.45
"""A little wider than the lanes' arcs, so that the follower has room to correct."""
SEARCH_M = 2.2
"""How far from the car a state to rejoin may be."""
STILL_S = 0.5
"""A car counts as stopped after standing this long."""
RETRY_S = 2.0
"""Wait before the next attempt when there is no way back yet."""
ITERATIONS = 2_000


class _Stage(StrEnum):
    STOPPING = "stopping"
    DRIVING = "driving"


@dataclass(kw_only=True)
class _Rejoin:
    stage: _Stage
    still_since: int
    retry_tick: int = 0
    target: int = -1


class Recovery:
    """Brings cars back onto the lane graph.

    Args:
        simulation: The run whose cars are watched.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._rejoining: dict[int, _Rejoin] = {}

    def abandon(self, car: int) -> None:
        """Stop caring for a car (it died)."""
        if self._rejoining.pop(car, None) is not None:
            self._simulation.executor.dependencies.unreserve(car)

    def tick(self, tick: int) -> None:
        """Notice cars that are off their lane, and move those that are being recovered on by one step."""
        driver = self._simulation.driver
        if not isinstance(driver, PathDriver):
            return
        for car in driver.off_lane():
            if car not in self._rejoining and self._simulation.dispatcher.phase[car] is not CarPhase.DEAD:
                self._begin(driver, car, tick)
        for car, rejoin in list(self._rejoining.items()):
            if rejoin.stage is _Stage.STOPPING:
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

    def _try(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        simulation = self._simulation
        if abs(float(simulation.world.car_speeds()[car])) > 0.05:
            rejoin.still_since = tick
        if (tick - rejoin.still_since) * simulation.tick_s < STILL_S or tick < rejoin.retry_tick:
            return
        rejoin.retry_tick = tick + round(RETRY_S / simulation.tick_s)
        usable = self._usable_cells(car)
        start = driver.estimate[car]
        for state in self._near_states(start, usable):
            result = plan_rejoin(
                start,
                simulation.graph.state_pose[state],
                TURNING_RADIUS_M,
                lambda poses: self._inside(poses, usable),
                seed=simulation.config.seed + tick,
                max_iterations=ITERATIONS,
            )
            if result.status is not RejoinStatus.SOLVED:
                continue
            cells = self._cells_of(result.poses)
            if not simulation.executor.dependencies.reserve(car, cells):
                continue
            self._drive(driver, car, result.poses, result.directions)
            rejoin.stage, rejoin.target = _Stage.DRIVING, state
            simulation.log("rejoin", car=f"car_{car}", state=state, length_m=round(_length(result.poses), 2))
            return
        simulation.log("rejoin_impossible", car=f"car_{car}", retry_s=RETRY_S)

    def _drive(self, driver: PathDriver, car: int, poses: FloatArray, directions: npt.NDArray[np.int8]) -> None:
        driver.restart(car)
        cusps = np.nonzero(np.diff(directions))[0] + 1
        bounds = [0, *cusps.tolist(), len(poses) - 1]
        for a, b in zip(bounds[:-1], bounds[1:], strict=True):
            part = poses[a : b + 1]
            s_m = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(part[:, 0]), np.diff(part[:, 1])))))
            driver.append_points(car, part, s_m, int(directions[a]))

    def _end(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        simulation = self._simulation
        del self._rejoining[car]
        driver.restart(car)
        simulation.executor.dependencies.unreserve(car)
        simulation.executor.relocate(car, rejoin.target)
        simulation.traffic.set_fixed(car, False)
        simulation.dispatcher.resume(car, tick)
        simulation.log("rejoined", car=f"car_{car}", state=rejoin.target)

    def _usable_cells(self, car: int) -> npt.NDArray[np.bool_]:
        """Free cells that no other car holds, shape (rows, cols)."""
        simulation = self._simulation
        grid = simulation.site.grid
        usable = grid.free.copy().ravel()
        usable &= ~simulation.traffic.blocked
        for other in range(simulation.world.n_cars):
            if other != car:
                for cell in simulation.executor.dependencies.held_cells(other):
                    usable[cell] = False
        return usable.reshape(grid.rows, grid.cols)

    def _near_states(self, pose: FloatArray, usable: npt.NDArray[np.bool_]) -> list[int]:
        graph = self._simulation.graph
        offset = graph.state_pose - pose
        distance = np.hypot(offset[:, 0], offset[:, 1])
        turn = np.abs(np.arctan2(np.sin(offset[:, 2]), np.cos(offset[:, 2])))
        near = np.nonzero((distance < SEARCH_M) & usable.ravel()[graph.state_cell])[0]
        order = np.lexsort((near, distance[near] + 0.5 * turn[near]))
        return near[order][:8].tolist()

    def _inside(self, poses: FloatArray, usable: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        grid = self._simulation.site.grid
        points = self._outline(poses)
        col = np.floor(points[..., 0] / grid.cell_m).astype(int)
        row = grid.rows - 1 - np.floor(points[..., 1] / grid.cell_m).astype(int)
        on_map = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
        ok = on_map & usable[np.where(on_map, row, 0), np.where(on_map, col, 0)]
        return ok.all(axis=1)

    def _cells_of(self, poses: FloatArray) -> list[int]:
        grid = self._simulation.site.grid
        points = self._outline(poses).reshape(-1, 2)
        col = np.floor(points[:, 0] / grid.cell_m).astype(int)
        row = grid.rows - 1 - np.floor(points[:, 1] / grid.cell_m).astype(int)
        return np.unique(row * grid.cols + col).tolist()

    def _outline(self, poses: FloatArray) -> FloatArray:
        """Points around the body at each pose, shape (k, 8, 2)."""
        car = self._simulation.scene.car
        middle = (car.front_m - car.rear_m) / 2
        ahead = np.array([car.front_m, middle, -car.rear_m, car.front_m, middle, -car.rear_m, car.front_m, -car.rear_m])
        left = np.array([1, 1, 1, -1, -1, -1, 0, 0]) * car.half_width_m
        cos, sin = np.cos(poses[:, 2:3]), np.sin(poses[:, 2:3])
        x = poses[:, 0:1] + cos * ahead - sin * left
        y = poses[:, 1:2] + sin * ahead + cos * left
        return np.stack([x, y], axis=-1)


def _length(poses: FloatArray) -> float:
    return float(np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1])).sum())
