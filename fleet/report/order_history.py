"""Order history: what became of one order, step by step, as the run file tells it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from fleet.tasks.board import UNDER_WAY, TaskState

_OF_CAR = {
    TaskState.ASSIGNED: "to",
    TaskState.LOADING: "onto",
    TaskState.UNLOADING: "from",
    TaskState.VISITING: "with",
}
"""How a state is said of its car; other states are `by` it."""
_ON_THE_WAY = {
    "visited": "it was at {place}",
    "inspected": "{place} was inspected",
    "pod_lifted": "{pod} is lifted",
    "pod_set_down": "{pod} is set down, {off_mm} mm and {off_deg} degrees from its place",
}
"""What is said of events that leave a task in its state, by their kinds."""


class OrderStep(NamedTuple):
    """Something that was decided about an order, or happened to it."""

    time_s: float
    """When [s]."""
    state: TaskState
    """The state of its task from then on."""
    car: str | None
    """The car that has, or had, it then."""
    cause: str
    """Why, in words."""
    waits: bool
    """Whether it says why the task went on waiting; else it came into its state."""

    def __str__(self) -> str:
        if self.waits:
            return f"waits: {self.cause}"
        return f"{_said(self.state, self.car)}: {self.cause}"


@dataclass(frozen=True, kw_only=True)
class OrderHistory:
    """What had become of an order by some time; its `str` says where it stood in a sentence."""

    order: str
    time_s: float
    """The time [s]."""
    steps: tuple[OrderStep, ...]
    """What had happened, by time; empty before its release."""

    @property
    def state(self) -> TaskState:
        """State of its task."""
        return self.steps[-1].state if self.steps else TaskState.ORDERED

    @property
    def car(self) -> str | None:
        """The car that works on it, if one does."""
        return self.steps[-1].car if self.state in UNDER_WAY else None

    def __str__(self) -> str:
        if not self.steps:
            return f"{self.order} is ordered, and not released yet"
        alike = itertools.takewhile(lambda step: step[1:3] == self.steps[-1][1:3], reversed(self.steps))
        *_, came = alike
        return f"{self.order} has been {_said(self.state, self.car)} since {came.time_s:.2f} s: {self.steps[-1].cause}"


def _said(state: TaskState, car: str | None) -> str:
    return str(state) if car is None else f"{state} {_OF_CAR.get(state, 'by')} {car}"


def orders_of(events: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the orders that a run has released, in the order of their releases."""
    return list(dict.fromkeys(str(event["task"]) for event in events if event.get("kind") == "task"))


def order_history(events: Sequence[Mapping[str, Any]], order: str, time_s: float) -> OrderHistory:
    """Read what became of an order.

    Args:
        events: Those of the run, by time.
        order: Its name.
        time_s: Until when [s].
    """
    steps: list[OrderStep] = []
    for event in events:
        if event.get("task") != order or event["sim_s"] > time_s:
            continue
        if event["kind"] == "task":
            state = TaskState(event["state"])
            steps.append(OrderStep(event["sim_s"], state, event["car"], event["cause"], waits=False))
        elif event["kind"] == "task_waits" and steps:
            steps.append(steps[-1]._replace(time_s=event["sim_s"], cause=event["cause"], waits=True))
        elif event["kind"] in _ON_THE_WAY and steps:
            said = _ON_THE_WAY[event["kind"]].format_map(event)
            steps.append(steps[-1]._replace(time_s=event["sim_s"], cause=said, waits=False))
    return OrderHistory(order=order, time_s=time_s, steps=tuple(steps))
