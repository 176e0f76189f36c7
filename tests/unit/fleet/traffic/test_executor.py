"""The executor on lanes small enough to follow by hand, with a driver that is told who drives."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fleet.config import TrafficConfig
from fleet.errors import ConfigError
from fleet.traffic.executor import Executor
from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.status import Status
from tests.unit.fleet.traffic.drivers import Drivers
from tests.unit.planners.mapf.lanes import graph_of, one_way_loop, open_grid

WORLD: Any = SimpleNamespace(tick_s=0.5)


class Site:
    """An executor with its driver and its log."""

    def __init__(self, graph: LaneGraph, *rows: list[int], reorder_after_s: float = 2.0) -> None:
        self.driver: Any = Drivers()
        self.log: list[dict[str, Any]] = []
        self.executor = Executor(
            graph,
            np.array(rows[0], dtype=np.int32),
            self.driver,
            TrafficConfig(grant_moves_n=1, reorder_after_s=reorder_after_s),
            lambda kind, **facts: self.log.append({"kind": kind, **facts}),
        )
        self.accept(*rows)

    def accept(self, *rows: list[int]) -> None:
        self.executor.accept(Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0))

    def drive(self, seconds: float) -> list[int]:
        """Let time pass; cars that were granted something, in order."""
        before = len(self.driver.driven)
        for _ in range(round(seconds / WORLD.tick_s)):
            self.executor.tick(WORLD)
        return [car for car, _ in self.driver.driven[before:]]


def crossing(reorder_after_s: float) -> Site:
    """Car 0 drives 0 1 2 3, car 1 crosses its way in cell 2: 4 2 5; car 0 breaks down on its way to cell 1."""
    graph = graph_of([0, 1, 2, 3, 4, 2, 5], [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6)])
    site = Site(graph, [0, 4], [1, 4], [2, 4], [3, 5], [3, 6], reorder_after_s=reorder_after_s)
    site.driver.late.add(0)
    return site


def test_a_late_car_holds_nobody_up_at_a_crossing() -> None:
    site = crossing(reorder_after_s=2.0)
    assert site.drive(1.5) == [0], "it may still come"
    assert site.drive(2.0) == [1, 1]
    assert site.executor.n_reordered == 1
    site.driver.late.clear()
    assert site.drive(3.0) == [0, 0]
    assert site.executor.dependencies.n_visits == 0


def test_the_order_of_the_plan_is_kept_if_so_wanted() -> None:
    site = crossing(reorder_after_s=math.inf)
    assert site.drive(60.0) == [0]
    site.driver.late.clear()
    assert site.drive(5.0) == [0, 0, 1, 1]
    assert site.executor.n_reordered == 0


def test_a_car_that_drives_is_not_late() -> None:
    site = crossing(reorder_after_s=2.0)
    site.driver.late.clear()
    assert site.drive(10.0) == [0, 0, 0, 1, 1]
    assert site.executor.n_reordered == 0


def test_a_time_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"traffic.reorder_after_s is 0.0; valid: a number > 0, or inf"):
        TrafficConfig(reorder_after_s=0.0)


def test_a_plan_with_a_ring_is_cut_before_it_and_told() -> None:
    graph = graph_of(range(4), [(0, 1), (1, 3), (3, 0), (2, 3)])
    site = Site(graph, [0, 1, 2], [0, 1, 3], [1, 3, 0])
    assert site.executor.tail_states().tolist() == [0, 1, 3]
    assert [(entry["kind"], entry["timestep"], entry["of"]) for entry in site.log] == [("plan_cut", 1, 2)]
    assert "closed ring" in site.log[0]["cause"]
    site.drive(2.0)
    assert site.executor.dependencies.n_visits == 0


def test_of_a_plan_with_several_faults_the_part_before_the_first_is_driven() -> None:
    site = Site(open_grid(1, 6), [0, 1], [0, 2], [1, 3], [3, 2], [2, 2], [9, 9])
    assert site.executor.tail_states().tolist() == [1, 3]
    assert [entry["timestep"] for entry in site.log] == [4, 3, 2]


def test_a_whole_ring_at_once_leaves_everybody_where_it_is() -> None:
    site = Site(one_way_loop(3), [0, 1, 2], [1, 2, 0])
    assert site.executor.tail_states().tolist() == [0, 1, 2]
    assert site.drive(5.0) == []


def test_a_cell_that_is_closed_for_two_reasons_opens_with_the_second() -> None:
    site = Site(open_grid(1, 3), [0], [1], [2])
    site.executor.close(1)
    assert site.executor.close_if_free(1)
    site.executor.open(1)
    site.accept([0], [1], [2])
    assert site.drive(2.0) == []
    site.executor.open(1)
    assert site.drive(2.0) == [0, 0]
