"""Routes of an arm: leave in a straight line, travel, arrive in a straight line; smooth, short and timed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import InverseKinematics
from planners.motion.arm.kinematics import flange_from_tip
from planners.motion.arrays import FloatArray, IntArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.path.lines import straight_line, tip_pose
from planners.motion.path.trajectory import Trajectory, retime
from planners.motion.problem import MotionPlanner, MotionProblem, MotionResult
from planners.motion.status import MotionStatus

_SPEED_SHARE, _ACCELERATION_SHARE = 0.995, 0.98
"""Parts of the limits that are planned with: `retime` keeps its limits up to 0.3 % and 1 %."""
_MOST = 2**31 - 1
_MOST_SEED = 2**32 - 1_000
_WORTH = 0.95
"""A goal is worth a try if its distance is less than so much of the best path's length."""


class RouteStatus(Enum):
    """How a route query ended."""

    SOLVED = "solved"
    NO_LINE_FROM_START = "no_line_from_start"
    """The straight way out collides, or leaves the reach or the joint limits."""
    UNREACHABLE = "unreachable"
    """No configuration inside the limits puts the tool at any of the poses."""
    GOALS_COLLIDE = "goals_collide"
    """Configurations exist, but all of them collide."""
    NO_LINE_TO_GOAL = "no_line_to_goal"
    """No straight way leads to a pose from where the search could get to."""
    START_COLLIDES = "start_collides"
    """The start, or the end of the straight way out, collides, is near to something, or outside the joint limits."""
    NO_PATH = "no_path"
    """The search's budget is used up."""
    NOT_TIMED = "not_timed"
    """A timed motion leaves its path so far that it collides."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteProblem:
    """Bring the tool from a configuration to any of several poses."""

    start: FloatArray
    """Start [rad], shape (n,)."""
    tips: FloatArray
    """Tool tip poses in the base frame, any of which will do, shape (k, 4, 4), k >= 1."""
    leave: FloatArray
    """Straight way of the tip before it travels, base frame [m], shape (3,); zero for none."""
    arrive: FloatArray
    """From a tip pose to where the straight way to it begins, base frame [m], shape (3,); zero for none."""
    seed: int = 0
    """The same problem and seed give the same bytes, in any process."""

    def __post_init__(self) -> None:
        for name in ("start", "tips", "leave", "arrive"):
            checks.is_array(f"RouteProblem.{name}", getattr(self, name))
        checks.whole("RouteProblem: seed", self.seed, 0, _MOST_SEED)
        if self.start.ndim != 1 or self.tips.ndim != 3 or self.tips.shape[1:] != (4, 4) or len(self.tips) == 0:
            raise PlanningError(
                f"RouteProblem: start {self.start.shape}, tips {self.tips.shape}; valid: (n,) and (k, 4, 4), k >= 1"
            )
        for name in ("leave", "arrive"):
            if getattr(self, name).shape != (3,):
                raise PlanningError(f"RouteProblem.{name}: shape {getattr(self, name).shape}; valid: (3,)")
        for name in ("start", "tips", "leave", "arrive"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise PlanningError(f"RouteProblem.{name}: {getattr(self, name).tolist()}; valid: finite numbers")
        for tip in self.tips:
            checks.rigid("RouteProblem.tips", tip)


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """Outcome of a route query."""

    status: RouteStatus
    out: FloatArray
    """Straight way out [rad], shape (k, n), one row if there is none; (0, n) if not solved."""
    travel: FloatArray
    """Corners of the way between the lines [rad], shape (k, n)."""
    into: FloatArray
    """Straight way to the pose [rad], shape (k, n)."""
    segments: tuple[Trajectory, ...] = ()
    """The timed motions, each from rest to rest, in order; lines that have no length are left out."""
    goals: FloatArray | None = None
    """What the search could choose from [rad], shape (k, n); None if it did not come to that."""

    @property
    def solved(self) -> bool:
        """Whether there is a route."""
        return self.status is RouteStatus.SOLVED

    @property
    def duration_s(self) -> float:
        """Time of all segments [s]."""
        return sum(segment.duration_s for segment in self.segments)


@dataclass(frozen=True, kw_only=True)
class RouteConfig:
    """Settings of `RoutePlanner`."""

    n_goals: int = 24
    """Goals given to the search: the nearest ones that do not collide."""
    n_further_goals: int = 400
    """Goals given to further searches, if the first finds no path."""
    first_iterations: int = 3_000
    """Budget of the first search, in the planner's own unit."""
    n_tries: int = 4
    """Searches of which the shortest path is taken."""
    good_ratio: float = 1.25
    """A path no longer than so many times the distance to the nearest goal ends the tries."""
    n_restarts: int = 3
    """Further searches, each with random numbers of its own."""
    max_iterations: int = 20_000
    """Budget of each of them."""
    line_speed: float = 0.6
    """Share of the speed and acceleration limits used on straight lines."""
    corner_rad: tuple[float, ...] = (0.1, 0.03, 0.01)
    """How far corners may be cut, largest first: the first that stays free is taken [rad]."""
    sample_s: float = 0.01
    """Sample period of the segments [s]."""

    def __post_init__(self) -> None:
        for name, least in (("n_goals", 1), ("n_further_goals", 1), ("first_iterations", 0), ("n_tries", 1)):
            checks.whole(f"RouteConfig.{name}", getattr(self, name), least, _MOST)
        for name in ("n_restarts", "max_iterations"):
            checks.whole(f"RouteConfig.{name}", getattr(self, name), 0, _MOST)
        for name in ("good_ratio", "line_speed", "sample_s"):
            checks.positive(f"RouteConfig.{name}", getattr(self, name))
        if not self.corner_rad:
            raise PlanningError("RouteConfig.corner_rad: nothing; valid: at least one number > 0")
        for corner in self.corner_rad:
            checks.positive("RouteConfig.corner_rad", corner)


