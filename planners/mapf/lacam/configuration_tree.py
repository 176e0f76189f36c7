"""Configuration tree: the search of LaCAM* over configurations of all agents, which stops and goes on at will."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.mapf.arrays import BoolArray, Int64Array, IntArray
from planners.mapf.chance import Chance, chance_of, draw, mixed
from planners.mapf.inheritance import clear
from planners.mapf.kernel import Int, kernel
from planners.mapf.lacam.successors import Board, Guide, board_of, complete, constrain, set_out
from planners.mapf.roads import Roads

_FAR = 2**60
_RESTART_SHARE = 0.001
"""How often the search goes back to the start instead of a configuration it has met before."""

_EXHAUSTED, _SPENT, _FULL, _IMPROVED = range(4)
_N_NODES, _N_PARTS, _N_EDGES, _N_OPEN, _GOAL = range(5)


class _Memory(NamedTuple):
    """The search tree. A node is a configuration; its `parts` are the partial successors that are still to be tried.

    Parts of a node form a queue (breadth first); a part constrains one more agent than its parent part.
    """

    counts: Int64Array
    """Used length of the pools below, and the goal node or -1."""
    states: IntArray
    """Shape (nodes, n)."""
    urgency: npt.NDArray[np.float32]
    """Timesteps of each agent since it was at its goal, and a fraction that tells equals apart, shape (nodes, n)."""
    order: IntArray
    """Agents by urgency, the most urgent first, shape (nodes, n)."""
    cost: Int64Array
    """Least loss known from the start, shape (nodes,)."""
    left: Int64Array
    """Sum of the distances to the goals: a lower bound of what is still to come."""
    parent: IntArray
    first_part: IntArray
    last_part: IntArray
    first_edge: IntArray
    on_queue: BoolArray
    reopened: BoolArray
    queue: IntArray
    """Working memory of the rewiring."""
    part_next: IntArray
    part_parent: IntArray
    part_agent: IntArray
    part_state: IntArray
    edge_to: IntArray
    edge_next: IntArray
    open: IntArray
    """Stack of nodes, shape (2 * nodes,)."""
    drawn: IntArray
    """Working memory: the successor just drawn and the best one, shape (2, n)."""
    slots: IntArray
    """Hash table of nodes, -1 = free; its length is a power of two."""


class ConfigurationTree:
    """LaCAM*: depth-first over configurations, lazily over their successors, and rewired whenever a way gets shorter.

    Complete: without a solution it ends with the proof that there is none. Anytime: after the first solution it goes
    on, and ends with the proof that the best one it has loses least.

    Args:
        roads: The open moves.
        guide: Goals and distances; agents with a goal must be able to reach it.
        starts: States at the beginning, shape (n,).
        urgency: Order in which agents choose at the beginning, each in [0, 1), larger first, shape (n,).
        samples: Successors to draw for one expansion; the one with the least cost to come is taken.
        rng: Source of the tie-breaking.

    Source: Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023,
    https://arxiv.org/abs/2305.03632; drawing several successors: Okumura, "Engineering LaCAM*: towards real-time,
    large-scale, and near-optimal multi-agent pathfinding", AAMAS 2024, https://arxiv.org/abs/2308.04292.
    """

    def __init__(
        self,
        roads: Roads,
        guide: Guide,
        starts: IntArray,
        urgency: npt.NDArray[np.float64],
        *,
        samples: int,
        rng: np.random.Generator,
    ) -> None:
        self._roads, self._guide = roads, guide
        self._samples = samples
        self._chance: Chance = chance_of(rng)
        self._board: Board = board_of(roads, len(starts))
        self._memory = _empty(len(starts), 64)
        self._memory.urgency[-1] = urgency  # the unused last row stands in for a parent
        self._memory.order[-1] = np.argsort(-urgency, kind="stable")
        _add(guide, self._memory, starts, -1, 0)
        self.exhausted = False
        """The search has come to its end: the best solution is proved, or that there is none."""

    @property
    def found(self) -> bool:
        """Whether there is a solution yet."""
        return bool(self._memory.counts[_GOAL] >= 0)

    @property
    def cost(self) -> int:
        """Sum of loss of the best solution."""
        return int(self._memory.cost[self._memory.counts[_GOAL]])

    @property
    def n_bytes(self) -> int:
        """Memory of the tree."""
        return sum(pool.nbytes for pool in self._memory)

    def search(self, iterations: int, bound: int | None = None) -> int:
        """Go on until a solution, or a better one, is found, or the search ends.

        Args:
            iterations: Expansions to make at most.
            bound: Sum of loss of a solution known from elsewhere: only better ones are looked for.

        Returns:
            Expansions made.
        """
        done = 0
        while True:
            n, end = _search(
                self._roads,
                self._guide,
                self._board,
                self._memory,
                self._chance,
                self._samples,
                iterations - done,
                _FAR if bound is None else bound,
            )
            done += n
            if end != _FULL:
                self.exhausted = end == _EXHAUSTED
                return int(done)
            self._memory = _grown(self._memory)

    def solution(self) -> IntArray:
        """Configurations from the start to the goal, or to the one closest to it so far, shape (T + 1, n)."""
        memory = self._memory
        node = int(memory.counts[_GOAL])
        if node < 0:
            node = int(np.argmin(memory.left[: memory.counts[_N_NODES]]))
        rows = []
        while node >= 0:
            rows.append(memory.states[node])
            node = int(memory.parent[node])
        return np.array(rows[::-1])


def _empty(n: int, nodes: int) -> _Memory:
    def ints(*shape: int) -> IntArray:
        return np.full(shape, -1, dtype=np.int32)

    counts = np.zeros(5, dtype=np.int64)
    counts[_GOAL] = -1
    return _Memory(
        counts=counts,
        states=ints(nodes, n),
        urgency=np.zeros((nodes, n), dtype=np.float32),
        order=ints(nodes, n),
        cost=np.zeros(nodes, dtype=np.int64),
        left=np.zeros(nodes, dtype=np.int64),
        parent=ints(nodes),
        first_part=ints(nodes),
        last_part=ints(nodes),
        first_edge=ints(nodes),
        on_queue=np.zeros(nodes, dtype=np.bool_),
        reopened=np.zeros(nodes, dtype=np.bool_),
        queue=ints(nodes),
        part_next=ints(8 * nodes),
        part_parent=ints(8 * nodes),
        part_agent=ints(8 * nodes),
        part_state=ints(8 * nodes),
        edge_to=ints(2 * nodes),
        edge_next=ints(2 * nodes),
        open=ints(2 * nodes),
        drawn=ints(2, n),
        slots=ints(4 * nodes),
    )


def _grown(memory: _Memory) -> _Memory:
    """The same tree with pools of twice the length, where they are more than half full."""

    def longer(pool: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
        return np.concatenate((pool, np.full_like(pool, -1 if pool.dtype == np.int32 else 0)))

    counts = memory.counts
    grown = memory._asdict()
    groups = {
        _N_NODES: (
            *("states", "urgency", "order", "cost", "left", "parent", "first_part", "last_part", "first_edge"),
            *("on_queue", "reopened", "queue"),
        ),
        _N_PARTS: ("part_next", "part_parent", "part_agent", "part_state"),
        _N_EDGES: ("edge_to", "edge_next"),
        _N_OPEN: ("open",),
    }
    for count, names in groups.items():
        if 2 * counts[count] > len(grown[names[0]]):
            for name in names:
                grown[name] = longer(grown[name])
    while len(grown["open"]) < counts[_N_OPEN] + len(grown["cost"]) + 1:
        grown["open"] = longer(grown["open"])
    if len(grown["slots"]) < 4 * len(grown["cost"]):
        grown["slots"] = np.full(4 * len(grown["cost"]), -1, dtype=np.int32)
        _fill_slots(grown["states"], int(counts[_N_NODES]), grown["slots"])
    return _Memory(**grown)


@kernel
def _slot_of(states: IntArray, slots: IntArray, wanted: IntArray) -> Int:  # pragma: no cover - compiled
    """Where a configuration is in the hash table, or the free slot where it belongs."""
    word = np.uint64(0)
    for agent in range(len(wanted)):
        word = mixed(word ^ np.uint64(wanted[agent] + 1))
    mask = len(slots) - 1
    slot = np.int64(word & np.uint64(mask))
    while slots[slot] >= 0:
        node = slots[slot]
        same = True
        for agent in range(len(wanted)):
            if states[node, agent] != wanted[agent]:
                same = False
                break
        if same:
            return slot
        slot = (slot + 1) & mask
    return slot


@kernel
def _fill_slots(states: IntArray, n_nodes: Int, slots: IntArray) -> None:  # pragma: no cover - compiled
    for node in range(n_nodes):
        slots[_slot_of(states, slots, states[node])] = node


@kernel
def _left_of(guide: Guide, states: IntArray) -> Int:  # pragma: no cover - compiled
    total = np.int64(0)
    for agent in range(len(states)):
        if guide.row[agent] >= 0:
            total += guide.distances[guide.row[agent], states[agent]]
    return total


@kernel
def _loss_of(guide: Guide, now: IntArray, after: IntArray) -> Int:  # pragma: no cover - compiled
    total = np.int64(0)
    for agent in range(len(now)):
        goal = guide.goals[agent]
        if goal >= 0 and (now[agent] != goal or after[agent] != goal):
            total += 1
    return total


@kernel
def _add(guide: Guide, memory: _Memory, states: IntArray, parent: Int, cost: Int) -> Int:  # pragma: no cover - compiled
    """Put a new configuration into the tree and on the stack; the agents away from their goals become more urgent."""
    counts = memory.counts
    node = np.int64(counts[_N_NODES])
    counts[_N_NODES] += 1
    for agent in range(len(states)):
        memory.states[node, agent] = states[agent]
        before = memory.urgency[parent, agent]
        if guide.goals[agent] >= 0 and states[agent] != guide.goals[agent]:
            memory.urgency[node, agent] = before + np.float32(1.0)
        else:
            memory.urgency[node, agent] = before - np.floor(before)
    _sort(memory, node, parent)
    memory.slots[_slot_of(memory.states, memory.slots, memory.states[node])] = node
    memory.parent[node] = parent
    memory.cost[node] = cost
    memory.left[node] = _left_of(guide, states)
    memory.first_edge[node] = -1
    part = counts[_N_PARTS]
    counts[_N_PARTS] += 1
    memory.part_next[part] = -1
    memory.part_parent[part] = -1
    memory.part_agent[part] = -1
    memory.first_part[node] = part
    memory.last_part[node] = part
    memory.open[counts[_N_OPEN]] = node
    counts[_N_OPEN] += 1
    _note_goal(memory, node)
    return node


@kernel
def _sort(memory: _Memory, node: Int, parent: Int) -> None:  # pragma: no cover - compiled
    """Order the agents of a node by urgency: an insertion sort, because the order of its parent is nearly right.

    Those who have just arrived go to the end first, which would be long ways for an insertion.
    """
    order, urgency, before = memory.order[node], memory.urgency[node], memory.order[parent]
    count = 0
    for waiting in range(2):
        for k in range(len(before)):
            agent = before[k]
            if (urgency[agent] < 1.0) == (waiting == 1):
                place = count
                while place > 0 and urgency[order[place - 1]] < urgency[agent]:
                    order[place] = order[place - 1]
                    place -= 1
                order[place] = agent
                count += 1


@kernel
def _note_goal(memory: _Memory, node: Int) -> None:  # pragma: no cover - compiled
    """Agents without a goal can end anywhere, so more than one configuration may do: keep the cheapest."""
    goal = memory.counts[_GOAL]
    if memory.left[node] == 0 and (goal < 0 or memory.cost[node] < memory.cost[goal]):
        memory.counts[_GOAL] = node


@kernel
def _link(memory: _Memory, node: Int, to: Int) -> None:  # pragma: no cover - compiled
    edge = memory.first_edge[node]
    while edge >= 0:
        if memory.edge_to[edge] == to:
            return
        edge = memory.edge_next[edge]
    edge = memory.counts[_N_EDGES]
    memory.counts[_N_EDGES] += 1
    memory.edge_to[edge] = to
    memory.edge_next[edge] = memory.first_edge[node]
    memory.first_edge[node] = edge


@kernel
def _rewire(guide: Guide, memory: _Memory, node: Int, bound: Int) -> None:  # pragma: no cover - compiled
    """Pass on a way that got shorter to all configurations beyond; they are worth another look.

    The paper's update by Dijkstra over *neigh*, with a queue in place of a heap: whose g falls again comes again.
    """
    n_nodes = memory.counts[_N_NODES]
    queue, reopened = memory.queue, memory.reopened
    for k in range(n_nodes):
        reopened[k] = False
    queue[0] = node
    head, n_waiting = 0, 1
    memory.on_queue[node] = True
    while n_waiting > 0:
        at = queue[head]
        head = (head + 1) % n_nodes
        n_waiting -= 1
        memory.on_queue[at] = False
        edge = memory.first_edge[at]
        while edge >= 0:
            to = memory.edge_to[edge]
            edge = memory.edge_next[edge]
            cost = memory.cost[at] + _loss_of(guide, memory.states[at], memory.states[to])
            if cost < memory.cost[to]:
                memory.cost[to] = cost
                memory.parent[to] = at
                _note_goal(memory, np.int64(to))
                if not reopened[to] and cost + memory.left[to] < bound:
                    reopened[to] = True
                    memory.open[memory.counts[_N_OPEN]] = to
                    memory.counts[_N_OPEN] += 1
                if not memory.on_queue[to]:
                    memory.on_queue[to] = True
                    queue[(head + n_waiting) % n_nodes] = to
                    n_waiting += 1


@kernel
def _search(
    roads: Roads,
    guide: Guide,
    board: Board,
    memory: _Memory,
    chance: Chance,
    samples: Int,
    iterations: Int,
    bound: Int,
) -> tuple[Int, Int]:  # pragma: no cover - compiled
    """Expand nodes; returns how many, and why it stopped.

    The names of the phases, in capitals below, are those of LaCAM*: *Open* is the stack `open`, *Explored* the hash
    table `slots`, a node's *tree* of constraints its `parts`, its *neigh* its edges, and g and h are `cost` and `left`.
    """
    counts = memory.counts
    n = memory.states.shape[1]
    widest = board.keys.shape[1]
    after, best = memory.drawn[0], memory.drawn[1]
    for done in range(iterations):
        # SELECT: the top of Open. A node leaves it when its tree is used up, or when it cannot lead to anything better
        # than the best solution: f = g + h is not below that (branch and bound).
        if counts[_GOAL] >= 0:
            bound = min(bound, memory.cost[counts[_GOAL]])
        while counts[_N_OPEN] > 0:
            node = memory.open[counts[_N_OPEN] - 1]
            if memory.first_part[node] >= 0 and memory.cost[node] + memory.left[node] < bound:
                break
            counts[_N_OPEN] -= 1
        if counts[_N_OPEN] == 0:
            return done, _EXHAUSTED
        # Not of the paper: an expansion that would not fit into the pools is not begun.
        if (
            counts[_N_NODES] == len(memory.cost)
            or counts[_N_PARTS] + widest >= len(memory.part_next)
            or counts[_N_EDGES] == len(memory.edge_to)
            or counts[_N_OPEN] + counts[_N_NODES] + 1 > len(memory.open)
        ):
            return done, _FULL

        # LOW-LEVEL NODE: the next constraint of the node's tree, breadth first.
        node = np.int64(memory.open[counts[_N_OPEN] - 1])
        now = memory.states[node]
        part = np.int64(memory.first_part[node])
        memory.first_part[node] = memory.part_next[part]
        order = memory.order[node]

        # CONFIGURATION GENERATOR: PIBT completes what the constraint and its parents leave open; of several samples the
        # one with the least f is taken. On the way LOW-LEVEL EXPANSION: the constraints of the next agent are queued.
        least = _FAR
        depth = 0
        for sample in range(samples):
            set_out(roads, guide, board, now, after)
            legal = True
            at = part
            depth = 0
            while memory.part_agent[at] >= 0:
                legal = legal and constrain(
                    guide, board, now, after, np.int64(memory.part_agent[at]), np.int64(memory.part_state[at])
                )
                at = memory.part_parent[at]
                depth += 1
            if legal and sample == 0 and depth < n:
                _split(roads, memory, node, part, np.int64(order[depth]), now)
            legal = legal and complete(roads, guide, board, now, after, order, chance)
            clear(board.options, board.claims, now)
            if not legal:
                break
            to_come = _loss_of(guide, now, after) + _left_of(guide, after)
            if to_come < least:
                least = to_come
                for agent in range(n):
                    best[agent] = after[agent]
        if least == _FAR:
            continue

        # EXPLORED?
        cost = memory.cost[node] + _loss_of(guide, now, best)
        known = memory.slots[_slot_of(memory.states, memory.slots, best)]
        if known < 0:  # HIGH-LEVEL EXPANSION: a new node
            to = _add(guide, memory, best, node, cost)
            _link(memory, node, to)
        else:  # LINK: a new edge to a known one, and REWIRE, if it is a shorter way; then go on there, or at the start
            to = np.int64(known)
            if to != node:
                _link(memory, node, to)
            if cost < memory.cost[to]:
                memory.cost[to] = cost
                memory.parent[to] = node
                _note_goal(memory, to)
                _rewire(guide, memory, to, bound)
            memory.open[counts[_N_OPEN]] = to if draw(chance) >= _RESTART_SHARE else 0
            counts[_N_OPEN] += 1
        if counts[_GOAL] >= 0 and memory.cost[counts[_GOAL]] < bound:
            return done + 1, _IMPROVED
    return iterations, _SPENT


@kernel
def _split(
    roads: Roads, memory: _Memory, node: Int, part: Int, agent: Int, now: IntArray
) -> None:  # pragma: no cover - compiled
    """Low-level expansion: queue the parts that constrain one more agent, one for each of its next states."""
    first, last = roads.ptr[now[agent]], roads.ptr[now[agent] + 1]
    for move in range(first - 1, last):
        child = memory.counts[_N_PARTS]
        memory.counts[_N_PARTS] += 1
        memory.part_next[child] = -1
        memory.part_parent[child] = part
        memory.part_agent[child] = agent
        memory.part_state[child] = now[agent] if move < first else roads.to[move]
        if memory.first_part[node] < 0:
            memory.first_part[node] = child
        else:
            memory.part_next[memory.last_part[node]] = child
        memory.last_part[node] = child
