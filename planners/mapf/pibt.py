"""PIBT: every agent takes its best step, and pushes whoever stands there out of the way first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import UNREACHABLE, DistanceTable, tables_of
from planners.mapf.options import Options, options_of
from planners.mapf.problem import NO_GOAL, BoolArray, Instance, IntArray, Plan
from planners.status import Status

Int64Array = npt.NDArray[np.int64]

# A key orders the options of an agent: distance left after it, then its class, then chance; it ends in its number.
_DISTANCE_BIT = 24
_CLASS_BIT = 22
_NUMBER_BITS = 12
_WAIT = 1 << _CLASS_BIT
_OCCUPIED = 2 << _CLASS_BIT
_TURN = 3 << _CLASS_BIT
_NUMBER = (1 << _NUMBER_BITS) - 1
_CHANCE = (1 << _CLASS_BIT) - (1 << _NUMBER_BITS)
_NO_KEY = 2**62


@dataclass(frozen=True, kw_only=True)
class PibtConfig:
    """Settings of `Pibt`."""

    impatience: float = 1.0
    """Priority an agent gains with each timestep of the window that ends away from its goal."""

    def __post_init__(self) -> None:
        if not self.impatience >= 0:
            raise PlanningError(f"pibt: impatience = {self.impatience}; valid: a number >= 0")


class Pibt:
    """Priority inheritance with backtracking on lane-graph states, one agent per cell.

    Greedy: complete for none of the hard instances, but a step costs microseconds, and every plan is legal whatever
    the instance. Steps are ordered by the distance that is left after them. A wait counts at the agent's own
    distance, so an agent waits before it takes a detour, and takes a free step sideways before it waits.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Source: Okumura, Machida, Défago, Tamura, "Priority Inheritance with Backtracking for Iterative Multi-agent Path
    Finding", Artificial Intelligence 310, 2022, algorithm 1, https://doi.org/10.1016/j.artint.2022.103752. Refusing
    closed rings, the swept cells, the turns on the spot and the waits that beat a detour are additions.
    """

    def __init__(self, config: PibtConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = PibtConfig() if config is None else config
        self._rng = np.random.default_rng(seed)
        self._stepper: Stepper | None = None

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan one window.

        Args:
            instance: The window.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one timestep of all agents.

        Returns:
            A plan that is legal from its first row to its last, whatever its status.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        graph = instance.graph
        tables = tables_of(instance, tables, "pibt")
        deadline = Deadline() if deadline is None else deadline
        distances, row = tables.rows(instance.goals)
        if self._stepper is None or not self._stepper.fits(graph, instance.blocked):
            self._stepper = Stepper(graph, instance.blocked, seed=self._rng)

        n = instance.n_agents
        states = np.empty((instance.horizon + 1, n), dtype=np.int32)
        states[0] = instance.starts
        content = instance.goals == NO_GOAL
        priority = np.array(instance.priorities, dtype=np.float64)
        order = np.lexsort((-priority, content)).astype(np.int32)
        done = 0
        while done < instance.horizon and deadline.spend():
            at_goal = states[done] == instance.goals
            if (at_goal & ~content).any():  # the order of the others does not change while all gain alike
                content |= at_goal
                order = np.lexsort((-priority, content)).astype(np.int32)
            self._stepper.step(
                states[done],
                states[done + 1],
                distances=distances,
                row=row,
                order=order,
                locked=instance.fixed | (instance.stay & at_goal),
                allow_rotation=instance.allow_rotation,
            )
            done += 1
            priority += self.config.impatience * ~content
        return Plan(states=states[: done + 1], status=_status(instance, distances, row, done), iterations=done)


def _status(instance: Instance, distances: npt.NDArray[np.uint16], row: IntArray, done: int) -> Status:
    has_goal = row >= 0
    left = distances[row[has_goal], instance.starts[has_goal]]
    if (left >= UNREACHABLE).any():
        return Status.INFEASIBLE
    return Status.FEASIBLE if done == instance.horizon else Status.TIMEOUT


class Stepper:
    """Decides one timestep of all agents; keeps its working memory, so that a step touches only the agents' cells.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
        seed: Seed of the tie-breaking; each step draws on.
    """

    def __init__(self, graph: LaneGraph, blocked: BoolArray, *, seed: int | np.random.Generator = 0) -> None:
        self.graph = graph
        self.options: Options = options_of(graph, blocked)
        self._blocked = blocked.copy()
        self.salt = int(np.random.default_rng(seed).integers(2**62))
        """State of the tie-breaking: steps from the same salt and the same arguments are the same."""
        self._floor = np.full((graph.n_cells, 2), -1, dtype=np.int32)
        self._crossed = np.full(graph.n_cells if self.options.has_sweeps else 1, -1, dtype=np.int32)
        self._keys = np.empty((0, self.options.widest + 1), dtype=np.int64)
        self._chain = np.empty((3, 0), dtype=np.int32)

    def fits(self, graph: LaneGraph, blocked: BoolArray) -> bool:
        """Whether this is the floor that steps are decided on."""
        return graph is self.graph and np.array_equal(blocked, self._blocked)

    def step(
        self,
        now: IntArray,
        after: IntArray,
        *,
        distances: npt.NDArray[np.uint16],
        row: IntArray,
        order: IntArray,
        locked: BoolArray,
        allow_rotation: bool,
    ) -> None:
        """Decide one timestep.

        Args:
            now: State of each agent, shape (n,), in distinct cells.
            after: Receives the state of each agent one timestep later, shape (n,).
            distances: Timesteps to goals, shape (n_rows, n_states), as `DistanceTable.rows` gives them.
            row: Row of each agent's goal, shape (n,), negative = none.
            order: Agents, the one that chooses first in front, shape (n,).
            locked: Agents that do not move, shape (n,).
            allow_rotation: Whether a closed ring of followers is legal.
        """
        n = len(now)
        if len(self._keys) < n:
            self._keys = np.empty((n, self.options.widest + 1), dtype=np.int64)
            self._chain = np.empty((3, n), dtype=np.int32)
        self.salt += 1
        options, graph = self.options, self.graph
        _step(
            options.aim,
            options.start,
            options.sweep,
            options.has_turns,
            options.has_sweeps,
            graph.state_cell,
            graph.swept_ptr,
            graph.swept_cell,
            distances,
            row,
            order,
            locked,
            allow_rotation,
            self.salt,
            now,
            after,
            self._floor,
            self._crossed,
            self._keys,
            self._chain,
        )


@njit(cache=True, nogil=True)
def _step(
    aim: IntArray,
    start: IntArray,
    sweep: IntArray,
    has_turns: bool,
    has_sweeps: bool,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    distances: npt.NDArray[np.uint16],
    row: IntArray,
    order: IntArray,
    locked: BoolArray,
    allow_rotation: bool,
    salt: int,
    now: IntArray,
    after: IntArray,
    floor: IntArray,
    crossed: IntArray,
    keys: Int64Array,
    chain: IntArray,
) -> None:  # pragma: no cover - compiled
    """Fill `after`, shape (n,), from `now`, shape (n,).

    `floor` holds who stands in each cell now and who after the timestep, `crossed` who sweeps over it on the way;
    all are -1 before and after the call. An agent is undecided while goes[agent], the cell it aims at, is -1.
    """
    n, n_keys = len(now), keys.shape[1]
    home, goes, stack = chain[0], chain[1], chain[2]
    _place(state_cell, locked, now, after, home, goes, floor)
    _rank(aim, start, has_turns, distances, row, locked, salt, now, home, floor, keys)

    for leader in order:
        if goes[leader] >= 0:
            continue
        # The push chain is an explicit stack: each agent on it tries its options in turn.
        depth = 0
        stack[0] = leader
        while depth >= 0:
            agent = stack[depth]
            here = home[agent]
            best = _NO_KEY
            for k in range(n_keys):
                best = min(best, keys[agent, k])
            if best == _NO_KEY:  # nowhere to go: stay, and the agent behind takes its step back
                goes[agent] = here
                after[agent] = now[agent]
                floor[here, 1] = agent
                depth -= 1
                if depth >= 0:
                    agent = stack[depth]
                    goes[agent] = -1
                    if has_sweeps:
                        _sweep_back(agent, now[agent], after[agent], aim, sweep, swept_ptr, swept_cell, crossed)
                continue
            number = best & _NUMBER
            keys[agent, number] = _NO_KEY
            if number == 0:
                if floor[here, 1] != -1:
                    continue
                goes[agent] = here
                after[agent] = now[agent]
                floor[here, 1] = agent
                break
            option = number - 1
            to = aim[now[agent], option, 1]
            if floor[to, 1] != -1:
                continue
            ahead = floor[to, 0]
            if to == here:
                ahead = -1
            if ahead >= 0 and goes[ahead] >= 0:
                if goes[ahead] == here:
                    continue  # swap
                if not allow_rotation and _closes_ring(agent, ahead, floor, goes):
                    continue
            if has_sweeps:
                if crossed[to] != -1 or not _is_clear(
                    sweep[now[agent], option], here, to, swept_ptr, swept_cell, floor, crossed
                ):
                    continue
                _sweep_over(agent, sweep[now[agent], option], here, to, swept_ptr, swept_cell, crossed)
            goes[agent] = to
            after[agent] = start[now[agent], option, 0] if has_turns else aim[now[agent], option, 0]
            floor[to, 1] = agent
            if ahead < 0 or goes[ahead] >= 0:
                break  # the whole chain moves
            depth += 1
            stack[depth] = ahead

    if has_turns:
        _hold_back(now, after, home, goes, state_cell, floor, stack)
    for agent in range(n):
        floor[home[agent], 0] = -1
        floor[goes[agent], 1] = -1
        if has_sweeps:
            _sweep_back(agent, now[agent], after[agent], aim, sweep, swept_ptr, swept_cell, crossed)


@njit(cache=True, nogil=True)
def _place(
    state_cell: IntArray,
    locked: BoolArray,
    now: IntArray,
    after: IntArray,
    home: IntArray,
    goes: IntArray,
    floor: IntArray,
) -> None:  # pragma: no cover - compiled
    """Put all agents on the floor, undecided but for those that do not move."""
    for agent in range(len(now)):
        cell = state_cell[now[agent]]
        home[agent] = cell
        floor[cell, 0] = agent
        goes[agent] = -1
        if locked[agent]:
            goes[agent] = cell
            floor[cell, 1] = agent
            after[agent] = now[agent]


@njit(cache=True, nogil=True)
def _rank(
    aim: IntArray,
    start: IntArray,
    has_turns: bool,
    distances: npt.NDArray[np.uint16],
    row: IntArray,
    locked: BoolArray,
    salt: int,
    now: IntArray,
    home: IntArray,
    floor: IntArray,
    keys: Int64Array,
) -> None:  # pragma: no cover - compiled
    """Give every option of every agent its key; option 0 is to wait.

    All agents in one loop, before any of them decides: the far memory that the distances lie in is then read for many
    agents at a time.
    """
    for agent in range(len(now)):
        if locked[agent]:
            continue
        state, here, goal_row = now[agent], home[agent], row[agent]
        noise = (salt ^ (agent * 0x9E3779B97F4A7C1)) * 0x2545F4914F6CDD1D
        noise ^= noise >> 29
        keys[agent, 0] = 0
        own = np.int64(0)
        if goal_row >= 0:
            own = np.int64(distances[goal_row, state]) + 1
            if own <= UNREACHABLE:
                keys[agent, 0] = (own << _DISTANCE_BIT) | _WAIT
        for option in range(aim.shape[1]):
            target, to = aim[state, option, 0], aim[state, option, 1]
            if target < 0:
                keys[agent, option + 1 :] = _NO_KEY
                break
            noise ^= noise << 13
            noise ^= noise >> 7
            noise ^= noise << 17
            key = (noise & _CHANCE) | (option + 1)
            left = np.int64(1)
            if has_turns:
                left += start[state, option, 1]
            if goal_row >= 0:
                left += np.int64(distances[goal_row, target])
            if to == here:
                key |= _TURN
            elif left == own and floor[to, 0] != -1:
                key |= _OCCUPIED
            keys[agent, option + 1] = key | (left << _DISTANCE_BIT)


@njit(cache=True, nogil=True)
def _closes_ring(agent: int, ahead: int, floor: IntArray, goes: IntArray) -> bool:  # pragma: no cover - compiled
    """Whether following `ahead`, who follows somebody in turn, ends at `agent` again."""
    while goes[ahead] >= 0:
        beyond = floor[goes[ahead], 0]
        if beyond == agent:
            return True
        if beyond < 0 or beyond == ahead:
            return False
        ahead = beyond
    return False


@njit(cache=True, nogil=True)
def _is_clear(
    move: int, here: int, to: int, swept_ptr: IntArray, swept_cell: IntArray, floor: IntArray, crossed: IntArray
) -> bool:  # pragma: no cover - compiled
    """Whether the cells that a move touches besides its two ends are nobody's; move -1 touches none."""
    if move < 0:
        return True
    for k in range(swept_ptr[move], swept_ptr[move + 1]):
        cell = swept_cell[k]
        if cell not in (here, to) and (floor[cell, 0] != -1 or floor[cell, 1] != -1 or crossed[cell] != -1):
            return False
    return True


