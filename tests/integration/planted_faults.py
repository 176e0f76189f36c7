"""Planted faults: safety rules of the fleet, each with a patch that takes it away and what notices that it is gone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent, TrafficConfig
from fleet.dispatch.interventions import Interventions
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.state import Missions
from fleet.run.setup import RunSetup
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.stations.booking import Bookings
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.traffic.drivers import PathDriver
from fleet.traffic.executor import Executor
from planners.mapf.options import options_of
from planners.mapf.pibt import Stepper
from planners.mapf.problem import NO_GOAL
from planners.precedence.dependency_graph import DependencyGraph
from planners.precedence.queues import NOBODY, NONE, Queues, hold, may_start, move_at
from tests.unit.planners.mapf.lanes import instance_of, king_grid, one_way_loop, open_grid

Patch = pytest.MonkeyPatch


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A rule, and how it is taken away."""

    rule: str
    """What is kept by it."""
    lives_in: str
    """The name of what keeps it, from its package on."""
    plant: Callable[[Patch], None]
    """Takes it away; its docstring says how."""
    caught_by: str
    """The invariant of a run, the kind of conflict in a plan, or the error, that notices."""
    run: str = "crowd"
    """In which of `RUNS` or `PLANS`."""

    @property
    def row(self) -> str:
        """Its row in the page."""
        planted = (self.plant.__doc__ or "").split(".")[0]
        return f"| {self.rule} | `{self.lives_in}` | {planted} | {self.run} | `{self.caught_by}` |"


def _run(**more: Any) -> RunConfig:
    usual = {"site": "small", "robots": 10, "tasks": 60, "fidelity": Fidelity.KINEMATIC, "duration_s": 60.0, "seed": 1}
    # With PIBT cars keep moves while a plan is made; some rules are about those.
    return RunConfig(**{**usual, **more}, arms=ArmConfig(workers_n=0), traffic=TrafficConfig(planner="pibt"))


RUNS = {
    "crowd": _run(),
    "pushes": _run(
        tasks=30,
        robots=8,
        duration_s=50.0,
        events=tuple(
            ScenarioEvent(time_s=time_s, kind="car_pushed", target=f"car_{car}", parameters={"dx_m": 0.3, "dy_m": 0.5})
            for time_s, cars in ((6.0, (0, 1)), (14.0, (2, 3)), (30.0, (0, 5)))
            for car in cars
        ),
    ),
    "lost grips": _run(
        tasks=30,
        robots=8,
        events=tuple(
            ScenarioEvent(time_s=float(time_s), kind="grip_lost", target=f"arm_{arm}", parameters={})
            for time_s, arm in ((8, 0), (9, 1), (10, 2), (11, 0), (14, 1), (18, 0), (22, 1), (26, 2), (30, 3))
        ),
    ),
    "blocked lanes": _run(
        robots=8,
        events=tuple(
            ScenarioEvent(
                time_s=4.0 + 3.0 * k, kind="lane_blocked", target=f"{row},{col}", parameters={"duration_s": 12.0}
            )
            for k, (row, col) in enumerate(3 * ((6, 7), (9, 3), (6, 4), (3, 2), (9, 6), (6, 10)))
        ),
    ),
}
"""Each is safe as long as nothing is planted; what comes late in them is there for the faults that need time."""

PLANS = {
    "plan: a push": instance_of(open_grid(1, 4), [0, 1], [1, NO_GOAL], priorities=[1.0, 0.0], blocked=[2]),
    "plan: a crossing": instance_of(king_grid(2, 2), [0, 1], [3, 2]),
    "plan: a ring": instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0]),
    "plan: a fixed car": instance_of(open_grid(1, 4), [0, 1], [3, NO_GOAL], fixed=[False, True]),
    "plan: a car that stays": instance_of(open_grid(1, 4), [0, 1], [3, 1], priorities=[9.0, 0.0], stay=[False, True]),
}
"""Each is planned by PIBT, and its plan is judged by `planners.mapf.validate.breaches`."""

# --------------------------------------------------------------------------------------------------------------- grants


def _swept(q: Queues, agent: int) -> list[int]:
    move = move_at(q, agent, q.granted[agent])
    cells: list[int] = q.swept_cell[q.swept_ptr[move] : q.swept_ptr[move + 1]].tolist()
    return cells


def _is_free(q: Queues, agent: int) -> bool:
    return all(q.holder[cell] in (NOBODY, agent) for cell in _swept(q, agent))


def _is_first(q: Queues, agent: int) -> bool:
    return all(q.visit_agent[q.line_first[cell]] == agent for cell in _swept(q, agent))


