"""Orders meet cars: who gets which and why, in which order, and what becomes of those that are taken back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fleet.config import (
    AllocationConfig,
    ArmConfig,
    CarConfig,
    Fidelity,
    RunConfig,
    StreamConfig,
    TimeoutConfig,
    TrafficConfig,
)
from fleet.dispatch.interventions import CannotCancel, CannotRequeue
from fleet.missions.phases import CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState, UnknownTask
from fleet.tasks.reasons import PairReason, TaskReason
from tests.lives import Lives

HEADER = "id,release_s,pick,drop,mass_kg,size_m,due_s,priority,after,picks,needs"
PIBT = TrafficConfig(planner="pibt")
Make = Callable[..., Simulation]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Make a run on the lane graph of lines `id,release,pick,drop,mass` and, if wanted, what the last columns hold."""

    def made(*lines: str, log: list[Event] | None = None, **settings: object) -> Simulation:
        rows = []
        for line in lines:
            name, release, pick, drop, mass, *rest = line.split(",")
            rows.append(",".join([name, release, pick, drop, mass, "0.06", *rest, *[""] * (5 - len(rest))]))
        path = tmp_path / "orders.csv"
        path.write_text("\n".join([HEADER, *rows]), encoding="utf-8")
        chosen = {"fidelity": Fidelity.GRID, "arms": ArmConfig(workers_n=0), "robots": 1, "orders": path} | settings
        return Simulation(RunConfig(**chosen), on_event=None if log is None else log.append)  # type: ignore[arg-type]

    return made


def until(simulation: Simulation, name: str, *states: TaskState, limit_s: float = 300.0) -> None:
    """Tick until a task is in one of the states."""
    while simulation.board.named(name).state not in states:
        assert simulation.sim_s < limit_s, simulation.explain_assignment(name)
        simulation.tick()


def entered_s(simulation: Simulation, name: str, state: TaskState) -> float:
    return simulation.board.named(name).since_s[state]


def picked_in_order(simulation: Simulation) -> list[str]:
    picked = [task for task in simulation.board.tasks if TaskState.LOADING in task.since_s]
    return [task.order.name for task in sorted(picked, key=lambda task: task.since_s[TaskState.LOADING])]


def check_nothing_lost(simulation: Simulation, lives: Lives) -> None:
    assert simulation.parcel_balance() == 0
    assert simulation.view.inventory.misplaced() == []
    lives.check()


# --- who goes first


def test_the_urgent_class_goes_first_then_what_would_be_late(make: Make) -> None:
    with make(
        "idle,0,pick_1,drop_1,0.3,,idle",
        "usual,0,pick_1,drop_1,0.3,,normal",
        "due,0,pick_1,drop_1,0.3,40,normal",
        "urgent,0,pick_2,drop_2,0.3,,emergency",
    ) as simulation:
        simulation.run()
        assert picked_in_order(simulation) == ["urgent", "due", "usual", "idle"]


def test_an_order_is_not_picked_before_those_it_follows_are_delivered(make: Make) -> None:
    log: list[Event] = []
    with make(
        "c,0,pick_2,drop_2,0.3,,emergency,a;b", "a,0,pick_1,drop_1,0.3", "b,0,pick_2,drop_1,0.3", log=log, robots=3
    ) as simulation:
        simulation.tick()
        assert simulation.explain_assignment("c").reason is TaskReason.WAITS_FOR_PREDECESSOR
        simulation.run()
        ready_s = entered_s(simulation, "c", TaskState.READY)
        assert ready_s >= max(entered_s(simulation, name, TaskState.DELIVERED) for name in "ab")
        assert simulation.summary().tasks_done == 3
    told = [event.facts["reason"] for event in log if event.kind == "task_waits" and event.facts["task"] == "c"]
    assert told[0] == TaskReason.WAITS_FOR_PREDECESSOR


