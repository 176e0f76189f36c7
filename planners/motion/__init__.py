"""Motion of single robots: arm planning in joint space, tool lines, time stamps, and car manoeuvres."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from planners.motion.problem import MotionPlanner as MotionPlanner
from planners.motion.problem import MotionProblem as MotionProblem
from planners.motion.problem import MotionResult as MotionResult
from planners.motion.problem import MotionStatus as MotionStatus
from planners.motion.rrt_connect import RrtConnect as RrtConnect
from planners.motion.rrt_connect_config import RrtConnectConfig as RrtConnectConfig
from planners.motion.rrt_connect_native import RrtConnectNative as RrtConnectNative

MOTION_PLANNERS: Mapping[str, type[RrtConnect] | type[RrtConnectNative]] = MappingProxyType(
    {
        "rrt_connect": RrtConnect,
        "rrt_connect_native": RrtConnectNative,
    }
)
"""Arm planners by name; a class called without arguments gives a planner with its default settings."""
