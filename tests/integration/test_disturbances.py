"""What goes wrong in a warehouse: the fleet goes on, and everything that still can be delivered is delivered.

Runs repeat exactly up to a disturbance, so a first run finds the moment at which the second one is disturbed.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from fleet.arrays import FloatArray
from fleet.config import ArmConfig, BatteryConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.insight.codebook import UnknownRobot
from fleet.insight.metrics import Summary
from fleet.missions.phases import CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from maps.site import load_site, save_site, site_from_plan
from maps.stations import StationOptions
from planners.mapf.distance_table import DistanceTable

Look = Callable[[Simulation], None]


def event(time_s: float, kind: str, target: str, **parameters: float) -> ScenarioEvent:
    return ScenarioEvent(time_s=time_s, kind=kind, target=target, parameters=parameters)


def made(events: Iterable[ScenarioEvent] = (), log: list[Event] | None = None, **settings: object) -> Simulation:
    """Make a run of six tasks for three cars on the small site, unless the settings say otherwise."""
    chosen = {"fidelity": Fidelity.KINEMATIC, "arms": ArmConfig(workers_n=0), "duration_s": 900.0} | settings
    config = RunConfig(events=tuple(events), **chosen)  # type: ignore[arg-type]
    return Simulation(config, on_event=None if log is None else log.append)


def run(*events: ScenarioEvent, look: Look | None = None, **settings: object) -> tuple[Summary, list[Event]]:
    log: list[Event] = []
    with made(events, log, **settings) as simulation:
        simulation.run(look)
        return simulation.summary(), log


def first(find: Callable[[Simulation], ScenarioEvent | None], **settings: object) -> ScenarioEvent:
    """Run undisturbed until `find` knows what should happen now."""
    with made(**settings) as simulation:
        while not simulation.finished:
            simulation.tick()
            found = find(simulation)
            if found is not None:
                return found
    raise AssertionError("the moment never came")


def connected_without(simulation: Simulation, cells: Iterable[int]) -> bool:
    """Whether every dock can be reached from every dock and parking place when some cells are closed."""
    graph = simulation.graph
    blocked = simulation.traffic.blocked.copy()
    blocked[list(cells)] = True
    docks = [station.dock_state for station in simulation.stations]
    places = [*docks, *(int(graph.states_of_cell(cell)[0]) for cell in simulation.site.parking)]
    here = [state for state in places if not blocked[graph.state_cell[state]]]
    if any(blocked[graph.state_cell[dock]] for dock in docks):
        return False
    tables = DistanceTable(graph, blocked)
    return all(int(tables.to(dock)[here].max()) < graph.n_states for dock in docks)


def of_kind(log: list[Event], *kinds: str) -> list[Event]:
    return [entry for entry in log if entry.kind in kinds]


def states_of(log: list[Event], task: object) -> list[object]:
    return [entry.facts["state"] for entry in of_kind(log, "task") if entry.facts["task"] == task]


def check(summary: Summary, failed: int = 0) -> None:
    """Nothing touched, nothing lost, and all but some tasks done."""
    assert (summary.tasks_done, summary.tasks_failed) == (summary.tasks_total - failed, failed)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)


# --- car_dead


def test_the_task_of_a_dead_car_goes_to_another() -> None:
    def find(simulation: Simulation) -> ScenarioEvent | None:
        for car in range(3):
            held = simulation.executor.dependencies.held_cells(car)
            bound = simulation.missions.phase[car] is CarPhase.TO_PICK
            if bound and simulation.sim_s > 0.5 and connected_without(simulation, held):
                return event(simulation.sim_s, "car_dead", f"car_{car}")
        return None

    death = first(find)
    summary, log = run(death)
    check(summary)
    given_back = next(e.facts for e in of_kind(log, "task") if e.facts["cause"] == f"{death.target} is dead")
    assert (given_back["before"], given_back["state"]) == (TaskState.ASSIGNED, TaskState.READY)
    carriers = [
        entry.facts["car"]
        for entry in of_kind(log, "task")
        if entry.facts["task"] == given_back["task"] and entry.facts["state"] == TaskState.CARRIED
    ]
    assert len(carriers) == 1
    assert carriers[0] not in (death.target, None)


def test_a_dead_car_stays_where_it_is_and_its_parcel_with_it() -> None:
    """It dies with a parcel, on a stretch that others can go round: its task fails, the others are done."""

    def find(simulation: Simulation) -> ScenarioEvent | None:
        for car in range(3):
            held = simulation.executor.dependencies.held_cells(car)
            loaded = simulation.missions.phase[car] is CarPhase.TO_DROP
            if loaded and simulation.world.car_speeds()[car] > 0.5 and connected_without(simulation, held):
                return event(simulation.sim_s, "car_dead", f"car_{car}")
        return None

    death = first(find)
    poses: list[np.ndarray] = []

    def look(simulation: Simulation) -> None:
        if simulation.sim_s > death.time_s:
            poses.append(simulation.world.car_poses()[int(death.target[-1])].copy())

    summary, log = run(death, look=look)
    check(summary, failed=1)
    failed = [entry.facts for entry in of_kind(log, "task") if entry.facts["state"] == TaskState.FAILED]
    assert [facts["cause"] for facts in failed] == [f"parcel stranded: {death.target} is dead"]
    assert np.hypot(*(poses[-1] - poses[0])[:2]) < 0.4, "it rolls out"
    assert np.array_equal(poses[-1], poses[len(poses) // 2]), "and stands"


@pytest.mark.parametrize("state", [TaskState.LOADING, TaskState.UNLOADING])
def test_a_car_that_dies_at_a_dock_is_not_brought_back_by_the_arm(state: TaskState) -> None:
    """The arm ends its work on the car that died under it, and the car stays dead."""
    _, log = run(duration_s=60.0)
    begun = next(entry for entry in of_kind(log, "task") if entry.facts["state"] == state)
    car = str(begun.facts["car"])
    dead: list[bool] = []

    def look(simulation: Simulation) -> None:
        if simulation.sim_s > begun.sim_s + 1.5:
            dead.append(simulation.missions.phase[int(car[-1])] is CarPhase.DEAD)

    summary, log = run(event(begun.sim_s + 1.0, "car_dead", car), look=look, duration_s=begun.sim_s + 20.0)
    assert all(dead)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)
    after = states_of(log, begun.facts["task"])
    stranded, delivered = [TaskState.CARRIED, TaskState.FAILED], [TaskState.DELIVERED, TaskState.COLLECTED]
    assert after[after.index(state) + 1 :] == (stranded if state is TaskState.LOADING else delivered)


def dies_on_the_way(simulation: Simulation) -> ScenarioEvent | None:
    """A moving car that others can go round, with several cells granted."""
    for car in range(3):
        held = simulation.executor.dependencies.held_cells(car)
        moves = simulation.world.car_speeds()[car] > 0.8 and len(held) > 3
        if moves and simulation.sim_s > 5.0 and connected_without(simulation, held):
            return event(simulation.sim_s, "car_dead", f"car_{car}")
    return None


def under(simulation: Simulation, car: int) -> set[int]:
    """Cells that a car's body touches."""
    x, y, yaw = simulation.world.car_poses()[car]
    spec, grid = simulation.scene.car, simulation.site.grid
    ahead, left = np.meshgrid(np.linspace(-spec.rear_m, spec.front_m, 9), np.linspace(-1, 1, 3) * spec.half_width_m)
    points = np.column_stack((x + np.cos(yaw) * ahead.ravel() - np.sin(yaw) * left.ravel(),
                              y + np.sin(yaw) * ahead.ravel() + np.cos(yaw) * left.ravel()))  # fmt: skip
    return {int(grid.index(*grid.cell_at(float(px), float(py)))) for px, py in points}