def test_who_follows_an_order_that_was_cancelled_fails_with_that_cause(make: Make) -> None:
    with make("a,0,pick_1,drop_1,0.3", "b,0,pick_1,drop_1,0.3,,,a", "c,0,pick_1,drop_1,0.3,,,b") as simulation:
        simulation.tick()
        simulation.cancel("a")
        simulation.run()
        assert simulation.board.named("b").reason == "a, which comes before it, is cancelled"
        assert simulation.board.named("c").reason == "b, which comes before it, is failed"
        assert simulation.sim_s < 5.0


def test_another_source_serves_when_many_wait_at_the_first(make: Make) -> None:
    """Cars are bound for pick_1 with orders that come first."""
    first = [f"f{k},0,pick_1,drop_1,0.3" for k in range(6)]
    with make(*first, "x,5,pick_1,drop_2,0.3,,,,pick_2", robots=8) as simulation:
        until(simulation, "x", TaskState.DELIVERED)
        assert simulation.board.named("x").pick == "pick_2"


def test_of_free_sources_the_cheapest_serves(make: Make) -> None:
    """Whichever is named first, the same one is taken: it is nearer."""
    chosen = set()
    for pick, other in (("pick_1", "pick_2"), ("pick_2", "pick_1")):
        with make(f"x,0,{pick},drop_2,0.3,,,,{other}") as simulation:
            simulation.tick()
            chosen.add(simulation.board.named("x").pick)
    assert len(chosen) == 1


# --- who gets it, and why


def test_only_a_car_with_the_capability_gets_the_order(make: Make) -> None:
    cars = {"car_1": CarConfig(capabilities=("cold",)), "car_2": CarConfig(capabilities=("cold",), max_payload_kg=0.2)}
    with make("x,0,pick_1,drop_1,0.3,,,,,cold", robots=3, cars=cars) as simulation:
        until(simulation, "x", TaskState.ASSIGNED)
        report = simulation.explain_assignment("x")
        assert (report.car, report.reason) == (1, TaskReason.ASSIGNED)
        reasons = [pair.reason for pair in report.pairs]
        assert reasons == [PairReason.LACKS_CAPABILITY, PairReason.CHOSEN, PairReason.TOO_HEAVY]
        assert "car_0 lacks a capability" in str(report)
        assert "car_1 has it, cost" in str(report)
        assert str(report).startswith("x has been assigned since")


def test_an_order_that_nobody_is_left_for_says_so(make: Make) -> None:
    cars = {"car_1": CarConfig(capabilities=("cold",))}
    log: list[Event] = []
    with make("x,20,pick_1,drop_1,0.3,,,,,cold", robots=2, cars=cars, log=log) as simulation:
        assert simulation.explain_assignment("x").reason is TaskReason.NOT_RELEASED
        while simulation.sim_s < 5.0:
            simulation.tick()
        simulation.driver.stop(1)
        simulation.executor.halt(1)
        simulation.dispatcher.rules.interventions.retire(1, CarPhase.DEAD, simulation.sim_s, "car_1 is dead")
        simulation.recovery.abandon(1)
        while simulation.sim_s < 22.0:
            simulation.tick()
        report = simulation.explain_assignment("x")
        assert (report.state, report.reason) == (TaskState.FAILED, TaskReason.ENDED)
        assert report.cause == "no car that is left can do it: car_1 could"
    assert not [e for e in log if e.kind == "task_waits"]


def test_a_station_that_is_cut_off_is_a_reason(make: Make) -> None:
    with make("x,0,pick_1,drop_1,0.3", robots=2) as simulation:
        simulation.traffic.set_blocked(simulation.site.stations[0].dock.cell, True)
        while simulation.sim_s < 1.5:
            simulation.tick()
        report = simulation.explain_assignment("x")
        assert report.reason is TaskReason.UNREACHABLE
        assert "no car has a way to pick_1" in str(report)


