"""Assembly: what a simulation is made of, from the site to the rules, in the order in which one part needs another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from fleet.config import AllocationConfig, CarConfig, Perception, RunConfig, require
from fleet.dispatch.allocation import TaskAllocation
from fleet.dispatch.assignments import Assignments
from fleet.dispatch.containment import Containment
from fleet.dispatch.cost_model import CostModel
from fleet.dispatch.dispatcher import Dispatcher, DispatchRules
from fleet.dispatch.due_dates import DueDates
from fleet.dispatch.fitness import Fitness
from fleet.dispatch.horizon import RollingHorizon
from fleet.dispatch.interventions import Interventions
from fleet.dispatch.offers import Offers
from fleet.dispatch.solver import Solver
from fleet.missions.admission import Admission
from fleet.missions.charging import Charging
from fleet.missions.docks import Docks
from fleet.missions.parcels.aboard import Aboard
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.parcels.perception import SeenPoses, TruePoses
from fleet.missions.parcels.planned_loads import PlannedLoads
from fleet.missions.parcels.prefetch import Prefetch
from fleet.missions.parcels.slots import Slots
from fleet.missions.parcels.transfer_requests import Transfers
from fleet.missions.parking import Parking
from fleet.missions.places import Places
from fleet.missions.pods import Pods
from fleet.missions.services import Services
from fleet.missions.state import Missions
from fleet.missions.turns import TurnBook
from fleet.missions.visit_queue import VisitQueue
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.visits import Visits
from fleet.missions.ways import Ways
from fleet.robots.battery import Batteries
from fleet.run.clock import Clock
from fleet.run.events import Events
from fleet.run.orders import orders_of
from fleet.run.setup import RunSetup
from fleet.run.view import Knowledge, RunView
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmManager, ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.stations.arms.shared_dock import share_docks
from fleet.stations.booking import Bookings
from fleet.stations.station import Station
from fleet.stations.stations import Stations
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import TaskBoard
from fleet.tasks.open_deliveries import OpenDeliveries
from fleet.tasks.order import LIFT, Ability, Order, ability_of
from fleet.tasks.order_file import OrderBook
from fleet.tasks.reasons import ReasonBook
from fleet.traffic.drivers import PASS_SPEED_MPS, Driver, PathDriver, StateDriver
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world import make_world
from fleet.world.grid import GridWorld
from fleet.world.protocol import World

Lost = Callable[[int, int], str]
"""Told that an arm has lost a parcel from its grip; returns why, in words."""


def usual_driver(setup: RunSetup, world: World, config: RunConfig, rng: np.random.Generator) -> Driver:
    """Drives cars along what they were granted, as the world has them drive."""
    if isinstance(world, GridWorld):
        return StateDriver(setup.graph, setup.start_states, world.car_states)
    poses = setup.graph.state_pose[setup.start_states]
    return PathDriver(setup.graph, setup.scene.cars, poses, world.tick_s, config.estimate, rng)


def usual_arm_manager(planner: ArmPlanner, setup: RunSetup, config: RunConfig, tick_s: float, lost: Lost) -> ArmManager:
    """Asks for the plans of all arms and plays them."""
    return ArmManager(planner, config.arms, setup.scene, tick_s, lost=lost)


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Who takes the place of parts of a usual run: agents, tests, experiments."""

    orders: Sequence[Order] | None = None
    """What is to be done, ascending in release time; None = as the configuration says."""
    arm_planner: ArmPlanner | None = None
    """Plans for the arms, and is not closed with the run; None = a new one."""
    driver: Callable[[RunSetup, World, RunConfig, np.random.Generator], Driver] = usual_driver
    """Makes what drives the cars."""
    arm_manager: Callable[[ArmPlanner, RunSetup, RunConfig, float, Lost], ArmManager] = usual_arm_manager
    """Makes what manages the arms."""
    traffic: type[Traffic] = Traffic
    """Plans the moves of the cars."""
    allocation: type[TaskAllocation] = TaskAllocation
    """Gives tasks to cars."""
    admission: type[Admission] = Admission
    """Sends cars with tasks to their stations."""
    dispatcher: type[Dispatcher] = Dispatcher
    """Says what happens in which order, and so who decides."""
    figures: bool = True
    """Whether ticks are taken into the figures; where nobody reads them, they need not be found out."""


@dataclass(frozen=True, kw_only=True)
class Assembled:
    """The parts of a run, and what was found on the way to them."""

    view: RunView
    arm_planner: ArmPlanner
    abilities: tuple[Ability, ...]
    book: OrderBook