def served(simulation: Simulation) -> tuple[int, int] | None:
    """The first arm that reaches over a car, and the car."""
    for service in simulation.arm_manager.services:
        car = int(simulation.missions.served[service.arm])
        if car >= 0 and not service.dock_is_clear:
            return service.arm, car
    return None


def test_a_car_under_a_dead_arm_is_alive_again_when_both_are_mended() -> None:
    def find(simulation: Simulation) -> ScenarioEvent | None:
        found = served(simulation)
        return None if found is None else event(simulation.sim_s, "arm_dead", f"arm_{found[0]}")

    dies = first(find)
    with made() as simulation:
        while (found := served(simulation)) is None:
            simulation.tick()
    arm, car = f"arm_{found[0]}", f"car_{found[1]}"
    at_s = [dies.time_s + 5.0 * k for k in range(4)]
    events = (
        dies,
        event(at_s[1], "car_dead", car),
        event(at_s[2], "car_repaired", car),
        event(at_s[3], "arm_repaired", arm),
    )
    dead_s: list[float] = []

    def look(simulation: Simulation) -> None:
        if simulation.missions.phase[found[1]] is CarPhase.DEAD:
            dead_s.append(simulation.sim_s)

    summary, log = run(*events, look=look)
    assert (dead_s[0], dead_s[-1]) == (pytest.approx(at_s[0], abs=0.11), pytest.approx(at_s[3], abs=0.11))
    assert of_kind(log, "wreck"), "the cells under it are known, although the arm never ended its work"
    check(summary, failed=summary.tasks_failed)


