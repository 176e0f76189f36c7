"""What a one-shot plan costs, and the least it can cost."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.problem import NO_GOAL, Instance, Plan


def loss(instance: Instance, plan: Plan) -> npt.NDArray[np.int64]:
    """Timesteps of each agent that neither begin nor end in vain, shape (n,): all but those it spends at its goal.

    A timestep counts unless the agent stands at its goal at its beginning and at its end. Agents without a goal lose
    nothing.

    Source: Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023, section 5
    ("sum of loss"), https://arxiv.org/abs/2305.03632.
    """
    away = plan.states != instance.goals
    counted: npt.NDArray[np.int64] = (away[1:] | away[:-1]).sum(axis=0)
    return np.where(instance.goals == NO_GOAL, 0, counted)


def sum_of_loss(instance: Instance, plan: Plan) -> int:
    """`loss` of all agents together."""
    return int(loss(instance, plan).sum())


def sum_of_costs(instance: Instance, plan: Plan) -> int:
    """Timesteps until each agent is at its goal for good, added up; the whole plan for one that does not get there."""
    away = plan.states != instance.goals
    rows = np.arange(1, len(plan.states) + 1)[:, None]
    last_away = (away * rows).max(axis=0, initial=0)
    return int(np.minimum(last_away, len(plan.states) - 1)[instance.goals != NO_GOAL].sum())


def lower_bound(instance: Instance, tables: DistanceTable) -> int:
    """Sum of the distances from start to goal: no plan costs less. Agents that cannot reach their goal add nothing."""
    distances, row = tables.rows(instance.goals)
    has_goal = row >= 0
    each = distances[row[has_goal], instance.starts[has_goal]].astype(np.int64)
    return int(each[each < UNREACHABLE].sum())