class RoutePlanner:
    """Plans routes of one arm in one scene.

    Args:
        inverse: Inverse kinematics of the arm.
        travel: The scene for the way between the lines, with what the tool holds and a margin.
        line: The scene for the straight lines, usually with less margin; also for their ends.
        planner: Searches between the lines.
        max_velocity_radps: Joint speed limits, shape (n,).
        max_acceleration_radps2: Joint acceleration limits, shape (n,).
        config: Settings.
    """

    def __init__(
        self,
        inverse: InverseKinematics,
        travel: CollisionChecker,
        line: CollisionChecker,
        planner: MotionPlanner,
        max_velocity_radps: npt.ArrayLike,
        max_acceleration_radps2: npt.ArrayLike,
        config: RouteConfig | None = None,
    ) -> None:
        self.config = config or RouteConfig()
        self._inverse, self._travel, self._line, self._planner = inverse, travel, line, planner
        model = travel.model
        self._solid = travel.with_margin(0.0)
        self._descent = NumericInverse.from_joints(model.base_from_joint, model.lower, model.upper)
        self._velocity = checks.floats("RoutePlanner: max_velocity_radps", max_velocity_radps).copy()
        self._acceleration = checks.floats("RoutePlanner: max_acceleration_radps2", max_acceleration_radps2).copy()
        for name, limit in (("velocity", self._velocity), ("acceleration", self._acceleration)):
            if limit.shape != (model.n_joints,) or not np.all(limit > 0):
                raise PlanningError(f"RoutePlanner: max_{name} {limit}; valid: {model.n_joints} values > 0")
        self._tool_m = model.tool_length

    def plan(self, problem: RouteProblem) -> Route:
        """Find, shorten and time a route.

        Args:
            problem: The query.

        Returns:
            The route, or a status that says why there is none.

        Raises:
            PlanningError: The start has the wrong number of joints.
        """
        n = self._travel.model.n_joints
        if problem.start.shape != (n,):
            raise PlanningError(f"RouteProblem.start: shape {problem.start.shape}; valid: ({n},)")
        out = self._way_out(problem)
        if out is None:
            return self._failed(RouteStatus.NO_LINE_FROM_START)
        # The nearest goals make short paths; what cannot be reached at all is found out by offering many.
        config = self.config
        searches = [(config.n_goals, config.first_iterations)]
        searches += [(config.n_further_goals, config.max_iterations)] * config.n_restarts
        for attempt, (n_goals, budget) in enumerate(searches):
            goals, poses, status = self._goals(problem, out[-1], n_goals)
            # A search that takes very long with some random numbers is often short with others.
            query = replace(problem, seed=problem.seed + attempt * config.n_tries)
            route = self._to_goals(query, out, goals, poses, budget) if len(goals) else self._failed(status)
            if route.status is not RouteStatus.NO_PATH:
                break
        return route

    def travel(self, start: FloatArray, goals: FloatArray, seed: int = 0) -> Route:
        """Find, shorten and time a way between configurations, without straight lines at its ends.

        Args:
            start: Start [rad], shape (n,).
            goals: Goals, any of which will do [rad], shape (k, n), k >= 1.
            seed: The same start, goals and seed give the same bytes, in any process.

        Returns:
            The route, or a status that says why there is none.

        Raises:
            PlanningError: Malformed input.
        """
        start = checks.vector("travel: start", start, self._travel.model.n_joints)
        goals = checks.rows("travel: goals", goals, self._travel.model.n_joints)
        checks.whole("travel: seed", seed, 0, _MOST_SEED)
        for attempt in range(1 + self.config.n_restarts):
            budget = self.config.max_iterations if attempt else self.config.first_iterations
            result = self._shortest(start, goals, seed + attempt * self.config.n_tries, budget)
            if result.solved:
                return self._timed(start[None], result.path, result.path[-1:], goals)
            if result.status is MotionStatus.INVALID_GOAL:
                return self._failed(RouteStatus.GOALS_COLLIDE)
            if result.status is MotionStatus.INVALID_START:
                return self._failed(RouteStatus.START_COLLIDES)
        return self._failed(RouteStatus.NO_PATH)

    def _to_goals(
        self, problem: RouteProblem, out: FloatArray, goals: FloatArray, poses: IntArray, budget: int
    ) -> Route:
        """Search, and search again without goals that no straight line leads in from."""
        offered = goals
        status = RouteStatus.NO_PATH
        while len(goals):
            result = self._shortest(out[-1], goals, problem.seed, budget)
            if result.status is MotionStatus.INVALID_START:
                return self._failed(RouteStatus.START_COLLIDES)
            if not result.solved:
                break
            chosen = int(np.argmin(np.abs(goals - result.path[-1]).max(axis=1)))
            into = self._way_in(problem, result.path[-1], problem.tips[poses[chosen]])
            if into is not None:
                return self._timed(out, result.path, into, offered)
            goals, poses = np.delete(goals, chosen, axis=0), np.delete(poses, chosen)
            status = RouteStatus.NO_LINE_TO_GOAL
        return self._failed(status)

    def can_leave(self, problem: RouteProblem) -> bool:
        """Whether there is a free straight way out that ends with the margin of the travel."""
        out = self._way_out(problem)
        return out is not None and self._travel.free(out[-1])

    def tip(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the tool tip in the base frame for q (n,), shape (4, 4)."""
        return tip_pose(self._inverse, np.asarray(q, dtype=np.float64), self._tool_m)

    def _failed(self, status: RouteStatus) -> Route:
        nothing = np.empty((0, self._travel.model.n_joints))
        return Route(status=status, out=nothing, travel=nothing, into=nothing)

    def _way_out(self, problem: RouteProblem) -> FloatArray | None:
        if not np.any(problem.leave):
            return problem.start[None]
        tip = tip_pose(self._inverse, problem.start, self._tool_m)
        tip[:3, 3] += problem.leave
        return self._checked_line(problem.start, tip)

    def _way_in(self, problem: RouteProblem, q: FloatArray, tip: FloatArray) -> FloatArray | None:
        return self._checked_line(q, tip) if np.any(problem.arrive) else q[None]

    def _checked_line(self, q: FloatArray, tip: FloatArray) -> FloatArray | None:
        line = straight_line(self._inverse, self._descent, q, tip, self._tool_m)
        return line if line is not None and self._line.path_free(line) else None

    def _goals(self, problem: RouteProblem, start: FloatArray, wanted: int) -> tuple[FloatArray, IntArray, RouteStatus]:
        """The nearest free configurations where arrivals begin (k, n), and the pose each belongs to (k,)."""
        found, pose = [], []
        for i, tip in enumerate(problem.tips):
            above = tip.copy()
            above[:3, 3] += problem.arrive
            solutions = self._inverse.ik_all(flange_from_tip(above, self._tool_m))
            found.append(solutions)
            pose.append(np.full(len(solutions), i))
        q, poses = np.concatenate(found), np.concatenate(pose)
        order = np.argsort(np.linalg.norm(q - start, axis=1), kind="stable")
        picked: list[int] = []
        for first in range(0, len(order), 4 * wanted):
            rows = order[first : first + 4 * wanted]
            picked += rows[self._travel.batch(q[rows])].tolist()
            if len(picked) >= wanted:
                break
        status = RouteStatus.UNREACHABLE if len(q) == 0 else RouteStatus.GOALS_COLLIDE
        return q[picked[:wanted]], poses[picked[:wanted]], status

    def _shortest(self, start: FloatArray, goals: FloatArray, seed: int, budget: int) -> MotionResult:
        """The shortest path of several searches; one that is nearly straight ends them."""
        config = self.config
        distance = np.linalg.norm(goals - start, axis=1)
        good = config.good_ratio * float(distance.min())
        query = MotionProblem(checker=self._travel, start=start, goals=goals, seed=seed, max_iterations=budget)
        best = self._planner.plan(query)
        for attempt in range(1, config.n_tries):
            if not best.solved or best.length_rad <= good:
                break
            # Only goals that are nearer than the path is long can shorten it.
            nearer = goals[distance < _WORTH * best.length_rad]
            if len(nearer) == 0:
                break
            other = self._planner.plan(replace(query, goals=nearer, seed=seed + attempt))
            if other.solved and other.length_rad < best.length_rad:
                best = other
        return best

    def _timed(self, out: FloatArray, travel: FloatArray, into: FloatArray, goals: FloatArray) -> Route:
        segments = []
        for path, speed in ((out, self.config.line_speed), (travel, 1.0), (into, self.config.line_speed)):
            if len(path) == 1:
                continue
            segment = self._timed_segment(path, speed)
            if segment is None:
                return self._failed(RouteStatus.NOT_TIMED)
            segments.append(segment)
        return Route(
            status=RouteStatus.SOLVED, out=out, travel=travel, into=into, segments=tuple(segments), goals=goals
        )

    def _timed_segment(self, path: FloatArray, speed: float) -> Trajectory | None:
        """The fastest motion along a path; corners are cut less if cutting them would touch something.

        Cut corners may use up the margin, which is there for such things; the obstacles themselves stay clear.
        """
        for deviation in self.config.corner_rad if speed == 1.0 else self.config.corner_rad[-1:]:
            trajectory = retime(
                path,
                self._velocity * (speed * _SPEED_SHARE),
                self._acceleration * (speed * _ACCELERATION_SHARE),
                self.config.sample_s,
                max_deviation_rad=deviation,
            )
            if self._solid.path_free(trajectory.q):
                return trajectory
        return None
