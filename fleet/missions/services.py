"""Services: which arm is at work on which car; all that changes when a service begins or ends changes here."""

from __future__ import annotations

from fleet.missions.phases import CarPhase
from fleet.missions.state import NOBODY, Missions
from fleet.stations.service_time import Direction
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph


class Services:
    """Services of cars by arms.

    While an arm is at work on a car, the car cannot move, its dock is closed to others, the world expects that they
    touch, and the station learns how long it takes.

    Args:
        missions: What cars and arms are about.
        graph: Lane graph.
        traffic: Told who stands fixed, and which docks are closed.
        world: Told who is served.
    """

    def __init__(self, missions: Missions, graph: LaneGraph, traffic: Traffic, world: World) -> None:
        self._missions = missions
        self._traffic = traffic
        self._world = world
        self._cell_of: list[int] = graph.state_cell[missions.stations.dock_states].tolist()
        self._car_of: dict[int, int] = {}  # by arm, in the order in which the services began

    @property
    def under_way(self) -> list[tuple[int, int]]:
        """Arms at work and their cars, in the order in which they began."""
        return list(self._car_of.items())

    def is_served(self, car: int) -> bool:
        """True while an arm is at work on a car, or still on its way home from it."""
        return car in self._car_of.values()

    def begin(self, station: Station, car: int, task: Task, now_s: float) -> None:
        """An arm begins to work on a car that stands at its dock."""
        missions, arm = self._missions, station.arm
        loading = station.direction is Direction.TO_CAR
        missions.enter(car, CarPhase.LOADING if loading else CarPhase.UNLOADING)
        state = TaskState.LOADING if loading else TaskState.UNLOADING
        missions.board.move(task, state, now_s, f"car_{car} stands at {station.name}")
        self._traffic.set_served(car, True)
        self._traffic.executor.close(self._cell_of[arm])
        self._car_of[arm] = car
        missions.served[arm] = car
        self._world.set_serving(arm, car)
        missions.stations.times.begin(arm, station.direction, now_s)

    def end(self, station: Station, now_s: float) -> None:
        """An arm is home from a car, and the dock is open for the next one."""
        missions, arm = self._missions, station.arm
        del self._car_of[arm]
        missions.served[arm] = NOBODY
        self._world.set_serving(arm, NOBODY)
        missions.stations.times.end(arm, now_s)
        self._traffic.executor.open(self._cell_of[arm])

    def let_go(self, car: int) -> None:
        """A loaded car may drive on while the arm still goes home."""
        self._traffic.set_served(car, False)
