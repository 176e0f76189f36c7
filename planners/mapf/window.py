"""A window planned timestep by timestep, with priorities that grow while agents are on their way."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from planners.deadline import Deadline
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.distance_table import UNREACHABLE
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


def plan_window(
    instance: Instance, step: WindowStep, deadline: Deadline, *, impatience: float, reachable: BoolArray
) -> Plan:
    """Plan a window.

    Those who have no goal, or have been at theirs, choose last; the others in the order of their priorities.

    Args:
        instance: The window.
        step: Decides a timestep.
        deadline: Budget; an iteration is one timestep.
        impatience: Priority an agent gains with each timestep that ends away from its goal.
        reachable: Agents without a goal, and those that have a way to theirs, shape (n,).
    """
    states = np.empty((instance.horizon + 1, instance.n_agents), dtype=np.int32)
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
        step(states[done], states[done + 1], order=order, locked=instance.fixed | (instance.stay & at_goal))
        done += 1
        priority += impatience * ~content
    status = Status.FEASIBLE if done == instance.horizon else Status.TIMEOUT
    if not reachable.all():
        status = Status.INFEASIBLE
    return Plan(states=states[: done + 1], status=status, iterations=done)


def reachable_goals(instance: Instance, distances: npt.NDArray[np.uint16], row: IntArray) -> BoolArray:
    """Agents without a goal, and those that have a way to theirs, shape (n,).

    Args:
        instance: The instance.
        distances: Timesteps to goals, shape (n_rows, n_states).
        row: Row of each agent's goal, negative = none, shape (n,).
    """
    has_goal = row >= 0
    reachable = np.ones(len(row), dtype=np.bool_)
    reachable[has_goal] = distances[row[has_goal], instance.starts[has_goal]] < UNREACHABLE
    return reachable
