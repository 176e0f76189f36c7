"""Dependency graph: which queued move may start, given who still has to pass through its cells first."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.precedence.arrays import BoolArray, Int64Array, IntArray
from planners.precedence.errors import ExecutionError, StalePlanError
from planners.precedence.following import start_behind
from planners.precedence.queues import (
    NOBODY,
    NONE,
    Queues,
    append,
    cut_off,
    empty_queues,
    end,
    end_all,
    first_in_line,
    granted_tails,
    hold,
    let_go,
    may_start,
    move_at,
    run_through,
    start,
    start_all,
    tails,
    take_places,
    timesteps_left,
    with_room,
)
from planners.precedence.reorder import go_first, held_up
from planners.precedence.steps import legal_steps


class StatePlan(Protocol):
    """What the dependency graph needs to know of a plan."""

    @property
    def states(self) -> IntArray:
        """State of each agent at each timestep, shape (T + 1, n)."""


class DependencyGraph:
    """The action dependency graph of a fleet, built up plan by plan and taken down move by move.

    A move may start when every cell it sweeps is free or its agent's own, and everybody who comes before it in one of
    these cells has been there. So the plan's order per cell is kept while its timing is not, and two agents never
    hold one cell. The order per cell is a line of the visits that are still to come; a cell's last user is
    its line's end, a finished move leaves nothing behind, and memory is bounded by the moves in flight.

    The order at a cell may be exchanged where somebody is late (`go_first`).

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
        states = np.array(start_states, dtype=np.int32)
        self._graph = graph
        self._q = empty_queues(graph, states)
        self._reserved: dict[int, set[int]] = {}  # by agent
        # Asked for in every tick, changed in few: None = not known any more.
        self._tails: IntArray | None = None
        self._granted_tails: IntArray | None = None
        self._held_up: BoolArray | None = None
        self._anyone_held_up = False
        self._all = np.full(len(states), np.iinfo(np.int64).max)
        self._nowhere = np.zeros(graph.n_cells, dtype=np.bool_)

        wrong = np.flatnonzero((states < 0) | (states >= graph.n_states))
        if wrong.size:
            agent = int(wrong[0])
            raise ExecutionError(
                f"dependency graph: start_states[{agent}] = {states[agent]}; valid: states 0..{graph.n_states - 1}"
            )
        agent = int(take_places(self._q))
        if agent < len(states):
            cell = int(graph.state_cell[states[agent]])
            raise ExecutionError(
                f"dependency graph: agents {self._q.holder[cell]} and {agent} both start in cell {cell}; "
                "valid: distinct cells"
            )

    @property
    def queues(self) -> Queues:
        """The arrays behind it, for kernels that only read; the next change may replace them."""
        return self._q

    def extend_lanes(self, graph: LaneGraph) -> None:
        """Go on with lanes of the same states that have more moves, behind those there are."""
        self._graph = graph
        self._q = self._q._replace(
            move_from=graph.move_from, move_to=graph.move_to, swept_ptr=graph.swept_ptr, swept_cell=graph.swept_cell
        )

    # --- plans

    @property
    def n_agents(self) -> int:
        """Number of agents."""
        return len(self._q.state)

    @property
    def n_visits(self) -> int:
        """Visits that wait in the lines of all cells: what the memory grows with."""
        return len(self._q.visit_next) - int(self._q.pool[1])

    def tail_states(self) -> IntArray:
        """State each agent stands in when all its moves are done, shape (n,), read-only."""
        if self._tails is None:
            self._tails = tails(self._q)
            self._tails.flags.writeable = False
        return self._tails

    def granted_states(self) -> IntArray:
        """State each agent stands in when all it was granted is done, shape (n,), read-only."""
        if self._granted_tails is None:
            self._granted_tails = granted_tails(self._q)
            self._granted_tails.flags.writeable = False
        return self._granted_tails

    def timesteps_left(self) -> Int64Array:
        """Timesteps until each agent stands in its tail state, shape (n,), if each move takes one as soon as it may."""
        return timesteps_left(self._q)

    def n_granted_so_far(self) -> Int64Array:
        """Number of moves each agent was granted so far, shape (n,)."""
        return self._q.granted.copy()

    def extend(self, plan: StatePlan) -> None:
        """Queue the moves of a plan behind those there are; a refused plan changes nothing.

        Args:
            plan: Row 0 equals `tail_states()`.

        Raises:
            StalePlanError: Row 0 is something else.
            IllegalPlanError: A step is no move of the graph, or two agents share a cell.
            CyclicPlanError: A closed ring of followers, two agents that swap included.
        """
        states = np.asarray(plan.states)
        self._check_start(states)
        steps = legal_steps(self._graph, states)
        q, move = self._q, steps.move
        new = np.bincount(steps.agent, minlength=self.n_agents)
        n_visits = int((q.swept_ptr[move + 1] - q.swept_ptr[move]).sum())
        self._q = with_room(q, int((q.queued - q.finished + new).max(initial=0)), n_visits)
        append(self._q, steps.timestep, steps.agent, move)
        self._replanned()

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
        self._keep(np.full(self.n_agents, lookahead), ())
        return self.tail_states()

    def has_cycle(self) -> bool:
        """True when some queued moves wait for each other and can never be granted."""
        q = self._q
        return bool((run_through(q, self._all, self._nowhere) < q.queued - q.granted).any())

    # --- grants

    def without_moves(self) -> BoolArray:
        """Whether all moves of each agent are finished, shape (n,)."""
        nothing: BoolArray = self._q.queued == self._q.finished
        return nothing

    def n_queued(self, agent: int) -> int:
        """Moves the agent waits to be granted."""
        return int(self._q.queued[agent] - self._q.granted[agent])

    def n_granted(self, agent: int) -> int:
        """Moves the agent was granted and has not finished."""
        return int(self._q.granted[agent] - self._q.finished[agent])

    def next_moves(self, agent: int) -> list[int]:
        """Queued moves in order."""
        return self._numbered(agent, self._q.granted[agent], self._q.queued[agent])

    def grantable(self, agent: int) -> bool:
        """True when the agent's next queued move may start."""
        return bool(may_start(self._q, agent))

    def grant(self, agent: int) -> int:
        """Let the agent start its next queued move, and give it the cells of that move.

        Returns:
            The move.

        Raises:
            ExecutionError: The move is not grantable.
        """
        if not may_start(self._q, agent):
            raise ExecutionError(
                f"dependency graph: the next move of agent {agent} must not start, it waits for (agent, cell) "
                f"{self.blockers(agent)}; valid: only a grantable agent"
            )
        self._moved()
        return int(start(self._q, agent))

    def grant_all(self, most: int, closed: BoolArray) -> tuple[IntArray, IntArray]:
        """Grant everything that is grantable, agent by agent.

        Args:
            most: Moves an agent may hold a grant for at once.
            closed: Cells into which nobody is let, shape (n_cells,).

        Returns:
            Agents and their moves, in the order of the grants, shape (k,).
        """
        agents = np.empty(self.n_agents * most, dtype=np.int32)
        moves = np.empty_like(agents)
        count = start_all(self._q, most, closed, agents, moves)
        self._moved()
        return agents[:count], moves[:count]

    def grant_behind(self) -> int:
        """Grant moves of agents without a grant into cells that others leave straight ahead of them; returns how many.

        Both hold the cell until the leader has left it, so only for agents that are kept apart while they move: the
        follower must not be faster than its leader.
        """
        self._moved()
        return start_behind(self._q, self._graph.state_heading)

    def finish(self, agent: int) -> int:
        """Take note that the agent's oldest granted move has reached its end, and free what it left.

        Returns:
            The move.

        Raises:
            ExecutionError: No move is granted.
        """
        if self._q.finished[agent] == self._q.granted[agent]:
            raise ExecutionError(f"dependency graph: agent {agent} has no granted move; valid: finish what was granted")
        self._moved()
        return int(end(self._q, agent))

    def finish_all(self, agents: npt.ArrayLike) -> None:
        """Do `finish` for each agent in turn; one may stand there more than once.

        Raises:
            ExecutionError: No move is granted; the agents before are done.
        """
        self._moved()
        in_turn = np.asarray(agents, dtype=np.int32)
        done = end_all(self._q, in_turn)
        if done < len(in_turn):
            self.finish(int(in_turn[done]))

    def blockers(self, agent: int) -> list[tuple[int, int]]:
        """What the agent's next move waits for: pairs (agent, cell) of whoever holds the cell or comes before."""
        q = self._q
        found: list[tuple[int, int]] = []
        for move in self.next_moves(agent)[:1]:
            for cell in self._swept(move):
                for other in (int(q.holder[cell]), int(q.visit_agent[q.line_first[cell]])):
                    if other not in (NOBODY, agent) and (other, cell) not in found:
                        found.append((other, cell))
        return found

    def holders(self) -> IntArray:
        """The agent that holds each cell, -1 = nobody, shape (n_cells,)."""
        return self._q.holder.copy()

    def next_visitors(self) -> IntArray:
        """The agent whose queued move comes first in each cell, -1 = nobody, shape (n_cells,)."""
        return first_in_line(self._q)

    def holds(self, agent: int, cell: int) -> bool:
        """Whether a cell is an agent's now; see `held_cells`."""
        return bool(self._q.holder[cell] == agent)

    def line(self, cell: int) -> list[tuple[int, int]]:
        """Queued moves that sweep a cell, in the order in which they may: pairs (agent, move)."""
        q = self._q
        found: list[tuple[int, int]] = []
        visit = int(q.line_first[cell])
        while visit != NONE:
            agent = int(q.visit_agent[visit])
            found.append((agent, int(move_at(q, agent, q.visit_number[visit]))))
            visit = int(q.visit_next[visit])
        return found

    def held_up(self) -> BoolArray:
        """Agents without a grant whose next cells are all free, but it is not their turn, shape (n,)."""
        return self._known_held_up().copy()

    @property
    def anyone_held_up(self) -> bool:
        """Whether `held_up` says so of any agent."""
        self._known_held_up()
        return self._anyone_held_up

    def go_first(self, agent: int, late: BoolArray) -> bool:
        """Let an agent go before those it waits for, if nobody is there yet and everybody still comes through.

        Args:
            agent: A `held_up` agent.
            late: Agents that will not move for a while, shape (n,); the others are overtaken only if they are so far
                away that they need not wait.

        Returns:
            Whether the agent's next move is grantable now; if not, nothing is changed.
        """
        self._moved()
        return self.n_queued(agent) > 0 and go_first(self._q, agent, late)

    def held_cells(self, agent: int) -> list[int]:
        """Cells that are the agent's now, its own first: where it stands, granted moves, reservations."""
        q = self._q
        cells = {int(q.state_cell[q.state[agent]]): None}
        for move in self._granted(agent):
            cells.update(dict.fromkeys(self._swept(move)))
        cells.update(dict.fromkeys(sorted(self._reserved.get(agent, ()))))
        return list(cells)

    def reservations(self) -> IntArray:
        """Cells that agents have reserved, as rows (agent, cell), shape (k, 2)."""
        pairs = [(agent, cell) for agent, cells in self._reserved.items() for cell in sorted(cells)]
        return np.array(pairs, dtype=np.int32).reshape(-1, 2)

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
            if not 0 <= cell < self._graph.n_cells:
                raise ExecutionError(f"dependency graph: cell {cell}; valid: 0..{self._graph.n_cells - 1}")
        if any(self._q.holder[cell] not in (NOBODY, agent) for cell in wanted):
            return False
        reserved = self._reserved.setdefault(agent, set())
        for cell in wanted - reserved:
            hold(self._q, agent, cell)
        reserved |= wanted
        self._moved()
        return True

    def unreserve(self, agent: int) -> None:
        """Give back all that the agent has reserved."""
        for cell in self._reserved.pop(agent, ()):
            let_go(self._q, cell)
        self._moved()

    def halt(self, agent: int) -> None:
        """Drop the agent's queued moves, and those of others that wait for them or lead through a cell it holds.

        It keeps what it holds, its granted moves included; a plan for the others treats `held_cells` as blocked.
        """
        limits = self._all.copy()
        limits[agent] = 0
        self._keep(limits, self.held_cells(agent))

    def avoid(self, cell: int) -> None:
        """Drop the queued moves that lead through a cell, and those that wait for them; granted moves stay."""
        self._keep(self._all, (cell,))

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
        q = self._q
        cell = int(q.state_cell[state])
        if q.holder[cell] not in (NOBODY, agent):
            raise ExecutionError(
                f"dependency graph: relocate agent {agent} to state {state}, whose cell {cell} is held by agent "
                f"{q.holder[cell]}; valid: a free cell or its own"
            )
        limits = self._all.copy()
        limits[agent] = 0
        self._keep(limits, (cell,))
        hold(q, agent, cell)
        for move in self._granted(agent):
            for swept in self._swept(move):
                let_go(q, swept)
        q.finished[agent] = q.granted[agent]
        let_go(q, q.state_cell[q.state[agent]])
        q.state[agent] = state
        self._replanned()

    # --- internals

    def _moved(self) -> None:
        """Forget what follows from what is granted and held: some of it has changed."""
        self._granted_tails = self._held_up = None

    def _replanned(self) -> None:
        """Forget what follows from the queued moves, too."""
        self._tails = None
        self._moved()

    def _known_held_up(self) -> BoolArray:
        if self._held_up is None:
            self._held_up = held_up(self._q)
            self._anyone_held_up = bool(self._held_up.any())
        return self._held_up

    def _keep(self, limits: Int64Array, closed: Iterable[int]) -> None:
        """Keep the queued moves that need nothing beyond `limits` and no `closed` cell; drop the others."""
        shut = self._nowhere.copy()
        shut[list(closed)] = True
        cut_off(self._q, run_through(self._q, limits, shut))
        self._replanned()

    def _granted(self, agent: int) -> list[int]:
        """Granted moves in order."""
        return self._numbered(agent, self._q.finished[agent], self._q.granted[agent])

    def _numbered(self, agent: int, first: int, last: int) -> list[int]:
        """Moves of an agent with the numbers from `first` to before `last`."""
        if first >= last:
            return []
        moves: list[int] = self._q.moves[agent, np.arange(first, last) % self._q.moves.shape[1]].tolist()
        return moves

    def _swept(self, move: int) -> list[int]:
        cells: list[int] = self._q.swept_cell[self._q.swept_ptr[move] : self._q.swept_ptr[move + 1]].tolist()
        return cells

    def _check_start(self, states: npt.NDArray[np.int32]) -> None:
        n = self.n_agents
        if states.ndim != 2 or states.shape[1] != n or not len(states):
            raise StalePlanError(f"dependency graph: plan of shape {states.shape}; valid: (timesteps + 1, {n})")
        tails = self.tail_states()
        wrong = np.flatnonzero(states[0] != tails)
        if wrong.size:
            agent = int(wrong[0])
            raise StalePlanError(
                f"dependency graph: the plan starts agent {agent} in state {states[0, agent]}; "
                f"valid: {tails[agent]}, where its moves end"
            )
