"""Every invariant is broken once on purpose, by taking away the rule that keeps it, and the violation has its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.errors import FleetError
from fleet.safety.breach import Invariant, InvariantError
from fleet.safety.check import SafetyCheck
from fleet.safety.clearance import CLEARANCE_M
from fleet.safety.order import OrderCheck
from fleet.simulation import Simulation
from fleet.stations.booking import Bookings
from fleet.tasks.board import TaskState
from fleet.world.protocol import ParcelBody
from maps.grid import GridMap
from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.precedence.dependency_graph import DependencyGraph
from planners.precedence.queues import start
from planners.status import Status
from tests.unit.planners.mapf.lanes import graph_of, open_grid

Make = Callable[..., tuple[Simulation, SafetyCheck]]


@pytest.fixture
def make() -> Iterator[Make]:
    """Make a checked run."""
    made: list[Simulation] = []

    def make(site: str = "small", robots: int = 8, **more: Any) -> tuple[Simulation, SafetyCheck]:
        more = {"fidelity": Fidelity.KINEMATIC, "arms": ArmConfig(workers_n=0), "seed": 1} | more
        simulation = Simulation(RunConfig(site=site, robots=robots, **more))
        made.append(simulation)
        return simulation, SafetyCheck(simulation.view)

    yield make
    for simulation in made:
        simulation.missions.faults = lambda: []  # type: ignore[method-assign]  # broken on purpose
        simulation.close()


def drive(simulation: Simulation, check: SafetyCheck, until: Callable[[], bool], most_s: float = 120.0) -> None:
    """Run, checked, until something is so."""
    while not until():
        assert simulation.sim_s < most_s, "it never happens"
        simulation.tick()
        check.tick()


def violation(simulation: Simulation, check: SafetyCheck, most_s: float = 120.0) -> InvariantError:
    """Run, checked, until an invariant does not hold."""
    with pytest.raises(InvariantError) as caught:
        drive(simulation, check, lambda: False, simulation.sim_s + most_s)
    return caught.value


def car_in(simulation: Simulation, state: TaskState) -> int:
    """The first car with a task in some state, -1 if there is none."""
    return next((task.car for task in simulation.board.in_state(state) if task.car is not None), -1)


# --------------------------------------------------------------------------------------------------------------- grants


def grant_everything(self: DependencyGraph, most: int, closed: object) -> tuple[Any, Any]:
    """As `grant_all`, without a look at who holds a cell, or whose turn it is."""
    granted = []
    for agent in range(self.n_agents):
        while self.n_queued(agent) and self.n_granted(agent) < most:
            granted.append((agent, int(start(self.queues, agent))))
    agents, moves = np.array(granted, dtype=np.int32).reshape(-1, 2).T
    return agents.copy(), moves.copy()


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
def test_without_the_check_of_grants_two_cars_have_one_cell(
    make: Make, monkeypatch: pytest.MonkeyPatch, fidelity: Fidelity
) -> None:
    monkeypatch.setattr(DependencyGraph, "grant_all", grant_everything)
    error = violation(*make(fidelity=fidelity))
    assert error.breach.invariant is Invariant.GRANTS
    assert len(error.breach.robots) == 2
    assert error.breach.place in str(error)


def test_books_that_forget_a_grant_are_found(make: Make) -> None:
    simulation, check = make()
    queues = simulation.executor.dependencies.queues
    cell = int(simulation.graph.state_cell[queues.state[0]])
    queues.holder[cell] = -1
    error = violation(simulation, check)
    assert error.breach.invariant is Invariant.GRANTS
    assert "by the books" in str(error)


# ------------------------------------------------------------------------------------------------------------ footprint


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
def test_a_teleported_car_is_where_it_must_not_be(make: Make, fidelity: Fidelity) -> None:
    simulation, check = make(fidelity=fidelity)
    drive(simulation, check, lambda: simulation.sim_s >= 2.0)
    simulation.world.push_car(3, 1.0, 0.0, 0.0)  # nobody tells of it
    error = violation(simulation, check)
    assert error.breach.invariant is Invariant.FOOTPRINT
    assert error.breach.robots[0] == "car_3"
    assert error.tick == simulation.now


def test_a_car_that_drives_without_a_grant_is_caught(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, check = make()
    monkeypatch.setattr(simulation.executor, "tick", lambda world: np.tile([0.0, 1.0], (world.n_cars, 1)))
    assert violation(simulation, check).breach.invariant is Invariant.FOOTPRINT


def test_a_body_off_the_floor_is_told(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: simulation.sim_s >= 1.0)
    simulation.world.put_car(0, simulation.world.car_poses()[0] - (50.0, 0.0, 0.0))
    assert "outside of the floor" in str(violation(simulation, check))


def test_a_pushed_car_is_excused_until_it_is_back_and_no_longer(make: Make) -> None:
    push = ScenarioEvent(time_s=3.0, kind="car_pushed", target="car_0", parameters={"dx_m": 0.0, "dy_m": 0.6})
    simulation, check = make(robots=3, events=(push,))
    logged: list[str] = []
    simulation.events.subscribe(lambda event: logged.append(event.kind))
    drive(simulation, check, lambda: "rejoined" in logged)
    drive(simulation, check, lambda: not check._faults.cars.any())
    simulation.world.push_car(0, 0.0, 1.2, 0.0)
    error = violation(simulation, check)
    assert (error.breach.invariant, error.breach.robots[0]) == (Invariant.FOOTPRINT, "car_0")


def test_a_car_pushed_on_the_grid_is_excused_until_it_is_put_back(make: Make) -> None:
    """An arm is at work on it, so that it stays where it was pushed to for longer than a push lasts."""
    simulation, check = make(robots=3, fidelity=Fidelity.GRID)
    served = simulation.missions.served
    drive(simulation, check, lambda: bool((served >= 0).any()))
    arm = int(np.flatnonzero(served >= 0)[0])
    car = int(served[arm])
    dx_m, dy_m = 0.35 * (simulation.scene.arm_base[arm, :2] - simulation.world.car_poses()[car, :2])
    facts = {"disturbance": "car_pushed", "target": f"car_{car}"}
    simulation.world.push_car(car, float(dx_m), float(dy_m), 0.0)
    simulation.events.log("disturbance", **facts)
    pushed_s = simulation.sim_s
    drive(simulation, check, lambda: simulation.sim_s > pushed_s + 2.5)
    assert check._faults.cars[car]
    drive(simulation, check, lambda: not check._faults.cars[car])
    assert served[arm] != car


def test_a_dead_car_is_excused(make: Make) -> None:
    simulation, check = make(robots=3, events=(ScenarioEvent(time_s=1.0, kind="car_dead", target="car_1"),))
    drive(simulation, check, lambda: simulation.sim_s >= 3.0)
    simulation.world.push_car(1, 1.0, 0.0, 0.0)
    drive(simulation, check, lambda: simulation.sim_s >= 3.5)


def test_a_lane_graph_that_hides_a_cell_is_refused(make: Make) -> None:
    simulation, _ = make(robots=2)
    graph = simulation.graph
    short: LaneGraph = replace(graph, swept_cell=graph.swept_cell[graph.swept_ptr[:-1]], swept_ptr=_ones(graph))
    view = replace(simulation.view, setup=replace(simulation.view.setup, graph=short))
    with pytest.raises(InvariantError, match="invariant swept: the body of a car on move 0"):
        SafetyCheck(view)


def _ones(graph: LaneGraph) -> Any:
    return np.arange(graph.n_moves + 1, dtype=np.int32)


# ---------------------------------------------------------------------------------------------------------------- order


def plan_of(*rows: list[int]) -> Plan:
    return Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0)


def order_of(dependencies: DependencyGraph) -> OrderCheck:
    """The referee of an order of cars in one row of cells."""
    grid = GridMap(np.ones((1, 10), dtype=np.bool_))
    run: Any = SimpleNamespace(executor=SimpleNamespace(dependencies=dependencies), site=SimpleNamespace(grid=grid))
    return OrderCheck(run)


def test_without_the_swap_rule_two_cars_wait_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planners.precedence.steps._check_rings", lambda *_: None)
    dependencies = DependencyGraph(open_grid(1, 2), [0, 1])
    dependencies.extend(plan_of([0, 1], [1, 0]))
    breach = order_of(dependencies).look()
    assert breach is not None
    assert breach.invariant is Invariant.ORDER
    assert sorted(breach.robots) == ["car_0", "car_1"]
    assert breach.values["waits_for"] == {"car_0": ["car_1 at 0,1"], "car_1": ["car_0 at 0,0"]}


def test_without_the_check_of_cycles_an_exchange_closes_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Agent 2 on the crossing would wait for agent 1 ahead, who waits for agent 0, whom it has overtaken."""
    graph = graph_of(range(8), [(0, 1), (1, 2), (2, 3), (4, 1), (1, 5), (5, 2), (2, 6), (5, 7)])
    dependencies = DependencyGraph(graph, [0, 5, 4])
    dependencies.extend(plan_of([0, 5, 4], [1, 5, 4], [2, 5, 4], [3, 2, 1], [3, 6, 5], [3, 6, 7]))
    order = order_of(dependencies)
    assert order.look() is None
    monkeypatch.setattr("planners.precedence.reorder.run_through", lambda q, *_: q.queued - q.granted)
    assert dependencies.go_first(2, np.ones(3, dtype=np.bool_))
    assert dependencies.has_cycle()
    breach = order.look()
    assert breach is not None
    assert breach.invariant is Invariant.ORDER
    assert len(breach.robots) >= 2