def _start(q: Queues, agent: int) -> int:
    """As `queues.start`, wherever in the lines the agent's visits are."""
    number, cells = q.granted[agent], _swept(q, agent)
    q.granted[agent] += 1
    for cell in cells:
        before, visit = NONE, q.line_first[cell]
        while q.visit_agent[visit] != agent or q.visit_number[visit] != number:
            before, visit = visit, q.visit_next[visit]
        if before == NONE:
            q.line_first[cell] = q.visit_next[visit]
        else:
            q.visit_next[before] = q.visit_next[visit]
        if q.line_last[cell] == visit:
            q.line_last[cell] = before
        q.visit_next[visit] = q.pool[0]
        q.pool[0] = visit
        q.pool[1] += 1
        hold(q, agent, cell)
    return int(move_at(q, agent, number))


def _grants_by(rule: Callable[[Queues, int], bool], *, into_closed: bool = False) -> Callable[..., Any]:
    """As `DependencyGraph.grant_all`, by another rule."""

    def grant_all(self: DependencyGraph, most: int, closed: Any) -> tuple[Any, Any]:
        q, granted = self.queues, []
        for agent in range(self.n_agents):
            while self.n_queued(agent) and self.n_granted(agent) < most and rule(q, agent):
                to = q.state_cell[q.move_to[move_at(q, agent, q.granted[agent])]]
                if closed[to] and not into_closed:
                    break
                granted.append((agent, _start(q, agent)))
        self._held_up = None
        agents, moves = np.array(granted, dtype=np.int32).reshape(-1, 2).T
        return agents.copy(), moves.copy()

    return grant_all


def cells_are_shared(patch: Patch) -> None:
    """Moves are granted in turn, whoever holds their cells."""
    patch.setattr(DependencyGraph, "grant_all", _grants_by(_is_first))


def turns_are_ignored(patch: Patch) -> None:
    """Moves are granted as soon as their cells are free, whoever is first in line."""
    patch.setattr(DependencyGraph, "grant_all", _grants_by(_is_free))


def closed_cells_are_entered(patch: Patch) -> None:
    """Moves are granted into closed cells, and what is queued through a cell is kept when it is closed."""
    patch.setattr(DependencyGraph, "grant_all", _grants_by(may_start, into_closed=True))
    patch.setattr(DependencyGraph, "avoid", lambda *_: None)
    patch.setattr("fleet.traffic.replanning.Traffic.set_blocked", lambda *_, **__: None)


def cars_drive_without_grants(patch: Patch) -> None:
    """Every car is told to drive straight on, whatever it was granted."""
    tick = Executor.tick

    def straight_on(self: Executor, world: Any) -> Any:
        return np.full_like(tick(self, world), (0.0, 1.0))

    patch.setattr(Executor, "tick", straight_on)


def cells_are_released_at_once(patch: Patch) -> None:
    """A move counts as done as soon as it is granted."""
    append = PathDriver.append
    granted: list[Any] = []

    def note(self: PathDriver, cars: Any, moves: Any) -> None:
        append(self, cars, moves)
        granted.append(cars)

    def finished(self: PathDriver) -> Any:
        del self
        done = np.concatenate([*granted, np.empty(0, dtype=np.int32)])
        granted.clear()
        return done

    patch.setattr(PathDriver, "append", note)
    patch.setattr(PathDriver, "finished", finished)


def a_cut_keeps_what_waits(patch: Patch) -> None:
    """At a replan as many moves of each car are kept as are asked for, though they wait for some that are dropped."""
    patch.setattr(
        "planners.precedence.dependency_graph.run_through",
        lambda q, limits, _: np.minimum(limits, q.queued - q.granted),
    )


def turns_sweep_one_cell(patch: Patch) -> None:
    """The lane graph says that a move sweeps only the first of its cells."""
    setup_of = RunSetup.of

    def of(config: RunConfig) -> RunSetup:
        setup = setup_of(config)
        graph = setup.graph
        first = graph.swept_cell[graph.swept_ptr[:-1]]
        return replace(
            setup, graph=replace(graph, swept_cell=first, swept_ptr=np.arange(graph.n_moves + 1, dtype=np.int32))
        )

    patch.setattr(RunSetup, "of", staticmethod(of))


# ------------------------------------------------------------------------------------------------------------- recovery


def a_lost_car_keeps_its_moves(patch: Patch) -> None:
    """A car that has left its lane goes on being granted what was queued."""
    patch.setattr(DependencyGraph, "halt", lambda *_: None)


