"""GridFleet: a warehouse on lane-graph timesteps alone, thousands of times faster than real time.

Every car is in one state of the lane graph; a timestep takes all cars one move on at most. Arms and parcels are reduced
to what they cost: a car at its dock is served for a fixed number of timesteps, and a car that is near its pick station
takes one of the slots there until its parcel is loaded. Tasks, slots, room near stations, parking and right of way
follow the rules of any run (`fleet.dispatch.dispatcher`), in the simplest form that keeps their effect.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.abstract import kernel
from fleet.abstract.kernel import (
    ENOUGH,
    NEVER,
    NO_BATTERY,
    NO_FAULTS,
    NONE,
    Battery,
    CarTable,
    Counts,
    Faults,
    Floor,
    Stage,
    StationTable,
    TaskTable,
)
from fleet.config import AllocationConfig
from fleet.errors import FleetError
from fleet.missions.admission import NEAR_MOVES
from fleet.missions.ways import EMERGENCY_RANK_S, LOADED_RANK_S
from fleet.robots.arms.spec import UsualService
from fleet.stations.service_time import PRIOR_MEAN_S
from fleet.tasks.order import Delivery
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site
from maps.stations import StationPlace
from planners.mapf.distance_table import MEMORY_CAP_BYTES, UNREACHABLE, DistanceTable
from planners.mapf.pibt import Stepper

TIMESTEP_S = 1.0
"""Time of one move: a cell of 1 m at the 1 m/s of aisles [s]."""
DOCKING_S = 1.5
"""What braking into a dock and going off again takes longer than moves at speed: drives of kinematic cars to their
docks on `small` and `medium` take 2 s more than their moves, curves and traffic included [s]."""
STATION_CAP = AllocationConfig.station_cap_n
"""Cars near one station at once, as in any run."""
ROOM_S = 60.0
"""No task is given out at a station while those under way to it keep its arm busy for longer than this [s]."""
STATION_ROOM = max(STATION_CAP + 1, round(ROOM_S / PRIOR_MEAN_S))
"""Tasks under way to one station at once: at least one car more than may be near, which is held back if it comes."""
MOST_DISTANCE_BYTES = 3_500_000_000
"""Memory for the distances of one site: 10,000 parking places on a floor of 60,000 cells."""
N_KINDS = 4
"""Kinds of moves of a car: straight, left, right, reverse."""


class FloorTooLarge(FleetError):
    """The distances of a site need more memory than a fleet may take."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetSite:
    """What a fleet needs to know of a site, worked out once: graph, places, distances to them."""

    site: Site
    graph: LaneGraph
    floor: Floor
    goal_row: npt.NDArray[np.int32]
    """Row of `floor.distance` of each dock, parking place and charger, `NONE` of other states, shape (n_states,)."""
    move_to: npt.NDArray[np.int32]
    """State that a move of each `MoveKind` but turns leads to, or `NONE`, shape (n_states, 4)."""
    far_steps: int
    """The longest way to a dock or a parking place, in timesteps."""

    @classmethod
    def of(
        cls, site: Site, services: Sequence[UsualService] | None = None, station_cap: int = STATION_CAP
    ) -> FleetSite:
        """Work it out.

        Args:
            site: The site.
            services: How long the arm of each station takes; None = all are taken, and hold a car, for the same time.
            station_cap: Cars near one station at once, at most.

        Raises:
            FloorTooLarge: Distances to all places of the site need more than `MOST_DISTANCE_BYTES`.
        """
        graph = build_lane_graph(site)
        docks = [graph.state_at(place.dock.cell, place.dock.heading) for place in site.stations]
        spots = [int(graph.states_of_cell(cell)[0]) for cell in site.parking]
        chargers = [int(graph.states_of_cell(cell)[0]) for cell in site.chargers]
        goals = np.array([*docks, *spots, *chargers], dtype=np.int32)
        n_goals = len(np.unique(goals))
        needed = 2 * graph.n_states * n_goals
        if needed > MOST_DISTANCE_BYTES:
            raise FloorTooLarge(
                f"site {site.name}: the distances to its {n_goals:,} docks, parking places and chargers "
                f"need {needed / 1e9:.1f} GB; valid: at most {MOST_DISTANCE_BYTES / 1e9:.1f} GB"
            )
        nowhere = np.zeros(graph.n_cells, dtype=np.bool_)
        distance, row = DistanceTable(graph, nowhere, memory_cap=max(MEMORY_CAP_BYTES, needed)).rows(goals)
        usual = UsualService(mean_s=PRIOR_MEAN_S, p90_s=PRIOR_MEAN_S, load_s=PRIOR_MEAN_S, unload_s=PRIOR_MEAN_S)
        times = [usual] * len(docks) if services is None else services
        docking_s = 0.0 if services is None else DOCKING_S
        k, n = len(docks), len(docks) + len(spots)
        floor = Floor(
            distance=distance,
            dock_state=goals[:k],
            dock_row=row[:k].astype(np.int32),
            spot_state=goals[k:n],
            spot_row=row[k:n].astype(np.int32),
            charger_state=goals[n:],
            charger_row=row[n:].astype(np.int32),
            service_steps=round(PRIOR_MEAN_S / TIMESTEP_S),
            load_steps=steps_of(docking_s + time.load_s for time in times),
            unload_steps=steps_of(docking_s + time.unload_s for time in times),
            cycle_steps=steps_of(time.mean_s for time in times),
            station_cap=np.array([_room_near(place, station_cap) for place in site.stations], dtype=np.int32),
            near_moves=NEAR_MOVES,
            loaded_rank=round(LOADED_RANK_S / TIMESTEP_S),
            urgent_rank=round(EMERGENCY_RANK_S / TIMESTEP_S),
        )
        goal_row, move_to = _none(graph.n_states), np.full((graph.n_states, N_KINDS), NONE, dtype=np.int32)
        goal_row[goals] = row
        move_to[graph.move_from, graph.move_kind] = graph.move_to
        # Row by row: all at once would be a copy of what may take most of the memory.
        far_steps = max(_farthest(distance[one]) for one in row[:n])
        return cls(site=site, graph=graph, floor=floor, goal_row=goal_row, move_to=move_to, far_steps=far_steps)


