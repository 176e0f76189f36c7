"""Conflict-based search: optimal plans for a few agents, the reference for all other planners."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import IntArray
from planners.mapf.cbs.decision_diagram import ENTER, STAND, SWEEP, Diagram, Fact, Seeker, draw
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.one_shot import hopeless, plan_of_paths, start_only, tables_for
from planners.mapf.options import open_moves
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.roads import closed_cells
from planners.status import Status


@dataclass(frozen=True, kw_only=True)
class CbsConfig:
    """Settings of `Cbs`."""

    nodes: int = 5000
    """Without a deadline: nodes of the search to open before giving up."""

    def __post_init__(self) -> None:
        if not self.nodes >= 1:
            raise PlanningError(f"cbs: nodes = {self.nodes}; valid: an integer >= 1")


class Cbs:
    """Conflict-based search: plans of least sum of costs, with proof, for a few agents.

    The cost of an agent is the number of timesteps until it stands at its goal for good; an agent without a goal may
    stand anywhere. All agents take their cheapest paths; where these conflict, the search branches: one of those who
    take part must not do its part. Every conflict is a set of things that cannot all be done: two agents in a cell,
    two that swap, a move over a used cell, a closed ring of followers.

    A problem without a solution is rarely recognised: most end with the budget, as a timeout.

    Args:
        config: Settings.
        seed: Not used, there is no chance in the search.

    Source: Sharon, Stern, Felner, Sturtevant, "Conflict-based search for optimal multi-agent pathfinding", Artificial
    Intelligence 219, 2015, https://doi.org/10.1016/j.artint.2014.11.006. Cardinal conflicts first and the bypass:
    Boyarski et al., "ICBS", IJCAI 2015. The bound from cardinal conflicts that share no agent: Felner et al., "Adding
    heuristics to conflict-based search", ICAPS 2018 (a matching in place of a vertex cover). Sweeps and rings as
    conflicts are additions.
    """

    def __init__(self, config: CbsConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = CbsConfig() if config is None else config

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan until every agent stands at its goal for good.

        Args:
            instance: The problem; its horizon cuts the plan that is returned, not the search.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one node of the search.

        Returns:
            A plan of least cost; with status timeout or infeasible its beginning, up to the first conflict that is
            left.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        tables = tables_for(instance, tables, "cbs")
        budget = Deadline(self.config.nodes) if deadline is None else deadline
        if hopeless(instance, tables):
            return start_only(instance, Status.INFEASIBLE, 0)
        if not budget.spend():
            return start_only(instance, Status.TIMEOUT, 0)
        search = _Search(instance, tables)
        root = search.root()
        if root is None:
            return start_only(instance, Status.INFEASIBLE, 1)
        numbers = itertools.count()
        queue = [(root.key, next(numbers), root)]
        closest = root
        opened = 1
        while queue:
            node = heapq.heappop(queue)[2]
            if not node.clashes:
                paths = [diagram.states for diagram in node.diagrams]
                return plan_of_paths(instance, paths, Status.OPTIMAL, opened)
            closest = min(closest, node, key=lambda either: len(either.clashes))
            for child in search.branch(node):
                heapq.heappush(queue, (child.key, next(numbers), child))
            if not budget.spend():
                return _legal_part(instance, closest, opened)
            opened += 1
        return start_only(instance, Status.INFEASIBLE, opened)


Clash = list[tuple[int, Fact]]
"""Agents and what each of them does; not all of it can be done."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Node:
    """Cheapest paths of all agents under the bans that were made on the way from the root."""

    bans: tuple[tuple[int, Fact], ...]
    diagrams: tuple[Diagram, ...]
    clashes: list[Clash]
    """All of them, the one to branch on first."""
    bound: int
    """No solution below this node costs less."""

    @property
    def cost(self) -> int:
        return sum(diagram.cost for diagram in self.diagrams)

    @property
    def key(self) -> tuple[int, int]:
        return self.bound, len(self.clashes)


