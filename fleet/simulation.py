"""Simulation: the loop in which tasks, traffic, arms and the world meet."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fleet.config import CarConfig, Fidelity, RunConfig, require
from fleet.dispatch.allocation import TaskAllocation
from fleet.dispatch.dispatcher import Dispatcher
from fleet.errors import FleetError
from fleet.incidents.disturbance import Disturbances
from fleet.incidents.recovery import Recovery
from fleet.insight.cause_watch import CauseWatch
from fleet.insight.codebook import Codebook, codebook_of
from fleet.insight.explain import Explanation, explain
from fleet.insight.metrics import Metrics, Summary
from fleet.insight.slip import SlipMeter
from fleet.insight.time_accounts import TimeAccounts
from fleet.missions.roster import CarPhase
from fleet.robots.battery import Batteries
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmManager, ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.stations.arms.shared_dock import share_docks
from fleet.stations.station import Station
from fleet.tasks.batches import Batches
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.order import MAX_GENERATED_KG, Ability, ability_of, generate_orders
from fleet.tasks.order_file import OrderBook, read_orders
from fleet.tasks.reasons import AssignmentReport
from fleet.tasks.stream import stream_orders
from fleet.traffic.drivers import Driver, PathDriver, StateDriver
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world import make_world
from fleet.world.grid import GridWorld
from fleet.world.protocol import FloatArray, World
from fleet.world.scene import Scene
from fleet.world.site_scene import scene_of
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, load_site
from planners.mapf.distance_table import DistanceTable

STALL_S = 300.0
"""A run whose tasks have not changed for this long has come to a stand [s]."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened, as it goes into the run file."""

    tick: int
    sim_s: float
    kind: str
    facts: dict[str, object]


@dataclass(frozen=True, kw_only=True)
class Actions:
    """What agents decide instead of the executor and the arm desk, for the first robots; None leaves all to them.

    Made for a run whose driver and desk know which robots agents decide (`fleet.envs.warehouse.agent_simulation`): in
    any other run the executor takes for granted that a car follows its path, and recovery takes back one that does not.
    """

    cars: FloatArray | None = None
    """Steering [rad] and speed [m/s] of the first cars, shape (k, 2)."""
    arms: FloatArray | None = None
    """Joint targets [rad] of the first arms, shape (m, n_joints)."""
    arms_qd: FloatArray | None = None
    """Joint velocities there [rad/s], same shape; None = zero."""
    grip: npt.NDArray[np.bool_] | None = None
    """Whether they hold, shape (m,); None leaves it to the desk."""


@dataclass(frozen=True, kw_only=True)
class RunSetup:
    """What runs with as many cars on the same site have in common, and may hand on from one to the next."""

    site: Site
    graph: LaneGraph
    start_states: npt.NDArray[np.int32]
    """Lane-graph state of each car at the start, shape (n_cars,)."""
    scene: Scene
    tables: DistanceTable
    """Distances with nothing blocked."""
    world: World | None = None
    """The world to run in, as it was when it was made; None = a new one."""

    @staticmethod
    def of(config: RunConfig) -> RunSetup:
        """The ground of a run.

        Raises:
            ConfigError: The site has no room for that many robots.
            SiteError: The site cannot be read.
        """
        site = load_site(config.site)
        require(
            config.robots <= len(site.parking),
            "--robots",
            config.robots,
            f"1 to {len(site.parking)} (parking cells of site {site.name})",
        )
        graph = build_lane_graph(site)
        start_states = graph.first_states(site.parking[: config.robots])
        return RunSetup(
            site=site,
            graph=graph,
            start_states=start_states,
            scene=scene_of(site, graph.state_pose[start_states], config.grip, config.arms),
            tables=DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)),
        )


