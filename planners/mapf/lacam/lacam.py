"""LaCAM*: one-shot planning, complete and anytime."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import IntArray
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.lacam.configuration_tree import ConfigurationTree
from planners.mapf.lacam.lns import LargeNeighbourhoodSearch
from planners.mapf.lacam.successors import Guide, guide_of
from planners.mapf.lacam.turning import can_forget_headings, with_headings, without_headings
from planners.mapf.one_shot import tables_for
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.roads import Roads, closed_cells, roads_of
from planners.status import Status

_STRIDE = 16
"""Iterations between two looks at the deadline."""
_TREE_SHARE = 4
"""Expansions of the tree after every stride of refining."""
_TREE_BYTES = 2**30
"""Memory at which the tree grows no further once there is a solution."""


@dataclass(frozen=True, kw_only=True)
class LacamConfig:
    """Settings of `Lacam`."""

    samples: int = 1
    """Next configurations to draw in one expansion; the one closest to the goals is taken."""
    refine: bool = True
    """Whether a large-neighbourhood search works on the best plan, beside the search itself."""
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
    Agents without a goal can end anywhere. Where everybody turns on the spot, the first solution is searched without
    headings.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Source: Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023,
    https://arxiv.org/abs/2305.03632; the refining: Okumura, "Engineering LaCAM*: towards real-time, large-scale, and
    near-optimal multi-agent pathfinding", AAMAS 2024, https://arxiv.org/abs/2308.04292.
    """

    def __init__(self, config: LacamConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = LacamConfig() if config is None else config
        self._rng = np.random.default_rng(seed)

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan from the starts to the goals, or to the horizon if that comes first.

        Args:
            instance: Who stands where and goes where. Larger `priorities` choose first at the beginning.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one expansion of the search or one step of the refining. None = until
                `patience` is used up.

        Returns:
            A legal plan. `timeout`: none was found in time; the rows lead to the configuration that came closest.
            `infeasible`: a goal is out of reach or shared, or the search has proved that there is no plan; the start.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        graph = instance.graph
        closed = closed_cells(instance)
        tables = tables_for(instance, tables, "lacam")
        guide = guide_of(instance, tables)
        if _hopeless(instance, guide):
            return Plan(states=np.array(instance.starts)[None], status=Status.INFEASIBLE, iterations=0)

        budget = _Budget(deadline)
        tree = self._tree(instance, guide)
        first = tree
        if can_forget_headings(instance):
            flat = without_headings(instance)
            first = self._tree(flat, guide_of(flat, DistanceTable(flat.graph, closed)))
        while not first.found and not first.exhausted and (granted := budget.take(_STRIDE)):
            first.search(granted)
        states = first.solution()
        if first is not tree:
            states = with_headings(instance, states)
        if first.found:
            states, proved = self._refined(roads_of(graph, closed), guide, states, tree, budget)
            status = Status.OPTIMAL if proved else Status.FEASIBLE
        else:
            status = Status.INFEASIBLE if first.exhausted else Status.TIMEOUT
        return Plan(states=states[: instance.horizon + 1], status=status, iterations=budget.spent)

    def _tree(self, instance: Instance, guide: Guide) -> ConfigurationTree:
        return ConfigurationTree(
            roads_of(instance.graph, closed_cells(instance)),
            guide,
            np.array(instance.starts),
            _urgency(instance, guide),
            samples=self.config.samples,
            rng=self._rng,
        )

    def _refined(
        self, roads: Roads, guide: Guide, states: IntArray, tree: ConfigurationTree, budget: _Budget
    ) -> tuple[IntArray, bool]:
        """The best plan that refining and further search find, and whether it is proved to be the best."""
        best = LargeNeighbourhoodSearch(roads, guide, states, self._rng)
        if self.config.refine:
            best.start_over(lambda: budget.take(1) > 0)
        improved, cost = budget.spent, best.cost
        while not tree.exhausted and not best.at_bound:
            if not budget.limited and budget.spent >= improved + self.config.patience:
                break
            if self.config.refine:
                best.run(budget.take(_STRIDE))
            granted = budget.take(_TREE_SHARE)
            if not granted:
                break
            if tree.n_bytes < _TREE_BYTES:
                tree.search(granted, best.cost)
                if tree.found and tree.cost < best.cost:
                    best = LargeNeighbourhoodSearch(roads, guide, tree.solution(), self._rng)
            elif not self.config.refine:
                break
            if best.cost < cost:
                improved, cost = budget.spent, best.cost
        return best.states(), tree.exhausted or best.at_bound


class _Budget:
    """A deadline, or none, and what has been spent of it."""

    def __init__(self, deadline: Deadline | None) -> None:
        self.limited = deadline is not None
        self.spent = 0
        self._deadline = Deadline() if deadline is None else deadline

    def take(self, iterations: int) -> int:
        """Take as much of a number of iterations as the budget covers."""
        while iterations and not self._deadline.spend(iterations):
            iterations //= 2
        self.spent += iterations
        return iterations


def _hopeless(instance: Instance, guide: Guide) -> bool:
    """Whether an agent can obviously never stand at its goal together with the others."""
    cells = instance.graph.state_cell
    has_goal = instance.goals != NO_GOAL
    wanted = np.concatenate((cells[instance.goals[has_goal]], cells[instance.starts[~has_goal & instance.fixed]]))
    if len(np.unique(wanted)) < len(wanted) or (has_goal & instance.fixed & (instance.goals != instance.starts)).any():
        return True
    return bool((guide.distances[guide.row[has_goal], instance.starts[has_goal]] >= UNREACHABLE).any())


def _urgency(instance: Instance, guide: Guide) -> npt.NDArray[np.float64]:
    """Rank by priority, then by distance, in [0, 1)."""
    away: IntArray = np.where(guide.row < 0, 0, guide.distances[guide.row, instance.starts])
    urgency = np.empty(instance.n_agents)
    urgency[np.lexsort((away, instance.priorities))] = np.arange(instance.n_agents) / max(instance.n_agents, 1)
    return urgency
