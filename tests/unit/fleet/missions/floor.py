"""A floor of 12 x 6 cells for tests of single rules: real books, lanes and traffic, no physics and no arm planning.

A car comes to where it was sent because a test says so, and an arm has moved a parcel because a test says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from fleet.arrays import IntArray
from fleet.config import AllocationConfig, BatteryConfig, TimeoutConfig, TrafficConfig
from fleet.dispatch.allocation import TaskAllocation
from fleet.dispatch.assignments import Assignments
from fleet.dispatch.containment import Containment
from fleet.dispatch.cost_model import CostMatrix, CostModel
from fleet.dispatch.due_dates import DueDates
from fleet.dispatch.fitness import Fitness
from fleet.dispatch.horizon import RollingHorizon
from fleet.dispatch.interventions import Interventions
from fleet.dispatch.offers import Offers
from fleet.dispatch.situation import Situation, situation_of
from fleet.dispatch.solver import Solver
from fleet.missions.admission import Admission
from fleet.missions.charging import Charging
from fleet.missions.docks import Docks
from fleet.missions.parcels.aboard import Aboard
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.parcels.perception import TruePoses
from fleet.missions.parcels.planned_loads import PlannedLoads
from fleet.missions.parcels.prefetch import Prefetch
from fleet.missions.parcels.slots import Slots
from fleet.missions.parcels.transfer_requests import Transfers
from fleet.missions.parking import Parking
from fleet.missions.phases import CarPhase
from fleet.missions.places import Places
from fleet.missions.pods import Pods
from fleet.missions.services import Services
from fleet.missions.state import Missions
from fleet.missions.turns import TurnBook
from fleet.missions.visit_queue import VisitQueue
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.visits import Visits
from fleet.missions.ways import Ways
from fleet.robots.arms.spec import UsualService
from fleet.robots.battery import Batteries
from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.booking import Bookings
from fleet.stations.station import Station
from fleet.stations.stations import Stations
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.open_deliveries import OpenDeliveries
from fleet.tasks.order import Ability, Delivery, Order, Visit
from fleet.tasks.reasons import ReasonBook
from fleet.traffic.executor import Executor
from fleet.traffic.floor_distances import FloorDistances
from fleet.traffic.replanning import Traffic
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, site_from_plan
from maps.waiting_cells import waiting_cells
from tests.unit.fleet.traffic.drivers import Drivers

PLAN = (
    "_.........._",
    "AP..KKCK..DA",
    "_.........._",
    "_.........._",
    "AP..KKCK..DA",
    "_.........._",
)
"""Two stations of each kind: docks in the second and the fifth row, parking places and chargers between them."""
SITE = site_from_plan(PLAN, name="floor")
TICK_S = 0.1
SIZE_M = (0.06, 0.05, 0.04)
CAR = racecar_spec()


def delivery(name: str, pick: str = "pick_1", drop: str = "drop_1", **own: Any) -> Delivery:
    """A delivery of a small box, released at once."""
    return Delivery(
        **({"name": name, "pick": pick, "drop": drop, "release_s": 0.0, "mass_kg": 0.5, "size_m": SIZE_M} | own)
    )


def visit(name: str, *errands: str | tuple[str, ...], **own: Any) -> Visit:
    """A visit of places, released at once."""
    each = tuple((errand,) if isinstance(errand, str) else errand for errand in errands)
    return Visit(name=name, errands=each, **({"release_s": 0.0, "kind": "patrol"} | own))


class Log:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.events: list[tuple[str, dict[str, Any]]] = []

    def __call__(self, kind: str, **facts: Any) -> None:
        self.events.append((kind, facts))

    def kinds(self) -> list[str]:
        """What was told, in order."""
        return [kind for kind, _ in self.events]


class StandingDrivers(Drivers):
    """Cars that stand where a test has put them."""

    def __init__(self, poses: Callable[[], np.ndarray]) -> None:
        super().__init__()
        self.moving: set[int] = set()
        self._poses = poses

    @property
    def estimate(self) -> np.ndarray:
        return self._poses()

    def at_rest(self, car: int) -> bool:
        return car not in self.moving


class FakeWorld:
    """Parcels as poses; cars stand in the middle of their states."""

    def __init__(self, n_arms: int, n_cars: int) -> None:
        self.tick_s = TICK_S
        self.n_cars = n_cars
        self.poses: dict[int, np.ndarray] = {}
        self.masses: dict[int, float] = {}
        self.in_grip = np.full(n_arms, -1)
        self.serving = [-1] * n_arms
        self.cars: Callable[[], np.ndarray] = lambda: np.zeros((0, 3))
        self.picture: Any = None
        self.looked: list[str] = []

    def car_poses(self) -> np.ndarray:
        return self.cars()

    def held(self) -> np.ndarray:
        return self.in_grip

    def parcel_ids(self) -> np.ndarray:
        return np.array(sorted(self.poses), dtype=np.int64)

    def parcel_poses(self) -> np.ndarray:
        return np.array([self.poses[parcel] for parcel in sorted(self.poses)]).reshape(-1, 7)

    def add_parcel(self, body: Any) -> None:
        self.poses[body.parcel] = body.pose
        self.masses[body.parcel] = body.mass_kg

    def remove_parcel(self, parcel: int) -> None:
        del self.poses[parcel]

    def set_serving(self, arm: int, car: int) -> None:
        self.serving[arm] = car

    def image(self, camera: Any) -> Any:
        self.looked.append(camera.name)
        return self.picture


class FakeArm:
    """An arm that does what a test says."""

    def __init__(self) -> None:
        self.state = ArmPhase.IDLE
        self.parcel = -1
        self.fetches = True
        self.clear = False
        """Whether the arm is off the car though it still moves."""

    @property
    def dock_is_clear(self) -> bool:
        return self.clear or self.state not in (ArmPhase.PLANNING, ArmPhase.MOVING)


class FakeArms:
    """Arms that are asked, and answer when a test says so."""

    def __init__(self, n_arms: int) -> None:
        self.services = [FakeArm() for _ in range(n_arms)]
        self.requests: list[Any] = []
        self.refused: list[tuple[int, int, str]] = []
        self.fetched: list[Any] = []
        self.returned: list[int] = []
        self.reasons = [""] * n_arms
        self.trays: dict[int, int] = {}

    def is_idle(self, arm: int) -> bool:
        return self.services[arm].state is ArmPhase.IDLE

    def fetched_for(self, arm: int) -> int:
        return self.trays.get(arm, 0)

    def is_ready(self, arm: int, parcel: int, tray: int = 0) -> bool:
        service = self.services[arm]
        holds = service.state is ArmPhase.HOLDING and service.parcel == parcel
        return self.is_idle(arm) or (holds and self.fetched_for(arm) == tray)

    def submit(self, request: Any, tick: int) -> None:
        del tick
        self.requests.append(request)
        self.begin(request.arm)

    def refuse(self, arm: int, parcel: int, reason: str, tick: int) -> None:
        del tick
        self.refused.append((arm, parcel, reason))
        self.begin(arm)

    def fetch(self, request: Any, tick: int) -> None:
        del tick
        self.fetched.append(request)
        self.begin(request.arm)

    def hold(self, arm: int, parcel: int) -> None:
        """An arm has fetched a parcel."""
        self.services[arm].state, self.services[arm].parcel = ArmPhase.HOLDING, parcel

    def put_back(self, arm: int) -> None:
        self.returned.append(arm)
        self.begin(arm)

    def reason(self, arm: int) -> str:
        return self.reasons[arm]

    def begin(self, arm: int) -> None:
        """An arm works."""
        self.services[arm].state, self.services[arm].clear = ArmPhase.MOVING, False

    def leave_car(self, arm: int) -> None:
        """An arm is off the car and on its way home."""
        self.services[arm].clear = True

    def come_home(self, arm: int) -> None:
        """An arm has nothing more to do."""
        self.services[arm].state, self.services[arm].clear = ArmPhase.IDLE, False


@dataclass(kw_only=True)
class Floor:
    """The floor, its books, and every rule on it, each made when it is first asked for."""

    orders: Sequence[Order] = ()
    n_cars: int = 2
    site: Site = field(default_factory=lambda: SITE)
    allocation_config: AllocationConfig = field(default_factory=AllocationConfig)
    battery_config: BatteryConfig | None = None
    """None = cars have no batteries."""
    timeouts: TimeoutConfig = field(default_factory=TimeoutConfig)
    abilities: Sequence[Ability] | None = None
    collect_after_s: float = 5.0
    askew: np.random.Generator | None = None
    n_tray_places: int = 1

    def __post_init__(self) -> None:
        self.log = Log()
        self.graph: LaneGraph = build_lane_graph(self.site)
        cells = (*self.site.parking, *waiting_cells(self.site, self.graph).tolist())
        starts = self.graph.first_states(cells[: self.n_cars])
        self.stations = Stations(
            [
                Station(arm, place, self.graph.state_at(place.dock.cell, place.dock.heading))
                for arm, place in enumerate(self.site.stations)
            ],
            [UsualService(mean_s=7.0, p90_s=8.0)] * len(self.site.stations),
        )
        self.world: Any = FakeWorld(len(self.stations), self.n_cars)
        self.driver: Any = StandingDrivers(self.car_poses)
        self.world.cars = self.car_poses
        config = TrafficConfig()
        self.executor = Executor(self.graph, starts, self.driver, config, self.log)
        distances = FloorDistances(self.graph, [station.place.dock.cell for station in self.stations])
        self.traffic = Traffic(self.graph, self.executor, config, TICK_S, seed=0, free=distances)
        self.board = TaskBoard(self.orders)
        self.places = Places(self.site, self.graph, self.stations)
        n_stations = len(self.stations)
        caps = [min(self.allocation_config.station_cap_n, len(station.contents)) for station in self.stations]
        caps += [1] * (len(self.places.cells) - n_stations)
        self.bookings = Bookings(caps, self.n_cars)
        left_late = self.places.cells[: n_stations + len(self.places.chargers)]
        self.missions = Missions(self.board, self.stations, self.bookings, left_late, self.traffic)
        self.ways = Ways(self.traffic, self.site.grid.cell_m)
        self.pods = Pods(None, self.places, self.graph, self.board, self.traffic, self.log)
        self.routes = VisitRoutes(self.places, self.ways, self.bookings, self.pods)
        self.services = Services(self.missions, self.graph, self.traffic, self.world)
        self.reasons = ReasonBook(self.log)
        self.fitness = Fitness(self._abilities())
        self.open_deliveries = OpenDeliveries(self.board, self.fitness.kind_of)
        self.visit_queue = VisitQueue(self.missions, self.places, self.ways, self.reasons)
        self.backlog = Backlog(self.board, self.reasons, self._check)
        self.arms: Any = FakeArms(n_stations)
        self.inventory = Inventory(
            self.board,
            self.stations,
            CarModels.alike(CAR, self.n_cars),
            self.world,
            self.log,
            self.collect_after_s,
            self.askew,
        )
        self.perception: Any = TruePoses(self.inventory)

    def _abilities(self) -> Sequence[Ability]:
        usual = [Ability(max_payload_kg=2.0, capabilities=frozenset({f"car_{car}"})) for car in range(self.n_cars)]
        return self.abilities or usual

    def _check(self, task: Task) -> None:
        self.due_dates.check(task)

    # --- rules

    @cached_property
    def admission(self) -> Admission:
        return Admission(self.missions, self.ways, self.turns, self.slots, self.log)

    @cached_property
    def turns(self) -> TurnBook:
        return TurnBook(self.missions, self.ways, np.zeros(len(self.stations)))

    @cached_property
    def charging(self) -> Charging | None:
        if self.battery_config is None:
            return None
        batteries = Batteries(self.battery_config, np.full(self.n_cars, CAR.mass_kg), TICK_S)
        in_use = self.places.chargers[: self.battery_config.chargers_n]
        return Charging(batteries, in_use, len(self.stations), self.missions, self.ways, self.admission, self.log)

    @property
    def chargers(self) -> Charging:
        """The charging of a floor whose cars have batteries."""
        if self.charging is None:
            raise AssertionError("cars of this floor have no batteries")
        return self.charging

    @property
    def _tray_of(self) -> IntArray:
        return np.zeros(self.n_cars, dtype=np.int64)

    @cached_property
    def transfers(self) -> Transfers:
        return Transfers(self.inventory, self.perception, self.arms, self.driver, self.world, self._tray_of)

    @cached_property
    def docks(self) -> Docks:
        return Docks(
            self.missions,
            self.ways,
            self.services,
            self.transfers,
            self.admission,
            self.aboard,
            self.log,
        )

    @cached_property
    def aboard(self) -> Aboard:
        return Aboard(
            self.missions, self.ways, self.slots, self.open_deliveries, self._abilities(), self.loads, self.log
        )

    @cached_property
    def loads(self) -> PlannedLoads:
        return PlannedLoads(self.missions, np.full(self.n_cars, self.n_tray_places))

    @cached_property
    def visits(self) -> Visits:
        return Visits(self.missions, self.places, self.routes, self.ways, self.charging, self.world, self.log)

    @cached_property
    def parking(self) -> Parking:
        return Parking(self.places.parking, self.places.waiting, self.missions, self.ways)

    @cached_property
    def prefetch(self) -> Prefetch:
        return Prefetch(self.missions, self.ways, self.arms, self.perception, TICK_S, self.log, self._tray_of)

    @cached_property
    def slots(self) -> Slots:
        return Slots(self.missions, self.ways, self.inventory, self.open_deliveries)

    @cached_property
    def cost_model(self) -> CostModel:
        return CostModel(self.allocation_config, self.missions, self.ways, self.routes, self.fitness, self.charging)

    @cached_property
    def horizon(self) -> RollingHorizon:
        return RollingHorizon(self.allocation_config, self.missions, self.ways, self.routes, self.loads)

    @cached_property
    def solver(self) -> Solver:
        return Solver(self.allocation_config, self.log)

    @cached_property
    def offers(self) -> Offers:
        return Offers(
            self.missions,
            self.ways,
            self.routes,
            self.fitness,
            self.open_deliveries,
            self.visit_queue,
            self.allocation_config,
        )

    @cached_property
    def allocation(self) -> TaskAllocation:
        return TaskAllocation(
            self.missions, self.cost_model, self.solver, self.offers, self.turns, self.horizon, self.reasons
        )

    @cached_property
    def assignments(self) -> Assignments:
        return Assignments(
            self.missions, self.ways, self.allocation, self.admission, self.visits, self.charging, self.reasons
        )

    @cached_property
    def interventions(self) -> Interventions:
        return Interventions(
            self.missions, self.ways, self.inventory, self.docks, self.admission, self.visits, self.timeouts
        )

    @cached_property
    def containment(self) -> Containment:
        return Containment(self.missions, self.places, self.ways, self.fitness, self.inventory, self.pods)

    @cached_property
    def due_dates(self) -> DueDates:
        return DueDates(self.cost_model, self.reasons, fastest_move_s=0.5)

    # --- where cars are

    def car_poses(self) -> np.ndarray:
        """Where the cars stand, shape (n_cars, 3)."""
        return self.graph.state_pose[self.executor.tail_states()]

    def state(self, row: int, col: int) -> int:
        """The first lane-graph state of a cell."""
        return int(self.graph.first_states([row * self.site.grid.cols + col])[0])

    def stand(self, car: int, state: int) -> None:
        """A car stands in a state."""
        self.executor.relocate(car, state)

    def come(self, car: int) -> None:
        """A car stands where it was sent."""
        self.stand(car, int(self.traffic.goals[car]))

    def arrive(self, car: int) -> None:
        """A car stands at the station it was sent to, and has booked it."""
        self.come(car)
        if not self.bookings.book(car):
            raise AssertionError("there is no room at the station")

    def dock_of(self, name: str) -> int:
        """Lane-graph state of a station's dock."""
        return self.stations.named(name).dock_state

    def moves(self, car: int, name: str) -> int:
        """Moves of a car to a station's dock."""
        return self.ways.of_car(car, self.dock_of(name))

    def block(self, *cells: int) -> None:
        """Nobody has a way through some cells any more."""
        for cell in cells:
            self.traffic.set_blocked(cell, True)

    def wall_in(self, car: int) -> None:
        """A car has no way to anywhere, but that will not last."""
        state = int(self.executor.tail_states()[car])
        moves = self.graph.out_move[self.graph.out_ptr[state] : self.graph.out_ptr[state + 1]]
        self.block(*set(self.graph.state_cell[self.graph.move_to[moves]].tolist()))

    # --- how far tasks are

    def task(self, name: str) -> Task:
        """The task of an order."""
        return self.board.named(name)

    def release(self, now_s: float = 0.0) -> None:
        """Those orders are known whose time has come."""
        self.board.release_due(now_s)

    def ready(self, name: str, now_s: float = 0.0) -> Task:
        """A task that a car can begin; the parcel of a delivery has no slot yet."""
        self.release(now_s)
        task = self.task(name)
        self.board.move(task, TaskState.READY, now_s, "by hand")
        return task

    def shelved(self, name: str, now_s: float = 0.0) -> Task:
        """A delivery that a car can begin, its parcel on a slot of its pick station."""
        task = self.ready(name, now_s)
        if not self.slots.take(task, now_s):
            raise AssertionError(f"no slot of {task.pick} is free")
        return task

    def assigned(self, name: str, car: int, now_s: float = 0.0) -> Task:
        """A delivery with its parcel on a slot, whose car is on its way to pick, without a booking."""
        task = self.shelved(name, now_s)
        self.missions.assign(car, task, now_s)
        station = self.stations.named(task.pick)
        self.missions.bind(car, station.arm)
        self.missions.enter(car, CarPhase.TO_PICK)
        self.ways.send(car, station.dock_state, rank_s=0.0, stay=True, tick=0)
        return task

    def carried(self, name: str, car: int, now_s: float = 0.0) -> Task:
        """A task whose parcel is in the tray of a car that is on its way to the drop station."""
        task = self.assigned(name, car, now_s)
        self.board.move(task, TaskState.LOADING, now_s, "by hand")
        self.lay_in_tray(task, car)
        self.inventory.vacate(task)
        self.board.move(task, TaskState.CARRIED, now_s, "by hand")
        station = self.stations.named(task.delivery.drop)
        self.missions.bind(car, station.arm)
        self.missions.enter(car, CarPhase.TO_DROP)
        self.ways.send(car, station.dock_state, rank_s=0.0, stay=True, tick=0)
        return task

    def visiting(self, name: str, car: int, now_s: float = 0.0) -> Task:
        """A visit whose car is on its way to the first place."""
        task = self.ready(name, now_s)
        if not self.visits.book(car, task):
            raise AssertionError("there is no room at the place")
        self.missions.assign(car, task, now_s)
        self.visits.send(car, task, tick=0)
        return task

    # --- where parcels are

    def lay_in_tray(self, task: Task, car: int) -> None:
        """A task's parcel lies in a car's tray."""
        x, y, yaw = self.car_poses()[car]
        self.world.poses[task.parcel] = np.array(
            [
                x + CAR.tray_x_m * np.cos(yaw),
                y + CAR.tray_x_m * np.sin(yaw),
                CAR.tray_floor_z_m + SIZE_M[2] / 2,
                0.0,
                0.0,
                0.0,
                1.0,
            ]
        )

    def lay_on_slot(self, task: Task, slot: int, name: str) -> None:
        """A task's parcel lies in the middle of a slot."""
        x, y, z = self.stations.named(name).place.slots[slot]
        self.world.poses[task.parcel] = np.array([x, y, z + SIZE_M[2] / 2, 0.0, 0.0, 0.0, 1.0])

    def lay_on_floor(self, task: Task) -> None:
        """A task's parcel lies where it should not."""
        self.world.poses[task.parcel] = np.array([6.0, 3.0, SIZE_M[2] / 2, 0.0, 0.0, 0.0, 1.0])

    # --- questions

    def situation(self, now_s: float = 0.0, *, exchange: bool = True) -> Situation:
        """What the cars are about; by default they may give away what they have not picked yet."""
        return situation_of(self.missions, self.ways, self.charging, now_s, exchange=exchange)

    def costs(
        self,
        *names: str,
        now_s: float = 0.0,
        soon_s: float = 0.0,
        not_before_s: Sequence[float] = (),
        exchange: bool = True,
    ) -> CostMatrix:
        """What some tasks cost, and after them those that cars have and may give away."""
        situation = self.situation(now_s, exchange=exchange)
        named = [self.task(name) for name in names]
        tasks = [*named, *(task for task in situation.held.values() if task not in named)]
        not_before = np.array([*not_before_s, *[0.0] * (len(tasks) - len(not_before_s))])
        return self.cost_model.of(tasks, not_before, situation, self.turns.all(now_s), soon_s, now_s)


def fake(**parts: Any) -> Any:
    """Something that has just these parts."""
    return SimpleNamespace(**parts)
