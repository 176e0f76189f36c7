"""Moves, patrols, inspections, charging, parking and orders of several legs, by cars that also deliver."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fleet.config import (
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    Fidelity,
    RunConfig,
    ScenarioEvent,
    TimeoutConfig,
)
from fleet.dispatch.interventions import CannotCancel, CannotRequeue
from fleet.missions.phases import ON_VISIT, CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import CANCELLABLE, OPEN_STATES, UNDER_WAY, TaskState
from fleet.tasks.place_names import LANE_STAND_S
from fleet.tasks.reasons import PairReason, TaskReason
from planners.allocation import ALLOCATORS
from tests.lives import Lives

Make = Callable[..., Simulation]
Items = list[dict[str, object]]
PACK = BatteryConfig(enabled=True, capacity_wh=6.0, charge_w=240.0, start=0.5, low=0.2, critical=0.1, idle_below=0.2)
"""Nobody charges unless told to, and then it takes a minute."""


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Make a run on the lane graph of orders; `release_s` is 0 where it is left out."""

    def made(*items: dict[str, object], log: list[Event] | None = None, **settings: object) -> Simulation:
        path = tmp_path / "orders.json"
        path.write_text(json.dumps([{"release_s": 0} | item for item in items]), encoding="utf-8")
        chosen = {"fidelity": Fidelity.GRID, "arms": ArmConfig(workers_n=0), "robots": 1, "orders": path} | settings
        return Simulation(RunConfig(**chosen), on_event=None if log is None else log.append)  # type: ignore[arg-type]

    return made


def parcel(name: str, pick: str = "pick_1", drop: str = "drop_1", **more: object) -> dict[str, object]:
    return {"id": name, "pick": pick, "drop": drop, "mass_kg": 0.3, "size_m": 0.06} | more


def until(simulation: Simulation, name: str, *states: TaskState, limit_s: float = 400.0) -> None:
    """Tick until a task is in one of the states."""
    while simulation.board.named(name).state not in states:
        assert simulation.sim_s < limit_s, simulation.explain_assignment(name)
        simulation.tick()


def check(simulation: Simulation) -> None:
    """Cars, tasks and bookings agree."""
    roster, bookings = simulation.missions, simulation.missions.bookings
    for car, (phase, task) in enumerate(zip(roster.phase, roster.task_of, strict=True)):
        assert (task is not None and task.visit is not None) or phase not in ON_VISIT
        assert task is None or (task.car == car and phase is not CarPhase.IDLE)
    for task in simulation.board.in_state(*UNDER_WAY):
        assert task.car is not None
        assert roster.task_of[task.car] is task
    assert all(len(bookings.cars(place)) <= cap for place, cap in enumerate(bookings.caps))


MIX: Items = [
    parcel("a", priority="idle"),
    parcel("b", "pick_2", "drop_2", after=["walk"], batch="both"),
    {"id": "tour", "type": "multi_stop", "stops": ["pick_1>drop_2", "pick_2>drop_1"], "mass_kg": 0.3, "size_m": 0.06},
    {"id": "walk", "type": "patrol", "places": ["drop_1", "6,1", "parking_4"], "stand_s": 3, "batch": "both"},
    {"id": "look", "type": "inspect", "places": "pick_2", "release_s": 20, "due_s": 100},
    {"id": "go", "type": "move", "places": "charger_1", "every_s": 40, "times": 2},
    {"id": "home", "type": "park", "after": ["go", "tour"]},
]


@pytest.mark.parametrize("allocator", [name for name in ALLOCATORS if name != "cpsat"])
def test_all_allocators_share_out_all_types(make: Make, allocator: str) -> None:
    log: list[Event] = []
    with make(*MIX, robots=3, allocation=AllocationConfig(allocator=allocator), log=log) as simulation:
        simulation.run(check)
        summary = simulation.summary()
    assert (summary.tasks_done, summary.tasks_total, summary.visits_done) == (9, 9, 5)
    assert (summary.batches, summary.batches_done) == (1, 1)
    (ended,) = [event for event in log if event.kind == "batch_ended"]
    assert ended.facts == {"batch": "both", "done": 2, "of": 2, "span_s": summary.batch_span_mean_s}
    assert summary.time_share_percent["visiting"] > 0.5
    assert sum(summary.time_share_percent.values()) == pytest.approx(100.0)
    assert (summary.robot_contacts, summary.parcel_balance, summary.parcels_misplaced) == (0, 0, 0)


