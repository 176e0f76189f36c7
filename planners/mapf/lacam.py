"""LaCAM*: one-shot planning, complete and anytime."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.configuration_tree import ConfigurationTree
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.problem import NO_GOAL, Instance, IntArray, Plan
from planners.mapf.roads import roads_of
from planners.mapf.successors import Guide
from planners.status import Status

_STRIDE = 16
"""Iterations between two looks at the deadline."""


@dataclass(frozen=True, kw_only=True)
class LacamConfig:
    """Settings of `Lacam`."""

    samples: int = 1
    """Next configurations to draw in one expansion; the one closest to the goals is taken."""
    patience: int = 1000
    """Without a deadline: iterations without improvement after which the best plan is handed back."""

    def __post_init__(self) -> None:
        for name, least in (("samples", 1), ("patience", 0)):
            if getattr(self, name) < least:
                raise PlanningError(f"lacam: {name} = {getattr(self, name)}; valid: an integer >= {least}")


class Lacam:
    """Lazy constraints addition search, which plans until every agent stands at its goal at the same time.

    Complete: where there is no solution it ends with `infeasible`, given time. Anytime: after the first solution it
    goes on to lower the sum of loss until the deadline, or until the best plan is proved `optimal` in that sense.
    Agents without a goal can end anywhere.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Source: Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023,
    https://arxiv.org/abs/2305.03632.
    """

    def __init__(self, config: LacamConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = LacamConfig() if config is None else config
        self._rng = np.random.default_rng(seed)

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan from the starts to the goals, or to the horizon if that comes first.

        Args:
            instance: Who stands where and goes where. Larger `priorities` choose first at the beginning.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one expansion of the search.

        Returns:
            A legal plan. `timeout`: none was found in time; the rows lead to the configuration that came closest.
            `infeasible`: a goal is out of reach or shared, or the search has proved that there is no plan; the start.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        graph = instance.graph
        if tables is not None and tables.graph is not graph:
            raise PlanningError("lacam: the distance table is of another graph than the instance; valid: the same one")
        closed = np.array(instance.blocked)
        closed[graph.state_cell[instance.starts[instance.fixed]]] = True
        if tables is None or instance.fixed.any():
            tables = DistanceTable(graph, closed)
        guide = _guide(instance, tables)
        if _hopeless(instance, guide):
            return Plan(states=np.array(instance.starts)[None], status=Status.INFEASIBLE, iterations=0)

        tree = ConfigurationTree(
            roads_of(graph, closed),
            guide,
            np.array(instance.starts),
            _urgency(instance, guide),
            samples=self.config.samples,
            rng=self._rng,
        )
        budget = Deadline() if deadline is None else deadline
        spent, improved = 0, 0
        while not tree.exhausted and (
            deadline is not None or not tree.found or spent < improved + self.config.patience
        ):
            granted = _take(budget, _STRIDE)
            if not granted:
                break
            before = tree.cost if tree.found else None
            spent += tree.search(granted)
            if tree.found and tree.cost != before:
                improved = spent
        states = tree.solution()[: instance.horizon + 1]
        if tree.exhausted:
            status = Status.OPTIMAL if tree.found else Status.INFEASIBLE
        else:
            status = Status.FEASIBLE if tree.found else Status.TIMEOUT
        return Plan(states=states, status=status, iterations=spent)


def _take(deadline: Deadline, iterations: int) -> int:
    """Take as much of a number of iterations as the budget covers."""
    while iterations and not deadline.spend(iterations):
        iterations //= 2
    return iterations


def _guide(instance: Instance, tables: DistanceTable) -> Guide:
    distances, row = tables.rows(instance.goals)
    return Guide(
        distances=distances,
        row=row,
        goals=np.array(instance.goals),
        fixed=np.array(instance.fixed),
        stay=np.array(instance.stay),
        allow_rotation=instance.allow_rotation,
    )


def _hopeless(instance: Instance, guide: Guide) -> bool:
    """Whether an agent can obviously never stand at its goal together with the others."""
    cells = instance.graph.state_cell
    has_goal = instance.goals != NO_GOAL
    wanted = np.concatenate((cells[instance.goals[has_goal]], cells[instance.starts[~has_goal & instance.fixed]]))
    if len(np.unique(wanted)) < len(wanted) or (has_goal & instance.fixed & (instance.goals != instance.starts)).any():
        return True
    return bool((guide.distances[guide.row[has_goal], instance.starts[has_goal]] >= UNREACHABLE).any())


def _urgency(instance: Instance, guide: Guide) -> np.typing.NDArray[np.float64]:
    """Rank by priority, then by distance, in [0, 1)."""
    away: IntArray = np.where(guide.row < 0, 0, guide.distances[guide.row, instance.starts])
    urgency = np.empty(instance.n_agents)
    urgency[np.lexsort((away, instance.priorities))] = np.arange(instance.n_agents) / max(instance.n_agents, 1)
    return urgency
