"""Tracer: hands what a simulation has done in each tick to the trace file of its run."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numba import njit

from fleet.recording.trace_file import UNKNOWN, Quantity, TraceFile
from fleet.roster import PHASES
from fleet.simulation import Simulation
from fleet.stations.service import ServiceState

_ARM_STATES = tuple(ServiceState)
_STATE_CODES = {state: code for code, state in enumerate(_ARM_STATES)}


class Tracer:
    """Traces a run; use as a context manager.

    Args:
        simulation: The run.
        directory: As returned by `prepare_output`.

    Raises:
        OutputError: The file cannot be opened.
    """

    def __init__(self, simulation: Simulation, directory: Path) -> None:
        self._simulation = simulation
        world, graph, site = simulation.world, simulation.graph, simulation.site
        stations = tuple(station.name for station in simulation.stations)
        chargers = tuple(f"charger_{k}" for k in range(1, len(site.chargers) + 1))
        parking = tuple(f"parking_{k}" for k in range(1, len(site.parking) + 1))
        about = {
            "tick_s": simulation.tick_s,
            "plan": site.plan,
            "cell_m": site.grid.cell_m,
            "stations": stations,
            "places": (*stations, *chargers, *parking),
            "phases": PHASES,
            "arm_states": _ARM_STATES,
        }
        self._file = TraceFile(directory, n_cars=world.n_cars, n_arms=world.n_arms, about=about)
        n = world.n_cars + world.n_arms
        # The last entry stands for -1: no state.
        self._codes = np.append(4 * graph.state_cell.astype(np.int64) + graph.state_heading, -1)
        self._values = np.full((len(Quantity), n), UNKNOWN, dtype=np.int64)
        self._motion = np.zeros((n, max(4, 2 * simulation.scene.arm.n_joints)))
        self._floor = (site.grid.cell_m, site.grid.rows, site.grid.cols)

    def tick(self) -> None:
        """Note the tick that has just ended."""
        simulation = self._simulation
        world, roster, values = simulation.world, simulation.dispatcher.roster, self._values
        n_cars = world.n_cars
        dependencies = simulation.executor.dependencies
        _gather(
            values,
            self._motion,
            self._codes,
            self._floor,
            roster.phase_index,
            simulation.dispatcher.bookings.place_of,
            simulation.traffic.goals,
            dependencies.tail_states(),
            dependencies.granted_n(),
            world.car_poses(),
            world.car_speeds(),
        )
        if world.n_arms:
            values[Quantity.PHASE, n_cars:] = [_STATE_CODES[service.state] for service in simulation.desk.services]
            values[Quantity.PLACE, n_cars:] = roster.served
            n_joints = simulation.scene.arm.n_joints
            self._motion[n_cars:, :n_joints] = world.arm_positions()
            self._motion[n_cars:, n_joints : 2 * n_joints] = world.arm_velocities()
        self._file.tick(simulation.now - 1, values, self._motion)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


@njit(cache=True)
def _gather(values, motion, codes, floor, phase, place, goals, tails, granted, poses, speeds):  # rows as `Quantity`
    cell_m, rows, cols = floor
    for car in range(len(phase)):
        row = rows - 1 - int(np.floor(poses[car, 1] / cell_m))
        col = int(np.floor(poses[car, 0] / cell_m))
        inside = 0 <= row < rows and 0 <= col < cols
        values[0, car] = phase[car]
        values[1, car] = place[car]
        values[2, car] = codes[goals[car]]
        values[3, car] = codes[tails[car]]
        values[4, car] = granted[car]
        values[5, car] = row * cols + col if inside else -1
        motion[car, 0] = poses[car, 0]
        motion[car, 1] = poses[car, 1]
        motion[car, 2] = poses[car, 2]
        motion[car, 3] = speeds[car]