@pytest.mark.parametrize(("site", "robots"), [("small", 1), ("medium", 40)])
def test_one_car_and_as_many_as_the_site_has_room_for(make: Make, site: str, robots: int) -> None:
    extra: Items = [{"id": f"p{k}", "type": "park", "places": f"parking_{k + 1}"} for k in range(4)]
    with make(*MIX, *extra, site=site, robots=robots) as simulation:
        simulation.run(check)
        assert [task.order.name for task in simulation.board.tasks if task.state in OPEN_STATES] == []
        assert simulation.summary().tasks_failed == 0


def test_a_visit_and_a_parcel_that_come_with_other_changes_are_not_overlooked(make: Make) -> None:
    """A parcel enters the backlog right after a visit has left it, and the other way round."""
    visits: Items = [{"id": f"v{k}", "type": "park", "release_s": 0.1 * k} for k in range(2)]
    parcels = [parcel(f"d{k}", release_s=0.1 * k + 0.05) for k in range(2)]
    with make(*visits, *parcels, robots=4) as simulation:
        lives = Lives(simulation.board)
        for _ in range(5):
            simulation.tick()
        assert simulation.board.count(TaskState.BACKLOG) == 0
        for task in simulation.board.tasks:
            released, ready = lives.of[task.order.name][:2]
            assert (ready.state, ready.time_s) == (TaskState.READY, released.time_s)


def test_equal_runs_are_equal(make: Make) -> None:
    hashes = set()
    for _ in range(2):
        with make(*MIX, robots=3, fidelity=Fidelity.KINEMATIC, duration_s=60.0) as simulation:
            simulation.run()
            hashes.add(simulation.state_hash())
    assert len(hashes) == 1


# --- single visits


def test_an_inspection_tells_the_pose(make: Make) -> None:
    log: list[Event] = []
    item = {"id": "look", "type": "inspect", "places": "6,1", "stand_s": 8}
    with make(item, fidelity=Fidelity.KINEMATIC, log=log) as simulation:
        lives = Lives(simulation.board)
        simulation.run(check)
        task = simulation.board.named("look")
        assert [step.state for step in lives.of["look"]][-2:] == [TaskState.VISITING, TaskState.DONE]
        stood_s = task.since_s[TaskState.DONE] - task.since_s[TaskState.VISITING]
        assert stood_s == pytest.approx(8.0, abs=0.1)
        (event,) = [event for event in log if event.kind == "inspected"]
        x, y = simulation.site.grid.cell_xy([6 * simulation.site.grid.cols + 1])[0]
        assert (event.facts["task"], event.facts["car"], event.facts["place"]) == ("look", "car_0", "6,1")
        assert np.hypot(float(str(event.facts["x"])) - x, float(str(event.facts["y"])) - y) < 0.6


def test_a_patrol_goes_in_order(make: Make) -> None:
    log: list[Event] = []
    places = ["drop_2", "pick_1", "drop_2", "parking_7"]
    with make({"id": "walk", "type": "patrol", "places": places}, log=log) as simulation:
        simulation.run(check)
    assert [event.facts["place"] for event in log if event.kind == "visited"] == places


