"""Scenarios of dispatch: settings of the environment under which choices make a difference, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class DispatchScenario:
    """Settings of `DispatchConfig`, and what is asked of policies."""

    summary: str
    """What is special about it."""
    arguments: Mapping[str, Any]
    """Settings, by name; plain values."""


SCENARIOS: dict[str, DispatchScenario] = {
    "due_dates": DispatchScenario(
        summary="fewer orders than the cars can carry, four in five with a due date",
        arguments={"site": "small", "n_cars": 6, "load": 0.9},
    ),
    "due_rush": DispatchScenario(
        summary="more orders than the cars can carry, four in five with a due date",
        arguments={"site": "small", "n_cars": 6, "load": 1.5},
    ),
    "tight_dates": DispatchScenario(
        summary="fewer orders than the cars can carry, all due within one to five minutes",
        arguments={
            "site": "small",
            "n_cars": 6,
            "load": 0.9,
            "stream": {"due_share": 1.0, "slack_s": (60.0, 300.0)},
        },
    ),
    "due_waves": DispatchScenario(
        summary="waves of orders for popular stations, 700 an hour: more than the cars can carry",
        arguments={"site": "medium", "n_cars": 16, "load": 1.3375, "stream": {"kind": "skewed_waves"}},
    ),
    "fair_waves": DispatchScenario(
        summary="waves of orders for popular stations, no more in all than the cars can carry",
        arguments={"site": "medium", "n_cars": 16, "load": 0.9, "stream": {"kind": "skewed_waves"}},
    ),
    "bottleneck": DispatchScenario(
        summary="seven of ten orders begin at two of the six pick stations",
        arguments={"site": "medium", "n_cars": 16, "load": 1.2, "stream": {"bottleneck_n": 2}},
    ),
    "breakdowns": DispatchScenario(
        summary="three times an hour a car stands for 45 s, and one in two of those without a parcel is lost for good",
        arguments={
            "site": "medium",
            "n_cars": 16,
            "load": 0.9,
            "breakdowns_per_h": 3.0,
            "repair_s": 45.0,
            "lost_share": 0.5,
        },
    ),
    "two_sources": DispatchScenario(
        summary="what lies at the bottleneck lies at another pick station, too; more orders than the cars can carry",
        arguments={"site": "medium", "n_cars": 16, "load": 1.6, "stream": {"bottleneck_n": 2, "sources_n": 2}},
    ),
}
"""Scenarios by name."""
