"""Planner: what every planner of the family offers, and what is checked of one's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, cast

import numpy as np

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import Instance, Plan
from planners.registry import told
from planners.status import Status


class PlanFault(PlanningError):
    """A planner of one's own gave an answer that is no plan."""


class MapfPlanner(Protocol):
    """What every planner of the family offers, of one window or from start to goal.

    Its class is made with `seed=`, and with `config=` if it has settings: a frozen dataclass, which the annotation of
    that argument names. One that plans with `Instance.comes` says so: `heeds_comes = True` in its class.
    """

    def __init__(self, *, seed: int | np.random.Generator = 0) -> None: ...

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan; an instance that cannot be solved, or not in time, is a result with a status, not an error."""


class Begins(Protocol):
    """A planner whose work can go on beside other work."""

    def begin(
        self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None
    ) -> Callable[[], Plan]:
        """Prepare what `plan` does.

        Returns:
            The rest of the work. It may be done in another thread, before the next call of the planner; until then the
            rows of `tables` that the instance needs must stay as they are.
        """


def begins(planner: MapfPlanner) -> Begins | None:
    """The planner, if its work can go on beside other work."""
    return cast("Begins", planner) if hasattr(planner, "begin") else None


def heeds_comes(planner: MapfPlanner) -> bool:
    """Whether a planner plans with the times at which agents come to their starts."""
    return bool(getattr(planner, "heeds_comes", False))


class CheckedPlanner:
    """A planner of one's own, whose answers are held against the form of a plan.

    Whether a plan is legal is for the executor and the referee to say, as with all planners.

    Args:
        name: What it is called in messages.
        planner: The planner.
    """

    def __init__(self, name: str, planner: MapfPlanner) -> None:
        self.planner = planner
        self.heeds_comes = heeds_comes(planner)
        self._name = name

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan.

        Raises:
            PlanFault: There is no answer, or it is no `Plan`, or its states are not those of this instance.
        """
        valid = f"valid: a Plan with states (T + 1, {instance.n_agents})"
        try:
            plan = self.planner.plan(instance, tables, deadline)
        except PlanningError:
            raise
        except Exception as error:
            what = told(error, type(self.planner).__module__)
            raise PlanFault(f"planner {self._name!r}: {what}; {valid}") from error
        if wrong := _wrong(instance, plan):
            raise PlanFault(f"planner {self._name!r}: its answer {wrong}; {valid}")
        return plan


def _wrong(instance: Instance, plan: object) -> str:
    """What keeps an answer from being a plan of this instance, empty if nothing does."""
    if not isinstance(plan, Plan):
        return f"is of type {type(plan).__name__}"
    status: Any = plan.status
    states: Any = plan.states
    if not isinstance(status, Status):
        return f"has the status {status!r}"
    if not isinstance(states, np.ndarray) or states.dtype != np.int32:
        return f"has states of type {getattr(states, 'dtype', type(states).__name__)}, not int32"
    if states.ndim != 2 or states.shape[1] != instance.n_agents or not 1 <= len(states) <= instance.horizon + 1:
        return f"has states of shape {states.shape} for {instance.n_agents} agents and {instance.horizon} timesteps"
    if (states < 0).any() or (states >= instance.graph.n_states).any():
        return f"has states that do not exist, from {states.min()} to {states.max()}"
    if (states[0] != instance.starts).any():
        agent = int(np.flatnonzero(states[0] != instance.starts)[0])
        return f"starts agent {agent} in state {states[0, agent]}, not {instance.starts[agent]}"
    return ""
