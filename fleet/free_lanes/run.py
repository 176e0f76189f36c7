"""LayoutRun: cars drive between the nodes of a layout, again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.config import EstimateConfig, TrafficConfig, require
from fleet.robots import ArmTeam
from fleet.robots.cars.models import usual_car
from fleet.traffic.drivers import PathDriver
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from fleet.world.scene import Scene
from maps.free_lanes.bodies import touching
from maps.free_lanes.graph import FreeLanes
from maps.lane_graph import LaneGraph
from maps.vehicle import TURN_RADIUS_M, Footprint

_SERVICE_S = 2.0
_AGAIN_S = 1.0
"""After which a car for which no place was free asks again."""
_STILL_MPS = 0.02
_NOWHERE = ""


def car_footprint() -> Footprint:
    """The body of a car, and the radius of its bends on lanes."""
    spec = usual_car()
    return Footprint(
        front_m=spec.front_m, rear_m=spec.rear_m, half_width_m=spec.half_width_m, turn_radius_m=TURN_RADIUS_M
    )


@dataclass(frozen=True, kw_only=True)
class LayoutResult:
    """What happened in a run."""

    duration_s: float
    trips: int
    """Times that a car has come to where it was sent, not counting those that only made room."""
    deliveries: int
    """Of these, to a station to drop at."""
    contacts: int
    """Between cars."""
    min_clearance_m: float
    longest_still_s: float
    """Longest time that a car stood which was on its way."""
    plans: int
    plans_cut: int
    """Of these, such as could not be executed as they were."""


class LayoutRun:
    """One run.

    Where a layout has stations to pick and to drop at, cars go from one kind to the other; else from node to node.

    Args:
        lanes: Where.
        n_cars: Number of cars.
        make_world: Makes the world of a scene.
        seed: Of where cars start, and of the nodes they choose.
        traffic: How they are planned for.

    Raises:
        ConfigError: There are fewer places to start from.
    """

    def __init__(
        self,
        lanes: FreeLanes,
        n_cars: int,
        make_world: Callable[[Scene], World],
        *,
        seed: int = 0,
        traffic: TrafficConfig | None = None,
    ) -> None:
        traffic = traffic or TrafficConfig()
        self.lanes = lanes
        graph = lanes.graph
        choice, noise, ties = np.random.SeedSequence(seed).spawn(3)
        self._rng = np.random.default_rng(choice)
        starts = _starts(graph, n_cars, self._rng)
        self.scene = Scene(
            size_m=lanes.size_m,
            boxes=(),
            car_kinds=(usual_car(),),
            car_start=graph.state_pose[starts],
            arms=ArmTeam.of(()),
            arm_base=np.empty((0, 4)),
            arm_start=np.empty((0, 0)),
        )
        self.world = make_world(self.scene)
        self._driver = PathDriver(
            graph,
            self.scene.cars,
            graph.state_pose[starts],
            self.world.tick_s,
            EstimateConfig(),
            np.random.default_rng(noise),
        )
        self._n_cut = 0
        self.executor = Executor(graph, starts, self._driver, traffic, self._log)
        self.traffic = Traffic(graph, self.executor, traffic, self.world.tick_s, int(ties.generate_state(1)[0]))
        uses = {station.node: station.use for station in lanes.layout.stations}
        self._delivers = {"pick", "drop"} <= set(uses.values())
        self._uses = uses if self._delivers else {}
        self._carries = np.zeros(n_cars, dtype=np.bool_)
        self._node = [_NOWHERE] * n_cars
        """Where each car is bound for, or was last."""
        self._ready = np.zeros(n_cars, dtype=np.int64)
        self._under_way = np.zeros(n_cars, dtype=np.bool_)
        self._still = np.zeros(n_cars, dtype=np.int64)
        self._longest_still, self._trips, self._deliveries, self._ticks = 0, 0, 0, 0
        self._arms = np.empty((0, 0))

    @property
    def ticks(self) -> int:
        """Control periods so far."""
        return self._ticks

    @property
    def time_s(self) -> float:
        """Simulated time so far [s]."""
        return self._ticks * self.world.tick_s

    @property
    def trips(self) -> int:
        """Times that a car has come to a node it was sent to."""
        return self._trips

    @property
    def deliveries(self) -> int:
        """Times that a car has set down."""
        return self._deliveries

    @property
    def car_words(self) -> tuple[str, ...]:
        """What each car is about, in the words of the time accounts."""
        slow = np.abs(self.world.car_speeds()) < _STILL_MPS
        return tuple(
            ("traffic" if stands else f"driving {'loaded' if carries else 'empty'}")
            if under_way
            else ("served" if node in self._uses else "idle")
            for under_way, stands, carries, node in zip(
                self._under_way.tolist(), slow.tolist(), self._carries.tolist(), self._node, strict=True
            )
        )

    def ways(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Line of every car that is granted, and what is planned beyond [m], shape (k, 2) each."""
        return self._driver.remaining_lines(), self.executor.planned_lines()

    def tick(self) -> None:
        """Let a control period pass."""
        for car in range(len(self._node)):
            self._serve(car)
        self.traffic.tick(self._ticks)
        commands = self.executor.tick(self.world)
        self.world.step(commands, self._arms, self._arms, np.empty(0, dtype=np.bool_))
        self._ticks += 1
        stands = np.abs(self.world.car_speeds()) < _STILL_MPS
        self._still = np.where(stands & self._under_way, self._still + 1, 0)
        self._longest_still = max(self._longest_still, int(self._still.max(initial=0)))

    def result(self) -> LayoutResult:
        """What has happened so far."""
        contacts = self.world.contacts()
        return LayoutResult(
            duration_s=self.time_s,
            trips=self._trips,
            deliveries=self._deliveries,
            contacts=contacts.robot + contacts.static,
            min_clearance_m=self.world.min_clearance_m(),
            longest_still_s=self._longest_still * self.world.tick_s,
            plans=self.traffic.n_plans,
            plans_cut=self._n_cut,
        )

    def _serve(self, car: int) -> None:
        """Let a car that has come to its node pick up or set down, and then go on."""
        if self._under_way[car]:
            arrived = self.executor.tail_states()[car] == self.traffic.goals[car] and self.executor.idle(car)
            if arrived:
                self._under_way[car] = False
                self._ready[car] = self._in(_SERVICE_S)
                self._arrive(car)
        elif self._ticks >= self._ready[car]:
            self._send(car)

    def _arrive(self, car: int) -> None:
        use = self._uses.get(self._node[car], _NOWHERE)
        self._trips += use != _NOWHERE or not self._delivers
        self._deliveries += use == "drop"
        if use != _NOWHERE:
            self._carries[car] = use == "pick"

    def _send(self, car: int) -> None:
        """Send a car to a free node of the other kind; while there is none, away from stations."""
        use = self._uses.get(self._node[car], _NOWHERE)
        wanted = "drop" if self._carries[car] else "pick"
        free = self._free(wanted) if self._delivers else self._free(_NOWHERE)
        self._ready[car] = self._in(_AGAIN_S)
        if not free and use != _NOWHERE:
            free = self._free(_NOWHERE)
        if not free:
            self.traffic.let_wait(car)
            return
        node = free[int(self._rng.integers(len(free)))]
        state = int(self.executor.tail_states()[car])
        moves = {goal: int(self.traffic.tables.to(goal)[state]) for goal in self.lanes.states_at[node]}
        goal = min(moves, key=lambda goal: (moves[goal], goal))
        self._node[car], self._under_way[car] = node, True
        self.traffic.send(car, goal, stay=node in self._uses, tick=self._ticks)

    def _free(self, use: str) -> list[str]:
        """Nodes of a kind that no car is bound for or at, in their order."""
        return [
            node for node in self.lanes.states_at if self._uses.get(node, _NOWHERE) == use and node not in self._node
        ]

    def _in(self, seconds: float) -> int:
        """The tick at which some time from now has passed."""
        return self._ticks + round(seconds / self.world.tick_s)

    def _log(self, kind: str, **_: object) -> None:
        self._n_cut += kind == "plan_cut"


def _starts(graph: LaneGraph, n_cars: int, rng: np.random.Generator) -> np.typing.NDArray[np.int32]:
    """Places at which cars do not touch each other."""
    touch = touching([pose[None] for pose in graph.state_pose], car_footprint())
    found: list[int] = []
    for state in rng.permutation(graph.n_states).tolist():
        if not touch[state, found].any():
            found.append(state)
    require(1 <= n_cars <= len(found), "--cars", n_cars, f"1 to {len(found)}, as many as have room on the lanes")
    return np.array(found[:n_cars], dtype=np.int32)