def assemble(
    config: RunConfig, setup: RunSetup, parts: Parts, events_of: Callable[[Clock], Events], undo: ExitStack
) -> Assembled:
    """Make all parts of a run.

    Args:
        config: Everything that decides the outcome.
        setup: Where it takes place.
        parts: Who takes the place of usual parts.
        events_of: Makes the events of a clock.
        undo: Closes the world and the planning process of a run that is refused, and afterwards of one that ends.

    Raises:
        ConfigError: The site has too few chargers, or no station room for so many cars.
        PlanningError: No planner or allocator has that name, or these settings.
        OrdersError: The orders file cannot be read, or none of its orders can be accepted.
        SiteError: An arm cannot serve its station.
    """
    _check(config, setup)
    site, graph, scene = setup.site, setup.graph, setup.scene
    orders_seed, estimate_seed, traffic_seed, askew_seed = np.random.SeedSequence(config.seed).spawn(4)
    abilities = _abilities(config, setup)
    if parts.orders is not None:
        book = OrderBook(orders=tuple(parts.orders))
    else:
        book = orders_of(config, site, abilities, np.random.default_rng(orders_seed))

    # The robots, and the floor they share.
    arm_planner = parts.arm_planner or _arm_planner(config, setup)
    if parts.arm_planner is None:
        undo.callback(arm_planner.close)
    world = setup.world or make_world(scene, graph, config)
    if setup.world is None:
        undo.callback(world.close)
    clock = Clock(world.tick_s)
    events = events_of(clock)
    log = events.log
    driver = parts.driver(setup, world, config, np.random.default_rng(estimate_seed))
    executor = Executor(graph, setup.start_states, driver, config.traffic, log)
    seed = int(traffic_seed.generate_state(1)[0])
    traffic = parts.traffic(graph, executor, config.traffic, clock.tick_s, seed, setup.distances)
    undo.callback(traffic.close)

    # What is to be done, and the state of those who do it.
    board = TaskBoard(book.orders)
    stations = Stations(
        [
            Station(arm, place, graph.state_at(place.dock.cell, place.dock.heading))
            for arm, place in enumerate(site.stations)
        ],
        [spec.service for spec in scene.arms.specs],
    )
    places = Places(site, graph, stations)
    # A car that books a pick station needs a slot for its parcel.
    caps = [min(config.allocation.station_cap_n, len(station.contents)) for station in stations]
    caps += [1] * (len(places.cells) - len(stations))
    bookings = Bookings(caps, world.n_cars)
    left_late = places.cells[: len(stations) + len(places.chargers)]
    missions = Missions(board, stations, bookings, left_late, traffic)
    services = Services(missions, graph, traffic, world)
    ways = Ways(traffic, site.grid.cell_m)
    pods = Pods(world.pods if site.storage else None, places, graph, board, traffic, log)
    routes = VisitRoutes(places, ways, bookings, pods)
    reasons = ReasonBook(log)

    # Parcels and arms.
    askew = np.random.default_rng(askew_seed) if config.askew else None
    inventory = Inventory(board, stations, scene.cars, world, log, config.collect_after_s, askew)
    lost = _Losses(world, board, inventory, log)
    arm_manager = parts.arm_manager(arm_planner, setup, config, clock.tick_s, lost)
    share_docks(site, scene, arm_manager.services)
    seen = config.perception is Perception.CAMERA
    perception = SeenPoses(stations, scene.cars.hull, world, inventory, log) if seen else TruePoses(inventory)

    # The rules that missions go by.
    turns = TurnBook(missions, ways, stations.least_cycle_s(config.collect_after_s))
    fitness = Fitness(abilities)
    open_deliveries = OpenDeliveries(board, fitness.kind_of)
    slots = Slots(missions, ways, inventory, open_deliveries)
    admission = parts.admission(missions, ways, turns, slots, log)
    batteries = None
    if config.battery.enabled:
        batteries = Batteries(config.battery, scene.cars.each("mass_kg"), clock.tick_s)
    charging = None
    if batteries is not None:
        in_use = places.chargers[: config.battery.chargers_n]
        charging = Charging(batteries, in_use, len(stations), missions, ways, admission, log)
    cost_model = CostModel(config.allocation, missions, ways, routes, fitness, charging)
    loads = PlannedLoads(missions, scene.cars.parcels_at_a_time(fill_trays=config.allocation.fill_trays))
    horizon = RollingHorizon(config.allocation, missions, ways, routes, loads)
    solver = Solver(config.allocation, log)
    visit_queue = VisitQueue(missions, places, ways, reasons)
    offers = Offers(missions, ways, routes, fitness, open_deliveries, visit_queue, config.allocation)
    allocation = parts.allocation(missions, cost_model, solver, offers, turns, horizon, reasons)
    tray_of = scene.cars.tray_of
    transfers = Transfers(inventory, perception, arm_manager, driver, world, tray_of)
    aboard = Aboard(missions, ways, slots, open_deliveries, abilities, loads, log)
    docks = Docks(missions, ways, services, transfers, admission, aboard, log)
    visits = Visits(missions, places, routes, ways, charging, world, log)
    fastest_move_s = site.grid.cell_m / scene.cars.most("max_speed_mps")
    rules = DispatchRules(
        missions=missions,
        backlog=Backlog(board, reasons, DueDates(cost_model, reasons, fastest_move_s).check),
        slots=slots,
        visit_queue=visit_queue,
        assignments=Assignments(missions, ways, allocation, admission, visits, charging, reasons),
        interventions=Interventions(missions, ways, inventory, docks, admission, visits, config.timeouts),
        admission=admission,
        docks=docks,
        prefetch=Prefetch(missions, ways, arm_manager, perception, clock.tick_s, log, tray_of),
        visits=visits,
        parking=Parking(places.parking, places.waiting, missions, ways),
        charging=charging,
    )
    containment = Containment(missions, places, ways, fitness, inventory, pods)
    view = RunView(
        config=config,
        setup=setup,
        clock=clock,
        events=events,
        world=world,
        traffic=traffic,
        arm_manager=arm_manager,
        missions=missions,
        services=services,
        knowledge=Knowledge(places=places, inventory=inventory, perception=perception, reasons=reasons),
        dispatcher=parts.dispatcher(rules, containment, clock.tick_s),
        batteries=batteries,
    )
    return Assembled(view=view, arm_planner=arm_planner, abilities=abilities, book=book)


