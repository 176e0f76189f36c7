"""Random asynchronous execution: whatever the speeds and the moments of replanning, nobody meets, nobody is stuck."""

from __future__ import annotations

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import DistanceTable
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Instance, Plan
from planners.precedence.dependency_graph import DependencyGraph
from tests.unit.planners.mapf.lanes import king_grid, one_way_grid, open_grid, random_starts

HORIZON = 10


class Fleet:
    """Agents that take and finish moves at random, and a book of its own about who holds what."""

    def __init__(self, graph: LaneGraph, n: int, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.graph = graph
        self.n = n
        starts = random_starts(graph, n, self.rng)
        self.dependencies = DependencyGraph(graph, starts)
        self.planner = Pibt(seed=seed)
        self.goals = self.rng.integers(graph.n_states, size=n).astype(np.int32)
        self.fixed = np.zeros(n, dtype=np.bool_)
        self.state = list(starts)
        self.granted: list[list[int]] = [[] for _ in range(n)]
        self.extra: list[set[int]] = [set() for _ in range(n)]
        self.n_finished = 0
        self.n_exchanged = 0

    def held(self, agent: int) -> set[int]:
        graph = self.graph
        cells = {int(graph.state_cell[self.state[agent]])} | self.extra[agent]
        for move in self.granted[agent]:
            cells |= set(graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist())
        return cells

    def check_cells(self) -> None:
        held = [self.held(agent) for agent in range(self.n)]
        assert sum(map(len, held)) == len(set().union(*held)), "two agents hold one cell"
        for agent in range(self.n):
            assert set(self.dependencies.held_cells(agent)) == held[agent]

    def check_lines(self) -> None:
        """At each cell an agent comes in its own order, and nobody enters between its coming and its going."""
        graph = self.graph
        after = [self.granted[agent][-1:] for agent in range(self.n)]
        stands = [graph.move_to[moves[0]] if moves else self.state[a] for a, moves in enumerate(after)]
        there = {int(graph.state_cell[state]): agent for agent, state in enumerate(stands)}
        order: list[list[int]] = [[] for _ in range(self.n)]
        for cell in range(graph.n_cells):
            inside = there.get(cell, -1)
            for agent, move in self.dependencies.line(cell):
                leaves = int(graph.state_cell[graph.move_from[move]]) == cell
                enters = int(graph.state_cell[graph.move_to[move]]) == cell
                assert inside == (agent if leaves else -1), "in line before the other has left"
                inside = agent if enters else -1
                order[agent].append(cell)
        for agent in range(self.n):
            moves = self.dependencies.next_moves(agent)
            swept = [int(c) for m in moves for c in graph.swept_cell[graph.swept_ptr[m] : graph.swept_ptr[m + 1]]]
            assert sorted(order[agent]) == sorted(swept), "a turn got lost"

    def plan(self, cut: np.ndarray) -> Plan:
        graph = self.graph
        assert len(set(graph.state_cell[cut].tolist())) == self.n, "the cut leaves two agents in one cell"
        blocked = np.zeros(graph.n_cells, dtype=np.bool_)
        for agent in range(self.n):
            if self.fixed[agent] or self.extra[agent]:
                blocked[list(self.held(agent))] = True
        instance = Instance(
            graph=graph,
            starts=cut,
            goals=self.goals,
            priorities=self.rng.random(self.n),
            stay=self.rng.random(self.n) < 0.5,
            fixed=self.fixed,
            blocked=blocked,
            allow_rotation=False,
            horizon=HORIZON,
        )
        arrived = np.flatnonzero(cut == self.goals)
        self.goals[arrived] = self.rng.integers(graph.n_states, size=len(arrived))
        return self.planner.plan(instance, DistanceTable(graph, blocked))

    def extend(self, plan: Plan) -> None:
        self.dependencies.extend(plan)
        assert not self.dependencies.has_cycle()

    def something_happens(self) -> bool:
        """One random grant or finish; False when nothing can happen any more."""
        dependencies = self.dependencies
        for agent in self.rng.permutation(self.n).tolist():
            may_grant = dependencies.grantable(agent) and not self.fixed[agent]
            may_finish = bool(self.granted[agent]) and not self.fixed[agent]
            if may_grant and (not may_finish or self.rng.random() < 0.6):
                assert dependencies.blockers(agent) == []
                self.granted[agent].append(dependencies.grant(agent))
                return True
            if may_finish:
                move = self.granted[agent].pop(0)
                assert self.state[agent] == self.graph.move_from[move], "a car jumped"
                assert dependencies.finish(agent) == move
                self.state[agent] = int(self.graph.move_to[move])
                self.n_finished += 1
                return True
        return False

    def run(self, events: int) -> None:
        for _ in range(events):
            if not self.something_happens():
                return
            self.check_cells()

    def drain(self) -> None:
        """Whatever is queued gets done."""
        while self.something_happens():
            pass
        self.check_cells()
        dependencies = self.dependencies
        assert [dependencies.n_queued(agent) for agent in range(self.n)] == [0] * self.n, "frozen"
        moving = ~self.fixed
        assert (dependencies.tail_states()[moving] == np.array(self.state)[moving]).all()
        assert dependencies.n_visits == 0, "finished moves leave nothing behind"


GRIDS = {"one_way": one_way_grid(6, 8), "two_way": open_grid(6, 8), "diagonal": king_grid(6, 8)}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("grid", GRIDS)
def test_replans_at_random_moments(grid: str, share: float, seed: int) -> None:
    fleet = Fleet(GRIDS[grid], int(48 * share), seed)
    for _ in range(12):
        cut = fleet.dependencies.commit_cut(int(fleet.rng.integers(0, 4)))
        assert not fleet.dependencies.has_cycle()
        plan = fleet.plan(cut)
        fleet.run(int(fleet.rng.integers(0, 20)))  # the plan is late
        fleet.extend(plan)
        fleet.run(int(fleet.rng.integers(0, 4 * fleet.n)))
        queued = sum(fleet.dependencies.n_queued(agent) for agent in range(fleet.n))
        assert queued <= fleet.n * (HORIZON + 3)
        assert fleet.dependencies.n_visits <= 4 * queued, "memory grows"
    fleet.drain()
    assert fleet.n_finished > 0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("grid", GRIDS)
def test_breakdowns_and_recoveries_at_random_moments(grid: str, seed: int) -> None:
    """Agents die where they are, are recovered elsewhere, and take extra cells for a while."""
    fleet = Fleet(GRIDS[grid], 16, seed)
    dependencies, rng = fleet.dependencies, fleet.rng
    for turn in range(16):
        fleet.extend(fleet.plan(dependencies.commit_cut(int(rng.integers(0, 3)))))
        fleet.run(int(rng.integers(0, 60)))
        agent = int(rng.integers(fleet.n))
        if turn % 4 == 0:
            dependencies.halt(agent)
            assert dependencies.n_queued(agent) == 0
            fleet.fixed[agent] = True
        elif turn % 4 == 1:
            cells = {int(cell) for cell in rng.integers(48, size=3)}
            free = all(cells.isdisjoint(fleet.held(other)) for other in range(fleet.n) if other != agent)
            assert dependencies.reserve(agent, cells) == free
            if free:
                fleet.extra[agent] |= cells
        elif turn % 4 == 2:
            for other in range(fleet.n):
                dependencies.unreserve(other)
                fleet.extra[other] = set()
        else:
            agent = int(np.flatnonzero(fleet.fixed)[0])
            others = set().union(*(fleet.held(other) for other in range(fleet.n) if other != agent))
            states = [s for s in range(fleet.graph.n_states) if int(fleet.graph.state_cell[s]) not in others]
            state = int(rng.choice(states))
            dependencies.relocate(agent, state)
            fleet.fixed[agent], fleet.granted[agent], fleet.state[agent] = False, [], state
        assert not dependencies.has_cycle()
        fleet.check_cells()
    fleet.drain()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("share", [0.3, 0.7])
@pytest.mark.parametrize("grid", GRIDS)
def test_exchanged_turns_at_random_moments(grid: str, share: float, seed: int) -> None:
    """Agents go first at random, among replans and with some agents slower than others; nobody is stuck."""
    fleet = Fleet(GRIDS[grid], int(48 * share), seed)
    dependencies, rng = fleet.dependencies, fleet.rng
    for _ in range(12):
        plan = fleet.plan(dependencies.commit_cut(int(rng.integers(0, 6))))
        for what in ("late", "landed"):
            for _ in range(int(rng.integers(1, 20))):
                fleet.run(int(rng.integers(0, 8)))
                slow = rng.random(fleet.n) < rng.random()
                for agent in rng.permutation(np.flatnonzero(dependencies.held_up())).tolist():
                    before = dependencies.next_moves(agent)
                    if dependencies.go_first(agent, slow):
                        fleet.n_exchanged += 1
                        assert dependencies.grantable(agent)
                        assert dependencies.next_moves(agent) == before
                        fleet.check_lines()
                        assert not dependencies.has_cycle()
            if what == "late":
                fleet.extend(plan)
    fleet.drain()
    assert fleet.n_exchanged > 0 or share > 0.5, "no chance on full lanes, but several on open ones"


def test_every_agent_gets_on_when_replanned_for_a_long_time() -> None:
    """Goals are reached again and again under late plans; the books stay as small as in the beginning."""
    fleet = Fleet(GRIDS["one_way"], 19, 5)
    changes = np.zeros(fleet.n, dtype=np.int64)
    for _ in range(250):
        goals = fleet.goals.copy()
        plan = fleet.plan(fleet.dependencies.commit_cut(2))
        changes += goals != fleet.goals
        for _ in range(10):
            fleet.something_happens()
        fleet.extend(plan)
        for _ in range(40):
            fleet.something_happens()
    assert (changes > 5).all()
    fleet.drain()