def test_nobody_fetches_what_cannot_be_set_down_any_more() -> None:
    """The drop arm dies while a car is on its way to the pick station."""

    def find(simulation: Simulation) -> ScenarioEvent | None:
        bound = [simulation.missions.task_of[car] for car in simulation.missions.cars_in(CarPhase.TO_PICK)]
        drops = [task.delivery.drop for task in bound if task is not None]
        arms = [station.arm for station in simulation.stations if station.name in drops[:1]]
        return event(simulation.sim_s, "arm_dead", f"arm_{arms[0]}") if arms else None

    dies = first(find)
    log = run(dies)[1]
    failed = [entry for entry in of_kind(log, "task") if entry.facts["state"] is TaskState.FAILED]
    assert failed
    assert all("is closed for good" in str(entry.facts["cause"]) for entry in failed)
    assert not any(TaskState.LOADING in states_of(log, entry.facts["task"]) for entry in failed)


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.GRID])
def test_a_dead_car_takes_only_the_cells_it_stands_in(fidelity: Fidelity) -> None:
    death = first(dies_on_the_way)
    car = int(death.target[-1])
    with made([death], fidelity=fidelity) as simulation:
        while simulation.sim_s < death.time_s + 4.0:
            simulation.tick()
        ground = under(simulation, car)
        assert len(ground) <= 2
        assert set(simulation.executor.dependencies.held_cells(car)) == ground
        assert set(np.flatnonzero(simulation.traffic.blocked).tolist()) == ground
        simulation.run()
        summary = simulation.summary()
    assert summary.tasks_done + summary.tasks_failed == summary.tasks_total
    assert summary.tasks_failed <= 1
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)


@pytest.mark.parametrize("ahead_m", [-1.0, 1.0])
def test_a_dead_car_that_is_pushed_is_seen_where_it_stands_then(ahead_m: float) -> None:
    """Pushed along the way it had been granted, too: that is no progress any more."""
    death = first(dies_on_the_way)
    car = int(death.target[-1])
    with made([death]) as simulation:
        while simulation.sim_s < death.time_s + 4.0:
            simulation.tick()
        yaw = simulation.world.car_poses()[car, 2]
    dx_m, dy_m = float(ahead_m * np.cos(yaw)), float(ahead_m * np.sin(yaw))
    push = event(death.time_s + 10.0, "car_pushed", death.target, dx_m=dx_m, dy_m=dy_m)
    log: list[Event] = []
    with made([death, push], log) as simulation:
        while simulation.sim_s < push.time_s + 4.0:
            simulation.tick()
        ground = under(simulation, car)
        assert set(simulation.executor.dependencies.held_cells(car)) == ground
        assert set(np.flatnonzero(simulation.traffic.blocked).tolist()) == ground
        simulation.run()
        assert simulation.summary().robot_contacts == 0
    before, after = (set(entry.facts["cells"]) for entry in of_kind(log, "wreck"))  # type: ignore[call-overload]
    assert before != after


