"""Prioritised planning with safe intervals: one agent after the other, each around all that are planned already."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import Int64Array, IntArray
from planners.mapf.distance_table import DistanceTable
from planners.mapf.one_shot import hopeless, plan_of_paths, start_only, tables_for
from planners.mapf.options import open_moves
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.roads import closed_cells
from planners.mapf.sipp.safe_intervals import Reservations
from planners.status import Status


@dataclass(frozen=True, kw_only=True)
class SippConfig:
    """Settings of `Sipp`."""

    orders: int = 256
    """Without a deadline: orders of the agents to try before giving up."""

    def __post_init__(self) -> None:
        if not self.orders >= 1:
            raise PlanningError(f"sipp: orders = {self.orders}; valid: an integer >= 1")


class Sipp:
    """Prioritised planning: agents one by one, each on its earliest path through the safe intervals that are left.

    Fast and not complete: an agent that comes late may find no way although there is a solution. Then it goes first
    and all are planned again; an order that was tried before is shuffled instead. A failure proves nothing, so it
    ends in a timeout. Agents that never move come before all others, agents without a goal after them: those stay
    unless somebody needs their cell.

    Args:
        config: Settings.
        seed: Seed of the shuffling. Each call draws on.

    Source: Silver, "Cooperative Pathfinding", AIIDE 2005 (agents one by one); Phillips and Likhachev, "SIPP: Safe
    Interval Path Planning for Dynamic Environments", ICRA 2011, https://www.cs.cmu.edu/~maxim/files/sipp_icra11.pdf.
    The intervals belong to cells here, because a cell carries one agent whatever its heading.
    """

    def __init__(self, config: SippConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = SippConfig() if config is None else config
        self._rng = np.random.default_rng(seed)

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan until every agent stands at its goal for good.

        Args:
            instance: The problem; its horizon cuts the plan that is returned, not the search.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one search for one agent.

        Returns:
            The first solution that is found; otherwise the start alone, with status timeout or infeasible.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        tables = tables_for(instance, tables, "sipp")
        budget = Deadline(self.config.orders * instance.n_agents) if deadline is None else deadline
        if hopeless(instance, tables):
            return start_only(instance, Status.INFEASIBLE, 0)
        distances, row = tables.rows(instance.goals)
        reservations = Reservations(
            instance.graph,
            open_moves(instance.graph, closed_cells(instance)),
            instance.starts,
            allow_rotation=instance.allow_rotation,
        )
        order = _first_order(instance, distances, row)
        n_fixed = int(instance.fixed.sum())
        tried: set[bytes] = set()
        searches = 0
        while True:
            paths: dict[int, IntArray] = {}
            reservations.clear()
            for agent in order.tolist():
                if not budget.spend():
                    return start_only(instance, Status.TIMEOUT, searches)
                searches += 1
                found = _path(agent, instance, distances[row[agent]], reservations)
                if found is None:
                    break
                reservations.add(*found)
                paths[agent] = found[0]
            else:
                every = [paths[agent] for agent in range(instance.n_agents)]
                return plan_of_paths(instance, every, Status.FEASIBLE, searches)
            tried.add(order.tobytes())
            order = self._next_order(order, agent, n_fixed, tried)

    def _next_order(self, order: Int64Array, failed: int, n_fixed: int, tried: set[bytes]) -> Int64Array:
        """Put the agent that found no way first, right after those that never move; shuffle if that was tried."""
        place = int(np.flatnonzero(order == failed)[0])
        raised = np.concatenate((order[:n_fixed], [failed], order[n_fixed:place], order[place + 1 :]))
        if raised.tobytes() in tried:
            raised[n_fixed:] = self._rng.permutation(raised[n_fixed:])
        return raised


def _first_order(instance: Instance, distances: npt.NDArray[np.integer], row: IntArray) -> Int64Array:
    """Immovable agents, then by priority and the longest way, agents without a goal last."""
    seeks = instance.goals != NO_GOAL
    way = np.zeros(instance.n_agents, dtype=np.int64)
    way[seeks] = distances[row[seeks], instance.starts[seeks]]
    order: Int64Array = np.lexsort((-way, -instance.priorities, ~seeks, ~instance.fixed)).astype(np.int64)
    return order


def _path(
    agent: int, instance: Instance, distance: npt.NDArray[np.integer], reservations: Reservations
) -> tuple[IntArray, IntArray] | None:
    """States and moves of one agent."""
    start = int(instance.starts[agent])
    if instance.fixed[agent]:
        return np.array([start], dtype=np.int32), np.empty(0, dtype=np.int32)
    return reservations.earliest_path(start, int(instance.goals[agent]), distance, stay=bool(instance.stay[agent]))
