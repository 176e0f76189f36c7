"""Arm planning by OMPL's AORRTC: the shortest paths, for as long as the budget lasts."""

from __future__ import annotations

from dataclasses import replace

from planners.motion.problem import MotionProblem, MotionResult
from planners.motion.search.ompl_planner import OmplPlanner
from planners.motion.search.rrt_connect_config import RrtConnectConfig

OPTIMIZE_ITERATIONS = 3000
"""Iterations after which the path is taken, if the problem's budget is larger."""


class Aorrtc(OmplPlanner):
    """Asymptotically optimal RRT-Connect; it uses up its budget, so that the budget is the price of quality.

    Source: Wilson, Thomason, Kingston and Gammell, AORRTC: Almost-surely asymptotically optimal planning with
    RRT-Connect, IEEE RA-L 2025.
    """

    def __init__(self, config: RrtConnectConfig | None = None) -> None:
        super().__init__("AORRTC", config)

    def plan(self, problem: MotionProblem) -> MotionResult:
        """See `OmplPlanner.plan`; at most `OPTIMIZE_ITERATIONS` are made unless no path is found by then."""
        short = replace(problem, max_iterations=min(problem.max_iterations, OPTIMIZE_ITERATIONS))
        result = super().plan(short)
        if result.solved or result.iterations < short.max_iterations or short.max_iterations == problem.max_iterations:
            return result
        return super().plan(problem)