@pytest.mark.parametrize("kind", ["car_towed", "car_pushed"])
def test_what_a_moved_wreck_cut_off_is_open_at_once(kind: str) -> None:
    """Else a task that comes in the meantime fails because of a wreck that is gone."""
    death = first(dies_on_the_way)
    push = {"dx_m": 0.3, "dy_m": 0.3} if kind == "car_pushed" else {}
    moved = event(death.time_s + 5.0, kind, death.target, **push)
    log: list[Event] = []
    with made([death, moved], log) as simulation:
        while simulation.sim_s < moved.time_s - 0.5:
            simulation.tick()
        assert simulation.traffic.blocked.any()
        while not any(entry.facts["disturbance"] == kind for entry in of_kind(log, "disturbance")):
            simulation.tick()
        while simulation.sim_s < moved.time_s + (0.3 if push else 0.0):  # a push has to be measured
            simulation.tick()
        assert not simulation.traffic.blocked.any()


def test_tasks_of_a_dock_that_a_dead_car_cuts_off_hold_no_car_up() -> None:
    """A car dies in a pick dock: whoever was sent there is free again, and the other station's tasks are done."""

    def find(simulation: Simulation) -> ScenarioEvent | None:
        for station in simulation.stations:
            bound = [
                task.car
                for task in simulation.board.in_state(TaskState.ASSIGNED)
                if task.order.pick == station.name and task.car is not None
            ]
            cells = cells_under_cars(simulation)
            there = [car for car in bound if cells[car] == station.place.dock.cell]
            if there and len(bound) > 1:
                return event(simulation.sim_s, "car_dead", f"car_{there[0]}")
        return None

    death = first(find, tasks=12)
    log: list[Event] = []
    with made([death], log, tasks=12) as simulation:
        while simulation.sim_s < death.time_s + 0.1:
            simulation.tick()
        cells = cells_under_cars(simulation)
        dock = next(s for s in simulation.stations if s.place.dock.cell == cells[int(death.target[-1])])
        while simulation.sim_s < death.time_s + 5.0:
            simulation.tick()
        assert not any(t.order.pick == dock.name for t in simulation.board.in_state(TaskState.ASSIGNED))
        simulation.run()
        board = simulation.board
        left = [task.order.pick for task in board.tasks if task.state is not TaskState.COLLECTED]
        assert set(left) == {dock.name}
        assert simulation.summary().robot_contacts == 0
    assert any(f"has no way to {dock.name}" in str(entry.facts["cause"]) for entry in of_kind(log, "task"))


# --- arm_slow


def test_a_slow_arm_takes_longer_and_recovers() -> None:
    slow = event(0.0, "arm_slow", "arm_0", factor=0.2, duration_s=40.0)
    plain, _ = run(site="cell", robots=1, tasks=3)
    summary, log = run(slow, site="cell", robots=1, tasks=3)
    check(summary)
    over = of_kind(log, "disturbance_over")
    assert [(entry.sim_s, entry.facts["target"]) for entry in over] == [(pytest.approx(40.0, abs=0.1), "arm_0")]
    assert summary.sim_s > plain.sim_s + 10.0
    tasks = of_kind(log, "task")
    begin = {e.facts["task"]: e.sim_s for e in tasks if e.facts["state"] == TaskState.LOADING}
    took_s = [e.sim_s - begin[e.facts["task"]] for e in tasks if e.facts["state"] == TaskState.CARRIED]
    assert took_s[0] > 2.0 * took_s[-1]


@pytest.mark.parametrize(("site", "robots", "factor"), [("cell", 1, 0.05), ("twin", 2, 0.1)])
def test_a_car_may_be_served_elsewhere_before_an_arm_is_home_from_it(site: str, robots: int, factor: float) -> None:
    """It comes to the other station, or back, while the first arm still moves."""
    summary, log = run(
        event(0.0, "arm_slow", "arm_0", factor=factor, duration_s=1e5), site=site, robots=robots, tasks=6
    )
    check(summary)
    assert not of_kind(log, "transfer_repeated")
    begun = [entry for entry in of_kind(log, "task") if entry.facts["state"] == TaskState.UNLOADING]
    assert len(begun) == 6