class _Losses:
    """Tells the log of parcels that arms have lost from their grips."""

    def __init__(self, world: World, board: TaskBoard, inventory: Inventory, log: Callable[..., None]) -> None:
        self._world = world
        self._board = board
        self._inventory = inventory
        self._log = log

    def __call__(self, arm: int, parcel: int) -> str:
        """Tell of a loss; returns why, in words.

        A parcel that was fetched ahead may have left the world, because its task was cancelled: that is no loss.
        """
        task = self._board.tasks[parcel]
        if not self._inventory.in_world(task):
            return ""
        cause = self._world.grip_loss(arm) or "why is not known"
        x, y, z = (round(float(v), 3) for v in self._inventory.pose(task)[:3])
        self._log("parcel_dropped", task=task.order.name, arm=f"arm_{arm}", x_m=x, y_m=y, z_m=z, cause=cause)
        return cause


def _check(config: RunConfig, setup: RunSetup) -> None:
    battery, known, site = config.battery, len(setup.site.chargers), setup.site.name
    if battery.enabled:
        require(known > 0, "battery.enabled", True, f"false, as site {site} has no charger (C in its plan)")
        fits = battery.chargers_n is None or battery.chargers_n <= known
        require(fits, "battery.chargers_n", battery.chargers_n, f"1 to {known} (chargers of site {site})")
    cap = config.allocation.station_cap_n
    most = max((len(station.slots) for station in setup.site.stations), default=1)
    require(
        cap <= max(most, AllocationConfig.station_cap_n),
        "allocation.station_cap_n",
        cap,
        f"1 to {most} (slots of the largest station of site {site})",
    )
    # Names and settings are refused before anything is started that would have to be stopped.
    for later in (config, *(config.as_of(change.time_s) for change in config.changes)):
        later.traffic.make_planner(seed=0)
        later.allocation.make_allocator()


def _abilities(config: RunConfig, setup: RunSetup) -> tuple[Ability, ...]:
    """What each car can carry."""
    found, usual = [], CarConfig()
    for car in range(config.robots):
        own = config.cars.get(f"car_{car}", usual)
        model = setup.scene.cars[car]
        payload_kg = model.max_payload_kg if own.max_payload_kg is None else own.max_payload_kg
        require(
            payload_kg <= model.max_payload_kg,
            f"cars.car_{car}.max_payload_kg",
            payload_kg,
            f"at most {model.max_payload_kg:g}, what its model {model.name} carries",
        )
        require(
            LIFT not in own.capabilities,
            f"cars.car_{car}.capabilities",
            LIFT,
            "other words, as this is what models have that lift pods",
        )
        capabilities = tuple(own.capabilities) if model.lifts is None else (*own.capabilities, LIFT)
        slowness = max(1.0, PASS_SPEED_MPS / model.max_speed_mps)
        found.append(ability_of(car, payload_kg, capabilities, slowness))
    return tuple(found)


def _arm_planner(config: RunConfig, setup: RunSetup) -> ArmPlanner:
    names = tuple(station.name for station in setup.site.stations)
    return make_arm_planner(arm_cells(setup.site, setup.scene), names, setup.scene.arms, config)