class GridFleet:
    """One episode of a fleet on the grid.

    Attributes:
        now: Timesteps that have passed.
        cars: The cars.
        tasks: The tasks.
        stations: The stations.
        counts: What has happened since `forget`.
        priority: Larger goes first in the next timestep, shape (n_cars,).
        locked: Cars that do not move in it, shape (n_cars,).

    Args:
        place: The site.
        n_cars: Number of cars, at most the parking places.
        orders: Deliveries, ascending in release.
        seed: Seed of the tie-breaking of PIBT, and of breakdowns.
        faults: How often cars break down.
        battery: How fast batteries empty and fill.
    """

    def __init__(
        self,
        place: FleetSite,
        n_cars: int,
        orders: Sequence[Delivery],
        seed: int,
        faults: Faults = NO_FAULTS,
        battery: Battery = NO_BATTERY,
    ) -> None:
        self.place = place
        self.now = 0
        self.faults = faults
        self.battery = battery
        self._dice = seed
        floor, graph = place.floor, place.graph
        self.cars = cars_at_start(floor, n_cars)
        self.tasks = tasks_of(orders, [station.name for station in place.site.stations])
        k = len(floor.dock_state)
        self.stations = StationTable(booked=_zero(k), under_way=_zero(k), free_at=_zero(k))
        self.counts = Counts.of(n_cars, np.int32)
        self.priority = np.zeros(n_cars)
        self.locked = np.zeros(n_cars, dtype=np.bool_)
        self._spot_user = spot_users_at_start(floor, n_cars)
        self._first = _none(len(floor.dock_state))
        self._after = self.cars.state.copy()
        # Copies share it: all that it remembers from one step to the next is the salt of the tie-breaking.
        self._stepper = Stepper(graph, np.zeros(graph.n_cells, dtype=np.bool_), seed=seed)
        self._salt = self._stepper.salt
        self._turn()

    def assign(self, car: int, task: int) -> None:
        """Give a ready task to a free car; `direct` sends it on its way."""
        kernel.assign(self.cars, self.tasks, self.stations, car, task, self.now)

    def assign_nearest(self) -> None:
        """Give the ready tasks to the nearest free cars."""
        kernel.assign_nearest(self.place.floor, self.cars, self.tasks, self.stations, STATION_ROOM, self.now)
        self.direct()

    def direct(self) -> None:
        """Give every car its goal, and its rank in the right of way."""
        floor, now = self.place.floor, self.now
        kernel.direct(floor, self.cars, self.stations, self._spot_user, self._first, now)
        kernel.rank_cars(floor, self.cars, self.tasks, now, self.priority, self.locked)

    def planned(self, wished: npt.NDArray[np.int32] | None = None) -> npt.NDArray[np.int32]:
        """Where PIBT lets every car go in the next timestep, shape (n_cars,); holds until the next call.

        Args:
            wished: State that each car prefers, its own to wait, negative = none, shape (n_cars,); None = no wishes.
        """
        after = self._step(wished)
        self._salt = self._stepper.salt
        return after

    def proposed(self) -> npt.NDArray[np.int32]:
        """Where `planned` without wishes would let every car go; its chance is not drawn on."""
        return self._step(None)

    def move(self, after: npt.NDArray[np.int32]) -> None:
        """Let a timestep pass.

        Args:
            after: State of each car after it, shape (n_cars,); legal and free of conflicts.
        """
        kernel.count_moves(self.cars, after, self.counts)
        self.now += 1
        self._turn()

    def copy(self) -> GridFleet:
        """A fleet at the same moment that goes on alike; the two share nothing that changes."""
        twin = copy.copy(self)
        for name in ("cars", "tasks", "stations", "counts"):
            group = getattr(self, name)
            setattr(twin, name, type(group)(*(array.copy() for array in group)))
        for name in ("priority", "locked", "_spot_user", "_first", "_after"):
            setattr(twin, name, getattr(self, name).copy())
        return twin

    def _step(self, wished: npt.NDArray[np.int32] | None) -> npt.NDArray[np.int32]:
        self._stepper.salt = self._salt
        self._stepper.step(
            self.cars.state,
            self._after,
            distances=self.place.floor.distance,
            row=self.cars.row,
            order=np.argsort(-self.priority, kind="stable").astype(np.int32),
            locked=self.locked,
            allow_rotation=False,
            wished=wished,
        )
        return self._after

    def _turn(self) -> None:
        """Everything that happens between two moves."""
        kernel.break_down(self.cars, self.tasks, self.stations, self.faults, self._dice, self.now)
        kernel.serve(self.place.floor, self.cars, self.tasks, self.stations, self.counts, self.now)
        kernel.charge_up(self.place.floor, self.cars, self.battery)
        kernel.release(self.tasks, self.counts, self.now)
        self.direct()


