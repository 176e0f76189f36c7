"""RunView: what observers and incidents see of a run: its parts, by name, and never the loop that drives them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from fleet.config import RunConfig
from fleet.dispatch.assignments import Assignments
from fleet.dispatch.dispatcher import Dispatcher
from fleet.missions.charging import Charging
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.parcels.perception import PoseSource
from fleet.missions.places import Places
from fleet.missions.services import Services
from fleet.missions.state import Missions
from fleet.missions.visits import Visits
from fleet.robots.battery import Batteries
from fleet.run.clock import Clock
from fleet.run.events import Events
from fleet.run.setup import RunSetup
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.booking import Bookings
from fleet.stations.stations import Stations
from fleet.tasks.board import TaskBoard
from fleet.tasks.reasons import ReasonBook
from fleet.traffic.drivers import Driver
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from fleet.world.scene import Scene
from maps.lane_graph import LaneGraph
from maps.site import Site


@dataclass(frozen=True, kw_only=True, eq=False)
class Knowledge:
    """What is known of places, parcels and tasks."""

    places: Places
    inventory: Inventory
    perception: PoseSource
    reasons: ReasonBook


@dataclass(frozen=True, kw_only=True, eq=False)
class RunView:
    """The parts of a run."""

    config: RunConfig
    setup: RunSetup
    clock: Clock
    events: Events
    world: World
    traffic: Traffic
    arm_manager: ArmManager
    missions: Missions
    services: Services
    knowledge: Knowledge
    dispatcher: Dispatcher
    batteries: Batteries | None
    """None = cars have none."""

    def state_hash(self) -> str:
        """Hash of the physical state, of the task states and of the batteries: equal runs, equal hashes."""
        digest = hashlib.sha256(self.world.state_bytes())
        digest.update(",".join(task.state for task in self.board.tasks).encode())
        digest.update(str(self.now).encode())
        if self.batteries is not None:
            digest.update(self.batteries.charge.tobytes())
        return digest.hexdigest()[:16]

    # --- where it takes place

    @property
    def site(self) -> Site:
        """The site."""
        return self.setup.site

    @property
    def graph(self) -> LaneGraph:
        """Its lane graph."""
        return self.setup.graph

    @property
    def scene(self) -> Scene:
        """What stands on its floor."""
        return self.setup.scene

    # --- when

    @property
    def now(self) -> int:
        """The present tick."""
        return self.clock.now

    @property
    def sim_s(self) -> float:
        """Simulated time [s]."""
        return self.clock.sim_s

    @property
    def tick_s(self) -> float:
        """Length of a tick [s]."""
        return self.clock.tick_s

    # --- how cars drive

    @property
    def executor(self) -> Executor:
        """Grants moves."""
        return self.traffic.executor

    @property
    def driver(self) -> Driver:
        """Drives cars through what they were granted."""
        return self.traffic.executor.driver

    # --- what is to be done, and by whom

    @property
    def board(self) -> TaskBoard:
        """The tasks."""
        return self.missions.board

    @property
    def stations(self) -> Stations:
        """The stations."""
        return self.missions.stations

    @property
    def bookings(self) -> Bookings:
        """Who is bound for which place."""
        return self.missions.bookings

    @property
    def places(self) -> Places:
        """Where cars can be sent."""
        return self.knowledge.places

    @property
    def inventory(self) -> Inventory:
        """Where parcels are."""
        return self.knowledge.inventory

    @property
    def perception(self) -> PoseSource:
        """Where parcels are believed to be."""
        return self.knowledge.perception

    @property
    def reasons(self) -> ReasonBook:
        """Why tasks wait."""
        return self.knowledge.reasons

    @property
    def assignments(self) -> Assignments:
        """Gives tasks to cars."""
        return self.dispatcher.rules.assignments

    @property
    def visits(self) -> Visits:
        """Cars on visits."""
        return self.dispatcher.rules.visits

    @property
    def charging(self) -> Charging | None:
        """Cars that charge; None = cars have no batteries."""
        return self.dispatcher.rules.charging
