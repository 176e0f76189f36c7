"""Requests and answers: when a plan lands, what it may cost, and that nobody stops for it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fleet.arrays import CellArray
from fleet.config import TrafficConfig
from fleet.errors import ConfigError
from fleet.traffic import replanning
from fleet.traffic.executor import Executor
from fleet.traffic.floor_distances import FloorDistances
from fleet.traffic.replanning import QUEUE_MOVES, Traffic
from tests.unit.fleet.traffic.drivers import Drivers
from tests.unit.planners.mapf.lanes import one_way_loop, open_grid

WORLD: Any = SimpleNamespace(tick_s=0.1)


class Run:
    """Traffic on a loop of 30 cells; a car ends a move in the tick after its grant."""

    def __init__(self, starts: list[int], **config: Any) -> None:
        graph = one_way_loop(30)
        settings = TrafficConfig(**config)
        self.driver: Any = Drivers()
        self.executor = Executor(
            graph, np.array(starts, dtype=np.int32), self.driver, settings, lambda kind, **facts: None
        )
        self.traffic = Traffic(graph, self.executor, settings, WORLD.tick_s, seed=0)
        self.now = 0

    def tick(self) -> bool:
        landed = self.traffic.tick(self.now)
        self.executor.tick(WORLD)
        self.now += 1
        return landed

    def landings(self, ticks: int) -> list[int]:
        return [self.now - 1 for _ in range(ticks) if self.tick()]


def test_a_plan_lands_exactly_when_its_latency_is_over() -> None:
    run = Run([0], latency_s=0.7, period_s=2.0)
    run.traffic.send(0, 20, stay=False, tick=0)
    assert run.landings(50) == [7, 27, 47]


def test_a_plan_without_latency_lands_at_once() -> None:
    assert Run([0], latency_s=0.0, period_s=2.0).landings(45) == [0, 20, 40]


def test_cars_with_grants_drive_on_while_a_plan_is_late() -> None:
    """Half of the time a request is under way, and no tick passes without a move."""
    run = Run([0, 15], latency_s=1.0, period_s=2.0, commit_moves_n=20, horizon_n=30, grant_moves_n=1)
    for car in (0, 1):
        run.traffic.send(car, 14 + 15 * car, stay=False, tick=0)
    run.landings(11)
    for _ in range(13):
        before = len(run.driver.driven)
        run.tick()
        assert sorted(car for car, _ in run.driver.driven[before:]) == [0, 1], f"a car stood still at tick {run.now}"


@pytest.mark.parametrize(
    ("planner", "latency_s", "kept"),
    [("pibt", 0.2, 2), ("pibt", 3.0, 2), ("multi_step_pibt", 0.2, 0), ("multi_step_pibt", 3.0, 3)],
)
def test_a_car_keeps_no_more_than_it_drives_meanwhile_if_the_planner_knows_when_it_comes(
    planner: str, latency_s: float, kept: int
) -> None:
    run = Run([0], planner=planner, latency_s=latency_s, period_s=4.0, grant_moves_n=1, horizon_n=60)
    run.traffic.send(0, 29, stay=False, tick=0)
    while not run.tick():
        pass
    while run.now % 40 or run.executor.granted_states()[0] == 0:
        run.tick()
    granted = int(run.executor.granted_states()[0])
    run.traffic.tick(run.now)
    assert int(run.executor.tail_states()[0]) - granted == min(kept, 29 - granted)


def test_a_request_costs_what_its_budget_says_and_the_next_goes_on() -> None:
    run = Run([0], latency_s=0.0, period_s=1.0, iterations_n=3)
    run.traffic.send(0, 20, stay=False, tick=0)
    run.tick()
    assert run.executor.tail_states().tolist() == [3]
    for _ in range(100):
        run.tick()
    assert run.executor.tail_states().tolist() == [20]
    assert len(run.driver.driven) == 20


def test_the_answer_is_the_same_on_any_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """No clock is read."""

    def clock() -> float:
        raise AssertionError("the wall clock was read")

    monkeypatch.setattr("time.perf_counter", clock)
    monkeypatch.setattr("time.monotonic", clock)
    run = Run([0], iterations_n=2)
    run.traffic.send(0, 9, stay=False, tick=0)
    assert run.landings(30)


def test_what_changes_the_floor_throws_the_late_plan_away() -> None:
    run = Run([0], latency_s=1.0, period_s=5.0)
    run.traffic.send(0, 20, stay=False, tick=0)
    run.landings(5)
    run.traffic.set_blocked(25, True)
    assert run.landings(12) == [15]
    assert run.executor.tail_states().tolist() == [12]


def test_a_budget_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"traffic.iterations_n is 0; valid: an integer >= 1"):
        TrafficConfig(iterations_n=0)


def at(state: int, goal: int) -> tuple[CellArray, CellArray]:
    return np.array([state], dtype=np.int32), np.array([goal], dtype=np.int32)


def test_avoided_cells_are_passed_only_where_there_is_no_other_way() -> None:
    """A grid of 2 x 3 cells: from 0 to 2 the way leads through 1, or round it through 3."""
    graph, settings = open_grid(2, 3), TrafficConfig()
    driver: Any = Drivers()
    executor = Executor(graph, np.array([0], dtype=np.int32), driver, settings, lambda kind, **facts: None)
    assert Traffic(graph, executor, settings, WORLD.tick_s, seed=0).next_cells(*at(0, 2)).tolist() == [1]
    traffic = Traffic(graph, executor, settings, WORLD.tick_s, seed=0, free=FloorDistances(graph, [1]))
    assert traffic.next_cells(*at(0, 2)).tolist() == [3]
    assert traffic.next_cells(*at(0, 1)).tolist() == [1]  # is the goal
    assert traffic.tables.to(2)[0] == 2  # as far as it is
    traffic.set_blocked(4, True)
    assert traffic.next_cells(*at(0, 2)).tolist() == [1]
    traffic.set_blocked(4, False)
    assert traffic.next_cells(*at(0, 2)).tolist() == [3]


class TwoLanes:
    """Two rows side by side; car 0 stands in the first one and wants to its end, car 1 comes behind it."""

    END = 15

    def __init__(self, *, stand: int = 4) -> None:
        graph = open_grid(2, self.END + 1)
        config = TrafficConfig()
        self.executor = Executor(
            graph, np.array([stand, 16], dtype=np.int32), cast(Any, Drivers()), config, lambda kind, **facts: None
        )
        self.traffic = Traffic(graph, self.executor, config, WORLD.tick_s, seed=0)
        self.traffic.set_fixed(0, True)
        self.traffic.send(0, self.END, stay=False, tick=0)
        self.now = 0

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / WORLD.tick_s)):
            self.traffic.tick(self.now)
            self.executor.tick(WORLD)
            self.now += 1


def test_ways_go_round_where_cars_wait() -> None:
    run = TwoLanes()
    straight = run.traffic.ways.to(run.END).tolist()
    before = run.traffic.n_ways
    run.wait(40.0)
    ways = run.traffic.ways.to(run.END)
    assert run.traffic.n_ways > before
    assert int(ways[3]) > straight[3], "the way through the crowd costs more"
    assert int(ways[3]) <= straight[3] + 2, "and that round it is taken"
    assert run.traffic.tables.to(run.END).tolist() == straight, "distances stay what they are"


def test_who_waits_near_its_goal_is_no_crowd() -> None:
    run = TwoLanes(stand=TwoLanes.END - QUEUE_MOVES)
    run.wait(40.0)
    assert run.traffic.n_ways == 0


def test_a_crowd_that_is_gone_costs_nothing() -> None:
    run = TwoLanes()
    straight = run.traffic.ways.to(run.END).tolist()
    run.wait(40.0)
    run.traffic.set_fixed(0, False)
    run.wait(20.0)
    run.traffic.send(1, run.END, stay=False, tick=run.now)
    run.wait(120.0)
    assert run.traffic.ways.to(run.END).tolist() == straight


def test_a_crowd_is_gone_round_past_blocked_cells_too() -> None:
    run = TwoLanes()
    run.wait(40.0)
    run.traffic.set_blocked(30, True)
    assert int(run.traffic.ways.to(run.END)[3]) > int(run.traffic.tables.to(run.END)[3])


def served(monkeypatch: pytest.MonkeyPatch, least: int) -> Run:
    """Two cars that stand at their goals, a plan under way; then an arm begins to work on the first."""
    monkeypatch.setattr(replanning, "GREAT_FLEET_CARS", least)
    run = Run([5, 20], latency_s=0.5, period_s=100.0)
    for car, state in enumerate((5, 20)):
        run.traffic.send(car, state, stay=True, tick=0)
    run.landings(3)
    run.traffic.set_served(0, True)
    return run


def test_a_great_fleet_keeps_plans_when_an_arm_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    assert served(monkeypatch, 2).landings(5) == [5]
    assert served(monkeypatch, 3).landings(8) == [8], "a small one plans anew"


def test_of_a_plan_that_moves_a_car_which_is_served_by_now_nothing_from_there_on_is_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(replanning, "GREAT_FLEET_CARS", 2)
    run = Run([5, 20], latency_s=0.5, period_s=100.0)
    for car in (0, 1):
        run.traffic.send(car, 10 + 15 * car, stay=True, tick=0)
    run.landings(3)
    run.traffic.set_served(0, True)
    while not run.tick():
        pass
    assert run.executor.tail_states().tolist() == [5, 20]
    run.landings(30)
    assert run.executor.tail_states()[0] == 5
    assert run.executor.tail_states()[1] != 20, "the next plan knows of it"


def test_a_great_fleet_asks_for_plans_in_peace(monkeypatch: pytest.MonkeyPatch) -> None:
    landings = []
    for least in (1, 2):
        monkeypatch.setattr(replanning, "GREAT_FLEET_CARS", least)
        run = Run([0], latency_s=0.0, period_s=100.0)
        landed = []
        for tick in range(7):
            run.traffic.send(0, 10 + tick, stay=False, tick=tick)
            landed += run.landings(1)
        landings.append(landed)
    assert landings == [[0, 3, 6], [0, 1, 2, 3, 4, 5, 6]]
