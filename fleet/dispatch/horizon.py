"""RollingHorizon: tasks, cars and arms as one problem for allocators that plan ahead, and what they have planned."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.arrays import BoolArray
from fleet.config import AllocationConfig
from fleet.dispatch.cost_model import CostMatrix
from fleet.missions.parcels.planned_loads import PlannedLoads
from fleet.missions.state import Missions
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.ways import STEP_S, Ways
from fleet.tasks.board import Task
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import NO_STATION, Shop
from planners.mapf.distance_table import UNREACHABLE

PRESSES_S = 150.0
"""The end of a task that presses so much counts twice [s]."""


class RollingHorizon:
    """Makes job shops of tasks, cars and arms, and proposes the last plan to the next.

    Args:
        config: Weights of ageing and lateness.
        missions: Stations, their rooms and how long their arms take.
        ways: How far places are.
        routes: Of visits.
        loads: Places in cars' trays; told of what is planned for them.
    """

    def __init__(
        self, config: AllocationConfig, missions: Missions, ways: Ways, routes: VisitRoutes, loads: PlannedLoads
    ) -> None:
        self._config = config
        self._stations = missions.stations
        self._bookings = missions.bookings
        self._ways = ways
        self._routes = routes
        self.loads = loads
        self._plan: list[tuple[int, int]] = []  # task and car, in order

    def change(self, config: AllocationConfig) -> None:
        """Go on with other weights."""
        self._config = config

    def keep(
        self,
        costs: CostMatrix,
        problem: AllocationProblem,
        assignment: Assignment,
        columns: list[int],
        cars: npt.NDArray[np.intp],
        soon: BoolArray,
    ) -> None:
        """Remember the plan for some tasks, by their columns among the prices, and some cars.

        What cars that cannot take a task now, `soon`, are to be loaded with first is theirs to begin later.
        """
        self._plan = []
        for row, sequence in enumerate(assignment.sequence if problem.shop is not None else ()):
            if problem.shop is not None and not soon[cars[row]]:
                n = problem.shop.n_together(row, sequence)
                self.loads.plan(int(cars[row]), [costs.tasks[columns[k]] for k in sequence[:n]])
        if assignment.timetable is None or problem.shop is None:
            return
        start_s = assignment.timetable.start_s[problem.shop.first_errand[:-1]].tolist()
        car_of = {k: int(cars[row]) for row, sequence in enumerate(assignment.sequence) for k in sequence}
        for k in sorted(car_of, key=lambda k: (start_s[k], k)):
            task = costs.tasks[columns[k]]
            self._plan.append((task.index, car_of[k]))

    def shop(self, costs: CostMatrix, columns: list[int], cars: npt.NDArray[np.intp]) -> Shop:
        """Tasks, cars and the arms they book; the clock starts now.

        Args:
            costs: Where and when each car can begin, and how much each task presses.
            columns: Columns of the tasks to plan among the prices.
            cars: The cars to plan for.
        """
        now_s, n_stations = costs.now_s, len(self._stations)
        tasks = [costs.tasks[column] for column in columns]
        visited = list(
            dict.fromkeys(errand for task in tasks if task.visit is not None for errand in self._routes.errands(task))
        )
        n_known = n_stations + len(cars)
        # Stations in their order, then where each car is, then what is visited; nobody drives to where a car was.
        docks = [station.dock_state for station in self._stations]
        errands = [errand[0].states[0] for errand in visited]
        states = np.concatenate((docks, costs.states[cars], errands)).astype(np.int32)
        travel_s = np.full((len(states), len(states)), np.inf)
        for k, dock_state in enumerate(docks):
            moves = self._ways.moves(states, dock_state).astype(np.float64)
            travel_s[:, k] = np.where(moves >= UNREACHABLE, np.inf, moves * STEP_S)
        for k, errand in enumerate(visited, start=n_known):
            moves = self._routes.moves_from(errand, states)
            travel_s[:, k] = np.where(moves >= UNREACHABLE, np.inf, moves * STEP_S)
        np.fill_diagonal(travel_s, 0.0)
        service_s = np.array([self._stations.time(station).mean_s for station in self._stations])
        number_of = {errand: k for k, errand in enumerate(visited, start=n_known)}
        jobs = [
            [self._stations.named(task.pick).arm, self._stations.named(task.delivery.drop).arm]
            if task.visit is None
            else [number_of[errand] for errand in self._routes.errands(task)]
            for task in tasks
        ]
        n_errands = np.array([len(job) for job in jobs])
        place = np.concatenate(jobs).astype(np.int32)
        served = np.repeat([task.visit is None for task in tasks], n_errands)
        stand_s = np.concatenate(
            [
                np.zeros(len(job)) if task.visit is None else self._routes.stands_s(task)
                for task, job in zip(tasks, jobs, strict=True)
            ]
        )
        due_s = np.array([task.order.due_s for task in tasks])
        order, vehicle = self._proposal(tasks, cars)
        return Shop(
            travel_s=travel_s,
            start=np.arange(n_stations, n_known, dtype=np.int32),
            ready_s=costs.free_s[cars],
            first_errand=np.concatenate(([0], np.cumsum(n_errands))).astype(np.int32),
            place=place,
            station=np.where(served, place, NO_STATION).astype(np.int32),
            service_s=np.where(served, service_s[np.where(served, place, 0)], stand_s),
            free_s=self._stations.times.all_left_s(now_s),
            n_carried=self.loads.n_places[cars].astype(np.int32),
            n_buffer_places=np.array(self._bookings.caps[:n_stations], dtype=np.int32),
            release_s=np.zeros(len(tasks)),
            due_s=due_s - now_s,
            weight=1.0 + costs.pressure_s[columns] / PRESSES_S,
            late_weight=np.full(len(tasks), self._config.lateness),
            late_cost=np.full(len(tasks), self._config.late_s),
            first_order=order,
            first_vehicle=vehicle,
        )

    def _proposal(
        self, tasks: list[Task], cars: npt.NDArray[np.intp]
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """The last plan, as far as its tasks and cars are still there."""
        column_of = {task.index: k for k, task in enumerate(tasks)}
        row_of = {car: row for row, car in enumerate(cars.tolist())}
        pairs = [(column_of[task], row_of[car]) for task, car in self._plan if task in column_of and car in row_of]
        vehicle = np.full(len(tasks), -1, dtype=np.int32)
        for k, row in pairs:
            vehicle[k] = row
        return np.array([k for k, _ in pairs], dtype=np.int32), vehicle
