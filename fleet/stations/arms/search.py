"""Search: ways of an arm between configurations, by a planner with a budget, and the trees that it grew for them."""

from __future__ import annotations

from fleet.arrays import FloatArray
from planners.motion import motion_planner
from planners.motion.collision.collision import CollisionChecker
from planners.motion.problem import MotionProblem, MotionResult
from planners.motion.search.search_tree import GrowsTrees, SearchTree


class Search:
    """Searches ways, one after the other.

    Args:
        planner: Of `motion_planner`.
        n_iterations: Budget of one search.
    """

    def __init__(self, planner: str, n_iterations: int) -> None:
        self._planner = motion_planner(planner)
        self._grower = self._planner if isinstance(self._planner, GrowsTrees) else None
        self._n_iterations = n_iterations

    def way(self, checker: CollisionChecker, start: FloatArray, goals: FloatArray, *, seed: int = 0) -> MotionResult:
        """Search a way.

        Args:
            checker: What must not be touched.
            start: Where the arm is [rad], shape (n,).
            goals: Where it may end [rad], shape (k, n).
            seed: Another one may find another way.
        """
        problem = MotionProblem(checker=checker, start=start, goals=goals, seed=seed, max_iterations=self._n_iterations)
        return self._planner.plan(problem)

    @property
    def keeps_trees(self) -> bool:
        """Whether the trees of searches are kept until they are taken."""
        return self._grower is not None and self._grower.trees is not None

    def keep_trees(self) -> None:
        """Keep the trees of searches from now on, if the planner grows any."""
        if self._grower is not None:
            self._grower.trees = []

    def take_trees(self) -> list[SearchTree]:
        """The trees since the last call; empty while none are kept."""
        if self._grower is None or self._grower.trees is None:
            return []
        trees, self._grower.trees = self._grower.trees, []
        return trees

    def add_trees(self, trees: list[SearchTree]) -> None:
        """Put trees of earlier searches behind those that are kept."""
        if self._grower is not None and self._grower.trees is not None:
            self._grower.trees += trees
