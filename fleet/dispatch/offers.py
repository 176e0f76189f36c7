"""Offers: ready tasks that there is room for at their stations."""

from __future__ import annotations

import numpy as np

from fleet.dispatch.cost_model import CostMatrix
from fleet.missions.state import Missions
from fleet.missions.visit_routes import VisitRoutes
from fleet.stations.service_time import Direction

QUEUE_S = 60.0
"""No task is given out at a station while those under way to it keep its arm busy for longer than this [s]."""


class Offers:
    """Says which tasks may be given out.

    Args:
        missions: Which cars are under way to which stations.
        routes: Room at the places of visits.
    """

    def __init__(self, missions: Missions, routes: VisitRoutes) -> None:
        self._missions = missions
        self._routes = routes

    def of(self, costs: CostMatrix, n_ready: int, *, sequences: bool) -> tuple[list[int], set[int]]:
        """Ready tasks that a car can take and that there is room for.

        Args:
            costs: What tasks cost; the ready ones come first.
            n_ready: How many they are.
            sequences: Whether the allocator gives cars several tasks, one after the other.

        Returns:
            Columns of those that are offered, the most urgent first, and of those without room.
        """
        room = self._room()
        place_room: dict[int, int] = {}
        offered: list[int] = []
        full: set[int] = set()
        feasible = [costs.offers(k) for k in range(n_ready)]
        order = sorted(
            range(n_ready),
            key=lambda k: (costs.tasks[k].order.priority.rank, -costs.pressure_s[k], costs.tasks[k].index),
        )
        named = self._missions.stations.named
        for k in order:
            task = costs.tasks[k]
            if task.visit is not None:
                if feasible[k] and self._routes.take_room(task, place_room):
                    offered.append(k)
                elif feasible[k]:
                    full.add(k)
                continue
            ends = (named(task.pick).arm, named(task.delivery.drop).arm)
            if any(room[arm] <= 0 for arm in ends):
                full.add(k)
            elif feasible[k]:
                offered.append(k)
                # Who plans ahead knows that an arm serves one car at a time.
                for arm in ends if not sequences else ():
                    room[arm] -= 1
        return offered, full

    def _room(self) -> list[int]:
        """Tasks that can be given out at each station."""
        missions = self._missions
        bound_for = missions.drop_of[(missions.under_way() >= 0) & (missions.drop_of >= 0)]
        delivering = np.bincount(bound_for, minlength=len(missions.stations)).tolist()
        room = []
        for station in missions.stations:
            # At least one car more than may be near: it is held back if it comes too early.
            most = max(missions.bookings.caps[station.arm] + 1, round(QUEUE_S / missions.stations.time(station).mean_s))
            if station.direction is Direction.TO_CAR:
                most -= len(missions.bookings.bound(station.arm))
            room.append(most - delivering[station.arm])
        return room