def test_one_slot_does_not_keep_the_cars_out_that_come_before_its_own(tmp_path: Path) -> None:
    """A pushed car is given back the only parcel on the rack, in the grip by then, and others are before it in line."""
    one_slot = StationOptions(slots=((-0.190, 0.408, 0.25),))
    small = site_from_plan(load_site("small").plan, name="one_slot", options={"pick_1": one_slot, "pick_2": one_slot})
    save_site(small, site := tmp_path / "one_slot.toml")
    rows = [f"o{k},0,pick_1,drop_{1 + k % 2},0.4,0.06" for k in range(6)]
    (orders := tmp_path / "orders.csv").write_text("\n".join(["id,release_s,pick,drop,mass_kg,size_m", *rows]))
    pushed = event(4.0, "car_pushed", "car_0", dx_m=0.4)
    summary, log = run(pushed, site=str(site), orders=orders, robots=4, seed=1)
    assert summary.tasks_done == 6
    assert of_kind(log, "put_back")


def test_of_two_slow_spells_the_later_end_counts() -> None:
    slow = [
        event(1.0, "arm_slow", "arm_0", factor=0.5, duration_s=20.0),
        event(2.0, "arm_slow", "arm_0", factor=0.5, duration_s=5.0),
    ]
    _, log = run(*slow, duration_s=30.0, fidelity=Fidelity.GRID)
    assert [entry.sim_s for entry in of_kind(log, "disturbance_over")] == [pytest.approx(21.0, abs=0.1)]


# --- lane_blocked


def cells_under_cars(simulation: Simulation) -> list[int]:
    grid = simulation.site.grid
    return [int(grid.index(*grid.cell_at(float(x), float(y)))) for x, y, _ in simulation.world.car_poses()]


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.GRID])
def test_traffic_goes_round_a_blocked_lane_and_through_it_afterwards(fidelity: Fidelity) -> None:
    """The busiest cell that can be gone round is blocked for a while."""
    since_s, lasts_s = 20.0, 40.0
    settings = {"fidelity": fidelity, "tasks": 12}
    usual: Counter[int] = Counter()
    later: set[int] = set()
    with made(**settings) as simulation:

        def count(simulation: Simulation) -> None:
            cells = cells_under_cars(simulation)
            if since_s < simulation.sim_s < since_s + lasts_s:
                usual.update(cells)
            elif simulation.sim_s > since_s + lasts_s:
                later.update(cells)

        simulation.run(count)
        docks = {station.place.dock.cell for station in simulation.stations}
        cell = next(
            cell
            for cell, _ in usual.most_common()
            if cell in later - docks - set(simulation.site.parking) and connected_without(simulation, [cell])
        )
        row, col = simulation.site.grid.row_col(cell)
    visits: list[float] = []

    def look(simulation: Simulation) -> None:
        if cell in cells_under_cars(simulation):
            visits.append(simulation.sim_s)

    summary, log = run(event(since_s, "lane_blocked", f"{row},{col}", duration_s=lasts_s), look=look, **settings)
    check(summary)
    fallen_s, over_s = (of_kind(log, kind)[0].sim_s for kind in ("disturbance", "disturbance_over"))
    assert fallen_s >= since_s
    assert over_s == pytest.approx(fallen_s + lasts_s, abs=0.1)
    assert not any(fallen_s < time_s < over_s for time_s in visits)
    assert any(time_s > over_s for time_s in visits)


def test_a_lane_that_is_blocked_for_good_right_before_a_car() -> None:
    """What was planned through the cell is dropped: the car, which was about to enter it, turns off before it."""
    planned: list[int] = []

    def find(simulation: Simulation) -> ScenarioEvent | None:
        executor, graph = simulation.executor, simulation.graph
        held = {cell for car in range(3) for cell in executor.dependencies.held_cells(car)}
        for car in range(3):
            for move in executor.dependencies.next_moves(car)[:2]:
                cell = int(graph.state_cell[graph.move_to[move]])
                if cell not in held and simulation.sim_s > 5.0 and connected_without(simulation, [cell]):
                    planned.append(car)
                    row, col = simulation.site.grid.row_col(cell)
                    return event(simulation.sim_s, "lane_blocked", f"{row},{col}", duration_s=1e6)
        return None

    block = first(find)
    row, col = (int(word) for word in block.target.split(","))

    def look(simulation: Simulation) -> None:
        if simulation.sim_s > block.time_s:
            assert int(simulation.site.grid.index(row, col)) not in cells_under_cars(simulation)

    summary, log = run(block, look=look)
    check(summary)
    assert of_kind(log, "disturbance")[0].sim_s == pytest.approx(block.time_s, abs=0.1)


