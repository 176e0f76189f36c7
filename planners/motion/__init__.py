"""Motion of single robots: arm planning in joint space, tool lines, time stamps, and car manoeuvres."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from planners.motion.problem import MotionPlanner as MotionPlanner
from planners.motion.problem import MotionProblem as MotionProblem
from planners.motion.problem import MotionResult as MotionResult
from planners.motion.search.aorrtc import Aorrtc as Aorrtc
from planners.motion.search.ompl_planner import OMPL_PLANNERS as OMPL_PLANNERS
from planners.motion.search.ompl_planner import OmplPlanner as OmplPlanner
from planners.motion.search.ompl_planner import UnknownPlannerError as UnknownPlannerError
from planners.motion.search.rrt_connect import RrtConnect as RrtConnect
from planners.motion.search.rrt_connect_config import RrtConnectConfig as RrtConnectConfig
from planners.motion.search.rrt_connect_native import RrtConnectNative as RrtConnectNative
from planners.motion.status import MotionStatus as MotionStatus

MOTION_PLANNERS: Mapping[str, type[RrtConnect] | type[RrtConnectNative] | type[Aorrtc]] = MappingProxyType(
    {
        "rrt_connect": RrtConnect,
        "rrt_connect_native": RrtConnectNative,
        "aorrtc": Aorrtc,
    }
)
"""Arm planners by name; a class called without arguments gives a planner with its default settings."""


def motion_planner(name: str) -> MotionPlanner:
    """Make an arm planner with its default settings.

    Args:
        name: A name in `MOTION_PLANNERS`, or one of OMPL's own names in `OMPL_PLANNERS`.

    Raises:
        UnknownPlannerError: Neither has the name.
        HangingPlannerError: An OMPL planner that would never return.
    """
    if not isinstance(name, str):
        raise UnknownPlannerError(f"arm planner {name!r}; valid: a name")
    if name in MOTION_PLANNERS:
        return MOTION_PLANNERS[name]()
    try:
        return OmplPlanner(name)
    except UnknownPlannerError as error:
        raise UnknownPlannerError(
            f"arm planner {name!r}; valid: {', '.join((*MOTION_PLANNERS, *OMPL_PLANNERS))}"
        ) from error