class _Search:
    """What the nodes of one search share."""

    def __init__(self, instance: Instance, tables: DistanceTable) -> None:
        self._graph, self._allow_rotation = instance.graph, instance.allow_rotation
        may_move = open_moves(instance.graph, closed_cells(instance))
        never = np.zeros_like(may_move)
        distances, row = tables.rows(instance.goals)
        self._seekers = []
        for agent in range(instance.n_agents):
            goal = int(instance.goals[agent])
            distance = distances[row[agent]]
            finite = distance[distance < UNREACHABLE]
            self._seekers.append(
                Seeker(
                    start=int(instance.starts[agent]),
                    goal=goal,
                    stay=bool(instance.stay[agent]),
                    may_move=never if instance.fixed[agent] else may_move,
                    distance=distance,
                    farthest=int(finite.max(initial=0)) if goal != NO_GOAL else 0,
                )
            )

    def root(self) -> _Node | None:
        """All agents on cheapest paths without bans."""
        diagrams: list[Diagram] = []
        for seeker in self._seekers:
            diagram = draw(self._graph, seeker, (), [other.states for other in diagrams])
            if diagram is None:
                return None
            diagrams.append(diagram)
        return self._node((), tuple(diagrams), 0)

    def branch(self, node: _Node) -> Iterator[_Node]:
        """Children that ban one part of the first clash each, or in their place a node as cheap with fewer clashes."""
        children = []
        for agent, fact in node.clashes[0]:
            bans = (*node.bans, (agent, fact))
            others = [other.states for k, other in enumerate(node.diagrams) if k != agent]
            old = node.diagrams[agent]
            diagram = draw(
                self._graph,
                self._seekers[agent],
                [ban for who, ban in bans if who == agent],
                others,
                least=old.cost,
            )
            if diagram is None:
                continue
            child = self._node(bans, _replaced(node.diagrams, agent, diagram), node.bound)
            if child.cost == node.cost and len(child.clashes) < len(node.clashes):
                # The path is as good without the ban, and then the other branch is not needed.
                detour = Diagram(cost=old.cost, states=diagram.states, moves=diagram.moves, layers=old.layers)
                yield self._node(node.bans, _replaced(node.diagrams, agent, detour), node.bound)
                return
            children.append(child)
        yield from children

    def _node(self, bans: tuple[tuple[int, Fact], ...], diagrams: tuple[Diagram, ...], bound: int) -> _Node:
        clashes = clashes_of(self._graph, diagrams, allow_rotation=self._allow_rotation)
        forced = [
            sum(diagrams[agent].forced(self._graph, fact) for agent, fact in clash) / len(clash) for clash in clashes
        ]
        clashes = [clashes[k] for k in sorted(range(len(clashes)), key=lambda k: -forced[k])]
        # Of the agents in a cardinal clash one must pay; count clashes that share nobody.
        paying: set[int] = set()
        extra = 0
        for clash in clashes[: forced.count(1.0)]:
            agents = {agent for agent, _ in clash}
            if not agents & paying:
                paying |= agents
                extra += 1
        cost = sum(diagram.cost for diagram in diagrams)
        return _Node(bans=bans, diagrams=diagrams, clashes=clashes, bound=max(bound, cost + extra))


def _replaced(diagrams: tuple[Diagram, ...], agent: int, diagram: Diagram) -> tuple[Diagram, ...]:
    return (*diagrams[:agent], diagram, *diagrams[agent + 1 :])


def _legal_part(instance: Instance, node: _Node, opened: int) -> Plan:
    """The plan of a node up to its first clash."""
    rows = [max(fact.timestep + (fact.does != STAND), 1) for clash in node.clashes for _, fact in clash]
    paths = [diagram.states[: min(rows)] for diagram in node.diagrams]
    return plan_of_paths(instance, paths, Status.TIMEOUT, opened)


def clashes_of(graph: LaneGraph, diagrams: Sequence[Diagram], *, allow_rotation: bool) -> list[Clash]:
    """What cannot all be done in the paths of these diagrams, by timestep."""
    rows = max((len(diagram.states) for diagram in diagrams), default=1)
    states = np.empty((rows, len(diagrams)), dtype=np.int32)
    moves = np.full((rows - 1, len(diagrams)), -1, dtype=np.int32)
    for k, diagram in enumerate(diagrams):
        states[: len(diagram.states), k] = diagram.states
        states[len(diagram.states) :, k] = diagram.states[-1]
        moves[: len(diagram.moves), k] = diagram.moves
    table = _clashes(states, moves, graph.state_cell, graph.swept_ptr, graph.swept_cell, graph.n_cells, allow_rotation)
    clashes: list[Clash] = []
    for number, agent, *fact in table.tolist():
        if number == len(clashes):
            clashes.append([])
        clashes[number].append((agent, Fact(*fact)))
    return clashes


