"""Answers by exhaustion, for tests only: slow, plain, and without a line in common with a planner or the referee."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence

from maps.lane_graph import LaneGraph
from planners.mapf.problem import NO_GOAL, Instance

Row = tuple[int, ...]


class Rules:
    """What agents may do in one timestep."""

    def __init__(self, graph: LaneGraph, *, blocked: Sequence[int] = (), allow_rotation: bool = False) -> None:
        self.cell = graph.state_cell.tolist()
        self.allow_rotation = allow_rotation
        self.options: list[list[int]] = [[state] for state in range(graph.n_states)]
        self.beside: dict[tuple[int, int], set[int]] = {}
        """Cells that a move sweeps besides its ends."""
        for move in range(graph.n_moves):
            a, b = int(graph.move_from[move]), int(graph.move_to[move])
            swept = set(graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist())
            if (swept | {self.cell[b]}) - {self.cell[a]} & set(blocked):
                continue
            self.options[a].append(b)
            self.beside[a, b] = swept - {self.cell[a], self.cell[b]}

    def agree(self, now: Row, after: Row) -> bool:
        """Whether the agents can make these steps, each possible alone, together."""
        old, new = [self.cell[s] for s in now], [self.cell[s] for s in after]
        if len(set(new)) < len(new):
            return False
        beside = [self.beside.get(step, set()) for step in zip(now, after, strict=True)]
        for a, swept in enumerate(beside):
            if swept and any(swept & ({old[b], new[b]} | beside[b]) for b in range(len(now)) if b != a):
                return False
        entered = {old[a]: new[a] for a in range(len(now)) if old[a] != new[a]}
        for first, second in entered.items():
            cell, size = second, 1
            while cell in entered and cell != first and size <= len(now):
                cell, size = entered[cell], size + 1
            if cell == first and (size == 2 or not self.allow_rotation):
                return False
        return True

    def steps(self, row: Row) -> list[Row]:
        """Everything that the agents can do next."""
        return [after for after in itertools.product(*(self.options[s] for s in row)) if self.agree(row, after)]

    def distances(self, goal: int) -> list[float]:
        """Timesteps to a goal from each state, for an agent that is alone."""
        left = [0.0 if goal in (NO_GOAL, state) else math.inf for state in range(len(self.cell))]
        for _ in left:
            left = [
                min(left[state], 1 + min(left[after] for after in self.options[state])) for state in range(len(left))
            ]
        return left


def rules_of(instance: Instance) -> Rules:
    blocked = [cell for cell in range(instance.graph.n_cells) if instance.blocked[cell]]
    return Rules(instance.graph, blocked=blocked, allow_rotation=instance.allow_rotation)


def least_sum_of_costs(instance: Instance) -> int | None:
    """Least sum over the agents of the timesteps until each stands at its goal for good; None = there is no solution.

    Dijkstra over where all agents are and who has finished, ordered by the cost so far and the sum of what each
    would still need alone: an agent costs 1 a timestep until it finishes, which it may do in its goal, or anywhere
    without one, and stands still from then on.
    """
    rules = rules_of(instance)
    starts, goals = tuple(instance.starts.tolist()), instance.goals.tolist()
    stay, fixed = instance.stay.tolist(), instance.fixed.tolist()
    agents = range(len(starts))
    left = [rules.distances(goal) for goal in goals]
    steps: dict[Row, list[Row]] = {}
    queue: list[tuple[float, float, Row, tuple[bool, ...]]] = []
    best: dict[tuple[Row, tuple[bool, ...]], float] = {}

    def offer(cost: float, row: Row, done: tuple[bool, ...]) -> None:
        """Queue every choice of who finishes now; whoever stays, or never moves, has none."""
        choices = []
        for a in agents:
            there = goals[a] in (NO_GOAL, row[a])
            must = fixed[a] or (stay[a] and row[a] == goals[a])
            choices.append([True] if done[a] or (there and must) else [False, True] if there else [False])
        need = cost + sum(left[a][row[a]] for a in agents)
        for finished in itertools.product(*choices):
            if need < math.inf and cost < best.get((row, finished), math.inf):
                best[row, finished] = cost
                heapq.heappush(queue, (need, cost, row, finished))

    offer(0, starts, (False,) * len(starts))
    while queue:
        _, cost, row, done = heapq.heappop(queue)
        if cost > best[row, done]:
            continue
        if all(done):
            return int(cost)
        if row not in steps:
            steps[row] = rules.steps(row)
        still = [a for a in agents if done[a] or fixed[a]]
        for after in steps[row]:
            if all(after[a] == row[a] for a in still):
                offer(cost + done.count(False), after, done)
    return None


def earliest_finish(instance: Instance, agent: int, others: Sequence[Row], *, limit: int = 400) -> int | None:
    """Timesteps until one agent stands at its goal for good while all others do as they are told; None = never.

    Args:
        instance: The problem.
        agent: Who is free to choose.
        others: A row per timestep with the states of all agents, of which `agent`'s own are ignored; after the last
            row nobody moves.
        limit: Timesteps after which the search ends.
    """
    rules = rules_of(instance)
    goal, stay = int(instance.goals[agent]), bool(instance.stay[agent])
    rows = [list(row) for row in others]

    def step(t: int, a: int, b: int) -> bool:
        now, after = list(rows[min(t, len(rows) - 1)]), list(rows[min(t + 1, len(rows) - 1)])
        now[agent], after[agent] = a, b
        return rules.agree(tuple(now), tuple(after))

    def for_good(t: int, state: int) -> bool:
        return all(step(later, state, state) for later in range(t, max(t, len(rows) - 1) + 1))

    there = {int(instance.starts[agent])}
    for t in range(limit):
        if any(goal in (NO_GOAL, state) and for_good(t, state) for state in there):
            return t
        there = {
            after
            for state in there
            if not (stay and state == goal)
            for after in rules.options[state]
            if step(t, state, after)
        }
    return None