# --- car_pushed


def shoved(simulation: Simulation, car: int) -> ScenarioEvent | None:
    """A push by 0.35 m to the side and a turn, where there is room for it and nobody is near."""
    grid, poses = simulation.site.grid, simulation.world.car_poses()
    x, y, yaw = poses[car]
    others = np.delete(poses, car, axis=0)
    if np.hypot(others[:, 0] - x, others[:, 1] - y).min() < 2.5:
        return None
    for side in (1.0, -1.0):
        aside = np.array([-np.sin(yaw), np.cos(yaw)]) * side
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        around = [np.array([x, y]) + aside * a + ahead * b for a in (0.0, 0.5, 0.9) for b in (-0.6, 0.0, 0.8)]
        if all(grid.free[grid.cell_at(float(px), float(py))] for px, py in around):
            dx, dy = (round(float(v), 3) for v in 0.35 * aside)
            return event(simulation.sim_s, "car_pushed", f"car_{car}", dx_m=dx, dy_m=dy, dyaw_rad=0.4 * side)
    return None


def on_the_way(phase: CarPhase) -> Callable[[Simulation], ScenarioEvent | None]:
    def find(simulation: Simulation) -> ScenarioEvent | None:
        speeds = simulation.world.car_speeds()
        for car in range(simulation.world.n_cars):
            if simulation.missions.phase[car] is phase and speeds[car] > 0.5:
                return shoved(simulation, car)
        return None

    return find


def check_rejoined(log: list[Event], car: str) -> None:
    kinds = [entry.kind for entry in of_kind(log, "off_lane", "rejoin", "rejoined") if entry.facts["car"] == car]
    assert kinds[0] == "off_lane"
    assert kinds[-2:] == ["rejoin", "rejoined"]
    assert kinds.count("off_lane") == 1


@pytest.mark.parametrize("phase", [CarPhase.TO_PICK, CarPhase.TO_DROP])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_pushed_car_finds_back_and_all_is_delivered(phase: CarPhase, seed: int) -> None:
    push = first(on_the_way(phase), seed=seed)
    summary, log = run(push, seed=seed)
    check(summary)
    check_rejoined(log, push.target)


@pytest.mark.parametrize("turn_rad", [-0.9, 0.9])
def test_a_car_is_turned_in_its_parking_place(turn_rad: float) -> None:
    summary, log = run(event(0.1, "car_pushed", "car_2", dyaw_rad=turn_rad))
    check(summary)
    check_rejoined(log, "car_2")


@pytest.mark.bullet
def test_a_car_is_pushed_in_the_physical_world() -> None:
    settings = {"fidelity": Fidelity.PHYSICS, "tasks": 2}
    push = first(on_the_way(CarPhase.TO_DROP), **settings)
    summary, log = run(push, **settings)
    check(summary)
    check_rejoined(log, push.target)


def test_a_push_in_the_very_tick_of_arrival_on_the_grid() -> None:
    """The car is in its next state, though not at its pose; it drives on from there."""

    def find(simulation: Simulation) -> ScenarioEvent | None:
        arrives = simulation.now % 20 == 0 and simulation.sim_s > 5.0
        moving = np.flatnonzero(simulation.world.car_speeds() > 0.5)
        if arrives and moving.size:
            return event(simulation.sim_s, "car_pushed", f"car_{moving[0]}", dx_m=0.05, dyaw_rad=0.1)
        return None

    push = first(find, fidelity=Fidelity.GRID)
    summary, _ = run(push, fidelity=Fidelity.GRID)
    check(summary)