@njit(cache=True, nogil=True)
def _note(
    table: IntArray, used: int, number: int, agent: int, does: int, t: int, cell: int, next_cell: int
) -> IntArray:  # pragma: no cover - compiled
    """Write row `used`; the table, with room for more."""
    if used == len(table):
        more = np.empty((2 * used, table.shape[1]), dtype=np.int32)
        more[:used] = table
        table = more
    table[used, 0], table[used, 1], table[used, 2] = number, agent, does
    table[used, 3], table[used, 4], table[used, 5] = t, cell, next_cell
    return table


@njit(cache=True, nogil=True)
def _clashes(
    states: IntArray,
    moves: IntArray,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    n_cells: int,
    allow_rotation: bool,
) -> IntArray:  # pragma: no cover - compiled
    """Rows (number of the clash, agent, what it does, timestep, cell, next cell), shape (k, 6).

    Of several agents in one cell each is set against the first, so that no row means no conflict.
    """
    rows, n = states.shape
    table = np.empty((16, 6), dtype=np.int32)
    used, number = 0, 0
    now = np.full(n_cells, -1, dtype=np.int32)  # who stands there
    after = np.full(n_cells, -1, dtype=np.int32)  # who stands there a timestep later
    across = np.full(n_cells, -1, dtype=np.int32)  # who sweeps over it
    for a in range(n):
        now[state_cell[states[0, a]]] = a
    for t in range(rows - 1):
        for a in range(n):
            cell = state_cell[states[t + 1, a]]
            b = after[cell]
            if b < 0:
                after[cell] = a
                continue
            table = _note(table, used, number, b, STAND, t + 1, cell, -1)
            table = _note(table, used + 1, number, a, STAND, t + 1, cell, -1)
            used, number = used + 2, number + 1

        for a in range(n):
            here, there = state_cell[states[t, a]], state_cell[states[t + 1, a]]
            if moves[t, a] >= 0:
                for k in range(swept_ptr[moves[t, a]], swept_ptr[moves[t, a] + 1]):
                    cell = swept_cell[k]
                    if cell in (here, there):
                        continue
                    b = across[cell]
                    if b >= 0:
                        table = _note(table, used, number, b, SWEEP, t, cell, -1)
                        table = _note(table, used + 1, number, a, SWEEP, t, cell, -1)
                        used, number = used + 2, number + 1
                    across[cell] = a
                    for later in range(2):
                        b = after[cell] if later else now[cell]
                        if b >= 0:
                            table = _note(table, used, number, b, STAND, t + later, cell, -1)
                            table = _note(table, used + 1, number, a, SWEEP, t, cell, -1)
                            used, number = used + 2, number + 1

            # Followers: whom this agent follows, and so on, until nobody is there or the ring closes.
            size, b, least = 1, now[there], a
            while there != here and b >= 0 and b != a and size <= n and state_cell[states[t + 1, b]] != there:
                there = state_cell[states[t + 1, b]]
                least = min(least, b)
                b = now[there]
                size += 1
            if b == a and least == a and (size == 2 or (size > 2 and not allow_rotation)):
                for _ in range(size):
                    cell = state_cell[states[t + 1, b]]
                    table = _note(table, used, number, b, ENTER, t, state_cell[states[t, b]], cell)
                    used += 1
                    b = now[cell]
                number += 1

        for a in range(n):
            if moves[t, a] >= 0:
                for k in range(swept_ptr[moves[t, a]], swept_ptr[moves[t, a] + 1]):
                    across[swept_cell[k]] = -1
            now[state_cell[states[t, a]]] = -1
        for a in range(n):
            cell = state_cell[states[t + 1, a]]
            now[cell] = a
            after[cell] = -1
    return table[:used]