def test_a_line_that_lost_a_visit_is_found() -> None:
    dependencies = DependencyGraph(open_grid(1, 3), [0, 2])
    dependencies.extend(plan_of([0, 2], [1, 2]))
    order = order_of(dependencies)
    assert order.look() is None
    dependencies.queues.line_first[1] = -1
    breach = order.look()
    assert breach is not None
    assert breach.words == "the line of cell 0,0 has a visit that is no waiting move"


# ------------------------------------------------------------------------------------------------------------ clearance


def touching(simulation: Simulation, check: SafetyCheck, poses: Any) -> Any:
    """What the referee of distances says of cars at some poses."""
    world = simulation.world
    return check._clearance.look(poses, world.held(), world.parcel_ids(), world.parcel_poses())


def test_two_bodies_that_overlap_are_found_and_two_that_pass_are_not(make: Make) -> None:
    simulation, check = make(robots=2)
    car = simulation.scene.car
    poses = np.array([[5.0, 5.0, 0.3], [5.0, 5.0, 0.3]])
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    for apart_m, found in ((0.0, True), (2 * car.half_width_m - 0.001, True), (2 * car.half_width_m + 0.02, False)):
        poses[1, :2] = poses[0, :2] + apart_m * across
        breach = touching(simulation, check, poses)
        assert (breach is not None) is found, apart_m
    poses[1] = (5.0 + car.front_m + car.half_width_m - 0.01, 5.0, np.pi / 2)  # a nose in a side
    poses[0, 2] = 0.0
    breach = touching(simulation, check, poses)
    assert (breach.invariant, breach.robots) == (Invariant.CLEARANCE, ("car_0", "car_1"))


