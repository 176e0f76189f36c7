"""Arm planning by OMPL's RRT-Connect over our own edge check."""

from __future__ import annotations

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from planners.motion.collision import CollisionChecker
from planners.motion.problem import MotionProblem, MotionResult, MotionStatus, settle_early
from planners.motion.rrt_connect_config import RrtConnectConfig
from planners.motion.shortcut import shorten


class _EdgeValidator(ob.MotionValidator):
    """Hands an OMPL edge to the compiled check in one call."""

    def __init__(self, si: ob.SpaceInformation, checker: CollisionChecker) -> None:
        super().__init__(si)
        self._checker = checker
        self._n = checker.model.n_joints

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:
        # Slices copy: OMPL reuses the memory of states it shows to callbacks.
        return self._checker.edge(a[0 : self._n], b[0 : self._n])


class RrtConnect:
    """RRT-Connect of OMPL with iteration-count termination and our own shortcutting.

    OMPL's random numbers are seeded per query, which makes a query repeatable within and across processes.

    Source: Kuffner and LaValle, RRT-Connect, ICRA 2000; OMPL 2.0.
    """

    def __init__(self, config: RrtConnectConfig | None = None) -> None:
        self.config = config or RrtConnectConfig()

    def plan(self, problem: MotionProblem) -> MotionResult:
        """Find a path from the start to one of the goals.

        Args:
            problem: The query.

        Returns:
            Path, status and iterations.
        """
        settled, goals = settle_early(problem)
        if settled is not None:
            return settled
        checker = problem.checker
        n = checker.model.n_joints
        ou.setLogLevel(ou.LogLevel.LOG_NONE)  # seeding again is an "error" to OMPL, though it works
        ou.RNG.setSeed(problem.seed + 1)  # before anything of the query exists; 0 is not a seed to OMPL
        space = ob.RealVectorStateSpace(n)
        bounds = ob.RealVectorBounds(n)
        for i in range(n):
            bounds.setLow(i, float(checker.model.lower[i]))
            bounds.setHigh(i, float(checker.model.upper[i]))
        space.setBounds(bounds)
        setup = og.SimpleSetup(space)
        si = setup.getSpaceInformation()
        setup.setStateValidityChecker(lambda state: checker.free(state[0:n]))
        validator = _EdgeValidator(si, checker)  # OMPL does not keep the Python object alive: this name must
        si.setMotionValidator(validator)
        setup.setStartState(_state(si, problem.start))
        goal = ob.GoalStates(si)
        for q in goals:
            goal.addState(_state(si, q))
        setup.setGoal(goal)
        planner = og.RRTConnect(si)
        planner.setRange(self.config.range_rad)
        setup.setPlanner(planner)
        used = 0

        def spent() -> bool:
            nonlocal used
            used += 1
            return used > problem.max_iterations

        setup.solve(ob.PlannerTerminationCondition(spent))
        iterations = min(used, problem.max_iterations)
        if not setup.haveExactSolutionPath():
            return MotionResult(path=np.empty((0, n)), status=MotionStatus.NO_SOLUTION, iterations=iterations)
        path = np.array([state[0:n] for state in setup.getSolutionPath().getStates()])
        path = shorten(path, checker, rounds=self.config.shortcut_rounds, seed=problem.seed)
        return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=iterations)


def _state(si: ob.SpaceInformation, q: np.ndarray[tuple[int], np.dtype[np.float64]]) -> ob.State:
    state = si.allocState()
    state[0 : len(q)] = [float(x) for x in q]
    return state
