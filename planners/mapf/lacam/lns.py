"""Large-neighbourhood search: takes a few agents out of a plan at a time and leads them through it better."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, FloatArray, Int64Array, IntArray
from planners.mapf.chance import Chance, chance_of, draw, draw_below
from planners.mapf.distance_table import DistanceTable, tables_of
from planners.mapf.kernel import Int, kernel
from planners.mapf.lacam.path_table import Frontier, PathTable, enter, frontier_of, path_table_of, reroute, withdraw
from planners.mapf.lacam.successors import Guide, guide_of
from planners.mapf.problem import Instance, Plan
from planners.mapf.roads import Roads, closed_cells, roads_of
from planners.status import Status

_SIZES = np.array([1, 2, 3, 4, 6, 8], dtype=np.int64)
"""Sizes of a neighbourhood."""
_WAYS = 3
"""Ways to pick one: who is in the way of a delayed agent, who passes a busy place, anybody."""
_ALONG, _AROUND = 0, 1
_MEMORY = 0.995
"""Share of what a kind of neighbourhood has yielded that still counts when it is tried once more."""
_CURIOSITY = 0.1
"""Share of the steps that try any size and way, whatever has paid off so far."""
_MOST_DRAWS = 200
_BATCH = 64
_ATTEMPTS = 12
_FAR = 2**40


class _Choice(NamedTuple):
    """Who can be picked, and what has paid off so far."""

    movable: IntArray
    """Agents that have a goal and may move."""
    starts: IntArray
    least: Int64Array
    """Distance of each agent from its start to its goal."""
    saved: FloatArray
    """Loss saved by each way and size, fading, shape (3 * n_sizes,)."""
    work: FloatArray
    """What that took, in expanded nodes."""
    picked: IntArray
    is_picked: BoolArray
    kept: IntArray
    """The paths of the picked agents before the step, shape (largest size, T + 1)."""
    kept_loss: Int64Array
    queue: IntArray
    seen: BoolArray


class LargeNeighbourhoodSearch:
    """Improves a plan step by step; never makes it worse.

    A step picks a few agents, takes them out, leads each of them along its cheapest path among all others, in a random
    order, and keeps the result unless more is lost. What kind of neighbourhood is picked follows what has paid off.

    Args:
        roads: The open moves.
        guide: Goals and distances.
        states: The plan, shape (T + 1, n). Agents that do not end at their goal are left alone.
        rng: Source of the choices.

    Source: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search",
    IJCAI 2021; as a refiner of LaCAM*: Okumura, "Engineering LaCAM*", AAMAS 2024, https://arxiv.org/abs/2308.04292.
    """

    def __init__(self, roads: Roads, guide: Guide, states: IntArray, rng: np.random.Generator) -> None:
        self._roads, self._guide = roads, guide
        self._table = path_table_of(roads, guide, states)
        self._frontier = frontier_of(self._table)
        self._chance = chance_of(rng)
        n, rows = self._table.path.shape
        movable = np.flatnonzero((guide.row >= 0) & ~guide.fixed & (states[-1] == guide.goals))
        least = np.where(guide.row < 0, 0, guide.distances[guide.row, states[0]]).astype(np.int64)
        self._choice = _Choice(
            movable=movable.astype(np.int32),
            starts=np.array(states[0]),
            least=least,
            saved=np.full(_WAYS * len(_SIZES), 10.0),
            work=np.full(_WAYS * len(_SIZES), 1e4),
            picked=np.zeros(int(_SIZES[-1]), dtype=np.int32),
            is_picked=np.zeros(n, dtype=np.bool_),
            kept=np.zeros((int(_SIZES[-1]), rows), dtype=np.int32),
            kept_loss=np.zeros(int(_SIZES[-1]), dtype=np.int64),
            queue=np.zeros(len(roads.cell), dtype=np.int32),
            seen=np.zeros(len(roads.cell), dtype=np.bool_),
        )

    @property
    def cost(self) -> int:
        """Sum of loss."""
        return int(self._table.loss.sum())

    @property
    def at_bound(self) -> bool:
        """Nothing more can be saved: every agent goes straight to its goal."""
        movable = self._choice.movable
        return bool((self._table.loss[movable] == self._choice.least[movable]).all())

    def run(self, steps: int) -> None:
        """Make a number of steps."""
        if not self.at_bound:
            _improve(self._roads, self._guide, self._table, self._frontier, self._choice, _SIZES, self._chance, steps)

    def start_over(self, spend: Callable[[], bool]) -> None:
        """Lead all agents anew, one after the other, those with the shortest ways first.

        An agent that finds no way is put first, and everything begins again. What comes out replaces the plan if it
        loses less; in a crowd, nothing comes out.

        Args:
            spend: Asked before every 64 agents whether to go on; an attempt that is broken off leaves no trace.

        Source: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 2, 1987 (prioritised planning).
        """
        table, choice = self._table, self._choice
        path, cost = table.path.copy(), self.cost
        movable = choice.movable
        order = movable[np.argsort(choice.least[movable], kind="stable")]
        for agent in movable:
            withdraw(self._roads, table, agent)
        done, attempts = 0, 1
        while done < len(order) and spend():
            batch = order[done : done + _BATCH]
            led = _lead(self._roads, self._guide, table, self._frontier, choice.starts, batch, self._chance)
            done += led
            if led < len(batch):
                if attempts == _ATTEMPTS:
                    break
                attempts += 1
                for agent in order[:done]:
                    withdraw(self._roads, table, agent)
                order = np.concatenate((order[done : done + 1], order[:done], order[done + 1 :]))
                done = 0
        if done == len(order) and self.cost <= cost:
            return
        for agent in order[:done]:
            withdraw(self._roads, table, agent)
        table.path[:] = path
        for agent in movable:
            enter(self._roads, self._guide, table, agent)

    def states(self) -> IntArray:
        """The plan as it is now, up to where the last agent arrives, shape (T + 1, n)."""
        states = np.ascontiguousarray(self._table.path.T)
        moving = np.flatnonzero((states != states[-1]).any(axis=1))
        return states[: moving[-1] + 2 if moving.size else 1]


def improve(
    instance: Instance,
    plan: Plan,
    tables: DistanceTable | None = None,
    deadline: Deadline | None = None,
    rng: np.random.Generator | None = None,
) -> Plan:
    """Lower the sum of loss of a plan.

    Args:
        instance: The instance that the plan solves.
        plan: A legal plan; agents that do not end at their goal keep their paths.
        tables: Distances on the same graph; None = built here.
        deadline: Budget; an iteration is one neighbourhood. None = 1,000 of them.
        rng: Source of the choices; None = seed 0.

    Returns:
        A legal plan that loses no more than the one given, `optimal` if every agent goes straight to its goal.

    Raises:
        PlanningError: The plan is not one of the instance, or `tables` belong to another graph.
    """
    if plan.states.shape[1:] != (instance.n_agents,) or (plan.states[0] != instance.starts).any():
        raise PlanningError("lns: the plan does not begin with the starts of the instance; valid: its own plans")
    tables = tables_of(instance, tables, "lns")
    rng = np.random.default_rng(0) if rng is None else rng
    deadline = Deadline(1000) if deadline is None else deadline
    search = LargeNeighbourhoodSearch(
        roads_of(instance.graph, closed_cells(instance)), guide_of(instance, tables), np.array(plan.states), rng
    )
    spent = 0
    while not search.at_bound and deadline.spend():
        search.run(1)
        spent += 1
    solved = (plan.states[-1] == instance.goals)[instance.goals >= 0].all()
    status = Status.OPTIMAL if solved and search.at_bound else plan.status
    return Plan(states=search.states(), status=status, iterations=spent)


@kernel
def _lead(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    frontier: Frontier,
    starts: IntArray,
    agents: IntArray,
    chance: Chance,
) -> Int:  # pragma: no cover - compiled
    """Enter the cheapest paths of agents, one after the other; returns how many until one has none."""
    for k in range(len(agents)):
        agent = np.int64(agents[k])
        if not reroute(roads, guide, table, frontier, agent, np.int64(starts[agent]), _FAR, chance):
            return k
        enter(roads, guide, table, agent)
    return len(agents)


@kernel
def _improve(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    frontier: Frontier,
    choice: _Choice,
    sizes: Int64Array,
    chance: Chance,
    steps: Int,
) -> None:  # pragma: no cover - compiled
    for _ in range(steps):
        arm = _choose(choice, chance)
        size = min(sizes[arm % len(sizes)], len(choice.movable))
        count = _pick(roads, guide, table, choice, arm // len(sizes), size, chance)
        before, least = np.int64(0), np.int64(0)
        for k in range(count):
            before += table.loss[choice.picked[k]]
            least += choice.least[choice.picked[k]]
        if before == least:
            continue
        expanded = frontier.expanded[0]
        saved = _replan(roads, guide, table, frontier, choice, count, before, least, chance)
        work = frontier.expanded[0] - expanded + table.path.shape[1] * count
        choice.saved[arm] = _MEMORY * choice.saved[arm] + saved
        choice.work[arm] = _MEMORY * choice.work[arm] + work


@kernel
def _choose(choice: _Choice, chance: Chance) -> Int:  # pragma: no cover - compiled
    """Draw a kind of neighbourhood by what it has yielded for its work."""
    n = len(choice.saved)
    total = 0.0
    for k in range(n):
        total += choice.saved[k] / choice.work[k]
    rest = draw(chance) * total
    if draw(chance) >= _CURIOSITY:
        for k in range(n):
            rest -= choice.saved[k] / choice.work[k]
            if rest < 0.0:
                return np.int64(k)
    return np.int64(draw_below(chance, n))


@kernel
def _replan(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    frontier: Frontier,
    choice: _Choice,
    count: Int,
    before: Int,
    least: Int,
    chance: Chance,
) -> Int:  # pragma: no cover - compiled
    """Lead the picked agents anew; returns the loss that it saves, 0 also when everything stays as it was."""
    picked, path = choice.picked, table.path
    for k in range(count):
        other = k + draw_below(chance, count - k)
        picked[k], picked[other] = picked[other], picked[k]
    for k in range(count):
        agent = np.int64(picked[k])
        withdraw(roads, table, agent)
        choice.kept_loss[k] = table.loss[agent]
        for t in range(path.shape[1]):
            choice.kept[k, t] = path[agent, t]
    left, to_come = np.int64(before), np.int64(least)
    done = 0
    while done < count:
        agent = np.int64(picked[done])
        to_come -= choice.least[agent]
        start = np.int64(choice.starts[agent])
        if not reroute(roads, guide, table, frontier, agent, start, left - to_come, chance):
            break
        enter(roads, guide, table, agent)
        left -= table.loss[agent]
        done += 1
    if done == count:
        return left
    for k in range(done):
        withdraw(roads, table, np.int64(picked[k]))
    for k in range(count):
        agent = np.int64(picked[k])
        for t in range(path.shape[1]):
            path[agent, t] = choice.kept[k, t]
        enter(roads, guide, table, agent)
    return np.int64(0)


@kernel
def _pick(
    roads: Roads, guide: Guide, table: PathTable, choice: _Choice, way: Int, size: Int, chance: Chance
) -> Int:  # pragma: no cover - compiled
    """Pick agents; returns how many."""
    delay = np.int64(0)
    for agent in choice.movable:
        delay += table.loss[agent] - choice.least[agent]
    rest = draw_below(chance, delay)
    seed = np.int64(choice.movable[0])
    for agent in choice.movable:
        rest -= table.loss[agent] - choice.least[agent]
        if rest < 0:
            seed = np.int64(agent)
            break
    count = _note(guide, choice, np.int64(0), seed, size)
    if way == _ALONG:
        count = _pick_along(roads, guide, table, choice, seed, count, size, chance)
    elif way == _AROUND:
        count = _pick_around(roads, guide, table, choice, seed, count, size, chance)
    for _ in range(_MOST_DRAWS):
        if count == size:
            break
        count = _note(guide, choice, count, np.int64(choice.movable[draw_below(chance, len(choice.movable))]), size)
    for k in range(count):
        choice.is_picked[choice.picked[k]] = False
    return np.int64(count)


@kernel
def _note(guide: Guide, choice: _Choice, count: Int, agent: Int, size: Int) -> Int:  # pragma: no cover
    """Pick one more agent, unless it is picked already or cannot move. Compiled."""
    if count == size or agent < 0 or choice.is_picked[agent] or guide.row[agent] < 0 or guide.fixed[agent]:
        return count
    choice.picked[count] = agent
    choice.is_picked[agent] = True
    return count + 1


@kernel
def _pick_along(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    choice: _Choice,
    seed: Int,
    count: Int,
    size: Int,
    chance: Chance,
) -> Int:  # pragma: no cover - compiled
    """Whoever is in the way when the seed tries at random to arrive earlier than it does."""
    path, row = table.path[seed], guide.row[seed]
    arrival = len(path) - 1
    while arrival > 0 and path[arrival - 1] == guide.goals[seed]:
        arrival -= 1
    for _ in range(10):
        if count == size or arrival == 0:
            break
        t = draw_below(chance, arrival)
        state = np.int64(path[t])
        while t < arrival and count < size:
            n_moves = roads.ptr[state + 1] - roads.ptr[state]
            turn = draw_below(chance, n_moves + 1)
            further = np.int64(-1)
            for k in range(n_moves + 1):
                which = (k + turn) % (n_moves + 1)
                to = np.int64(roads.to[roads.ptr[state] + which]) if which < n_moves else state
                if t + 1 + np.int64(guide.distances[row, to]) < arrival:
                    further = to
                    break
            if further < 0:
                break
            count = _note(guide, choice, count, np.int64(table.occupant[roads.cell[further], t + 1]), size)
            ahead = np.int64(table.occupant[roads.cell[further], t])
            if ahead >= 0 and roads.cell[table.path[ahead, t + 1]] == roads.cell[state]:
                count = _note(guide, choice, count, ahead, size)
            state = further
            t += 1
    return count


@kernel
def _pick_around(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    choice: _Choice,
    seed: Int,
    count: Int,
    size: Int,
    chance: Chance,
) -> Int:  # pragma: no cover - compiled
    """Whoever is near a place of the seed's path around the time when it is there."""
    path = table.path[seed]
    last = len(path) - 1
    arrival = last
    while arrival > 0 and path[arrival - 1] == guide.goals[seed]:
        arrival -= 1
    when = draw_below(chance, arrival + 1)
    queue, seen = choice.queue, choice.seen
    queue[0] = path[when]
    seen[path[when]] = True
    head, tail = 0, 1
    while head < tail and count < size:
        state = np.int64(queue[head])
        head += 1
        cell = roads.cell[state]
        for offset in range(-3, 4):
            t = when + offset
            if 0 <= t <= last:
                count = _note(guide, choice, count, np.int64(table.occupant[cell, t]), size)
        for move in range(roads.ptr[state], roads.ptr[state + 1]):
            to = roads.to[move]
            if not seen[to]:
                seen[to] = True
                queue[tail] = to
                tail += 1
    for k in range(tail):
        seen[queue[k]] = False
    return count