def test_losers_know_to_whom(make: Make) -> None:
    with make("x,0,pick_1,drop_1,0.3", "y,0,pick_2,drop_1,0.3,,emergency", robots=3) as simulation:
        until(simulation, "x", TaskState.ASSIGNED)
        simulation.tick()
        x, y = simulation.explain_assignment("x"), simulation.explain_assignment("y")
        assert {pair.reason for pair in x.pairs} == {
            PairReason.CHOSEN,
            PairReason.CLASS_FIRST,
            PairReason.TASK_GOT_BETTER,
        }
        assert {pair.reason for pair in y.pairs} <= {
            PairReason.CHOSEN,
            PairReason.CAR_GOT_BETTER,
            PairReason.TASK_GOT_BETTER,
        }
        assert f"leaves it to car_{x.car}" in str(x)


def test_a_due_date_that_nobody_can_keep_is_told_at_the_release(make: Make) -> None:
    log: list[Event] = []
    with make("x,1,pick_1,drop_1,0.3,9", "y,1,pick_1,drop_1,0.3,300", log=log) as simulation:
        while simulation.sim_s < 1.2:
            simulation.tick()
        (event,) = [event for event in log if event.kind == "impossible_due"]
        assert event.facts["task"] == "x"
        assert "it is due 8.0 s after its release" in simulation.explain_assignment("x").warning
        simulation.run()
        summary = simulation.summary()
        assert (summary.tasks_done, summary.on_time_share) == (2, 0.5)
        assert summary.tardiness_mean_s is not None
        assert summary.tardiness_mean_s > 0


def test_names_that_nobody_has(make: Make) -> None:
    valid = "task is 'z'; valid: the id of an order, such as x"
    with make("x,0,pick_1,drop_1,0.3") as simulation, pytest.raises(UnknownTask, match=valid):
        simulation.explain_assignment("z")


# --- re-assignment


def swaps(lives: Lives) -> list[str]:
    return [step.cause for step in lives.all() if step.cause.startswith("re-assigned")]


@pytest.mark.parametrize(("keep_gain_s", "swapped"), [(5.0, True), (1e6, False)])
def test_a_task_changes_hands_before_its_pick_up_if_enough_is_gained(
    make: Make, keep_gain_s: float, swapped: bool
) -> None:
    """A stream of orders keeps two of three cars on their way to a pick station."""
    allocation = AllocationConfig(keep_gain_s=keep_gain_s)
    stream = StreamConfig(rate_per_h=600.0, due_share=1.0, slack_s=(30.0, 120.0), emergency_share=0.0)
    settings = {"orders": None, "stream": stream, "duration_s": 240.0, "robots": 3, "seed": 3, "traffic": PIBT}
    with make("x,0,pick_1,drop_1,0.3", allocation=allocation, **settings) as simulation:
        lives = Lives(simulation.board)
        simulation.run()
        assert bool(swaps(lives)) is swapped
        check_nothing_lost(simulation, lives)
        for steps in lives.of.values():
            states = [step.state for step in steps]
            if TaskState.CARRIED in states:
                after = states[states.index(TaskState.CARRIED) :]
                assert TaskState.ASSIGNED not in after, "after the pick-up it stays with its car"


# --- cancel, requeue, time-outs


@pytest.mark.parametrize("state", [TaskState.ORDERED, TaskState.READY, TaskState.ASSIGNED])
def test_an_order_is_taken_back(make: Make, state: TaskState) -> None:
    lines = ("w,0,pick_1,drop_1,0.3,,emergency", "x,3,pick_1,drop_1,0.3")
    with make(*(lines if state is not TaskState.ASSIGNED else lines[1:])) as simulation:
        lives = Lives(simulation.board)
        until(simulation, "x", state)
        simulation.cancel("x")
        simulation.run()
        assert simulation.board.named("x").state is TaskState.CANCELLED
        assert simulation.board.named("x").reason == "cancelled on request"
        summary = simulation.summary()
        assert (summary.tasks_done, summary.tasks_cancelled) == (summary.tasks_total - 1, 1)
        check_nothing_lost(simulation, lives)
        with pytest.raises(CannotCancel, match="task x is cancelled; valid to cancel: ordered, backlog, ready, assign"):
            simulation.cancel("x")


