"""A window planned timestep by timestep, with priorities that grow while agents are on their way."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from planners.deadline import Deadline
from planners.mapf.arrays import BoolArray, FloatArray, Int64Array, IntArray
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.kernel import Int, kernel
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.status import Status


class WindowStep(Protocol):
    """Decides one timestep of all agents."""

    def __call__(self, now: IntArray, after: IntArray, *, order: IntArray, locked: BoolArray) -> None:
        """Decide it.

        Args:
            now: State of each agent, shape (n,).
            after: Receives the state of each agent one timestep later, shape (n,).
            order: Agents, the one that chooses first in front, shape (n,).
            locked: Agents that do not move, shape (n,).
        """


class WindowTurns(NamedTuple):
    """Who chooses first in a timestep; n agents."""

    order: IntArray
    """Agents: those that are not content before those that are, among them the greater priority first, shape (n,)."""
    content: BoolArray
    """Agents that have no goal, or have been at theirs, shape (n,)."""
    priority: FloatArray
    """Shape (n,)."""
    locked: BoolArray
    """Agents that do not move, shape (n,)."""


class WindowAgents(NamedTuple):
    """What is asked of the agents of a window, shape (n,) each."""

    goals: IntArray
    """States, `NO_GOAL` = none."""
    stay: BoolArray
    """Who stays once it is at its goal."""
    fixed: BoolArray
    """Who does not move."""
    comes: Int64Array
    """Timesteps until each is where it starts; before, it does not move."""


def plan_window(
    instance: Instance,
    step: WindowStep,
    deadline: Deadline,
    *,
    impatience: float,
    reachable: BoolArray,
    comes: Int64Array | None = None,
) -> Plan:
    """Plan a window.

    Those who have no goal, or have been at theirs, choose last; the others in the order of their priorities.

    Args:
        instance: The window.
        step: Decides a timestep.
        deadline: Budget; an iteration is one timestep.
        impatience: Priority an agent gains with each timestep that ends away from its goal.
        reachable: Agents without a goal, and those that have a way to theirs, shape (n,).
        comes: See `Instance`; None = all are at their starts.
    """
    states = np.empty((instance.horizon + 1, instance.n_agents), dtype=np.int32)
    states[0] = instance.starts
    agents, turns = agents_of(instance, comes), turns_at_start(instance)
    done = 0
    while done < instance.horizon and deadline.spend():
        take_turns(turns, states[done], agents, done, impatience)
        step(states[done], states[done + 1], order=turns.order, locked=turns.locked)
        done += 1
    return window_plan(instance, states[: done + 1], reachable)


def agents_of(instance: Instance, comes: Int64Array | None) -> WindowAgents:
    """What a window asks of its agents; `comes` as for `plan_window`."""
    comes = np.zeros(instance.n_agents, dtype=np.int64) if comes is None else comes
    return WindowAgents(goals=instance.goals, stay=instance.stay, fixed=instance.fixed, comes=comes)


def turns_at_start(instance: Instance) -> WindowTurns:
    """Who chooses first in the first timestep of a window."""
    content = (instance.goals == NO_GOAL) | (instance.goals == instance.starts)
    priority = np.array(instance.priorities, dtype=np.float64)
    return WindowTurns(
        order=np.lexsort((-priority, content)).astype(np.int32),
        content=content,
        priority=priority,
        locked=np.empty(instance.n_agents, dtype=np.bool_),
    )


def window_plan(instance: Instance, states: IntArray, reachable: BoolArray) -> Plan:
    """The plan of a window of which so much was planned.

    Args:
        instance: The window.
        states: Shape (timesteps + 1, n).
        reachable: As for `plan_window`.
    """
    done = len(states) - 1
    status = Status.FEASIBLE if done == instance.horizon else Status.TIMEOUT
    if not reachable.all():
        status = Status.INFEASIBLE
    return Plan(states=states, status=status, iterations=done)


@kernel
def take_turns(
    turns: WindowTurns, now: IntArray, agents: WindowAgents, done: Int, impatience: float
) -> None:  # pragma: no cover - compiled
    """Begin a timestep, before which so many are `done`.

    From the second on, whoever is not content has become more impatient; it may be content now.
    """
    order, content, priority, locked = turns
    some = False
    for agent in range(len(now)):
        if done > 0 and not content[agent]:
            priority[agent] += impatience
        at_goal = now[agent] == agents.goals[agent]
        locked[agent] = agents.fixed[agent] or agents.comes[agent] > done or (agents.stay[agent] and at_goal)
        if at_goal and not content[agent]:
            content[agent] = True
            some = True
    if some:  # the order of the others does not change while all gain alike
        _sort(order, content, priority)


@kernel
def _sort(order: IntArray, content: BoolArray, priority: FloatArray) -> None:  # pragma: no cover - compiled
    """Put agents in order again, of whom few have changed: by insertion."""
    for end in range(1, len(order)):
        agent, at = order[end], end
        while at > 0 and _before(agent, order[at - 1], content, priority):
            order[at] = order[at - 1]
            at -= 1
        order[at] = agent


@kernel
def _before(a: Int, b: Int, content: BoolArray, priority: FloatArray) -> bool:  # pragma: no cover - compiled
    """Whether agent `a` chooses before agent `b`."""
    if content[a] != content[b]:
        return bool(content[b])
    if priority[a] != priority[b]:
        return bool(priority[a] > priority[b])
    return bool(a < b)


def goals_to_look_up(instance: Instance, tables: DistanceTable) -> IntArray:
    """Goals whose distances a window needs: all, or where more agents are than goals fit, those not reached yet.

    Who is at its goal and pushed from it finds back in the next window.
    """
    if instance.n_agents <= tables.capacity:
        return instance.goals
    return np.where(instance.starts == instance.goals, np.int32(NO_GOAL), instance.goals)


def reachable_goals(instance: Instance, distances: npt.NDArray[np.uint16], row: IntArray) -> BoolArray:
    """Agents without a goal, and those that have a way to theirs, shape (n,).

    Args:
        instance: The instance.
        distances: Timesteps to goals, shape (n_rows, n_states).
        row: Row of each agent's goal, negative = none, shape (n,).
    """
    # Who is at its goal has been there: nothing is looked up in the far memory of the distances.
    away = ((row >= 0) & (instance.starts != instance.goals)).nonzero()[0]
    reachable = np.ones(len(row), dtype=np.bool_)
    reachable[away] = distances[row[away], instance.starts[away]] < UNREACHABLE
    return reachable