def test_nobody_stands_in_a_lane_for_long(make: Make) -> None:
    """Once its visit is over a car goes to a parking place, from wherever it was."""
    items: Items = [{"id": f"m{k}", "type": "move", "places": f"6,{k + 1}", "stand_s": 10} for k in range(3)]
    with make(*items, robots=3) as simulation:
        bays = set(simulation.site.bays().values())
        still_s = np.zeros(3)
        longest_s = 0.0
        for _ in range(round(90.0 / simulation.tick_s)):
            simulation.tick()
            cells = simulation.graph.state_cell[simulation.executor.tail_states()]
            stands = [simulation.executor.idle(car) and int(cells[car]) not in bays for car in range(3)]
            still_s = (still_s + simulation.tick_s) * np.array(stands)
            longest_s = max(longest_s, float(still_s.max()))
        assert simulation.board.count(TaskState.DONE) == 3
        assert LANE_STAND_S <= longest_s < LANE_STAND_S + 5.0
        assert {int(cell) for cell in cells} <= set(simulation.site.parking)


def test_who_is_parked_makes_room(make: Make) -> None:
    """Each of two cars is asked to the place where the other one stands."""
    swap: Items = [
        {"id": f"p{car}", "type": "park", "places": f"parking_{2 - car}", "needs": f"car_{car}"} for car in range(2)
    ]
    with make(*swap, robots=2) as simulation:
        simulation.run(check)
        cells = simulation.graph.state_cell[simulation.executor.tail_states()].tolist()
        assert cells == list(simulation.site.parking[1::-1])


def test_two_visits_to_one_place_come_one_after_the_other(make: Make) -> None:
    twice: Items = [{"id": name, "type": "move", "places": "parking_9", "stand_s": 30} for name in "ab"]
    with make(*twice, robots=2) as simulation:
        until(simulation, "a", TaskState.VISITING)
        report = simulation.explain_assignment("b")
        assert (report.state, report.reason) == (TaskState.READY, TaskReason.STATION_FULL)
        assert report.cause == "parking_9 has no room for one more car"
        simulation.run(check)
        a, b = (simulation.board.named(name) for name in "ab")
        assert b.since_s[TaskState.VISITING] > a.since_s[TaskState.DONE]


def test_who_finds_its_place_taken_by_a_visit_given_out_with_its_own_says_so(make: Make) -> None:
    """A place with two for a choice takes the only one of the other; both cars are on their way to chargers."""
    pack = BatteryConfig(enabled=True, start=0.7)
    with make(
        {"id": "any", "type": "park", "places": ["parking_9", "parking_8"], "priority": "emergency", "release_s": 1.2},
        {"id": "that", "type": "park", "places": "parking_8", "release_s": 1.2},
        robots=2,
        battery=pack,
    ) as simulation:
        until(simulation, "any", TaskState.ASSIGNED)
        report = simulation.explain_assignment("that")
        assert (simulation.board.named("any").place, report.reason) == ("parking_8", TaskReason.STATION_FULL)
        roster, bookings = simulation.missions, simulation.missions.bookings
        going = roster.phase.index(CarPhase.TO_CHARGER)
        assert bookings.has(going), "it goes on to the charger it had"
        simulation.run(check)
        assert {task.state for task in simulation.board.tasks} == {TaskState.DONE}


def test_a_patrol_is_held_while_its_next_place_is_full(make: Make) -> None:
    log: list[Event] = []
    with make(
        {"id": "stay", "type": "move", "places": "parking_9", "stand_s": 60},
        {"id": "walk", "type": "patrol", "places": ["pick_1", "parking_9"]},
        robots=2,
        log=log,
    ) as simulation:
        while not any(event.kind == "called" for event in log):
            simulation.tick()
        car = next(event for event in log if event.kind == "called").facts["car"]
        assert simulation.explain_assignment("walk").cause == f"{car} may go on to parking_9"
        simulation.run(check)
    words = [(event.kind, event.facts["task"]) for event in log if event.kind in ("held", "called")]
    assert words == [("held", "walk"), ("called", "walk")]


def test_a_car_charges_until_it_is_full(make: Make) -> None:
    """An emptier car is preferred unless one is named."""
    log: list[Event] = []
    with make(
        {"id": "any", "type": "charge"},
        {"id": "this", "type": "charge", "places": "charger_2", "needs": "car_2"},
        robots=3,
        battery=PACK,
        log=log,
    ) as simulation:
        assert simulation.batteries is not None
        simulation.batteries.charge[:] = (0.6, 0.4, 0.9)
        simulation.run(check)
        assert [simulation.board.named(name).car for name in ("any", "this")] == [1, 2]
        assert simulation.batteries.charge[[1, 2]].min() > 0.9
        assert simulation.batteries.charge[0] < 0.6
        assert simulation.summary().charging_sessions == 2