@pytest.mark.parametrize("yaw_rad", [0.02, 0.0])
def test_a_car_that_leans_on_a_wall_leaves_it_without_touching_it_again(yaw_rad: float) -> None:
    """Its wheels are turned towards its lane when it stands there: its tail would swing into the wall at once."""
    log: list[Event] = []
    with made(log=log) as simulation:
        spec, world = simulation.scene.car, simulation.world

        def gap_m(pose: FloatArray) -> float:
            sin, cos = np.sin(pose[2]), np.cos(pose[2])
            return float(pose[1] + min(-spec.rear_m * sin, spec.front_m * sin) - spec.half_width_m * abs(cos) - 1.0)

        def in_the_lowest_row() -> list[int]:
            x, y, yaw = world.car_poses().T
            return np.flatnonzero((y < 2.0) & (x > 4.0) & (x < 12.0) & (np.cos(yaw) > 0.99)).tolist()

        while not in_the_lowest_row():
            simulation.tick()
        car = in_the_lowest_row()[0]
        pose = world.car_poses()[car] * [1.0, 0.0, 0.0] + [0.0, 1.0, yaw_rad]
        pose[1] -= gap_m(pose) - 0.001
        world.put_car(car, pose)
        while not of_kind(log, "rejoin"):
            simulation.tick()
        gaps_m = [gap_m(world.car_poses()[car])]
        while not of_kind(log, "rejoined"):
            simulation.tick()
            gaps_m.append(gap_m(world.car_poses()[car]))
    assert gaps_m[0] < 0.01
    assert min(gaps_m) > gaps_m[0] - 0.0001


def test_a_small_push_is_steered_out() -> None:
    push = first(on_the_way(CarPhase.TO_DROP))
    small = {name: value * 0.3 for name, value in push.parameters.items()}
    summary, log = run(event(push.time_s, "car_pushed", push.target, **small))
    check(summary)
    assert not of_kind(log, "off_lane")


def test_a_car_pushed_away_from_the_arm_that_serves_it() -> None:
    """The arm ends its work; the task goes back and is done, unless its parcel fell in between."""
    _, log = run(duration_s=40.0)
    begun = next(entry for entry in of_kind(log, "task") if entry.facts["state"] == TaskState.LOADING)
    car = str(begun.facts["car"])

    def find(simulation: Simulation) -> ScenarioEvent | None:
        if simulation.sim_s < begun.sim_s + 0.3:
            return None
        station = next(s for s in simulation.stations if simulation.missions.task_of[int(car[-1])].order.pick == s.name)
        away = station.place.dock.pose[:2] - np.array(station.place.arm.pose[:2])
        away *= 0.35 / np.hypot(*away)
        return event(simulation.sim_s, "car_pushed", car, dx_m=float(away[0]), dy_m=float(away[1]), dyaw_rad=0.3)

    push = first(find)
    summary, log = run(push)
    assert summary.tasks_done + summary.tasks_failed == summary.tasks_total
    assert summary.tasks_failed <= 1
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)
    check_rejoined(log, car)


# --- all of them


def test_everything_at_once() -> None:
    events = [
        event(3.0, "arm_slow", "arm_1", factor=0.3, duration_s=50.0),
        event(8.0, "car_pushed", "car_2", dyaw_rad=1.2),
        event(30.0, "lane_blocked", "6,7", duration_s=30.0),
        event(40.0, "car_pushed", "car_4", dy_m=0.3, dx_m=0.3),
        event(50.0, "car_pushed", "car_1", dx_m=-0.2, dyaw_rad=-0.9),
    ]
    summary, log = run(*events, robots=5, tasks=12)
    assert len(of_kind(log, "disturbance")) == 5
    assert summary.tasks_done + summary.tasks_failed == 12
    assert summary.tasks_failed <= 1
    assert summary.parcel_balance == 0


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, pytest.param(Fidelity.PHYSICS, marks=pytest.mark.bullet)])
def test_a_disturbed_run_repeats_exactly(fidelity: Fidelity) -> None:
    push = event(5.0, "car_pushed", "car_2", dx_m=-0.08, dy_m=0.35, dyaw_rad=0.54)
    hashes = {run(push, duration_s=12.0, fidelity=fidelity)[0].state_hash for _ in range(2)}
    assert len(hashes) == 1