def a_lost_car_keeps_its_task(patch: Patch) -> None:
    """A car that has left its lane keeps the task that it is to pick."""

    def retire(self: Interventions, car: int, phase: Any, now_s: float, reason: str) -> None:
        del now_s, reason
        self._missions.enter(car, phase)

    patch.setattr(Interventions, "retire", retire)


# ------------------------------------------------------------------------------------------------------ stations, books


def arms_are_clear_at_once(patch: Patch) -> None:
    """An arm says that it is clear of the car from the beginning of its work on."""
    patch.setattr(ArmController, "dock_is_clear", property(lambda _: True))


def arms_are_believed(patch: Patch) -> None:
    """A parcel counts as moved whatever its arm says, without a look at where it is."""
    patch.setattr(Inventory, "in_tray", lambda *_: True)
    patch.setattr(Inventory, "on_slot", lambda *_: True)
    patch.setattr("fleet.missions.docks._ARM_IS_DONE", tuple(ArmPhase))


def places_are_never_full(patch: Patch) -> None:
    """Every place has room for one more car."""
    patch.setattr(Bookings, "room", lambda *_: 1)


def every_parcel_gets_the_first_slot(patch: Patch) -> None:
    """All parcels of a station are given slot 0."""

    def take_slot(self: Station, task: int) -> int | None:
        if not self.n_free:
            return None
        self.contents[self.contents.index(None)] = task
        self.n_free -= 1
        return 0

    patch.setattr(Station, "take_slot", take_slot)


def delivered_parcels_give_up_slots(patch: Patch) -> None:
    """A drop slot is given back when the parcel is delivered, before it is collected."""
    patch.setattr(Inventory, "collect_later", lambda self, station, slot, now_s: station.free_slot(slot))


def picked_parcels_keep_slots(patch: Patch) -> None:
    """A pick slot is not given back when its parcel has left."""
    patch.setattr(Inventory, "vacate", lambda *_: None)


def collected_parcels_stay(patch: Patch) -> None:
    """A parcel that is collected is written off and left on its slot."""

    def take_out(self: Inventory, task: Task, station: Station, slot: int) -> None:
        del task
        self.n_left += 1
        station.free_slot(slot)

    patch.setattr(Inventory, "_take_out", take_out)


def tasks_are_kept_when_they_go_back(patch: Patch) -> None:
    """A task that goes back to the pool stays with its car, too."""
    patch.setattr(Missions, "_take", lambda *_: None)


def tasks_are_listed_twice(patch: Patch) -> None:
    """A task that changes its state stays listed under the old one."""
    move = TaskBoard.move

    def keep(self: TaskBoard, task: Task, state: TaskState, now_s: float, reason: str) -> None:
        before = task.state
        move(self, task, state, now_s, reason)
        if state is TaskState.CARRIED:
            self._by_state[before][task.index] = task

    patch.setattr(TaskBoard, "move", keep)


# ---------------------------------------------------------------------------------------------------------------- plans


def blocked_cells_are_options(patch: Patch) -> None:
    """Steps into blocked cells are options like others."""
    patch.setattr("planners.mapf.pibt.options_of", lambda graph, blocked: options_of(graph, np.zeros_like(blocked)))


def options_sweep_nothing(patch: Patch) -> None:
    """Steps claim the cell that they end in, and nothing on the way."""

    def without_sweeps(graph: Any, blocked: Any) -> Any:
        ends = np.column_stack([graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]]).ravel()
        bounds = 2 * np.arange(graph.n_moves + 1, dtype=np.int32)
        return options_of(replace(graph, swept_cell=ends.astype(np.int32), swept_ptr=bounds), blocked)

    patch.setattr("planners.mapf.pibt.options_of", without_sweeps)


def rings_turn(patch: Patch) -> None:
    """Closed rings of followers are allowed, whatever the instance says."""
    step = Stepper.step

    def rotating(self: Stepper, *states: Any, allow_rotation: bool, **more: Any) -> None:
        del allow_rotation
        step(self, *states, allow_rotation=True, **more)

    patch.setattr(Stepper, "step", rotating)


def nobody_is_locked(patch: Patch) -> None:
    """Cars that must not move are pushed like others."""
    step = Stepper.step

    def pushing(self: Stepper, *states: Any, locked: Any, **more: Any) -> None:
        step(self, *states, locked=np.zeros_like(locked), **more)

    patch.setattr(Stepper, "step", pushing)


