"""Probe: what cars and stations are busy with, sampled while a run goes on."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from fleet.dispatcher import CarPhase
from fleet.insight.ledger import STANDING_MPS
from fleet.simulation import Simulation

SAMPLE_S = 1.0
"""Simulated time between two samples [s]."""


class CarUse(StrEnum):
    """What a car's time goes into."""

    DRIVING = "driving"
    TRAFFIC = "traffic"
    """Bound for a station, standing, and the arm there is free: other cars are in the way."""
    QUEUEING = "queueing"
    """Bound for a station, standing, while the arm there works for another car."""
    SERVED = "served"
    IDLE = "idle"
    FAULT = "fault"


class Probe:
    """Counts samples of a run.

    Args:
        simulation: The run.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._period = max(1, round(SAMPLE_S / simulation.tick_s))
        self._cars = dict.fromkeys(CarUse, 0)
        self._stations = np.zeros(len(simulation.stations), dtype=np.int64)
        self._arm_of = {station.name: station.arm for station in simulation.stations}
        self._samples = 0

    def look(self) -> None:
        """Take a sample if one is due."""
        simulation = self._simulation
        if simulation.now % self._period:
            return
        self._samples += 1
        busy = np.array([not simulation.desk.is_idle(station.arm) for station in simulation.stations])
        standing = np.abs(simulation.world.car_speeds()) < STANDING_MPS
        for car in range(simulation.world.n_cars):
            self._cars[self._use(car, bool(standing[car]), busy)] += 1
        self._stations += busy

    def car_shares(self) -> dict[CarUse, float]:
        """Share of all cars' time in each use; they sum to 1."""
        total = max(1, self._samples * self._simulation.world.n_cars)
        return {use: count / total for use, count in self._cars.items()}

    def station_shares(self) -> dict[str, float]:
        """Share of the time in which each station's arm was at work."""
        shares = self._stations / max(1, self._samples)
        return {station.name: float(shares[station.arm]) for station in self._simulation.stations}

    def _use(self, car: int, standing: bool, busy: np.ndarray) -> CarUse:
        dispatcher = self._simulation.dispatcher
        phase, task = dispatcher.phase[car], dispatcher.task_of[car]
        if phase in (CarPhase.LOADING, CarPhase.UNLOADING):
            return CarUse.SERVED
        if phase in (CarPhase.DEAD, CarPhase.RECOVERING):
            return CarUse.FAULT
        if phase not in (CarPhase.TO_PICK, CarPhase.TO_DROP) or task is None:
            return CarUse.IDLE
        if not standing:
            return CarUse.DRIVING
        station = task.order.pick if phase is CarPhase.TO_PICK else task.order.drop
        return CarUse.QUEUEING if busy[self._arm_of[station]] else CarUse.TRAFFIC