@pytest.mark.parametrize("delay_s", [0.15, 0.3])
def test_a_car_that_hears_late_stays_on_its_lane(delay_s: float) -> None:
    off_m: list[float] = []

    def look(simulation: Simulation) -> None:
        off_m.append(float(np.abs(simulation.view.driver.paths.follower.cross_track).max()))

    late = event(1.0, "commands_late", "car_0", delay_s=delay_s, duration_s=400.0)
    summary, log = run(late, look=look, robots=1, tasks=2)
    check(summary)
    assert not of_kind(log, "off_lane")
    assert max(off_m) <= 0.05


def test_a_station_is_closed_until_all_that_closes_it_is_over() -> None:
    """A station that was closed for a while opened over an arm that was dead for good."""
    dead = event(5.0, "arm_dead", "arm_0")
    closed = event(6.0, "station_closed", "pick_1", duration_s=5.0)
    with made([dead, closed], fidelity=Fidelity.GRID) as simulation:
        stations = simulation.stations
        while simulation.sim_s < 20.0:
            simulation.tick()
            if simulation.sim_s > 6.5:
                assert not stations.is_open("pick_1")
                assert stations.is_lost(stations.named("pick_1"))
                assert simulation.missions.bookings.closed[0]


@pytest.mark.parametrize("car", [-1, 3])
def test_a_car_that_is_not_there_cannot_be_lost(car: int) -> None:
    with made(fidelity=Fidelity.GRID) as simulation:
        with pytest.raises(UnknownRobot, match=f"car is {car}; valid: 0 to 2"):
            simulation.lose_car(car, "test")
        assert not simulation.missions.cars_in(CarPhase.DEAD)


def test_the_time_of_a_dead_arm_is_no_work_and_its_station_is_not_busy() -> None:
    """It counted as at work, and its station as busy, as long as it stood dead over a car."""
    with made((event(30.0, "arm_dead", "arm_0", duration_s=100.0),), robots=3, duration_s=120.0) as simulation:
        simulation.run()
        ticks = simulation.summary().arm_ticks["arm_0"]
        station = next(station.name for station in simulation.stations if station.arm == 0)
        busy_s = simulation.summary().stations[station].busy_share * simulation.sim_s
        assert ticks.fault * simulation.tick_s == pytest.approx(simulation.sim_s - 30.0, abs=0.2)
        assert sum(vars(ticks).values()) == simulation.now
        assert busy_s <= 31.0
        below = int(simulation.missions.served[0])
        if below >= 0:
            assert simulation.summary().car_ticks[f"car_{below}"].queue * simulation.tick_s > 80.0


def test_a_car_that_was_taken_out_of_service_is_idle_and_not_in_fault() -> None:
    summary, _ = run(event(1.0, "car_out", "car_0"), robots=3, tasks=6)
    ticks = summary.car_ticks["car_0"]
    assert (ticks.fault, ticks.idle > 0.9 * sum(vars(ticks).values())) == (0, True)
    assert summary.idle_percent["out"] == pytest.approx(100.0 / 3.0, abs=3.0)


def test_cars_that_have_to_stand_still_are_in_fault_and_not_in_traffic() -> None:
    stop = event(20.0, "emergency_stop", "fleet", duration_s=30.0)
    stopped, usual = (run(*events, robots=3, tasks=12)[0] for events in ((stop,), ()))
    fault_s = sum(ticks.fault for ticks in stopped.car_ticks.values()) * 0.05
    assert 45.0 < fault_s < 90.0, "who is at a dock is served, if not at once"
    assert sum(ticks.fault for ticks in stopped.arm_ticks.values()) * 0.05 == pytest.approx(4 * 30.0, abs=1.0)
    assert usual.time_share_percent["fault"] == 0.0


def test_a_battery_that_was_empty_once_is_told_when_it_has_been_changed() -> None:
    events = event(20.0, "battery_empty", "car_0"), event(60.0, "battery_changed", "car_0")
    summary, _ = run(*events, battery=BatteryConfig(enabled=True), robots=3, tasks=8)
    assert (summary.cars_stranded, summary.lowest_charge) == (1, 0.0)