FAULTS = (
    Fault(
        rule="A move is granted when nobody else holds a cell that it sweeps",
        lives_in="planners.precedence.queues.may_start",
        plant=cells_are_shared,
        caught_by="grants",
    ),
    Fault(
        rule="A move is granted in the order of the plan",
        lives_in="planners.precedence.queues.may_start",
        plant=turns_are_ignored,
        caught_by="order",
    ),
    Fault(
        rule="Nobody is let into a closed cell",
        lives_in="planners.precedence.queues.start_all",
        plant=closed_cells_are_entered,
        caught_by="closed",
        run="blocked lanes",
    ),
    Fault(
        rule="No grant, no motion",
        lives_in="fleet.traffic.executor.Executor.tick",
        plant=cars_drive_without_grants,
        caught_by="footprint",
    ),
    Fault(
        rule="A cell is released when its car has passed",
        lives_in="fleet.traffic.drivers.PathDriver.finished",
        plant=cells_are_released_at_once,
        caught_by="footprint",
    ),
    Fault(
        rule="A cut drops whatever waits for what is dropped",
        lives_in="planners.precedence.dependency_graph.DependencyGraph.commit_cut",
        plant=a_cut_keeps_what_waits,
        caught_by="InstanceError",
    ),
    Fault(
        rule="A move claims every cell that the body touches",
        lives_in="maps.lane_graph.build_lane_graph",
        plant=turns_sweep_one_cell,
        caught_by="swept",
    ),
    Fault(
        rule="A car off its lane drops its queued moves",
        lives_in="planners.precedence.dependency_graph.DependencyGraph.halt",
        plant=a_lost_car_keeps_its_moves,
        caught_by="PathError",
        run="pushes",
    ),
    Fault(
        rule="A car off its lane gives back what it has not picked",
        lives_in="fleet.dispatch.interventions.Interventions.retire",
        plant=a_lost_car_keeps_its_task,
        caught_by="phases",
        run="pushes",
    ),
    Fault(
        rule="A car stands until the arm is clear of it",
        lives_in="fleet.stations.arms.arm_controller.ArmController.dock_is_clear",
        plant=arms_are_clear_at_once,
        caught_by="clearance",
    ),
    Fault(
        rule="A transfer is done when the parcel is measured where it belongs",
        lives_in="fleet.missions.docks.Docks",
        plant=arms_are_believed,
        caught_by="parcels",
        run="lost grips",
    ),
    Fault(
        rule="A place takes no more cars than it has room for",
        lives_in="fleet.stations.booking.Bookings.room",
        plant=places_are_never_full,
        caught_by="bookings",
    ),
    Fault(
        rule="A slot is promised once",
        lives_in="fleet.stations.station.Station.take_slot",
        plant=every_parcel_gets_the_first_slot,
        caught_by="parcels",
    ),
    Fault(
        rule="A delivered parcel has its slot until it is collected",
        lives_in="fleet.missions.parcels.inventory.Inventory.collect_later",
        plant=delivered_parcels_give_up_slots,
        caught_by="parcels",
    ),
    Fault(
        rule="A loaded parcel gives its slot back",
        lives_in="fleet.missions.parcels.inventory.Inventory.vacate",
        plant=picked_parcels_keep_slots,
        caught_by="parcels",
    ),
    Fault(
        rule="A collected parcel leaves the world",
        lives_in="fleet.missions.parcels.inventory.Inventory.collect",
        plant=collected_parcels_stay,
        caught_by="parcels",
    ),
    Fault(
        rule="A task that goes back to the pool is no car's",
        lives_in="fleet.missions.state.Missions.unassign",
        plant=tasks_are_kept_when_they_go_back,
        caught_by="phases",
        run="pushes",
    ),
    Fault(
        rule="A task is listed under its one state",
        lives_in="fleet.tasks.board.TaskBoard.move",
        plant=tasks_are_listed_twice,
        caught_by="tasks",
    ),
    Fault(
        rule="No plan leads into a blocked cell",
        lives_in="planners.mapf.options.options_of",
        plant=blocked_cells_are_options,
        caught_by="blocked",
        run="plan: a push",
    ),
    Fault(
        rule="No two moves sweep one cell at a time",
        lives_in="planners.mapf.options.options_of",
        plant=options_sweep_nothing,
        caught_by="swept",
        run="plan: a crossing",
    ),
    Fault(
        rule="No plan has a closed ring of followers",
        lives_in="planners.mapf.pibt.Stepper.step",
        plant=rings_turn,
        caught_by="rotation",
        run="plan: a ring",
    ),
    Fault(
        rule="A car that cannot move is not pushed",
        lives_in="planners.mapf.window.plan_window",
        plant=nobody_is_locked,
        caught_by="fixed",
        run="plan: a fixed car",
    ),
    Fault(
        rule="A car that stays at its goal is not pushed",
        lives_in="planners.mapf.window.plan_window",
        plant=nobody_is_locked,
        caught_by="stay",
        run="plan: a car that stays",
    ),
)