def test_an_arm_over_a_car_that_it_does_not_serve_is_found(make: Make) -> None:
    simulation, check = make("cell", 1)
    served = simulation.missions.served
    breach = None
    while breach is None and simulation.sim_s < 120.0:
        simulation.tick()
        serving = served.copy()
        served[:] = -1
        breach = touching(simulation, check, simulation.world.car_poses())
        served[:] = serving
    assert breach.invariant is Invariant.CLEARANCE
    assert breach.robots[1] == "car_0"
    assert "(it serves no car)" in breach.words


def test_two_arms_that_no_rule_of_the_tray_keeps_apart_are_found_when_they_meet(make: Make) -> None:
    """Both arms of a dock reach over its tray: nobody asks `SharedDock`, as they are driven without their services."""
    simulation, check = make("twin", 2)
    base = simulation.scene.arm_base
    first, second = check._clearance._arms.near[0].tolist()
    world = simulation.world
    q = world.arm_positions()
    for arm, other in ((first, second), (second, first)):
        q[arm] = _reaching(base[arm], base[other])
    for _ in range(100):
        world.step(np.zeros((2, 2)), q, np.zeros_like(q), np.zeros(len(q), dtype=np.bool_))
        if breach := touching(simulation, check, world.car_poses()):
            break
    assert breach is not None
    assert (breach.invariant, breach.robots) == (Invariant.CLEARANCE, (f"arm_{first}", f"arm_{second}"))
    assert -0.05 < breach.values["clearance_m"] <= CLEARANCE_M, "in the tick in which they come too close"


def _reaching(base: Any, other: Any) -> Any:
    """Joints of an arm that lies down towards another one."""
    turn = np.arctan2(other[1] - base[1], other[0] - base[0]) - base[3]
    return np.array([(turn + np.pi) % (2 * np.pi) - np.pi, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0])


# ---------------------------------------------------------------------------------------------------------------- books


def test_a_phase_that_does_not_fit_the_task_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: car_in(simulation, TaskState.CARRIED) >= 0)
    car = car_in(simulation, TaskState.CARRIED)
    simulation.missions.enter(car, simulation.missions.phase[car].IDLE)
    error = violation(simulation, check)
    assert (error.breach.invariant, error.breach.robots) == (Invariant.PHASES, (f"car_{car}",))


def test_a_task_in_two_states_is_found(make: Make) -> None:
    simulation, check = make()
    task = simulation.board.tasks[0]
    simulation.board._by_state[TaskState.DELIVERED][0] = task
    error = violation(simulation, check, 2.0)
    assert error.breach.invariant is Invariant.TASKS
    assert task.order.name in str(error)


