"""PIBT: every agent takes its best step, and pushes whoever stands there out of the way first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, Int64Array, IntArray
from planners.mapf.distance_table import UNREACHABLE, DistanceTable, tables_of
from planners.mapf.inheritance import PUSHED, UNDECIDED, Claims, claims_of, clear, enter, push, stay
from planners.mapf.kernel import Int, inlined, kernel
from planners.mapf.options import Options, options_of
from planners.mapf.problem import NOBODY, Instance, Plan
from planners.mapf.window import goals_to_look_up, plan_window, reachable_goals

# A key orders the options of an agent: distance left after it, then its class, then chance; it ends in its number.
_DISTANCE_BIT = 24
_CLASS_BIT = 22
_NUMBER_BITS = 12
_WAIT = 1 << _CLASS_BIT
_OCCUPIED = 2 << _CLASS_BIT
_TURN = 3 << _CLASS_BIT
_CHANCE = (1 << _CLASS_BIT) - (1 << _NUMBER_BITS)
_USED_UP = 2**62
_UNRANKED = -1
"""In place of the key of waiting: an agent that wants to stay where it is, whose options nobody has asked for yet."""
_WISHED = -2
"""Key of the option that an agent is told to prefer: less than any other."""
_NO_WISHES = np.empty(0, dtype=np.int32)


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
        distances, row = tables.rows(goals_to_look_up(instance, tables))
        if self._stepper is None or not self._stepper.fits(graph, instance.blocked):
            self._stepper = Stepper(graph, instance.blocked, seed=self._rng)

        step = partial(self._stepper.step, distances=distances, row=row, allow_rotation=instance.allow_rotation)
        reachable = reachable_goals(instance, distances, row)
        return plan_window(instance, step, deadline, impatience=self.config.impatience, reachable=reachable)


class NextWishes(NamedTuple):
    """What is asked of one timestep; n agents."""

    distances: npt.NDArray[np.uint16]
    """Timesteps to goals, shape (n_rows, n_states)."""
    row: IntArray
    """Row of each agent's goal, negative = none, shape (n,)."""
    order: IntArray
    """Agents, the one that chooses first in front, shape (n,)."""
    locked: BoolArray
    """Agents that do not move, shape (n,)."""
    allow_rotation: bool
    """Whether a closed ring of followers is legal."""
    wished: IntArray
    """State that each agent prefers, negative = what brings it nearest to its goal, shape (n,); or nobody's, (0,)."""


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
        self._options = tuple(self.options)
        self._claims = tuple(claims_of(self.options, graph.n_cells, 0))
        self._keys = np.empty((0, self.options.widest + 1), dtype=np.int64)

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
        wished: IntArray | None = None,
    ) -> None:
        """Decide one timestep.

        An agent with a wish tries that first, whenever its turn comes or it is pushed, and what remains in the usual
        order. So whatever is wished for, the timestep is as legal as without.

        Args:
            now: State of each agent, shape (n,), in distinct cells.
            after: Receives the state of each agent one timestep later, shape (n,).
            distances: Timesteps to goals, shape (n_rows, n_states), as `DistanceTable.rows` gives them.
            row: Row of each agent's goal, shape (n,), negative = none.
            order: Agents, the one that chooses first in front, shape (n,).
            locked: Agents that do not move, shape (n,).
            allow_rotation: Whether a closed ring of followers is legal.
            wished: State that each agent would rather aim at than at any other, its own to wait, negative = no wish,
                shape (n,); None = nobody has one.

        Source of the wishes: R. Veerapaneni et al., "Improving Learnt Local MAPF Policies with Heuristic Search", 2024,
        https://arxiv.org/abs/2403.20300 (CS-PIBT: collisions are shielded by PIBT over a policy's preferences).
        """
        n = len(now)
        if len(self._keys) < n:
            self._claims = tuple(claims_of(self.options, self.graph.n_cells, n))
            self._keys = np.empty((n, self.options.widest + 1), dtype=np.int64)
        self.salt += 1
        # Plain tuples: numba takes named ones five times slower, and this is called in every timestep of every fleet.
        decide(
            self._options,
            (distances, row, order, locked, allow_rotation, _NO_WISHES if wished is None else wished),
            self._claims,
            self._keys,
            self.graph.state_cell,
            self.salt,
            now,
            after,
        )


