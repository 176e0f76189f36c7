"""LaCAM*: proofs against brute force, hard little puzzles, and what its settings do."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.lacam.lacam import Lacam, LacamConfig
from planners.mapf.metrics import sum_of_loss
from planners.mapf.problem import Plan
from planners.mapf.validate import breaches, conflicts
from planners.status import Status
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    king_grid,
    one_way_grid,
    open_grid,
    random_starts,
    rotating_grid,
)

Configuration = tuple[int, ...]
SMALL: dict[str, Callable[[], LaneGraph]] = {
    "two_way": lambda: open_grid(2, 3),
    "dead_ends": lambda: graph_of(range(5), [(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2), (1, 4), (4, 1)]),
    "diagonal": lambda: king_grid(2, 3),
    "rotating": lambda: rotating_grid(1, 3),
    "one_way": lambda: one_way_grid(2, 4),
}


def legal_steps(graph: LaneGraph, n: int, *, rotation: bool) -> dict[Configuration, list[Configuration]]:
    """Every configuration of n agents and its successors, as the referee judges them."""
    nexts = [
        [state, *graph.move_to[graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]].tolist()]
        for state in range(graph.n_states)
    ]
    steps: dict[Configuration, list[Configuration]] = {}
    for now in itertools.product(range(graph.n_states), repeat=n):
        if len({int(graph.state_cell[state]) for state in now}) < n:
            continue
        steps[now] = []
        for after in itertools.product(*(nexts[state] for state in now)):
            plan = Plan(states=np.array([now, after], dtype=np.int32), status=Status.FEASIBLE, iterations=0)
            if not conflicts(graph, plan, allow_rotation=rotation):
                steps[now].append(after)
    return steps


def least_loss(
    steps: dict[Configuration, list[Configuration]], start: Configuration, goal: Configuration
) -> int | None:
    """Dijkstra over configurations; None = the goal is out of reach."""
    best = {start: 0}
    queue = [(0, start)]
    while queue:
        cost, now = heapq.heappop(queue)
        if now == goal:
            return cost
        if cost > best[now]:
            continue
        for after in steps[now]:
            then = cost + sum((a, b) != (g, g) for a, b, g in zip(now, after, goal, strict=True))
            if then < best.get(after, then + 1):
                best[after] = then
                heapq.heappush(queue, (then, after))
    return None


@pytest.mark.parametrize("rotation", [False, True])
@pytest.mark.parametrize("graph", SMALL)
def test_what_is_proved_is_what_brute_force_finds(graph: str, rotation: bool) -> None:
    lanes = SMALL[graph]()
    n = 3 if graph in {"two_way", "dead_ends"} else 2
    steps = legal_steps(lanes, n, rotation=rotation)
    rng = np.random.default_rng(3)
    seen = set()
    for seed in range(30):
        starts, goals = random_starts(lanes, n, rng), random_starts(lanes, n, rng)
        instance = instance_of(lanes, starts, goals, allow_rotation=rotation, horizon=1000)
        plan = Lacam(seed=seed).plan(instance, None, Deadline(300_000))
        least = least_loss(steps, tuple(starts), tuple(goals))
        seen.add(plan.status)
        assert breaches(instance, plan) == []
        if least is None:
            assert plan.status is Status.INFEASIBLE
        else:
            assert plan.status is Status.OPTIMAL
            assert sum_of_loss(instance, plan) == least
            assert (plan.states[-1] == instance.goals).all()
    assert Status.OPTIMAL in seen


def test_a_sliding_puzzle_of_eight_is_solved() -> None:
    """Eight agents on nine cells; the goal is reached by legal shifts, so that there is a way."""
    graph = open_grid(3, 3)
    rng = np.random.default_rng(0)
    for seed in range(3):
        board = [*range(8), -1]
        hole = 8
        for _ in range(60):
            row, col = divmod(hole, 3)
            near = [hole + d for d, ok in ((-3, row > 0), (3, row < 2), (-1, col > 0), (1, col < 2)) if ok]
            tile = int(rng.choice(near))
            board[hole], board[tile], hole = board[tile], -1, tile
        goals = [board.index(agent) for agent in range(8)]
        instance = instance_of(graph, list(range(8)), goals, horizon=10**6)
        plan = Lacam(LacamConfig(refine=False), seed=seed).plan(instance, None, Deadline(50_000))
        assert plan.status in (Status.FEASIBLE, Status.OPTIMAL)
        assert breaches(instance, plan) == []
        assert (plan.states[-1] == instance.goals).all()


def test_four_agents_reverse_their_order_in_a_corridor_with_one_bay() -> None:
    corridor = [pair for k in range(8) for pair in ((k, k + 1), (k + 1, k))]
    graph = graph_of(range(10), [*corridor, (4, 9), (9, 4)])
    instance = instance_of(graph, [0, 1, 8, 7], [8, 7, 0, 1], horizon=10**5)
    plan = Lacam().plan(instance, None, Deadline(50_000))
    assert plan.status in (Status.FEASIBLE, Status.OPTIMAL)
    assert breaches(instance, plan) == []
    assert (plan.states[-1] == instance.goals).all()


def test_more_work_never_makes_the_plan_worse() -> None:
    rng = np.random.default_rng(1)
    graph = open_grid(8, 8)
    instance = instance_of(graph, random_starts(graph, 30, rng), random_starts(graph, 30, rng), horizon=1000)
    costs = [sum_of_loss(instance, Lacam().plan(instance, None, Deadline(budget))) for budget in (200, 500, 2000)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_more_samples_are_drawn_when_asked_for() -> None:
    rng = np.random.default_rng(1)
    graph = open_grid(8, 8)
    instance = instance_of(graph, random_starts(graph, 30, rng), random_starts(graph, 30, rng), horizon=1000)
    first = [Lacam(LacamConfig(samples=samples, refine=False, patience=0)).plan(instance).states for samples in (1, 20)]
    assert first[0].shape != first[1].shape or (first[0] != first[1]).any()


@pytest.mark.parametrize(("name", "value"), [("samples", 0), ("patience", -1)])
def test_settings_out_of_range_are_refused(name: str, value: int) -> None:
    with pytest.raises(PlanningError, match=f"lacam: {name} = {value}"):
        LacamConfig(**{name: value})
