"""Arm planning by any planner that OMPL offers to Python, over our own edge check, guarded against its traps."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from planners.errors import PlanningError
from planners.motion.arrays import FloatArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.problem import MotionProblem, MotionResult, path_length, settle_early
from planners.motion.search.rrt_connect_config import RrtConnectConfig
from planners.motion.search.search_tree import SearchTree
from planners.motion.search.shortcut import shorten
from planners.motion.status import MotionStatus

_WAITS = "asks its termination condition in a second thread, which waits for Python's lock for ever"
REFUSED = MappingProxyType({"PRM": _WAITS, "PRMstar": _WAITS})
"""Planners that hang with a termination condition that counts, and why; measured with OMPL 2.0.1."""
ONE_GOAL = frozenset({"AORRTC"})
"""Planners that search on for ever in one call once their path is shorter than the way to another goal would be."""
GOALS_IN_TURN = 4
"""Goals that such a planner is given one after the other, nearest first, each with its share of the budget."""
OMPL_PLANNERS: tuple[str, ...] = tuple(
    name
    for name in sorted(dir(og))
    if isinstance(getattr(og, name), type) and issubclass(getattr(og, name), ob.Planner) and name not in REFUSED
)
"""Planners that can be named."""
MOST_MOTIONS = 50_000
"""A planner that checks so many motions without asking whether it should end has lost its way: about half a second."""


class UnknownPlannerError(PlanningError):
    """No planner of this name is offered to Python."""


class HangingPlannerError(PlanningError):
    """The planner would never return."""


class StuckPlannerError(PlanningError):
    """The planner no longer asks whether it should end."""


class InfiniteLimitsError(PlanningError):
    """A space without bounds cannot be sampled."""


class _Stuck(Exception):
    """Passes through OMPL and never reaches a caller."""


class _EdgeValidator(ob.MotionValidator):
    """Hands an OMPL edge to the compiled check in one call."""

    def __init__(self, si: ob.SpaceInformation, checker: CollisionChecker) -> None:
        super().__init__(si)
        self._checker = checker
        self._n = checker.model.n_joints
        self.since_asked = 0
        """Motions since the planner last asked whether it should end."""

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:
        self.since_asked += 1
        if self.since_asked > MOST_MOTIONS:
            raise _Stuck
        # Slices copy: OMPL reuses the memory of states it shows to callbacks.
        return self._checker.edge(a[0 : self._n], b[0 : self._n])


class OmplPlanner:
    """One of OMPL's geometric planners with iteration-count termination and our own shortcutting.

    OMPL's random numbers are seeded per query, which makes a query repeatable within and across processes.

    Args:
        name: One of `OMPL_PLANNERS`.
        config: Longest edge, for planners that have one, and shortening.

    Raises:
        UnknownPlannerError: No such planner.
        HangingPlannerError: The planner is known to hang.

    Source: Sucan, Moll, Kavraki, The Open Motion Planning Library, IEEE RAM 2012; OMPL 2.0.
    """

    def __init__(self, name: str = "RRTConnect", config: RrtConnectConfig | None = None) -> None:
        if name in REFUSED:
            raise HangingPlannerError(f"OMPL planner {name}: {REFUSED[name]}; valid: {', '.join(OMPL_PLANNERS)}")
        if name not in OMPL_PLANNERS:
            raise UnknownPlannerError(f"OMPL planner {name!r} is not bound; valid: {', '.join(OMPL_PLANNERS)}")
        self.name = name
        self.config = config or RrtConnectConfig()
        self.trees: list[SearchTree] | None = None
        """See `GrowsTrees`."""

    def plan(self, problem: MotionProblem) -> MotionResult:
        """Find a path from the start to one of the goals.

        Args:
            problem: The query.

        Returns:
            Path, status and iterations.

        Raises:
            StuckPlannerError: The planner went on checking motions without asking whether its budget is spent.
            InfiniteLimitsError: The arm has a joint without limits.
        """
        settled, goals = settle_early(problem)
        if settled is not None:
            return settled
        used = 0

        def budget(share: float) -> Callable[[], bool]:
            end = min(problem.max_iterations, used + math.ceil(share * problem.max_iterations))

            def spent() -> bool:
                nonlocal used
                used += 1
                return used > end

            return spent

        path = self.search(problem, goals, budget)
        iterations = min(used, problem.max_iterations)
        if path is None:
            nothing = np.empty((0, problem.checker.model.n_joints))
            return MotionResult(path=nothing, status=MotionStatus.NO_SOLUTION, iterations=iterations)
        path = shorten(path, problem.checker, rounds=self.config.shortcut_rounds, seed=problem.seed)
        return MotionResult(path=path, status=MotionStatus.SOLVED, iterations=iterations)

    def search(
        self, problem: MotionProblem, goals: FloatArray, budget: Callable[[float], Callable[[], bool]]
    ) -> FloatArray | None:
        """The bare planner, without shortening.

        Informed planners of OMPL 2.0.1 never return from one call once a path is as short as the straight line to its
        goal: goals that a straight line reaches are kept from the planner, and so are goals beyond the nearest of them.

        Args:
            problem: Start, seed and scene.
            goals: Valid goals [rad], shape (k, n), k >= 1.
            budget: From a share of the whole budget to what the planner asks again and again, and which ends it when
                true.

        Returns:
            Corners [rad], shape (m, n); None if there is no path.

        Raises:
            StuckPlannerError: See `plan`.
            InfiniteLimitsError: See `plan`.
        """
        distance = np.linalg.norm(goals - problem.start, axis=1)
        goals, distance = goals[np.argsort(distance, kind="stable")], np.sort(distance)
        best: FloatArray | None = None
        shortest = np.inf
        for goal, way in zip(goals, distance, strict=True):
            if problem.checker.edge(problem.start, goal):
                best, shortest = np.stack([problem.start, goal]), float(way)
                break
        nearer = goals[distance < shortest]
        if len(nearer) and self.name not in ONE_GOAL:
            path = self._search(problem, nearer, budget(1.0))
            return path if path is not None and path_length(path) < shortest else best
        turns = min(len(nearer), GOALS_IN_TURN)
        for goal in nearer[:turns]:
            if np.linalg.norm(goal - problem.start) >= shortest:
                break
            path = self._search(problem, goal[None], budget(1.0 / turns))
            if path is not None and path_length(path) < shortest:
                best, shortest = path, path_length(path)
        return best

    def _search(self, problem: MotionProblem, goals: FloatArray, spent: Callable[[], bool]) -> FloatArray | None:
        """One call of the planner."""
        checker = problem.checker
        n = checker.model.n_joints
        if not np.all(np.isfinite(checker.model.upper - checker.model.lower)):
            joint = int(np.argmin(np.isfinite(checker.model.upper - checker.model.lower)))
            raise InfiniteLimitsError(f"OMPL planner {self.name}: joint {joint} has no limits; valid: finite limits")
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
        setup.setStateValidityChecker(lambda state: bool(checker.free(state[0:n])))
        validator = _EdgeValidator(si, checker)  # OMPL does not keep the Python object alive: this name must
        si.setMotionValidator(validator)
        setup.setStartState(_state(si, problem.start))
        goal = ob.GoalStates(si)
        for q in goals:
            goal.addState(_state(si, q))
        setup.setGoal(goal)
        planner = getattr(og, self.name)(si)
        if hasattr(planner, "setRange"):
            planner.setRange(self.config.range_rad)
        setup.setPlanner(planner)

        def asked() -> bool:
            validator.since_asked = 0
            return spent()

        try:
            setup.solve(ob.PlannerTerminationCondition(asked))
        except _Stuck:
            raise StuckPlannerError(
                f"OMPL planner {self.name}: {MOST_MOTIONS:,} motions checked without asking whether its budget of "
                f"{problem.max_iterations:,} iterations is spent"
            ) from None
        if self.trees is not None:
            self.trees.append(_tree(planner, si, n))
        if not setup.haveExactSolutionPath():
            return None
        return np.array([state[0:n] for state in setup.getSolutionPath().getStates()])


def _tree(planner: ob.Planner, si: ob.SpaceInformation, n: int) -> SearchTree:
    """Copy what a planner has grown."""
    data = ob.PlannerData(si)
    planner.getPlannerData(data)
    count = data.numVertices()
    vertices = np.array([data.getVertex(k).getState()[0:n] for k in range(count)]).reshape(-1, n)
    edges = [(k, m) for k in range(count) for m in data.getEdges(k)]
    return SearchTree(vertices=vertices, edges=np.array(edges, dtype=np.int64).reshape(-1, 2))


def _state(si: ob.SpaceInformation, q: FloatArray) -> ob.State:
    state = si.allocState()
    state[0 : len(q)] = [float(x) for x in q]
    return state