def _room_near(place: StationPlace, station_cap: int) -> int:
    return min(station_cap, len(place.slots)) if place.kind == "pick" else station_cap


def _farthest(ways: npt.NDArray[np.uint16]) -> int:
    return int(ways.max(where=ways < UNREACHABLE, initial=0))


def steps_of(times_s: Iterable[float]) -> npt.NDArray[np.int32]:
    """Times as whole timesteps, at least one."""
    return np.array([max(1, round(time_s / TIMESTEP_S)) for time_s in times_s], dtype=np.int32)


def cars_at_start(floor: Floor, n_cars: int) -> CarTable:
    """Cars without a task, each in a parking place of its own, before their first `direct`; the first one is full."""
    start = floor.spot_state[:n_cars].copy()
    return CarTable(
        state=start,
        phase=np.zeros(n_cars, dtype=np.int8),
        held=np.zeros(n_cars, dtype=np.bool_),
        booked=np.zeros(n_cars, dtype=np.bool_),
        task=_none(n_cars),
        station=_none(n_cars),
        spot=np.arange(n_cars, dtype=np.int32),
        charger=_none(n_cars),
        charge=np.linspace(1.0, ENOUGH, n_cars),
        left=_zero(n_cars),
        bound=_zero(n_cars),
        since=_zero(n_cars),
        goal=start.copy(),
        row=floor.spot_row[:n_cars].copy(),
    )


def spot_users_at_start(floor: Floor, n_cars: int) -> npt.NDArray[np.int32]:
    """Car whose own each parking place is in the beginning, or `NONE`, shape (p,)."""
    spots = np.arange(len(floor.spot_state), dtype=np.int32)
    return np.where(spots < n_cars, spots, NONE).astype(np.int32)


def tasks_of(orders: Sequence[Delivery], names: list[str]) -> TaskTable:
    """Tasks that are not released yet, one for each source of each order.

    Args:
        orders: Deliveries, ascending in release.
        names: Names of the stations, in their order.
    """
    number = {name: k for k, name in enumerate(names)}
    told = [(order, pick) for order in orders for pick in order.picks]
    n = len(told)
    n_sources = np.array([len(order.picks) for order in orders], dtype=np.int64)
    due = [order.due_s / TIMESTEP_S if math.isfinite(order.due_s) else NEVER for order, _ in told]
    return TaskTable(
        release=np.array([math.ceil(order.release_s / TIMESTEP_S) for order, _ in told], dtype=np.int32),
        due=np.array(due, dtype=np.int64).astype(np.int32),
        pick=np.array([number[pick] for _, pick in told], dtype=np.int32),
        drop=np.array([number[order.drop] for order, _ in told], dtype=np.int32),
        rank=np.array([order.rank for order, _ in told], dtype=np.int8),
        stage=np.full(n, Stage.ORDERED, dtype=np.int8),
        car=_none(n),
        done=np.full(n, NEVER, dtype=np.int32),
        order=np.repeat(np.cumsum(n_sources) - n_sources, n_sources).astype(np.int32),
        window=_zero(2),
    )


def one_per_order(tasks: TaskTable) -> npt.NDArray[np.bool_]:
    """One task of each order: the one that a car was given, or else the first, shape (m,)."""
    first = tasks.order == np.arange(len(tasks.order))
    return np.where(tasks.stage <= Stage.READY, first, tasks.stage != Stage.WITHDRAWN)


def late_steps(tasks: TaskTable, now: int) -> npt.NDArray[np.int64]:
    """Timesteps by which each order is late, delivered or not, at its one task; 0 at all others, shape (m,)."""
    late = np.maximum(0, np.minimum(tasks.done, now).astype(np.int64) - tasks.due)
    return np.where(one_per_order(tasks), late, 0)


def _zero(n: int) -> npt.NDArray[np.int32]:
    return np.zeros(n, dtype=np.int32)


def _none(n: int) -> npt.NDArray[np.int32]:
    return np.full(n, NONE, dtype=np.int32)
