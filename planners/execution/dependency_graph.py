"""Dependency graph: which queued move may start, given who still has to pass through its cells first."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import islice, pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.execution.errors import ExecutionError, StalePlanError
from planners.execution.steps import legal_steps

IntArray = npt.NDArray[np.int32]

FREE = -1


class StatePlan(Protocol):
    """What the dependency graph needs to know of a plan."""

    @property
    def states(self) -> IntArray:
        """State of each agent at each timestep, shape (T + 1, n)."""


class DependencyGraph:
    """The action dependency graph of a fleet, built up plan by plan and taken down move by move.

    A move may start when every cell it sweeps is free or its agent's own, and everybody who comes before it in one of
    these cells has been there. So the plan's order per cell is kept while its timing is not, and two agents never
    hold one cell. The order per cell is stored as a queue of the agents that are still to come; a cell's last user is
    its queue's end, a finished move leaves nothing behind, and memory is bounded by the queued moves.

    A plan without rotation closes no cycle: its moves come after all earlier ones, and in one timestep followers
    form chains. Every queued move can therefore be granted sooner or later, whatever the speeds.

    Args:
        graph: Lane graph.
        start_states: State of each agent, shape (n,); distinct cells.

    Raises:
        ExecutionError: A state does not exist or two agents stand in one cell.

    Source: Hönig, Kiesel, Tinka, Durham, Ayanian, "Persistent and Robust Execution of MAPF Schedules in Warehouses",
    IEEE RA-L 4(2), 2019, section IV. The cut of queued moves at a replan follows LSMART, arXiv 2602.15721, 2026.
    """

    def __init__(self, graph: LaneGraph, start_states: npt.ArrayLike) -> None:
        states = [int(state) for state in np.asarray(start_states)]
        self._graph = graph
        self._state_cell: list[int] = graph.state_cell.tolist()
        self._move_to: list[int] = graph.move_to.tolist()
        swept, ptr = graph.swept_cell.tolist(), graph.swept_ptr.tolist()
        self._swept = [tuple(swept[a:b]) for a, b in pairwise(ptr)]

        self._state = states  # the last state reached
        self._tail = list(states)  # the state after all granted and queued moves
        self._queued: list[deque[int]] = [deque() for _ in states]  # moves in order
        self._granted: list[deque[int]] = [deque() for _ in states]
        self._reserved: list[set[int]] = [set() for _ in states]
        self._holder = [FREE] * graph.n_cells
        self._holds = [0] * graph.n_cells  # reasons to hold: the agent's position, granted moves, a reservation
        self._coming: dict[int, deque[int]] = {}  # agents whose queued moves sweep the cell, in order

        for agent, state in enumerate(states):
            if not 0 <= state < graph.n_states:
                raise ExecutionError(
                    f"dependency graph: start_states[{agent}] = {state}; valid: states 0..{graph.n_states - 1}"
                )
            cell = self._state_cell[state]
            if self._holder[cell] != FREE:
                raise ExecutionError(
                    f"dependency graph: agents {self._holder[cell]} and {agent} both start in cell {cell}; "
                    "valid: distinct cells"
                )
            self._hold(agent, cell)

    # --- plans

    def tail_states(self) -> IntArray:
        """State each agent stands in when all its moves are done, shape (n,)."""
        return np.array(self._tail, dtype=np.int32)

    def extend(self, plan: StatePlan) -> None:
        """Queue the moves of a plan behind those there are; a refused plan changes nothing.

        Args:
            plan: Row 0 equals `tail_states()`.

        Raises:
            StalePlanError: Row 0 is something else.
            IllegalPlanError: A step is no move of the graph, or two agents share a cell.
            CyclicPlanError: A closed ring of followers, two agents that swap included.
        """
        graph = self._graph
        states = np.asarray(plan.states)
        self._check_start(states)
        steps = legal_steps(graph, states)
        timestep, agent, moves = steps.timestep, steps.agent, steps.move

        by_agent = np.argsort(agent, kind="stable")
        ends = np.flatnonzero(np.diff(agent[by_agent], append=-1)) + 1
        ordered = moves[by_agent].tolist()
        begin = 0
        for who, end in zip(agent[by_agent][ends - 1].tolist(), ends.tolist(), strict=True):
            self._queued[who].extend(ordered[begin:end])
            begin = end

        # Order per cell: by timestep, and in one timestep whoever leaves before whoever enters.
        counts = graph.swept_ptr[moves + 1] - graph.swept_ptr[moves]
        use = np.repeat(np.arange(len(moves)), counts)
        swept = graph.swept_cell[_ranges(graph.swept_ptr[moves], counts)]
        entering = swept != graph.state_cell[graph.move_from[moves]][use]
        by_cell = np.argsort((swept * np.int64(len(states)) + timestep[use]) * 2 + entering, kind="stable")
        ends = np.flatnonzero(np.diff(swept[by_cell], append=-1)) + 1
        visitors = agent[use[by_cell]].tolist()
        coming = self._coming
        begin = 0
        for cell, end in zip(swept[by_cell][ends - 1].tolist(), ends.tolist(), strict=True):
            line = coming.get(cell)
            if line is None:
                coming[cell] = deque(visitors[begin:end])
            else:
                line.extend(visitors[begin:end])
            begin = end
        self._tail = states[-1].tolist()

    def commit_cut(self, lookahead: int) -> IntArray:
        """Keep the next few moves of each agent and drop the rest, to plan anew from where they end.

        Granted moves stay; of the queued ones each agent keeps up to `lookahead`, fewer where a move waits for one
        that is dropped.

        Args:
            lookahead: Queued moves to keep, >= 0.

        Returns:
            The new `tail_states()`, shape (n,); distinct cells.

        Raises:
            ExecutionError: `lookahead` is negative.
        """
        if lookahead < 0:
            raise ExecutionError(f"dependency graph: lookahead = {lookahead}; valid: an integer >= 0")
        self._keep([lookahead] * len(self._state))
        return self.tail_states()

    def has_cycle(self) -> bool:
        """True when some queued moves wait for each other and can never be granted."""
        kept, _ = self._executable([len(queue) for queue in self._queued], frozenset())
        return sum(kept) < sum(map(len, self._queued))

    # --- grants

    def n_queued(self, agent: int) -> int:
        """Moves the agent waits to be granted."""
        return len(self._queued[agent])

    def n_granted(self, agent: int) -> int:
        """Moves the agent was granted and has not finished."""
        return len(self._granted[agent])

    def next_moves(self, agent: int) -> list[int]:
        """Queued moves in order."""
        return list(self._queued[agent])

    def grantable(self, agent: int) -> bool:
        """True when the agent's next queued move may start."""
        queue = self._queued[agent]
        if not queue:
            return False
        holder, coming = self._holder, self._coming
        for cell in self._swept[queue[0]]:
            if coming[cell][0] != agent:
                return False
            held_by = holder[cell]
            if held_by not in (FREE, agent):
                return False
        return True

    def grant(self, agent: int) -> int:
        """Let the agent start its next queued move, and give it the cells of that move.

        Returns:
            The move.

        Raises:
            ExecutionError: The move is not grantable.
        """
        if not self.grantable(agent):
            raise ExecutionError(
                f"dependency graph: the next move of agent {agent} must not start, it waits for (agent, cell) "
                f"{self.blockers(agent)}; valid: only a grantable agent"
            )
        move = self._queued[agent].popleft()
        self._granted[agent].append(move)
        coming, holder, holds = self._coming, self._holder, self._holds
        for cell in self._swept[move]:
            line = coming[cell]
            line.popleft()
            if not line:
                del coming[cell]
            holder[cell] = agent
            holds[cell] += 1
        return move

    def finish(self, agent: int) -> int:
        """Take note that the agent's oldest granted move has reached its end, and free what it left.

        Returns:
            The move.

        Raises:
            ExecutionError: No move is granted.
        """
        if not self._granted[agent]:
            raise ExecutionError(f"dependency graph: agent {agent} has no granted move; valid: finish what was granted")
        move = self._granted[agent].popleft()
        before, state = self._state[agent], self._move_to[move]
        self._state[agent] = state
        self._holds[self._state_cell[state]] += 1
        holder, holds = self._holder, self._holds
        for cell in self._swept[move]:
            holds[cell] -= 1
            if not holds[cell]:
                holder[cell] = FREE
        self._release(self._state_cell[before])
        return move

    def blockers(self, agent: int) -> list[tuple[int, int]]:
        """What the agent's next move waits for: pairs (agent, cell) of whoever holds the cell or comes before."""
        queue = self._queued[agent]
        found: list[tuple[int, int]] = []
        if not queue:
            return found
        for cell in self._swept[queue[0]]:
            for other in (self._holder[cell], self._coming[cell][0]):
                if other not in (FREE, agent) and (other, cell) not in found:
                    found.append((other, cell))
        return found

    def held_cells(self, agent: int) -> list[int]:
        """Cells that are the agent's now, its own first: where it stands, granted moves, reservations."""
        cells = {self._state_cell[self._state[agent]]: None}
        for move in self._granted[agent]:
            cells.update(dict.fromkeys(self._swept[move]))
        cells.update(dict.fromkeys(sorted(self._reserved[agent])))
        return list(cells)

    # --- exceptions

    def reserve(self, agent: int, cells: Iterable[int]) -> bool:
        """Give an agent extra cells, in addition to those it has reserved, for a manoeuvre beside the plan.

        Whoever is to come through them waits until `unreserve`; the manoeuvre must therefore not wait for others.

        Returns:
            False, with nothing changed, when another agent holds one of them.

        Raises:
            ExecutionError: A cell is not on the floor.
        """
        wanted = set(cells)
        for cell in wanted:
            if not 0 <= cell < len(self._holder):
                raise ExecutionError(f"dependency graph: cell {cell}; valid: 0..{len(self._holder) - 1}")
        if any(self._holder[cell] not in (FREE, agent) for cell in wanted):
            return False
        for cell in wanted - self._reserved[agent]:
            self._hold(agent, cell)
        self._reserved[agent] |= wanted
        return True

    def unreserve(self, agent: int) -> None:
        """Give back all that the agent has reserved."""
        for cell in self._reserved[agent]:
            self._release(cell)
        self._reserved[agent] = set()

    def halt(self, agent: int) -> None:
        """Drop the agent's queued moves, and those of others that wait for them or lead through a cell it holds.

        It keeps what it holds, its granted moves included; a plan for the others treats `held_cells` as blocked.
        """
        limits = [len(queue) for queue in self._queued]
        limits[agent] = 0
        self._keep(limits, closed=frozenset(self.held_cells(agent)))

    def avoid(self, cell: int) -> None:
        """Drop the queued moves that lead through a cell, and those that wait for them; granted moves stay."""
        self._keep([len(queue) for queue in self._queued], closed=frozenset((cell,)))

    def relocate(self, agent: int, state: int) -> None:
        """Put an agent into another state: its moves are void, and it holds that state's cell (and reservations).

        Queued moves of others that wait for its dropped moves or lead through the new cell are dropped.

        Raises:
            ExecutionError: The state does not exist or another agent holds its cell.
        """
        if not 0 <= state < self._graph.n_states:
            raise ExecutionError(
                f"dependency graph: relocate agent {agent} to state {state}; valid: 0..{self._graph.n_states - 1}"
            )
        cell = self._state_cell[state]
        if self._holder[cell] not in (FREE, agent):
            raise ExecutionError(
                f"dependency graph: relocate agent {agent} to state {state}, whose cell {cell} is held by agent "
                f"{self._holder[cell]}; valid: a free cell or its own"
            )
        self._hold(agent, cell)
        for move in self._granted[agent]:
            for swept in self._swept[move]:
                self._release(swept)
        self._granted[agent].clear()
        self._release(self._state_cell[self._state[agent]])
        self._state[agent] = state
        limits = [len(queue) for queue in self._queued]
        limits[agent] = 0
        self._keep(limits, closed=frozenset((cell,)))

    # --- internals

    def _hold(self, agent: int, cell: int) -> None:
        self._holder[cell] = agent
        self._holds[cell] += 1

    def _release(self, cell: int) -> None:
        self._holds[cell] -= 1
        if not self._holds[cell]:
            self._holder[cell] = FREE

    def _keep(self, limits: list[int], closed: frozenset[int] = frozenset()) -> None:
        """Keep the queued moves that need nothing beyond `limits` and no `closed` cell; drop the others."""
        kept, self._coming = self._executable(limits, closed)
        for agent, queue in enumerate(self._queued):
            for _ in range(len(queue) - kept[agent]):
                queue.pop()
            last = queue or self._granted[agent]
            self._tail[agent] = self._move_to[last[-1]] if last else self._state[agent]

    def _executable(self, limits: list[int], closed: frozenset[int]) -> tuple[list[int], dict[int, deque[int]]]:
        """Run the queues without their timing: which moves come through when each agent does at most `limits`.

        The order in which they are tried does not matter: a move that can be executed stays so.

        Returns:
            Moves executed per agent, and the order per cell of these moves alone.
        """
        kept = [0] * len(self._queued)
        passed: dict[int, int] = {}  # visitors of the cell that are through
        order: dict[int, deque[int]] = {}
        upcoming = [
            list(islice(queue, limit)) if limit > 0 else [] for queue, limit in zip(self._queued, limits, strict=True)
        ]
        lines: dict[int, list[int]] = {}
        todo = [agent for agent, moves in enumerate(upcoming) if moves]
        while todo:
            agent = todo.pop()
            moves = upcoming[agent]
            while kept[agent] < len(moves):
                swept = self._swept[moves[kept[agent]]]
                if not closed.isdisjoint(swept):
                    break
                for cell in swept:
                    if cell not in lines:
                        lines[cell] = list(self._coming[cell])
                    if lines[cell][passed.get(cell, 0)] != agent:
                        break
                else:
                    kept[agent] += 1
                    for cell in swept:
                        through = passed[cell] = passed.get(cell, 0) + 1
                        order.setdefault(cell, deque()).append(agent)
                        line = lines[cell]
                        if through < len(line) and line[through] != agent:
                            todo.append(line[through])
                    continue
                break
        return kept, order

    def _check_start(self, states: npt.NDArray[np.int32]) -> None:
        n = len(self._tail)
        if states.ndim != 2 or states.shape[1] != n or not len(states):
            raise StalePlanError(f"dependency graph: plan of shape {states.shape}; valid: (timesteps + 1, {n})")
        wrong = np.flatnonzero(states[0] != self._tail)
        if wrong.size:
            agent = int(wrong[0])
            raise StalePlanError(
                f"dependency graph: the plan starts agent {agent} in state {states[0, agent]}; "
                f"valid: {self._tail[agent]}, where its moves end"
            )


def _ranges(start: npt.NDArray[np.integer], count: npt.NDArray[np.integer]) -> npt.NDArray[np.intp]:
    """All of start[i] .. start[i] + count[i] - 1, one after the other."""
    skipped = np.cumsum(count) - count
    values: npt.NDArray[np.intp] = np.arange(int(count.sum())) + np.repeat(start - skipped, count)
    return values
