"""The time that calls of a planner take is told, and decides nothing."""

import time

import numpy as np

from fleet.session.planning_time import PlanningTime
from planners.mapf.problem import Plan, Status

PLAN = Plan(states=np.zeros((1, 1), dtype=np.int32), status=Status.FEASIBLE, iterations=1)


def after(seconds: float) -> Plan:
    time.sleep(seconds)
    return PLAN


def test_before_the_first_call_there_is_nothing_to_tell() -> None:
    planning = PlanningTime()
    assert (planning.mean_ms, planning.longest_ms) == (None, None)


def test_mean_and_longest_call() -> None:
    planning = PlanningTime()
    assert planning.of(lambda: after(0.03)) is PLAN
    assert planning.of(lambda: after(0.0)) is PLAN
    mean_ms, longest_ms = planning.mean_ms, planning.longest_ms
    assert mean_ms is not None
    assert longest_ms is not None
    assert longest_ms >= 30.0
    assert longest_ms / 2.0 <= mean_ms < longest_ms
