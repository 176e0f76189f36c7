"""Aboard: cars whose trays have room for several parcels take more at a station before they leave it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, islice

from fleet.missions.parcels.planned_loads import PlannedLoads
from fleet.missions.parcels.slots import Slots
from fleet.missions.phases import CarPhase
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.stations.station import Station
from fleet.tasks.board import Task
from fleet.tasks.open_deliveries import OpenDeliveries
from fleet.tasks.order import Ability
from planners.mapf.distance_table import UNREACHABLE

N_LOOKED_AT = 20
"""Open deliveries of a station that are looked at, the most urgent first."""
N_DETOUR = 8
"""Moves by which the way to a drop station may be longer because of the one before it."""


class Aboard:
    """Which parcels cars take beside the one that they came for, and in which order they are brought away.

    A car that has been loaded takes another delivery that begins at the same station, if its tray has a place and all
    of it is not too heavy for it: first what was planned for it, then what no other car is to have and of which one of
    both drop stations lies nearly on the way to the other one, `N_DETOUR`. It brings away what it carries nearest
    first.

    Args:
        missions: What cars are about.
        ways: How far stations are from each other.
        slots: Puts parcels on racks.
        open_deliveries: What no car has yet.
        abilities: What each car can do.
        loads: Places in each car's tray, and what is planned for them.
        log: Called as ``log(kind, **facts)`` when a car takes one more.
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        slots: Slots,
        open_deliveries: OpenDeliveries,
        abilities: Sequence[Ability],
        loads: PlannedLoads,
        log: Callable[..., None],
    ) -> None:
        self._missions = missions
        self._ways = ways
        self._slots = slots
        self._open = open_deliveries
        self._abilities = abilities
        self._loads = loads
        self._log = log
        self.any = bool((loads.n_places > 1).any())
        """Whether any car has room for several."""

    def take_more(self, station: Station, car: int, now_s: float) -> Task | None:
        """Give a car that has just been loaded another delivery of the station where it stands, if there is one.

        Args:
            station: The station.
            car: The car; what it was about is aboard afterwards.
            now_s: Simulated time [s].
        """
        missions = self._missions
        had = missions.task_of[car]
        if had is None or car in missions.leaving or len(missions.aboard[car]) + 1 >= self._loads.n_places[car]:
            return None
        carried = [had, *missions.aboard[car]]
        planned, of_others = self._loads.of(car), self._loads.spoken_for((car,))
        near = (
            task
            for task in islice(self._open.urgent(station.name), N_LOOKED_AT)
            if task.index not in of_others and all(self._on_one_way(station, other, task) for other in carried)
        )
        for task in chain(planned, near):
            if self._fits(station, car, carried, task):
                task.pick = station.name
                if self._slots.take(task, now_s):
                    missions.stow(car)
                    missions.assign(car, task, now_s, f"car_{car} is at {station.name} and takes it along")
                    missions.enter(car, CarPhase.TO_PICK)
                    self._log("taken_too", task=task.order.name, car=f"car_{car}", station=station.name)
                    return task
        return None

    def nearest(self, car: int) -> Task | None:
        """Of what a car carries the delivery whose drop station is nearest; None if it carries nothing."""
        missions = self._missions
        had = missions.task_of[car]
        carried = [*([] if had is None else [had]), *missions.aboard[car]]
        return min(carried, key=lambda task: (self._to_drop(car, task), task.index), default=None)

    def _fits(self, station: Station, car: int, carried: Sequence[Task], task: Task) -> bool:
        """Whether a car that carries some parcels may take one more."""
        ability, drop = self._abilities[car], self._missions.stations.named(task.delivery.drop)
        load_kg = sum(other.delivery.mass_kg for other in carried)
        return (
            station.name in task.delivery.picks
            and (task.pick_slot is None or task.pick == station.name)
            and not task.order.same_car_as
            and car not in task.shunned
            and ability.fits(task.order)
            and load_kg + task.delivery.mass_kg <= ability.max_payload_kg
            and not self._missions.bookings.closed[drop.arm]
            and self._to_drop(car, task) < UNREACHABLE
        )

    def _on_one_way(self, station: Station, one: Task, other: Task) -> bool:
        """Whether one of two drop stations lies nearly on the way to the other one."""
        begin = station.dock_state
        first, second = (self._missions.stations.named(task.delivery.drop).dock_state for task in (one, other))
        ways = self._ways
        there, back = ways.between(first, second), ways.between(second, first)
        return (
            ways.between(begin, first) + there <= ways.between(begin, second) + N_DETOUR
            or ways.between(begin, second) + back <= ways.between(begin, first) + N_DETOUR
        )

    def _to_drop(self, car: int, task: Task) -> int:
        return self._ways.of_car(car, self._missions.stations.named(task.delivery.drop).dock_state)