def test_more_charge_orders_than_chargers(make: Make) -> None:
    items: Items = [{"id": f"c{car}", "type": "charge", "needs": f"car_{car}"} for car in range(4)]
    with make(*items, robots=4, battery=PACK) as simulation:
        simulation.run(check)
        assert simulation.board.count(TaskState.DONE) == 4


# --- orders of several legs


def test_legs_are_done_by_one_car_with_nothing_in_between(make: Make) -> None:
    tour: dict[str, object] = {"id": "tour", "type": "multi_stop", "mass_kg": 0.3, "size_m": 0.06}
    stops = ["pick_1>drop_1", "pick_2>drop_2", "pick_1>drop_2"]
    # The others are many, and more urgent.
    others = [parcel(f"u{k}", priority="emergency", release_s=20) for k in range(6)]
    with make(tour | {"stops": stops}, *others, robots=2) as simulation:
        until(simulation, "tour_2", TaskState.ASSIGNED)
        simulation.tick()
        legs = [simulation.board.named(f"tour_{k}") for k in (1, 2, 3)]
        car = legs[0].car
        assert car is not None
        verdicts = {pair.car: pair.reason for pair in simulation.explain_assignment("tour_2").pairs}
        assert verdicts[1 - car] in (PairReason.OTHER_CAR, PairReason.CAR_BUSY)
        open_one = next(task for task in simulation.board.in_state(TaskState.READY) if task.order.name[0] == "u")
        simulation.tick()
        verdicts = {pair.car: pair.reason for pair in simulation.explain_assignment(open_one.order.name).pairs}
        assert verdicts[car] in (PairReason.KEPT_FOR_LEG, PairReason.CAR_BUSY)
        simulation.run(check)
        done = sorted((task for task in simulation.board.tasks if task.car == car), key=lambda task: task.done_s or 0.0)
        first = done.index(legs[0])
        assert done[first : first + 3] == legs


def test_a_car_between_two_legs_never_waits_for_parcels_that_wait_for_it(make: Make) -> None:
    """One car, and more parcels than slots, some of them more urgent."""
    tour = {"id": "tour", "type": "multi_stop", "stops": ["pick_1>drop_1", "pick_2>drop_1", "pick_1>drop_2"]}
    others = [
        parcel(f"o{k}", f"pick_{1 + k % 2}", priority="emergency" if k % 3 == 0 else "normal", release_s=k)
        for k in range(16)
    ]
    with make(tour | {"mass_kg": 0.3, "size_m": 0.06}, *others, duration_s=2000.0) as simulation:
        simulation.run(check)
        assert {task.state for task in simulation.board.tasks} == {TaskState.COLLECTED}
        done = sorted(simulation.board.tasks, key=lambda task: task.done_s or 0.0)
        assert "tour_1 tour_2 tour_3" in " ".join(task.order.name for task in done)


@pytest.mark.parametrize("leg", ["tour_1", "tour_2", "tour_3"])
def test_slots_that_were_promised_to_a_cancelled_order_are_free_again(make: Make, leg: str) -> None:
    tour = {"id": "tour", "type": "multi_stop", "stops": ["pick_1>drop_1", "pick_2>drop_1", "pick_1>drop_2"]}
    with make(tour | {"mass_kg": 0.3, "size_m": 0.06}, {"id": "end", "type": "park", "release_s": 200}) as simulation:
        until(simulation, "tour_1", TaskState.ASSIGNED)
        simulation.cancel(leg)
        simulation.run(check)
        assert simulation.parcel_balance() == 0
        assert all(station.n_free == len(station.contents) for station in simulation.stations)