class Simulation:
    """One run of a fleet.

    Args:
        config: Everything that decides the outcome.
        on_event: Called with every event as it happens.
        ground: What `RunSetup.of` gives for this configuration, if it is known already; its world is not closed by the
            run.

    Raises:
        ConfigError: The site has no room for that many robots, or an option does not fit it.
        PlanningError: No planner or allocator has that name, or these settings.
        SiteError: The site cannot be read or served.
        OrdersError: The orders file cannot be read, or none of its orders can be accepted.
    """

    allocation_type: type[TaskAllocation] = TaskAllocation
    traffic_type: type[Traffic] = Traffic
    """Who gives tasks out, and who plans the moves; environments put agents in their place."""
    books: bool = True
    """Whether ticks are taken into the figures; where nobody reads them, they need not be found out."""

    def __init__(
        self, config: RunConfig, *, on_event: Callable[[Event], None] | None = None, ground: RunSetup | None = None
    ) -> None:
        self._closed = False
        self.config = config
        ground = ground or RunSetup.of(config)
        self.site: Site = ground.site
        traffic, allocation = config.traffic, config.allocation
        chargers_n = config.battery.chargers_n or 1
        known = len(self.site.chargers)
        require(
            not config.battery.enabled or chargers_n <= known,
            "battery.chargers_n",
            config.battery.chargers_n,
            f"1 to {known} (chargers of site {self.site.name})" if known else "no batteries: the site has no charger",
        )
        # Names and settings are refused before anything is started that would have to be stopped.
        traffic.make_planner(seed=0)
        allocation.make_allocator()
        self.on_event = on_event
        orders_seed, estimate_seed, traffic_seed, askew_seed = np.random.SeedSequence(config.seed).spawn(4)
        self.graph: LaneGraph = ground.graph
        start_states = ground.start_states
        self.scene: Scene = ground.scene
        self.abilities = self._abilities()
        book = self._orders(np.random.default_rng(orders_seed))
        self.orders, self.refused = book.orders, book.refused
        self.arm_planner: ArmPlanner = self._arm_planner()
        with ExitStack() as undo:
            # A run that is refused leaves no planning process behind.
            undo.callback(self.arm_planner.close)
            self._owns_world = ground.world is None
            self.world: World = ground.world or make_world(self.scene, self.graph, config)
            if self._owns_world:
                undo.callback(self.world.close)
            self.tick_s = self.world.tick_s
            self.now = 0
            self._progress_s = 0.0
            self.driver: Driver = self._driver(start_states, np.random.default_rng(estimate_seed))
            self.executor = Executor(self.graph, start_states, self.driver, config.traffic, self.log)
            self.traffic = self.traffic_type(
                self.graph,
                self.executor,
                config.traffic,
                self.tick_s,
                int(traffic_seed.generate_state(1)[0]),
                ground.tables,
            )
            self.board = TaskBoard(self.orders, self._task_moved)
            self.batches = Batches(self.board.tasks, self.log)
            self.stations = [
                Station(arm, place, self.graph.state_at(place.dock.cell, place.dock.heading))
                for arm, place in enumerate(self.site.stations)
            ]
            self.arm_manager: ArmManager = self._arm_manager()
            self.shared_docks = share_docks(self.site, self.scene, TOOLS[config.grip], self.arm_manager.services)
            battery = config.battery
            self.batteries = Batteries(battery, self.world.n_cars, self.tick_s) if battery.enabled else None
            self.dispatcher = Dispatcher(
                site=self.site,
                graph=self.graph,
                config=config,
                board=self.board,
                stations=self.stations,
                arm_manager=self.arm_manager,
                traffic=self.traffic,
                executor=self.executor,
                world=self.world,
                abilities=self.abilities,
                batteries=self.batteries,
                askew=np.random.default_rng(askew_seed) if config.askew else None,
                log=self.log,
                allocation=self.allocation_type,
            )
            self.recovery = Recovery(self)
            self.disturbances = Disturbances(self, config.events)
            docks = [station.place.dock.cell for station in self.stations]
            time_accounts = TimeAccounts(
                self.world.n_cars, self.site.grid.cell_xy(docks), self.graph.n_cells, len(self.dispatcher.places.cells)
            )
            self.metrics = Metrics(self.world.n_cars, self.tick_s, time_accounts)
            self.arm_planner.wait_ready()
            undo.pop_all()
        self.log("run_started", site=self.site.name, robots=self.world.n_cars, tasks=len(self.orders))
        for refusal in self.refused:
            self.log("order_refused", task=refusal.name, where=refusal.where, cause=refusal.cause)

    # Made when they are first asked for: where nobody reads the figures, nobody does.

    @cached_property
    def causes(self) -> CauseWatch:
        """The causes of all robots, tick by tick."""
        return CauseWatch(self)

    @cached_property
    def codebook(self) -> Codebook:
        """What the numbers stand for."""
        return codebook_of(self)

    @cached_property
    def slip_meter(self) -> SlipMeter | None:
        """Measures every carry; None without physics, where parcels stick rigidly to their tools."""
        return SlipMeter(self.scene.arm, self.scene.arm_base) if self._in_physics else None

    @property
    def sim_s(self) -> float:
        """Simulated time [s]."""
        return self.now * self.tick_s

    @property
    def _in_physics(self) -> bool:
        return self.config.fidelity is Fidelity.PHYSICS

    @property
    def finished(self) -> bool:
        """True when every task has ended, the time is up, or nothing has moved for too long."""
        return self.board.finished or self.sim_s >= self.config.duration_s or self.stalled

    @property
    def stalled(self) -> bool:
        """True when work is open and for `STALL_S` no task has changed and no order was still to come
        and nobody charged or stood on a visit."""
        if self.sim_s - max(self._progress_s, self.dispatcher.visits.progress_s) <= STALL_S:
            return False
        roster = self.dispatcher.roster
        stands = CarPhase.STANDING in roster.phase or bool(roster.charges.any())
        return not stands and self.board.count(TaskState.ORDERED) == 0

    def tick(self, actions: Actions | None = None) -> None:
        """Advance the whole fleet by one tick.

        Raises:
            FleetError: The run is closed.
        """
        if self._closed:
            raise FleetError(f"tick {self.now} of a run that is closed; make a new Simulation to run again")
        self.disturbances.tick(self.now)
        self.dispatcher.tick(self.now, self.sim_s)
        self.traffic.tick(self.now)
        commands = self.executor.tick(self.world)
        self.recovery.tick(self.now)
        self.arm_manager.tick(self.now, self.world.held())
        self.world.step(*self._merged(commands, actions))
        if self.books:
            self._book(self.world.car_speeds())
        if self.batteries is not None:
            roster = self.dispatcher.roster
            self.batteries.tick(self.world.car_speeds(), roster.load_kg, roster.awake, roster.charges)
            for car in np.flatnonzero(self.batteries.charge <= 0.0).tolist():
                if roster.phase[car] is not CarPhase.DEAD:
                    self.lose_car(car, f"the battery of car_{car} is empty")
        self.now += 1

    def _book(self, speeds: FloatArray) -> None:
        """Take the tick into the figures: slip, causes, metrics, ledger."""
        if self.slip_meter is not None:
            self.slip_meter.tick(self.arm_manager.services, self.world)
        roster = self.dispatcher.roster
        self.causes.tick(self.now, speeds)
        self.metrics.tick(speeds, roster.loaded, roster.bound)
        self.metrics.time_accounts.tick(
            self.causes.rows,
            roster.phase_index,
            roster.loaded,
            self.dispatcher.bookings.place_of,
            roster.served,
            speeds,
            self.world.car_poses(),
        )

    def lose_car(self, car: int, reason: str) -> None:
        """Take a car out of the run for good: it rolls out and stays where it is."""
        self.driver.stop(car)
        self.executor.halt(car)
        self.dispatcher.retire(car, CarPhase.DEAD, self.sim_s, reason)
        self.recovery.abandon(car)
        self.log("car_lost", car=f"car_{car}", cause=reason)

    def run(self, on_tick: Callable[[Simulation], None] | None = None) -> None:
        """Tick until the run is finished; `on_tick` is called after every tick."""
        while not self.finished:
            self.tick()
            if on_tick is not None:
                on_tick(self)

    def log(self, kind: str, **facts: object) -> None:
        """Report an event at the present tick."""
        if self.on_event is not None:
            self.on_event(Event(tick=self.now, sim_s=round(self.sim_s, 6), kind=kind, facts=facts))

    def state_hash(self) -> str:
        """Hash of the physical state, of the task states and of the batteries: equal runs, equal hashes."""
        digest = hashlib.sha256(self.world.state_bytes())
        digest.update(",".join(task.state for task in self.board.tasks).encode())
        digest.update(str(self.now).encode())
        if self.batteries is not None:
            digest.update(self.batteries.charge.tobytes())
        return digest.hexdigest()[:16]

    def parcel_balance(self) -> int:
        """Parcels that entered, less those that left, less those found in the world; zero unless one was lost."""
        return self.dispatcher.inventory.balance()

    def cancel(self, name: str) -> None:
        """Take an order back, as long as its parcel was not picked; a visit can be taken back until its end.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
            CannotCancel: Its parcel was picked, or it has ended.
        """
        self.dispatcher.cancel(self.board.named(name), self.sim_s, "cancelled on request")

    def requeue(self, name: str) -> None:
        """Give an order to another car than the one that is under way to pick it, or that visits.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
            CannotRequeue: No car is under way to pick it, and none visits.
        """
        self.dispatcher.requeue(self.board.named(name), self.sim_s, "requeued on request")

    def explain_assignment(self, name: str) -> AssignmentReport:
        """Say who got an order, who did not and why, or why nobody has it; `str` of it is a sentence.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
        """
        return self.dispatcher.reasons.report(self.board.named(name))

    def explain(self, robot: str, time_s: float | None = None) -> Explanation:
        """Say why a robot waits: who or what keeps it, the root of that, and what would release it.

        Args:
            robot: Such as ``car_2`` or ``arm_0``.
            time_s: When, from the start of the run until now [s]; None = now.

        Returns:
            Its `str` is a sentence.

        Raises:
            UnknownRobot: There is no such robot.
            OutsideRun: The run was not under way then.
        """
        return explain(self.causes.log, self.codebook, robot, self.sim_s if time_s is None else time_s)

    def summary(self) -> Summary:
        """Figures of the run so far."""
        return self.metrics.summary(self)

    def close(self) -> None:
        """Free the world and the planning process; calling twice is harmless."""
        self._closed = True
        if self._owns_world:
            self.world.close()
        self.arm_planner.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _abilities(self) -> tuple[Ability, ...]:
        found, usual = [], CarConfig()
        for car in range(self.config.robots):
            own = self.config.cars.get(f"car_{car}", usual)
            payload_kg = self.scene.car.max_payload_kg if own.max_payload_kg is None else own.max_payload_kg
            found.append(ability_of(car, payload_kg, tuple(own.capabilities)))
        return tuple(found)

    def _orders(self, rng: np.random.Generator) -> OrderBook:
        grip_kg = TOOLS[self.config.grip].payload_kg(self.config.grip_force_n)
        if self.config.orders is not None:
            battery = self.config.battery
            chargers_n = len(self.site.chargers[: battery.chargers_n]) if battery.enabled else 0
            return read_orders(self.config.orders, self.site, self.abilities, chargers_n=chargers_n, grip_kg=grip_kg)
        require(
            grip_kg >= MAX_GENERATED_KG,
            "--grip-force",
            self.config.grip_force_n,
            f"a force that holds {MAX_GENERATED_KG} kg, the heaviest generated parcel; this one holds {grip_kg:.3g} kg",
        )
        if self.config.stream is not None:
            orders = stream_orders(self.site, self.config.stream, self.config.duration_s, self.config.tasks, rng)
            return OrderBook(orders=orders)
        return OrderBook(orders=generate_orders(self.site, self.config.n_tasks, self.config.robots, rng))

    def _arm_planner(self) -> ArmPlanner:
        names = tuple(station.name for station in self.site.stations)
        return make_arm_planner(arm_cells(self.site, self.scene), names, self.scene.arm, self.config)

    def _arm_manager(self) -> ArmManager:
        scene = self.scene
        return ArmManager(
            self.arm_planner, self.config.arms, scene.car, scene.arm_start, self.tick_s, lost=self._parcel_lost
        )

    def _driver(self, start_states: npt.NDArray[np.int32], rng: np.random.Generator) -> Driver:
        if isinstance(self.world, GridWorld):
            return StateDriver(self.graph, start_states, self.world.car_states)
        return PathDriver(
            self.graph,
            self.scene.car,
            self.graph.state_pose[start_states],
            self.tick_s,
            self.config.estimate,
            rng,
        )

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        self._progress_s = now_s
        car = f"car_{task.car}" if task.car is not None else None
        self.log("task", task=task.order.name, before=before, state=task.state, car=car, cause=task.reason)
        self.batches.moved(task, before, now_s)

    def _parcel_lost(self, arm: int, parcel: int) -> str:
        """Tell the log of a parcel that an arm has lost from its grip; returns why, in words.

        One that was fetched ahead may have left the world, because its task was cancelled: that is no loss.
        """
        if parcel not in self.world.parcel_ids():
            return ""
        cause = self.world.grip_loss(arm) or "why is not known"
        x, y, z = (round(float(v), 3) for v in self.dispatcher.inventory.pose(self.board.tasks[parcel])[:3])
        name = self.board.tasks[parcel].order.name
        self.log("parcel_dropped", task=name, arm=f"arm_{arm}", x_m=x, y_m=y, z_m=z, cause=cause)
        return cause

    def _merged(
        self, commands: FloatArray, actions: Actions | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        arm_manager = self.arm_manager
        if actions is None:
            return commands, arm_manager.q, arm_manager.qd, arm_manager.grip
        q, qd, grip = arm_manager.q, arm_manager.qd, arm_manager.grip
        if actions.cars is not None:
            commands[: len(actions.cars)] = actions.cars
        if actions.arms is not None:
            n = len(actions.arms)
            q, qd, grip = q.copy(), qd.copy(), grip.copy()
            q[:n], qd[:n] = actions.arms, 0.0 if actions.arms_qd is None else actions.arms_qd
            if actions.grip is not None:
                grip[:n] = actions.grip
        return commands, q, qd, grip