def test_a_task_of_two_cars_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: car_in(simulation, TaskState.ASSIGNED) >= 0)
    missions = simulation.missions
    first = car_in(simulation, TaskState.ASSIGNED)
    second = next(car for car, task in enumerate(missions.task_of) if car != first and task is not None)
    missions.task_of[second] = missions.task_of[first]
    missions.faults = lambda: []  # type: ignore[method-assign]  # which would see it first
    breach = check._books.audit()
    assert breach is not None
    assert (breach.invariant, set(breach.robots)) == (Invariant.TASKS, {f"car_{first}", f"car_{second}"})


def test_a_station_that_is_booked_twice_is_found(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Bookings, "room", lambda *_: 1)
    error = violation(*make(tasks=40, allocation=AllocationConfig(station_cap_n=1)))
    assert error.breach.invariant is Invariant.BOOKINGS
    assert error.breach.place.startswith(("pick", "drop"))
    assert len(error.breach.robots) > int(str(error.breach.values["capacity"]))


# -------------------------------------------------------------------------------------------------------------- parcels


def a_parcel(simulation: Simulation, state: TaskState) -> int:
    tasks = [task for task in simulation.board.in_state(state) if task.parcel in simulation.world.parcel_ids()]
    return tasks[0].parcel if tasks else -1


def test_a_parcel_that_came_from_nowhere_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: a_parcel(simulation, TaskState.READY) >= 0 or simulation.sim_s > 5.0)
    copy = len(simulation.board.tasks) - 1
    pose = np.array([1.0, 1.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    simulation.world.add_parcel(ParcelBody(parcel=copy, size_m=(0.1, 0.1, 0.1), mass_kg=1.0, pose=pose))
    error = violation(simulation, check)
    assert error.breach.invariant is Invariant.PARCELS
    assert "parcels too many: 1" in str(error)
    simulation.view.inventory.n_entered += 1  # and if the books are made to agree
    assert "in the world, not booked" in str(violation(simulation, check, 2.0))


def test_a_parcel_that_vanished_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: a_parcel(simulation, TaskState.CARRIED) >= 0)
    simulation.world.remove_parcel(a_parcel(simulation, TaskState.CARRIED))
    assert "parcels lost: 1" in str(violation(simulation, check))


def test_a_parcel_that_lies_elsewhere_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: a_parcel(simulation, TaskState.CARRIED) >= 0)
    parcel = a_parcel(simulation, TaskState.CARRIED)
    world: Any = simulation.world
    size, kg = simulation.board.tasks[parcel].delivery.size_m, simulation.board.tasks[parcel].delivery.mass_kg
    world.remove_parcel(parcel)
    aside = np.array([1.0, 1.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    world.add_parcel(ParcelBody(parcel=parcel, size_m=size, mass_kg=kg, pose=aside))
    error = violation(simulation, check, 1.0)
    assert error.breach.invariant is Invariant.PARCELS
    assert "is booked as carried and lies at (1.0, 1.0" in str(error)


def test_a_parcel_in_two_grips_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: simulation.world.held().max() >= 0)
    world: Any = simulation.world
    world._parcels.held[:] = world.held().max()
    world._parcels.update = lambda *_: None
    error = violation(simulation, check, 0.2)
    assert error.breach.invariant is Invariant.PARCELS
    assert "held by arm_0 and arm_1" in str(error)


def test_a_parcel_with_two_slots_is_found(make: Make) -> None:
    simulation, check = make()
    drive(simulation, check, lambda: any(c is not None for s in simulation.stations for c in s.contents))
    content = next(c for s in simulation.stations for c in s.contents if c is not None)
    station = next(s for s in simulation.stations if s.n_free)
    assert station.take_slot(content) is not None
    assert "has two slots" in str(violation(simulation, check, 2.0))


def test_the_error_carries_all_that_is_to_be_known(make: Make) -> None:
    simulation, check = make()
    events: list[Any] = []
    simulation.events.subscribe(events.append)
    drive(simulation, check, lambda: simulation.sim_s >= 1.0)
    simulation.world.push_car(3, 1.0, 0.0, 0.0)
    error = violation(simulation, check)
    assert isinstance(error, FleetError)
    assert (error.tick, error.time_s) == (simulation.now, simulation.sim_s)
    assert error.facts["invariant"] == "footprint"
    assert {"robots", "place", "values", "message"} <= error.facts.keys()
    last = events[-1]
    assert (last.kind, last.tick, last.facts["message"]) == ("violation", error.tick, str(error))