def test_another_car_goes_on_where_one_died_between_two_legs(make: Make) -> None:
    tour = {"id": "tour", "type": "multi_stop", "stops": ["pick_1>drop_1", "pick_2>drop_2"]}
    with make(tour | {"mass_kg": 0.3, "size_m": 0.06}, robots=2) as simulation:
        until(simulation, "tour_2", TaskState.ASSIGNED)
        car = simulation.board.named("tour_1").car
        assert car is not None
        for _ in range(round(15.0 / simulation.tick_s)):
            simulation.tick()
        simulation.lose_car(car, "test")
        simulation.run(check)
        assert simulation.board.named("tour_2").state is TaskState.COLLECTED
        assert simulation.board.named("tour_2").car == 1 - car


def test_a_leg_that_is_requeued_goes_to_another_car(make: Make) -> None:
    tour = {"id": "tour", "type": "multi_stop", "stops": ["pick_1>drop_1", "pick_2>drop_2"]}
    with make(tour | {"mass_kg": 0.3, "size_m": 0.06}, robots=2) as simulation:
        until(simulation, "tour_2", TaskState.ASSIGNED)
        simulation.requeue("tour_2")
        simulation.run(check)
        assert simulation.board.named("tour_1").car != simulation.board.named("tour_2").car


# --- what goes wrong


def test_all_that_waits_for_a_cancelled_order_fails_at_once(make: Make) -> None:
    """Also what is looked at before what it waits for, because it is more urgent."""
    chain: Items = [
        parcel("a", release_s=1),
        parcel("b", after=["a"]),
        parcel("c", after=["b"], priority="emergency"),
        {"id": "d", "type": "park", "after": ["c"], "priority": "emergency"},
    ]
    with make(*chain) as simulation:
        simulation.tick()
        simulation.cancel("a")
        for _ in range(5):
            simulation.tick()
        assert [task.state for task in simulation.board.tasks] == [*[TaskState.FAILED] * 3, TaskState.CANCELLED]


def test_a_visit_goes_on_with_another_car_at_the_errand_where_one_died(make: Make) -> None:
    log: list[Event] = []
    walk = {"id": "walk", "type": "patrol", "places": ["pick_1", "6,1", "drop_2", "parking_5"], "stand_s": 5}
    with make(walk, robots=3, log=log) as simulation:
        task = simulation.board.named("walk")
        while task.n_errands_done < 2:
            simulation.tick()
        first = task.car
        assert first is not None
        simulation.lose_car(first, "test")
        assert task.state is TaskState.READY
        simulation.run(check)
        assert (task.state, task.car != first) == (TaskState.DONE, True)
    assert [event.facts["place"] for event in log if event.kind == "visited"] == walk["places"]


@pytest.mark.parametrize("state", [*sorted(CANCELLABLE), TaskState.DONE])
def test_a_visit_is_cancelled_in_every_state(make: Make, state: TaskState) -> None:
    walk = {"id": "walk", "type": "patrol", "places": ["pick_1", "drop_2"], "stand_s": 5, "release_s": 5}
    walk |= {"after": ["first"]} if state is TaskState.BACKLOG else {}
    with make(parcel("first"), walk, {"id": "end", "type": "park", "release_s": 90}) as simulation:
        until(simulation, "walk", state)
        if state is TaskState.DONE:
            with pytest.raises(
                CannotCancel, match="walk is done; valid to cancel: ordered, backlog, ready, assigned, v"
            ):
                simulation.cancel("walk")
            return
        simulation.cancel("walk")
        check(simulation)
        simulation.run(check)
        assert simulation.board.named("walk").state is TaskState.CANCELLED
        assert simulation.board.named("end").state is TaskState.DONE