def test_after_its_pick_up_an_order_cannot_be_taken_back(make: Make) -> None:
    with make("x,0,pick_1,drop_1,0.3") as simulation:
        until(simulation, "x", TaskState.LOADING)
        with pytest.raises(CannotCancel, match="task x is loading"):
            simulation.cancel("x")
        with pytest.raises(CannotRequeue, match="task x is loading; valid to requeue: assigned"):
            simulation.requeue("x")
        until(simulation, "x", TaskState.DELIVERED)


def test_a_requeued_order_goes_to_another_car_if_there_is_one(make: Make) -> None:
    for robots in (1, 2):
        with make("x,0,pick_1,drop_1,0.3", robots=robots) as simulation:
            until(simulation, "x", TaskState.ASSIGNED)
            before = simulation.board.named("x").car
            simulation.requeue("x")
            simulation.tick()
            until(simulation, "x", TaskState.ASSIGNED)
            task = simulation.board.named("x")
            assert (task.car == before) is (robots == 1)
            simulation.run()
            assert task.state is TaskState.COLLECTED


@pytest.mark.parametrize(
    ("timeouts", "states", "cause"),
    [
        (TimeoutConfig(waiting_s=3.0), {TaskState.COLLECTED, TaskState.CANCELLED}, "no car had it 3 s after"),
        (TimeoutConfig(assigned_s=2.0), {TaskState.COLLECTED}, "was not at pick_1 after 2 s"),
        (TimeoutConfig(service_s=2.0), {TaskState.FAILED}, "was loading for 2 s"),
        (TimeoutConfig(carried_s=2.0), {TaskState.FAILED}, "was not at drop_1 after 2 s"),
    ],
)
def test_what_lasts_too_long_is_ended_with_its_cause(
    make: Make, timeouts: TimeoutConfig, states: set[TaskState], cause: str
) -> None:
    lines = [f"{name},0,pick_1,drop_1,0.3" for name in "xyz"]
    with make(*lines, robots=2, timeouts=timeouts, duration_s=200.0) as simulation:
        lives = Lives(simulation.board)
        simulation.run()
        tasks = simulation.board.tasks
        causes = [step.cause for step in lives.all()]
        assert any(cause in other for other in causes), causes
        asked_again = (TaskState.READY, TaskState.ASSIGNED)
        assert {task.state for task in tasks if task.state not in asked_again} <= states
        check_nothing_lost(simulation, lives)


@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_asked_nothing_is_lost(make: Make, seed: int) -> None:
    """Random requests at random times, some of them impossible, over a stream with chains of followers."""
    rng = np.random.default_rng(seed)
    lines = []
    for k in range(14):
        after = f"o{rng.integers(k)}" if k and rng.random() < 0.4 else ""
        lines.append(f"o{k},{3 * k},pick_{rng.integers(1, 3)},drop_{rng.integers(1, 3)},0.3,,,{after}")
    timeouts = TimeoutConfig(assigned_s=20.0, waiting_s=150.0)
    with make(*lines, robots=3, timeouts=timeouts, seed=seed, duration_s=900.0) as simulation:
        lives = Lives(simulation.board)

        def ask(simulation: Simulation) -> None:
            if simulation.now % 40 == 0 and rng.random() < 0.3:
                request = simulation.cancel if rng.random() < 0.3 else simulation.requeue
                try:
                    request(f"o{rng.integers(14)}")
                except (CannotCancel, CannotRequeue):
                    check_nothing_lost(simulation, lives)

        simulation.run(ask)
        check_nothing_lost(simulation, lives)
        assert simulation.board.finished
        summary = simulation.summary()
        assert summary.tasks_done + summary.tasks_failed + summary.tasks_cancelled == 14
        assert all(simulation.explain_assignment(f"o{k}").reason is TaskReason.ENDED for k in range(14))