@njit(cache=True, nogil=True)
def _sweep_over(
    agent: int, move: int, here: int, to: int, swept_ptr: IntArray, swept_cell: IntArray, crossed: IntArray
) -> None:  # pragma: no cover - compiled
    if move < 0:
        return
    for k in range(swept_ptr[move], swept_ptr[move + 1]):
        cell = swept_cell[k]
        if cell not in (here, to):
            crossed[cell] = agent


@njit(cache=True, nogil=True)
def _sweep_back(
    agent: int,
    now: int,
    after: int,
    aim: IntArray,
    sweep: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    crossed: IntArray,
) -> None:  # pragma: no cover - compiled
    """Give back what an agent's move swept over."""
    for option in range(aim.shape[1]):
        move = sweep[now, option]
        if aim[now, option, 0] == after and move >= 0:
            for k in range(swept_ptr[move], swept_ptr[move + 1]):
                if crossed[swept_cell[k]] == agent:
                    crossed[swept_cell[k]] = -1


@njit(cache=True, nogil=True)
def _hold_back(
    now: IntArray,
    after: IntArray,
    home: IntArray,
    goes: IntArray,
    state_cell: IntArray,
    floor: IntArray,
    trail: IntArray,
) -> None:  # pragma: no cover - compiled
    """Let everyone wait who would enter the cell of an agent that only turns, and everyone behind them.

    Afterwards after[agent] is what happens; goes[agent] is still what was aimed at.
    """
    n = len(now)
    # Encode the verdict in `home`: ~cell = judged.
    for leader in range(n):
        length = 0
        agent = leader
        moves = True
        while True:
            if home[agent] < 0:  # judged before, or a ring that has closed
                moves = state_cell[after[agent]] != ~home[agent]
                break
            home[agent] = ~home[agent]
            if state_cell[after[agent]] == ~home[agent]:
                moves = False
                break
            trail[length] = agent
            length += 1
            agent = floor[goes[agent], 0]
            if agent < 0:
                break
        if not moves:
            for k in range(length):
                after[trail[k]] = now[trail[k]]
    for agent in range(n):
        home[agent] = ~home[agent]
