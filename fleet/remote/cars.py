"""RemoteCars: cars that somebody outside of the fleet drives, within cells that they can get."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.incidents.recovery import Recovery
from fleet.incidents.rejoin_room import cell_of, outline
from fleet.missions.phases import CarPhase
from fleet.remote.errors import RemoteError
from fleet.robots.angle import wrapped_all
from fleet.robots.spec import CarSpec
from fleet.run.view import RunView
from fleet.safety.floor import DEVIATIONS, TAIL_M
from fleet.traffic.drivers import PathDriver

STALE_S = 0.5
"""A car that has heard nothing for so long brakes: who drives it must go on telling it what to do [s]."""
CLEAR_M = 0.08
"""Kept free in the direction of travel, beyond where the car would stand if it braked now [m]."""
WALL_M = 0.02
"""How far a body may seem to be in a wall [m]: the tail of a car in a bay is 1 cm off it, by a noisy measurement."""
BRAKES = 0.8
"""Share of its greatest deceleration that a car is counted on to reach."""
STEP_M = 0.05
"""Between poses at which a way ahead is looked at [m]."""
SLOW_MPS = 0.01


@dataclass(kw_only=True)
class _Wheel:
    """What is known of a car in other hands."""

    trusted: bool
    """Whether it may go where others have the right of way."""
    speed_mps: float = 0.0
    steering_rad: float = 0.0
    heard_s: float = -math.inf
    """When it was told that."""
    cells: frozenset[int] = frozenset()
    """Cells that it has got for its way."""
    stopped: str = ""
    """Why it was stopped last."""
    stopped_s: float = -math.inf
    """When it was stopped last [s]."""


class RemoteCars:
    """Cars in other hands.

    Such a car has left the care of the planner. It holds the cells that its body will sweep until it could stand, and
    gives back what it has left behind it; where it cannot get a cell, because another car holds it, or it is closed, or
    there is no floor, it is stopped before it.

    Args:
        run: The run.
        recovery: Takes cars off their lanes, and brings them back.
    """

    def __init__(self, run: RunView, recovery: Recovery) -> None:
        self._run = run
        self._recovery = recovery
        self._wheels: dict[int, _Wheel] = {}

    @property
    def taken(self) -> list[int]:
        """Cars in other hands."""
        return list(self._wheels)

    def take(self, car: int, *, trusted: bool = False) -> None:
        """Let somebody else drive a car from now on; its task goes back to the pool, but for a parcel in its tray.

        Args:
            car: The car.
            trusted: Whether it may go where others have the right of way; else it is stopped before.

        Raises:
            RemoteError: It cannot be taken at present.
        """
        run = self._run
        if car in self._wheels:
            self._wheels[car].trusted = trusted
            return
        if run.driver.paths is None:
            raise RemoteError(f"car_{car} goes from cell to cell; valid: a run with --fidelity physics or kinematic")
        if not run.scene.cars[car].steers:
            raise RemoteError(f"car_{car} is told a yaw rate; valid: a car that steers")
        if run.missions.phase[car] is CarPhase.DEAD or not self._recovery.take(car):
            raise RemoteError(f"car_{car} is {run.missions.phase[car]}; valid: a car on its lane that no arm serves")
        self._wheels[car] = _Wheel(trusted=trusted)
        run.events.log("remote_taken", robot=f"car_{car}", trusted=trusted)

    def drive(self, car: int, speed_mps: float, steering_rad: float) -> None:
        """Tell a car that was taken what to do; it goes on so for `STALE_S` at most.

        Args:
            car: The car.
            speed_mps: Signed speed; what is too fast is taken as its greatest.
            steering_rad: Steering angle of the bicycle, positive to the left; what is too much is taken as its most.

        Raises:
            RemoteError: It was not taken, or these are no numbers.
        """
        if car not in self._wheels:
            valid = ", ".join(f"car_{one}" for one in self._wheels) or "a car that was taken before"
            raise RemoteError(f"car_{car} was not taken; valid: {valid}")
        if not (math.isfinite(speed_mps) and math.isfinite(steering_rad)):
            raise RemoteError(f"car_{car}: speed {speed_mps}, steering {steering_rad}; valid: finite numbers")
        spec, wheel = self._run.scene.cars[car], self._wheels[car]
        wheel.speed_mps = max(-spec.max_speed_mps, min(spec.max_speed_mps, speed_mps))
        wheel.steering_rad = max(-spec.max_steering_rad, min(spec.max_steering_rad, steering_rad))
        wheel.heard_s = self._run.sim_s

    def give_back(self, car: int) -> None:
        """Let the fleet have a car again: it comes back to its lane by itself."""
        if self._wheels.pop(car, None) is None:
            return
        if self._run.missions.phase[car] is not CarPhase.DEAD:
            self._recovery.give_back(car)
        self._run.events.log("remote_given_back", robot=f"car_{car}")

    def tick(self, commands: FloatArray) -> None:
        """Put what cars in other hands do into the commands of all cars, shape (n_cars, 2)."""
        paths = self._run.driver.paths
        for car, wheel in list(self._wheels.items()):
            if paths is None or self._run.missions.phase[car] is CarPhase.DEAD:
                self.give_back(car)
            else:
                commands[car] = self._command(paths, car, wheel)

    def _command(self, paths: PathDriver, car: int, wheel: _Wheel) -> tuple[float, float]:
        """Steering [rad] and speed [m/s] of a car in this tick."""
        run = self._run
        steering_rad, speed_mps = float(run.world.car_steering()[car]), float(run.world.car_speeds()[car])
        stop = steering_rad, 0.0
        if run.sim_s - wheel.heard_s > STALE_S or car in run.driver.hindrances.held:
            return stop
        target = wheel.steering_rad, wheel.speed_mps
        ways = list(_ways(run.scene.cars[car], paths.estimate[car], (steering_rad, speed_mps), target, run.tick_s))
        cells = self._cells(car, np.concatenate(ways))
        why = "" if wheel.trusted else self._obstacle(car, np.concatenate(ways), cells)
        if why:
            if why != wheel.stopped or run.sim_s - wheel.stopped_s > STALE_S:
                run.events.log("remote_stopped", robot=f"car_{car}", cause=why)
            wheel.stopped, wheel.stopped_s = why, run.sim_s
            return stop
        if cells != wheel.cells:
            wheel.cells = cells
            self._hold(paths, car, cells)
        return target

    def _cells(self, car: int, way: FloatArray) -> frozenset[int]:
        """Cells that a body sweeps, but for what every car may reach into beyond its own cells."""
        run = self._run
        stray_m = TAIL_M + DEVIATIONS * run.config.estimate.noise_m
        return self._under(car, way, -min(stray_m, run.scene.cars[car].half_width_m))

    def _under(self, car: int, way: FloatArray, margin_m: float) -> frozenset[int]:
        """Cells under a body and a margin at poses; -1 for what is beyond the floor."""
        grid = self._run.site.grid
        row, col = cell_of(
            outline(way, self._run.scene.cars[car].footprint, margin_m).reshape(-1, 2), grid.rows, grid.cell_m
        )
        on_floor = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
        return frozenset(np.unique(np.where(on_floor, row * grid.cols + col, -1)).tolist())

    def _obstacle(self, car: int, way: FloatArray, cells: frozenset[int]) -> str:
        """Why a car may not go a way; empty if it may."""
        run = self._run
        grid, executor = run.site.grid, run.executor
        for cell in sorted(self._under(car, way, -WALL_M)):
            if cell < 0 or not grid.free.flat[cell]:
                return "the floor ends" if cell < 0 else f"there is no floor in {grid.words(cell)}"
        holders = executor.dependencies.holders()
        for cell in sorted(cells):
            holder = int(holders[cell])
            if holder == car:
                continue
            if holder >= 0:
                return f"{grid.words(cell)} is held by car_{holder}"
            if executor.closed[cell] or run.traffic.blocked[cell] or executor.n_walkers[cell]:
                return f"{grid.words(cell)} is closed"
        return ""

    def _hold(self, paths: PathDriver, car: int, cells: frozenset[int]) -> None:
        """Let a car have just these cells, as far as nobody else has them, and stand in a state in one of them."""
        run = self._run
        dependencies, graph = run.executor.dependencies, run.graph
        paths.give_up(car)  # what it was granted is void
        dependencies.unreserve(car)
        holders = dependencies.holders()
        own = [cell for cell in sorted(cells) if cell >= 0 and holders[cell] in (-1, car)]
        dependencies.reserve(car, own)
        states = np.flatnonzero(np.isin(graph.state_cell, own))
        if not len(states):
            return  # beside all lanes it keeps its last cell there: the graph knows no other place for it
        x, y, yaw = paths.estimate[car].tolist()
        away = np.hypot(graph.state_pose[states, 0] - x, graph.state_pose[states, 1] - y)
        away += 0.1 * np.abs(wrapped_all(graph.state_pose[states, 2] - yaw))
        state = int(states[np.argmin(away)])
        if state != int(run.executor.tail_states()[car]) or dependencies.n_granted(car):
            run.executor.relocate(car, state)
            run.traffic.set_fixed(car, True)


def _ways(
    spec: CarSpec, pose: FloatArray, now: tuple[float, float], target: tuple[float, float], tick_s: float
) -> Iterator[FloatArray]:
    """What a car sweeps if it obeys for a tick and then brakes: poses x, y, yaw, each (k, 3).

    The wheels turn from where they are to where they are told to, at the most at `max_steering_rate_radps`, so that the
    way lies between the circles of both ends. A car that changes its direction brakes first.
    """
    (steering, speed), (wanted, target_mps) = now, target
    reach = spec.max_steering_rate_radps * (2 * tick_s + abs(speed) / (BRAKES * spec.max_brake_mps2))
    ends = (steering, max(steering - reach, min(steering + reach, wanted)))
    gain_mps = 2 * spec.max_accel_mps2 * tick_s
    speeds = []
    if abs(speed) > SLOW_MPS:
        faster = abs(target_mps) > abs(speed) and speed * target_mps > 0
        speeds.append(math.copysign(min(abs(speed) + gain_mps, spec.max_speed_mps) if faster else abs(speed), speed))
    if target_mps != 0.0 and (abs(speed) <= SLOW_MPS or speed * target_mps < 0):
        speeds.append(math.copysign(min(abs(target_mps), gain_mps), target_mps))
    yield pose[None]
    for mps in speeds:
        length_m = 2 * abs(mps) * tick_s + mps * mps / (2 * BRAKES * spec.max_brake_mps2) + CLEAR_M
        s_m = math.copysign(1.0, mps) * np.linspace(0.0, length_m, 1 + math.ceil(length_m / STEP_M))
        for angle in ends:
            yield _arc(pose, s_m, math.tan(angle) / spec.wheelbase_m)


def _arc(pose: FloatArray, s_m: FloatArray, curvature: float) -> FloatArray:
    """Poses along a circle, or a straight line, through a pose, shape (k, 3)."""
    x, y, yaw = pose.tolist()
    if abs(curvature) < 1e-6:
        return np.column_stack((x + s_m * math.cos(yaw), y + s_m * math.sin(yaw), np.full(len(s_m), yaw)))
    turned = yaw + curvature * s_m
    return np.column_stack(
        (
            x + (np.sin(turned) - math.sin(yaw)) / curvature,
            y - (np.cos(turned) - math.cos(yaw)) / curvature,
            turned,
        )
    )
