"""Tracer: hands what a simulation has done in each tick to the trace file of its run."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numba import njit

from fleet.missions.phases import PHASES
from fleet.recording.trace_file import UNKNOWN, TraceFile
from fleet.run.view import RunView
from fleet.stations.arms.arm_controller import ArmPhase

BLOCK_TICKS = 60
"""Ticks that are written at once at most."""
BLOCK_S = 0.5
"""Simulated time that is written at once at most, of which a killed run loses no more [s]."""
_ARM_STATES = tuple(ArmPhase)
_STATE_CODES = {state: code for code, state in enumerate(_ARM_STATES)}


class Tracer:
    """Traces a run; use as a context manager.

    Args:
        run: The run.
        directory: As returned by `prepare_output`.
        name: Name of the run, see `fleet.recording.run_file.RunFile`.

    Raises:
        OutputError: The file cannot be opened.
    """

    def __init__(self, run: RunView, directory: Path, name: str) -> None:
        self._run = run
        world, graph, site = run.world, run.graph, run.site
        stations = tuple(station.name for station in run.stations)
        chargers = tuple(f"charger_{k}" for k in range(1, len(site.chargers) + 1))
        parking = tuple(f"parking_{k}" for k in range(1, len(site.parking) + 1))
        storage = tuple(f"storage_{k}" for k in range(1, len(site.storage) + 1))
        about = {
            "run": name,
            "tick_s": run.tick_s,
            "plan": site.plan,
            "cell_m": site.grid.cell_m,
            "stations": stations,
            "places": (*stations, *chargers, *parking, *storage),
            "place_cells": list(map(int, run.places.cells)),
            "phases": PHASES,
            "arm_states": _ARM_STATES,
        }
        self._file = TraceFile(directory, n_cars=world.n_cars, n_arms=world.n_arms, about=about)
        # The last entry stands for -1: no state.
        self._codes = np.append(4 * graph.state_cell.astype(np.int64) + graph.state_heading, -1)
        self._floor = (site.grid.cell_m, site.grid.rows, site.grid.cols)
        n_cars, n_arms, n_joints = world.n_cars, world.n_arms, run.scene.arms.width
        # One row for each tick: they are looked through together, which costs a fraction of doing it tick by tick.
        self._most = n = max(1, min(BLOCK_TICKS, round(BLOCK_S / run.tick_s)))
        self._cars = np.zeros((n, 5, n_cars), dtype=np.int64)
        self._poses, self._speeds = np.zeros((n, n_cars, 3)), np.zeros((n, n_cars))
        self._arms = np.zeros((n, 2, n_arms), dtype=np.int64)
        self._joints = np.zeros((n, n_arms, n_joints))
        self._first = self._rows = 0

    def tick(self) -> None:
        """Note the tick that has just ended."""
        run, row = self._run, self._rows
        world, dependencies = run.world, run.executor.dependencies
        if row == 0:
            self._first = run.now - 1
        cars = self._cars[row]
        cars[0] = run.missions.phase_index
        cars[1] = run.bookings.place_of
        cars[2] = run.traffic.goals
        cars[3] = dependencies.tail_states()
        cars[4] = dependencies.n_granted_so_far()
        self._poses[row] = world.car_poses()
        self._speeds[row] = world.car_speeds()
        if world.n_arms:
            self._arms[row, 0] = [_STATE_CODES[service.state] for service in run.arm_manager.services]
            self._arms[row, 1] = run.missions.served
            self._joints[row] = world.arm_positions()
        self._rows += 1
        if self._rows == self._most:
            self._write()

    def close(self) -> None:
        """Write what is left; calling twice is harmless."""
        if self._rows:
            self._write()
        self._file.close()

    def _write(self) -> None:
        n, self._rows = self._rows, 0
        values, motion = _gather(
            self._codes,
            self._floor,
            self._cars[:n],
            self._poses[:n],
            self._speeds[:n],
            self._arms[:n],
            self._joints[:n],
        )
        self._file.write(self._first, values, motion)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@njit(cache=True)
def _gather(codes, floor, cars, poses, speeds, arms, joints):
    """Quantities, and what decides how robots move on, of all robots at all ticks, see `TraceFile.write`."""
    cell_m, rows, cols = floor
    n_ticks, _, n_cars = cars.shape
    _, n_arms, n_joints = joints.shape
    values = np.full((n_ticks, 6, n_cars + n_arms), UNKNOWN, dtype=np.int64)  # in the order of `Quantity`
    motion = np.zeros((n_ticks, n_cars + n_arms, max(4, n_joints)))
    for k in range(n_ticks):
        for car in range(n_cars):
            row = rows - 1 - int(np.floor(poses[k, car, 1] / cell_m))
            col = int(np.floor(poses[k, car, 0] / cell_m))
            values[k, 0, car] = cars[k, 0, car]
            values[k, 1, car] = cars[k, 1, car]
            values[k, 2, car] = codes[cars[k, 2, car]]
            values[k, 3, car] = codes[cars[k, 3, car]]
            values[k, 4, car] = cars[k, 4, car]
            values[k, 5, car] = row * cols + col if 0 <= row < rows and 0 <= col < cols else -1
            for axis in range(3):
                motion[k, car, axis] = poses[k, car, axis]
            motion[k, car, 3] = speeds[k, car]
        for arm in range(n_arms):
            values[k, 0, n_cars + arm] = arms[k, 0, arm]
            values[k, 1, n_cars + arm] = arms[k, 1, arm]
            for joint in range(n_joints):
                motion[k, n_cars + arm, joint] = joints[k, arm, joint]
    return values, motion