@kernel
def decide(
    option_arrays: tuple[Any, ...],
    wish_arrays: tuple[Any, ...],
    claim_arrays: tuple[Any, ...],
    keys: Int64Array,
    state_cell: IntArray,
    salt: int,
    now: IntArray,
    after: IntArray,
) -> None:  # pragma: no cover - compiled
    """Fill `after`, shape (n,), from `now`, shape (n,)."""
    options, wishes, claims = Options(*option_arrays), NextWishes(*wish_arrays), Claims(*claim_arrays)
    for agent in range(len(now)):
        enter(claims, agent, state_cell[now[agent]])
        if wishes.locked[agent]:
            stay(claims, now, after, agent)
    _rank(options, wishes, claims, keys, salt, now)
    if len(wishes.wished):
        _prefer(options, wishes, claims, keys, salt, now)
    # The main loop of algorithm 1: by priority, whoever is undecided.
    for leader in wishes.order:
        if claims.goes[leader] != UNDECIDED:
            continue
        if keys[leader, 0] == _UNRANKED and claims.cells[claims.home[leader], 1] == NOBODY:
            stay(claims, now, after, leader)
            continue
        claims.stack[0] = leader
        end, depth = PUSHED, np.int64(0)
        while end == PUSHED:
            pushed = claims.stack[depth]
            if keys[pushed, 0] == _UNRANKED:
                _rank_options(options, wishes, claims, keys, salt, now, pushed)
            end, depth = push(options, claims, keys, _USED_UP, now, after, depth, wishes.allow_rotation)
    if options.has_turns:
        _hold_back(claims, state_cell, now, after)
    clear(options, claims, now)


@kernel
def _rank(
    options: Options, wishes: NextWishes, claims: Claims, keys: Int64Array, salt: int, now: IntArray
) -> None:  # pragma: no cover - compiled
    """Give every option of every agent its key.

    All agents in one loop, before any of them decides: the far memory that the distances lie in is then read for many
    agents at a time. Those that have no goal, or are at theirs, want nothing better than to wait: their options are
    ranked when they are pushed, which most never are.
    """
    for agent in range(len(now)):
        if wishes.locked[agent]:
            continue
        goal_row = wishes.row[agent]
        if goal_row < 0 or wishes.distances[goal_row, now[agent]] == 0:
            keys[agent, 0] = _UNRANKED
        else:
            _rank_options(options, wishes, claims, keys, salt, now, agent)


@inlined
def _rank_options(
    options: Options, wishes: NextWishes, claims: Claims, keys: Int64Array, salt: int, now: IntArray, agent: Int
) -> None:  # pragma: no cover - compiled
    """Give every option of an agent its key; option 0 is to wait."""
    state, here, goal_row = now[agent], claims.home[agent], wishes.row[agent]
    noise = (salt ^ (agent * 0x9E3779B97F4A7C1)) * 0x2545F4914F6CDD1D
    noise ^= noise >> 29
    keys[agent, 0] = 0
    own = np.int64(0)
    if goal_row >= 0:
        own = np.int64(wishes.distances[goal_row, state]) + 1
        if own <= UNREACHABLE:
            keys[agent, 0] = (own << _DISTANCE_BIT) | _WAIT
    for option in range(options.aim.shape[1]):
        target, to = options.aim[state, option, 0], options.aim[state, option, 1]
        if target < 0:
            keys[agent, option + 1 :] = _USED_UP
            break
        noise ^= noise << 13
        noise ^= noise >> 7
        noise ^= noise << 17
        key = (noise & _CHANCE) | (option + 1)
        left = np.int64(1)
        if options.has_turns:
            left += options.start[state, option, 1]
        if goal_row >= 0:
            left += np.int64(wishes.distances[goal_row, target])
        if to == here:
            key |= _TURN
        elif left == own and claims.cells[to, 0] != NOBODY:
            key |= _OCCUPIED
        keys[agent, option + 1] = key | (left << _DISTANCE_BIT)


@kernel
def _prefer(
    options: Options, wishes: NextWishes, claims: Claims, keys: Int64Array, salt: int, now: IntArray
) -> None:  # pragma: no cover - compiled
    """Put the option that each agent wishes for before its others."""
    for agent in range(len(now)):
        state, wished = now[agent], wishes.wished[agent]
        if wished < 0 or wishes.locked[agent]:
            continue
        if wished == state:
            # Whose options are not ranked waits anyway, unless it is pushed, and then it cannot.
            if keys[agent, 0] != _UNRANKED:
                keys[agent, 0] = _WISHED
            continue
        if keys[agent, 0] == _UNRANKED:
            _rank_options(options, wishes, claims, keys, salt, now, agent)
        for option in range(options.aim.shape[1]):
            if options.aim[state, option, 0] == wished:
                keys[agent, option + 1] = _WISHED


@kernel
def _hold_back(claims: Claims, state_cell: IntArray, now: IntArray, after: IntArray) -> None:  # pragma: no cover
    """Let everyone wait who would enter the cell of an agent that only turns, and everyone behind them. Compiled.

    Afterwards after[agent] is what happens; goes[agent] is still what was aimed at.
    """
    home, trail = claims.home, claims.stack
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
            agent = claims.cells[claims.goes[agent], 0]
            if agent < 0:
                break
        if not moves:
            for k in range(length):
                after[trail[k]] = now[trail[k]]
    for agent in range(n):
        home[agent] = ~home[agent]
