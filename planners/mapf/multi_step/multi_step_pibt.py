"""Multi-step PIBT: agents hold operations of a few timesteps and push whoever is in the way of a better one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.chance import chance_of, next_word
from planners.mapf.distance_table import DistanceTable, tables_of
from planners.mapf.multi_step import multi_step_kernel as kernels
from planners.mapf.multi_step.crew import Crew
from planners.mapf.multi_step.multi_step_kernel import Aims, Choices, Costs, Look, Wishes, wishes_to_stay
from planners.mapf.multi_step.operations import LONGEST, Operations, operations_of
from planners.mapf.multi_step.stagnation import Stagnation
from planners.mapf.multi_step.window_kernel import StepSearch, plan_steps
from planners.mapf.options import open_moves
from planners.mapf.problem import Instance, Plan
from planners.mapf.window import (
    WindowAgents,
    WindowTurns,
    agents_of,
    goals_to_look_up,
    plan_window,
    reachable_goals,
    turns_at_start,
    window_plan,
)

_ROUND = 2000
"""Agents that a round of improvement asks at most, so that one round of a large fleet is no long wait."""
STUCK_WINDOWS, RELEASE_WINDOWS = 60, 20
"""After so many windows in which an agent has come no nearer to its goal than before, those who may be pushed away from
theirs, such as cars that park, make room for all others for so many; and again."""
_LAST = 1e9
"""More than any two priorities differ."""
_MOST_CHAINS = 2**30
"""Number of the last chain of pushes before they are numbered anew; half of what there is room for."""
MOST_ROUNDS = 10_000
"""Rounds of a timestep; so many take minutes, and a window ends only between two timesteps."""


@dataclass(frozen=True, kw_only=True)
class MultiStepConfig:
    """Settings of `MultiStepPibt`."""

    length: int = 3
    """Timesteps of an operation."""
    most_tries: int = 3000
    """Operations that a chain of pushes tries before it gives up."""
    rounds: int = 0
    """Rounds of improvement a timestep; each offers a better operation to random agents, as many as there are agents
    but at most 2,000."""
    impatience: float = 1.0
    """Priority an agent gains with each timestep of the window that ends away from its goal."""

    def __post_init__(self) -> None:
        if self.most_tries < 1:
            raise PlanningError(f"multi-step pibt: most_tries = {self.most_tries}; valid: an integer >= 1")
        if not 0 <= self.rounds <= MOST_ROUNDS:
            raise PlanningError(f"multi-step pibt: rounds = {self.rounds}; valid: 0 to {MOST_ROUNDS}")
        if not 1 <= self.length <= LONGEST:
            raise PlanningError(f"multi-step pibt: length = {self.length}; valid: 1 to {LONGEST}")
        if not self.impatience >= 0:
            raise PlanningError(f"multi-step pibt: impatience = {self.impatience}; valid: a number >= 0")


class MultiStepPibt:
    """PIBT over operations, short sequences of moves that end in a wait.

    Looking a few timesteps ahead lets a vehicle that must turn first make room in time, which one-step PIBT cannot
    see. Of each operation only the first timestep is carried out, the rest is kept until something better is found.

    Two agents whose priorities grow alike can push each other to and fro for ever where one has to get out of a dead
    end and the other wants in. After a while whoever only wants to rest makes room.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Source: Yukhnevich, Andreychuk, "Enhancing PIBT via Multi-Action Operations", 2025,
    https://arxiv.org/abs/2511.09193. Keeping the rest of an operation and refusing closed rings are additions.
    """

    heeds_comes = True

    def __init__(self, config: MultiStepConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = MultiStepConfig() if config is None else config
        self._rng = np.random.default_rng(seed)
        self._mover: Mover | None = None
        self._stagnation = Stagnation(0)

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
        return self.begin(instance, tables, deadline)()

    def begin(
        self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None
    ) -> Callable[[], Plan]:
        """Prepare a window; see `plan`, and `planners.mapf.planner.Begins`."""
        graph, n = instance.graph, instance.n_agents
        tables = tables_of(instance, tables, "multi-step pibt")
        deadline = Deadline() if deadline is None else deadline
        table, row = tables.rows(goals_to_look_up(instance, tables))
        reachable = reachable_goals(instance, table, row)
        # Who has no goal has no row: row -1 is what the memory of the tables happens to hold.
        has_way = reachable & (row >= 0)
        left = np.where(has_way, table[np.maximum(row, 0), instance.starts], np.uint16(0)).astype(np.int32)
        if self._is_stuck(instance, left):
            priorities = np.where(instance.stay, instance.priorities, instance.priorities - _LAST)
            instance = replace(instance, priorities=priorities)
        if self._mover is None or not self._mover.fits(graph, instance.blocked, n):
            self._mover = Mover(graph, instance.blocked, n, length=self.config.length, seed=self._rng)
        mover = self._mover
        wishes = wishes_to_stay(np.where(reachable, row, np.int32(-1)))
        costs = exact_costs(table, graph.n_states)
        if self.config.rounds == 0 and not mover.crew.is_shared and not deadline.reads_clock:
            return self._window_at_once(instance, mover, costs, wishes, deadline, reachable)
        mover.begin(instance.starts)

        def step(now: IntArray, after: IntArray, *, order: IntArray, locked: BoolArray) -> None:
            del now  # the mover remembers
            mover.lock(locked)
            after[:] = mover.step(
                costs,
                wishes,
                order,
                weight=rank_weights(order),
                most_tries=self.config.most_tries,
                allow_rotation=instance.allow_rotation,
                polish=lambda: self.config.rounds > 0,
                rounds=self.config.rounds,
            )

        plan = plan_window(
            instance,
            step,
            deadline,
            impatience=self.config.impatience,
            reachable=reachable,
            comes=instance.comes,
        )
        return lambda: plan

    def _window_at_once(
        self,
        instance: Instance,
        mover: Mover,
        costs: Costs,
        wishes: Wishes,
        deadline: Deadline,
        reachable: BoolArray,
    ) -> Callable[[], Plan]:
        """As `plan_window`, in one kernel, which lets other threads go on."""
        n_steps = 0
        while n_steps < instance.horizon and deadline.spend():
            n_steps += 1
        states = np.empty((n_steps + 1, instance.n_agents), dtype=np.int32)
        states[0] = instance.starts
        agents, turns = agents_of(instance, instance.comes), turns_at_start(instance)

        def work() -> Plan:
            mover.window(
                states,
                costs,
                wishes,
                agents,
                turns,
                impatience=self.config.impatience,
                most_tries=self.config.most_tries,
                allow_rotation=instance.allow_rotation,
            )
            return window_plan(instance, states, reachable)

        return work

    def _is_stuck(self, instance: Instance, left: IntArray) -> bool:
        """Count a window, at whose begin so much is `left` to each agent; whether those who may be pushed make room."""
        if len(self._stagnation) != len(left):
            self._stagnation = Stagnation(len(left))
        waited = self._stagnation.look(left, instance.goals, excused=(left == 0) | instance.fixed)
        longest = int(waited.max(initial=0))
        return longest % (STUCK_WINDOWS + RELEASE_WINDOWS) >= STUCK_WINDOWS


def exact_costs(table: npt.NDArray[np.uint16], n_states: int) -> Costs:
    """Costs whose table has an entry for each state, shape (n_rows, n_states)."""
    return Costs(table=table, look=look_of_states(n_states))


def look_of_states(n_states: int) -> Look:
    """Look-up where every state has its own entry."""
    every = np.arange(n_states + 1, dtype=np.int32)
    return Look(ptr=every, key=every[:-1], ahead=np.zeros(n_states, dtype=np.int32), scale=1)


def look_behind(look: Look, operations: Operations) -> Look:
    """Where to look behind each operation: from all states that the robot can turn into while it rests at its end."""
    rested, n_states = _look_of_rests(look, operations), len(look.ptr) - 1
    longest = (len(rested.ptr) - 1) // n_states - 1
    state, rest = operations.ending.T
    at = np.minimum(rest, longest) * n_states + state
    counts = np.diff(rested.ptr)[at]
    ptr = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
    entry = np.repeat(rested.ptr[at] - ptr[:-1], counts) + np.arange(ptr[-1], dtype=np.int32)
    return Look(ptr=ptr, key=rested.key[entry], ahead=rested.ahead[entry], scale=look.scale)


def _look_of_rests(look: Look, operations: Operations) -> Look:
    """Where to look after r timesteps of rest, spent turning: entry r * S + s for state s; r up to the longest turn."""
    n_states = len(look.ptr) - 1
    state = np.arange(n_states, dtype=np.int64).repeat(np.diff(operations.turn_ptr))
    counts = np.diff(look.ptr)[operations.turn_state]
    place = (np.cumsum(counts) - counts).repeat(counts)
    entry = np.arange(counts.sum()) - place + look.ptr[operations.turn_state].repeat(counts)
    state, steps = state.repeat(counts), operations.turn_steps.repeat(counts)
    key, ahead = look.key[entry].astype(np.int64), look.ahead[entry]
    parts = []
    for rest in range(int(operations.turn_steps.max(initial=0)) + 1):
        near = np.flatnonzero(steps <= rest)
        order = near[np.lexsort((ahead[near], key[near], state[near]))]
        fresh = np.ones(len(order), dtype=np.bool_)
        fresh[1:] = (np.diff(state[order]) != 0) | (np.diff(key[order]) != 0)
        kept = order[fresh]
        parts.append(np.column_stack((state[kept] + rest * n_states, key[kept], ahead[kept])))
    rows = np.concatenate(parts)
    ptr = np.concatenate(([0], np.cumsum(np.bincount(rows[:, 0], minlength=len(parts) * n_states))))
    return Look(
        ptr=ptr.astype(np.int32), key=rows[:, 1].astype(np.int32), ahead=rows[:, 2].astype(np.int32), scale=look.scale
    )


def rank_weights(sequence: IntArray) -> npt.NDArray[np.float64]:
    """Weight of each agent, which falls off with its place in the order, shape (n,).

    With even weights the many who are pushed outvote the one who pushes, and a crowd comes to a standstill; where the
    last weigh next to nothing, nobody cares how much time they lose.

    Source: the winner of the 2024 League (No Man's Sky) squares what is a power of 3/2 here,
    https://github.com/Straple/LORR24.
    """
    n = len(sequence)
    weight = np.empty(n)
    weight[sequence] = (1.0 - np.arange(n) / max(n, 1)) ** 1.5
    return weight


class Mover:
    """Moves a fleet timestep by timestep and remembers what is left of the operations.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
        n: Number of agents.
        length: Timesteps of an operation.
        look: Where costs are looked up; None = every state has its own entry.
        dearest: Most that a move lessens what is left to do.
        patience: Agents look for another operation when theirs has come to its last `patience` timesteps, which it
            rests; with 1 in every timestep, with more those whom nobody hinders decide less often.
        seed: Seed of the tie-breaking.
    """

    def __init__(
        self,
        graph: LaneGraph,
        blocked: BoolArray,
        n: int,
        *,
        length: int,
        look: Look | None = None,
        dearest: int = 1,
        patience: int = 1,
        seed: int | np.random.Generator = 0,
    ) -> None:
        self.graph = graph
        self._blocked = blocked.copy()
        self.operations = operations_of(graph, length, open_moves(graph, blocked))
        self._patience = patience
        self._reach = length * dearest
        self.chance = chance_of(np.random.default_rng(seed))
        """Stream of the tie-breaking; whoever puts an earlier copy back repeats what followed."""
        self._behind = look_behind(look_of_states(graph.n_states) if look is None else look, self.operations)
        widest = int(np.diff(self.operations.ptr).max(initial=1))
        self._nowhere_dear = np.zeros(graph.n_cells, dtype=np.int32)
        self._drawn = np.empty(min(n, _ROUND), dtype=np.int32)
        self.crew = Crew(n)
        """Threads that share the agents."""

        def ints(*shape: int) -> IntArray:
            return np.zeros(shape, dtype=np.int32)

        self._choices = Choices(
            state=ints(n),
            chosen=ints(n),
            at=ints(graph.n_cells, length + 1),
            key=ints(n, widest),
            order=np.zeros((n, widest), dtype=np.int16),
            n_sorted=ints(n),
            place=ints(n),
            weight=np.ones(n),
            locked=np.zeros(n, dtype=np.bool_),
            eager=np.zeros(n, dtype=np.bool_),
            stack=ints(n + 1),
            tried=ints(n + 1),
            before=ints(n + 1),
            spent=np.zeros(n + 1),
            mark=ints(n),
            stamp=ints(1),
        )

    def fits(self, graph: LaneGraph, blocked: BoolArray, n: int) -> bool:
        """Whether this is the floor and the size of fleet it was made for."""
        return graph is self.graph and n == len(self._choices.state) and np.array_equal(blocked, self._blocked)

    def begin(self, states: IntArray) -> None:
        """Forget all operations: agents stand in `states`, shape (n,), in distinct cells."""
        self._choices.state[:] = states
        kernels.begin(self.operations, self._choices, self.graph.state_cell)

    def lock(self, locked: BoolArray) -> None:
        """Say who does not move, shape (n,). Who was about to is stopped, and then everybody decides anew."""
        kernels.lock(self.operations, self._choices, locked, self.graph.state_cell)

    def step(
        self,
        costs: Costs,
        wishes: Wishes,
        sequence: IntArray,
        *,
        weight: npt.NDArray[np.float64],
        most_tries: int,
        allow_rotation: bool,
        polish: Callable[[], bool],
        rounds: int | None = None,
        crowd: IntArray | None = None,
    ) -> IntArray:
        """Decide a timestep and let it pass.

        Args:
            costs: What is left to do.
            wishes: Where the agents want to go.
            sequence: Agents, the one that goes first in front, shape (n,).
            weight: What a unit of cost of each agent counts in a round of improvement, shape (n,).
            most_tries: Operations a chain of pushes tries.
            allow_rotation: Whether a closed ring of followers is legal.
            polish: Asked before each round of improvement whether there is time for it.
            rounds: Most rounds of improvement; None = as long as there is time.
            crowd: What it costs more to be in each cell, shape (n_cells,); None = nothing.

        Returns:
            State of each agent after the timestep, shape (n,).
        """
        ops, choices, cell = self.operations, self._choices, self.graph.state_cell
        n = len(choices.state)
        self._renumber()
        choices.place[sequence] = np.arange(n, dtype=np.int32)
        choices.weight[:] = weight
        aims = Aims(
            table=costs.table,
            behind=self._behind,
            wishes=wishes,
            reach=self._reach,
            crowd=self._nowhere_dear if crowd is None else crowd,
            salt=np.uint64(next_word(self.chance)),
            chance=self.chance,
        )
        kernels.reconsider(ops, choices, self._patience)
        self._rank_eager(aims)
        kernels.sweep(ops, choices, aims, sequence, most_tries, cell, allow_rotation)
        done = 0
        while (rounds is None or done < rounds) and polish():
            kernels.draw_agents(choices, self.chance, self._drawn)
            self._rank_eager(aims)
            kernels.polish(ops, choices, aims, self._drawn, min(most_tries, 100), cell, allow_rotation)
            done += 1
        after = np.empty(n, dtype=np.int32)
        kernels.first_states(ops, choices, costs, wishes, after)
        kernels.go_on(ops, choices, after)
        return after

    def window(
        self,
        states: IntArray,
        costs: Costs,
        wishes: Wishes,
        agents: WindowAgents,
        turns: WindowTurns,
        *,
        impatience: float,
        most_tries: int,
        allow_rotation: bool,
    ) -> None:
        """Decide timesteps one after the other, as `begin`, `lock` and `step` without improvement do.

        Args:
            states: The first row says where the agents stand, the others are filled in, shape (timesteps + 1, n).
            costs: What is left to do.
            wishes: Where the agents want to go.
            agents: What is asked of them.
            turns: Who chooses first in the first timestep; moves on.
            impatience: See `plan_window`.
            most_tries: Operations a chain of pushes tries.
            allow_rotation: Whether a closed ring of followers is legal.
        """
        search = StepSearch(
            behind=self._behind,
            reach=self._reach,
            crowd=self._nowhere_dear,
            chance=self.chance,
            patience=self._patience,
            most_tries=most_tries,
            allow_rotation=allow_rotation,
        )
        self._renumber()
        plan_steps(
            self.operations,
            self._choices,
            search,
            costs,
            wishes,
            agents,
            turns,
            impatience,
            self.graph.state_cell,
            states,
        )

    def _renumber(self) -> None:
        """Let chains of pushes be numbered from the start before the numbers run out."""
        if self._choices.stamp[0] > _MOST_CHAINS:
            self._choices.mark[:] = 0
            self._choices.stamp[0] = 0

    def _rank_eager(self, aims: Aims) -> None:
        """In a large fleet, rank the operations of all who are about to ask for them; else each does when it asks."""
        if not self.crew.is_shared:
            return
        self.crew.each(lambda begin, end: kernels.rank(self.operations, self._choices, aims, begin, end))
