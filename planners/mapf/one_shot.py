"""What every one-shot planner asks first and does last: is there no hope, and how much of a solution was asked for."""

from __future__ import annotations

import numpy as np

from planners.mapf.arrays import IntArray
from planners.mapf.distance_table import UNREACHABLE, DistanceTable, tables_of
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.roads import closed_cells
from planners.status import Status


def tables_for(instance: Instance, tables: DistanceTable | None, planner: str) -> DistanceTable:
    """Take the caller's distance table, or make one where that would be better informed.

    Raises:
        PlanningError: The table belongs to another graph; names the planner.
    """
    if tables is None:
        return DistanceTable(instance.graph, closed_cells(instance))
    given = tables_of(instance, tables, planner)
    return DistanceTable(instance.graph, closed_cells(instance)) if instance.fixed.any() else given


def hopeless(instance: Instance, tables: DistanceTable) -> bool:
    """Whether a glance proves that not all agents can stand at their goals at the same time.

    True if a goal cannot be reached even when all who can make way, two goals lie in one cell, or an agent that never
    moves is not at its goal. The table is that of `tables_for`, in which nobody enters the cell of such an agent.
    """
    cells, goals = instance.graph.state_cell, instance.goals
    seekers = np.flatnonzero(goals != NO_GOAL)
    distances, row = tables.rows(goals)
    if (distances[row[seekers], instance.starts[seekers]] >= UNREACHABLE).any():
        return True
    goal_cells = cells[goals[seekers]]
    if len(np.unique(goal_cells)) < len(goal_cells):
        return True
    return bool((instance.fixed[seekers] & (instance.starts[seekers] != goals[seekers])).any())


def start_only(instance: Instance, status: Status, iterations: int) -> Plan:
    """The shortest legal prefix."""
    return Plan(states=instance.starts[None].astype(np.int32), status=status, iterations=iterations)


def plan_of_paths(instance: Instance, paths: list[IntArray], status: Status, iterations: int) -> Plan:
    """One table of the agents' paths, each padded with its last state, as far as the instance's horizon.

    Args:
        instance: The instance.
        paths: States of each agent from timestep 0 until it stands still for good.
        status: How the search ended; a plan that is cut is feasible at best.
        iterations: Work done.
    """
    rows = max((len(path) for path in paths), default=1)
    states = np.empty((min(rows, instance.horizon + 1), len(paths)), dtype=np.int32)
    for agent, path in enumerate(paths):
        states[: len(path), agent] = path[: len(states)]
        states[len(path) :, agent] = path[-1]
    if status is Status.OPTIMAL and len(states) < rows:
        status = Status.FEASIBLE
    return Plan(states=states, status=status, iterations=iterations)
