"""Slots: parcels enter the warehouse at rack slots: when their cars are near, or when slots are free anyhow."""

from __future__ import annotations

from fleet.missions.parcels.inventory import Inventory
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.open_deliveries import OpenDeliveries


class Slots:
    """Gives slots to parcels.

    A car that is near gets a slot for its parcel when it books its pick station, so that cars at a dock never wait for
    slots that parcels of other cars have. At most half of the slots are given to parcels that nobody comes for yet.
    When cars change tasks, more have them: the least urgent goes back when a car is near whose parcel has no slot.

    Args:
        missions: Tells which cars come.
        ways: How far they are.
        inventory: Puts parcels on slots, and takes them out.
        open_deliveries: What no car has yet.
    """

    def __init__(self, missions: Missions, ways: Ways, inventory: Inventory, open_deliveries: OpenDeliveries) -> None:
        self._missions = missions
        self._ways = ways
        self._inventory = inventory
        self._open = open_deliveries
        self._seen: dict[int, tuple[int, int, int]] = {}

    def collect(self, now_s: float) -> None:
        """Take out the delivered parcels whose time has come."""
        self._inventory.collect(now_s)

    def take(self, task: Task, now_s: float) -> bool:
        """Put a parcel on a slot of its pick station, if it is not there yet; False if none is free."""
        if task.pick_slot is not None:
            return True
        station = self._missions.stations.named(task.pick)
        if station.n_free == 0 and (other := self._least_urgent(station)) is not None:
            self._inventory.take_back(other)
        task.pick_slot = station.take_slot(task.index)
        if task.pick_slot is None:
            return False
        self._inventory.enter(task, now_s)
        return True

    def fill(self, now_s: float) -> None:
        """Put parcels on slots that are free anyhow: first those whose cars come soonest, then the most urgent."""
        for station in self._missions.stations.loading():
            if not _has_spare(station):
                continue
            changes = int(self._missions.bookings.changed_at[station.arm])
            if self._seen.get(station.arm) == (changes, station.n_free, self._open.n_changes):
                continue
            while _has_spare(station) and (task := self._next(station)) is not None:
                task.pick = station.name
                self.take(task, now_s)
            self._seen[station.arm] = (changes, station.n_free, self._open.n_changes)

    def _least_urgent(self, station: Station) -> Task | None:
        """Of the parcels on a station's slots that nobody comes for, the one that can be done without longest.

        While no car has booked the station, nobody comes for those of cars that are held back either.
        """
        missions = self._missions
        nobody_comes = not missions.bookings.cars(station.arm)
        tasks = [missions.board.tasks[index] for index in station.contents if index is not None]
        left = [
            task
            for task in tasks
            if (task.state is TaskState.READY or (nobody_comes and missions.is_held_back(task)))
            and not self._inventory.in_a_grip(task)
            and self._inventory.on_slot(task, task.pick_slot, station)
        ]
        return max(left, key=lambda task: (task.order.rank, task.since_s[TaskState.BACKLOG], task.index), default=None)

    def _next(self, station: Station) -> Task | None:
        missions = self._missions
        tasks = [(car, missions.task_of[car]) for car in missions.bookings.bound(station.arm)]
        cars = [car for car, task in tasks if task is not None and _lacks_slot(task)]
        if cars:
            nearest = int(self._ways.moves(self._ways.tails[cars], station.dock_state).argmin())
            return missions.task_of[cars[nearest]]
        return next((task for task in self._open.urgent(station.name) if task.pick_slot is None), None)


def _lacks_slot(task: Task) -> bool:
    return task.state is TaskState.ASSIGNED and task.visit is None and task.pick_slot is None


def _has_spare(station: Station) -> bool:
    """Whether more than half of the slots are free."""
    return 2 * (station.n_free - 1) >= len(station.contents)
