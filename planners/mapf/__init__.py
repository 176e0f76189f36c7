"""Multi-agent path finding: the problem, the referee, and one file per planner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from planners.registry import NO_SETTINGS, Family

if TYPE_CHECKING:
    from planners.mapf.planner import MapfPlanner

_METHOD = "plan(instance, tables, deadline) -> Plan"

PLANNERS: Family[MapfPlanner] = Family(
    "planner",
    _METHOD,
    {
        "pibt": "planners.mapf.pibt.Pibt",
        "multi_step_pibt": "planners.mapf.multi_step.multi_step_pibt.MultiStepPibt",
        "window_search": "planners.mapf.window_search.window_search.WindowSearch",
        "auto": "planners.mapf.window_search.auto.Auto",
    },
)
"""Planner of one window by name."""

DEFAULT_PLANNER = "multi_step_pibt"
"""What a fleet plans with unless told otherwise: the best over the shipped sites and densities, see decision 58."""

ONE_SHOT_PLANNERS: Family[MapfPlanner] = Family(
    "planner",
    _METHOD,
    {
        "lacam": "planners.mapf.lacam.lacam.Lacam",
        "sipp": "planners.mapf.sipp.sipp.Sipp",
        "cbs": "planners.mapf.cbs.cbs.Cbs",
    },
)
"""Planner from start to goal by name: it ends when all agents are at their goals."""


def planner_named(
    name: str,
    settings: Mapping[str, object] = NO_SETTINGS,
    *,
    seed: int = 0,
    family: Family[MapfPlanner] = PLANNERS,
    what: str = "planner",
) -> MapfPlanner:
    """Make a planner.

    Args:
        name: A name of the family, or `package.module.Class` of a class like `MapfPlanner`.
        settings: Fields of the planner's settings, by name; the others keep their defaults.
        seed: Seed of its tie-breaking.
        family: `PLANNERS` or `ONE_SHOT_PLANNERS`.
        what: What chose the name, for messages.

    Raises:
        MemberError: There is no such planner, or it cannot be made; says the valid choices.
        SettingError: It has no such setting, or the setting takes another kind of value; says what is valid.
        PlanningError: A setting is out of its range.
    """
    from planners.mapf.planner import CheckedPlanner

    planner = family.make(name, settings, what=what, seed=seed)
    return planner if name in family else CheckedPlanner(name, planner)