@pytest.mark.parametrize("phase", [CarPhase.TO_PLACE, CarPhase.STANDING, CarPhase.HELD, CarPhase.CHARGING])
def test_a_visit_is_requeued_in_every_phase(make: Make, phase: CarPhase) -> None:
    items: Items = [
        {"id": "stay", "type": "move", "places": "parking_9", "stand_s": 90, "priority": "emergency"},
        {"id": "walk", "type": "patrol", "places": ["pick_1", "parking_9"], "stand_s": 5},
    ]
    if phase is CarPhase.CHARGING:
        items = [{"id": "walk", "type": "charge"}]
    with make(*items, robots=3, battery=PACK) as simulation:
        task = simulation.board.named("walk")
        while task.car is None or simulation.missions.phase[task.car] is not phase:
            simulation.tick()
            assert simulation.sim_s < 200.0
        before = task.car
        simulation.requeue("walk")
        check(simulation)
        simulation.run(check)
        assert (task.state, task.car != before) == (TaskState.DONE, True)
        with pytest.raises(CannotRequeue, match="walk is done; valid to requeue: assigned, visiting"):
            simulation.requeue("walk")


def test_a_visit_that_takes_too_long_fails_and_its_car_is_free(make: Make) -> None:
    items: Items = [{"id": "stay", "type": "move", "places": "parking_9", "stand_s": 600}, parcel("next")]
    with make(*items, timeouts=TimeoutConfig(visiting_s=20.0)) as simulation:
        simulation.run(check)
        stay = simulation.board.named("stay")
        assert (stay.state, stay.reason) == (TaskState.FAILED, "had not ended after 20 s")
        assert simulation.board.named("next").state is TaskState.COLLECTED


def test_a_place_that_nobody_can_reach_says_so_until_its_lane_is_open_again(make: Make) -> None:
    with make(
        {"id": "look", "type": "inspect", "places": "6,1", "release_s": 5},
        events=(ScenarioEvent(time_s=1.0, kind="lane_blocked", target="6,1", parameters={"duration_s": 60.0}),),
    ) as simulation:
        while simulation.sim_s < 30.0:
            simulation.tick()
        report = simulation.explain_assignment("look")
        assert (report.reason, report.cause) == (TaskReason.UNREACHABLE, "no car has a way to 6,1")
        simulation.run(check)
        assert simulation.board.named("look").state is TaskState.DONE


def test_a_lane_that_is_blocked_on_the_way_sends_the_visit_back(make: Make) -> None:
    with make(
        {"id": "look", "type": "inspect", "places": "6,1"},
        events=(ScenarioEvent(time_s=3.0, kind="lane_blocked", target="6,1", parameters={"duration_s": 40.0}),),
    ) as simulation:
        until(simulation, "look", TaskState.ASSIGNED)
        until(simulation, "look", TaskState.READY)
        assert simulation.board.named("look").reason == "car_0 has no way to 6,1"
        simulation.run(check)
        assert simulation.board.named("look").state is TaskState.DONE


def test_a_car_that_was_pushed_comes_back_and_somebody_makes_the_visit(make: Make) -> None:
    push = ScenarioEvent(time_s=6.0, kind="car_pushed", target="car_0", parameters={"dx_m": 0.3, "dy_m": 0.3})
    item = {"id": "walk", "type": "patrol", "places": ["drop_2", "pick_1"], "needs": "car_0"}
    with make(item, fidelity=Fidelity.KINEMATIC, robots=2, events=(push,)) as simulation:
        lives = Lives(simulation.board)
        simulation.run(check)
        assert simulation.board.named("walk").state is TaskState.DONE
        assert any(step.cause == "car_0 left its lane" for step in lives.of["walk"])


def test_an_impossible_due_date_is_told_at_once(make: Make) -> None:
    log: list[Event] = []
    with make({"id": "look", "type": "inspect", "places": "6,1", "stand_s": 9, "due_s": 5}, log=log) as simulation:
        simulation.tick()
    (event,) = [event for event in log if event.kind == "impossible_due"]
    assert event.facts["cause"] == "it is due 5.0 s after its release, and takes 9.0 s from 6,1"


def test_a_run_does_not_count_as_stalled_while_a_car_stands(make: Make) -> None:
    with make({"id": "stay", "type": "move", "places": "parking_9", "stand_s": 400}) as simulation:
        simulation.run(check)
        assert simulation.board.named("stay").state is TaskState.DONE
