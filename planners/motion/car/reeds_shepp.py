"""Manoeuvres of a car, forwards and backwards, between two poses: OMPL's Reeds-Shepp curves and RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from planners.errors import PlanningError
from planners.motion.arrays import BoolArray, FloatArray
from planners.motion.status import MotionStatus

Validity = Callable[[FloatArray], BoolArray]

_STEP_M = 0.05  # spacing of poses, in the result and in validity checks
_FINE_M = 0.002  # segments shorter than this may be missed when the direction of travel is recovered
_BISECTIONS = 30
_SHORTCUTS = 40
_REACH_RADII = 4.0  # room for manoeuvres around both poses, in turning radii


@dataclass(frozen=True, kw_only=True, eq=False)
class RejoinResult:
    """A manoeuvre of a car."""

    poses: FloatArray
    """Rear axle x, y [m] and yaw [rad, continuous] at most 0.05 m apart, every cusp included, shape (k, 3)."""
    directions: npt.NDArray[np.int8]
    """+1 forwards, -1 backwards: the travel from each pose to the next (the last repeats), shape (k,)."""
    status: MotionStatus
    iterations: int
    """Tree extensions used; 0 when the direct curve was valid."""

    @property
    def solved(self) -> bool:
        """Whether there is a manoeuvre."""
        return self.status is MotionStatus.SOLVED

    @property
    def length_m(self) -> float:
        """Distance driven, both ways counted [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1).sum())


class _Curves:
    """Reeds-Shepp curves as arrays."""

    def __init__(self, turning_radius_m: float, low: FloatArray, high: FloatArray) -> None:
        self.space = ob.ReedsSheppStateSpace(turning_radius_m)
        bounds = ob.RealVectorBounds(2)
        for i in range(2):
            bounds.setLow(i, float(low[i]))
            bounds.setHigh(i, float(high[i]))
        self.space.setBounds(bounds)
        self._from, self._to, self._at = (self.space.allocState() for _ in range(3))

    def length(self, a: FloatArray, b: FloatArray) -> float:
        """Length of the shortest curve [m]."""
        write_state(self._from, a)
        write_state(self._to, b)
        return float(self.space.distance(self._from, self._to))

    def sample(self, a: FloatArray, b: FloatArray, fractions: FloatArray) -> FloatArray:
        """Poses at fractions (k,) of the curve's length, shape (k, 3)."""
        write_state(self._from, a)
        write_state(self._to, b)
        poses = np.empty((len(fractions), 3))
        for i, fraction in enumerate(fractions):
            self.space.interpolate(self._from, self._to, float(fraction), self._at)
            poses[i] = read_state(self._at)
        return poses

    def spaced(self, a: FloatArray, b: FloatArray, step_m: float) -> FloatArray:
        """Poses at most `step_m` apart, both ends included."""
        n = max(1, int(np.ceil(self.length(a, b) / step_m)))
        return self.sample(a, b, np.arange(n + 1) / n)


def read_state(state: ob.State) -> tuple[float, float, float]:
    """Pose of an SE(2) state; copied at once, since OMPL reuses the memory."""
    return state.getX(), state.getY(), state.getYaw()


def write_state(state: ob.State, pose: FloatArray) -> None:
    """Set an SE(2) state; the yaw is brought to (-pi, pi]."""
    state.setX(float(pose[0]))
    state.setY(float(pose[1]))
    state.setYaw(float(np.arctan2(np.sin(pose[2]), np.cos(pose[2]))))


class _CurveValidator(ob.MotionValidator):
    """Checks a whole curve by one call of the caller's validity function."""

    def __init__(self, si: ob.SpaceInformation, curves: _Curves, valid: Validity) -> None:
        super().__init__(si)
        self._curves = curves
        self._valid = valid

    def checkMotion(self, a: ob.State, b: ob.State) -> bool:
        start, goal = np.array(read_state(a)), np.array(read_state(b))
        return bool(np.all(self._valid(self._curves.spaced(start, goal, _STEP_M))))


def plan_rejoin(
    start: npt.ArrayLike,
    goal: npt.ArrayLike,
    turning_radius_m: float,
    valid: Validity,
    *,
    seed: int = 0,
    max_iterations: int = 1000,
    lead_m: float = 0.0,
    lead_radius_m: float = np.inf,
) -> RejoinResult:
    """Find a drivable way from a pose to a pose, reversing where needed.

    The direct Reeds-Shepp curve is taken if it is valid; else RRT-Connect looks for one around obstacles, and random
    shortcuts shorten it. The same query and seed give the same bytes, in any process.

    Args:
        start: Rear axle x, y [m], yaw [rad], shape (3,).
        goal: Wanted rear axle pose, shape (3,).
        turning_radius_m: Smallest turning radius of the rear axle [m], > 0.
        valid: Says for poses (k, 3) which are free, shape (k,) bool; called at poses at most 0.05 m apart.
        seed: Seed of the search, 0 to 2^32 - 2.
        max_iterations: Tree extensions to try; 0 tries the direct curve only.
        lead_m: Driven straight, or in a wide curve, before all else [m]; negative backwards.
        lead_radius_m: Radius of that curve [m]; positive to the left, negative to the right.

    Returns:
        The manoeuvre; empty arrays if there is none.

    Raises:
        PlanningError: Malformed input.

    Source: Reeds and Shepp, Optimal paths for a car that goes both forwards and backwards, 1990; OMPL 2.0.
    """
    a, b = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    if a.shape != (3,) or b.shape != (3,) or not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        raise PlanningError(f"plan_rejoin: start {a.tolist()}, goal {b.tolist()}; valid: x, y, yaw each")
    if not turning_radius_m > 0:
        raise PlanningError(f"plan_rejoin: turning_radius_m {turning_radius_m}; valid: > 0")
    if not 0 <= seed < 2**32 - 1 or max_iterations < 0:
        raise PlanningError(f"plan_rejoin: seed {seed}, max_iterations {max_iterations}; valid: >= 0")
    if not np.isfinite(lead_m):
        raise PlanningError(f"plan_rejoin: lead_m {lead_m}; valid: a finite length")
    if not abs(lead_radius_m) >= turning_radius_m:
        raise PlanningError(f"plan_rejoin: lead_radius_m {lead_radius_m}; valid: at least {turning_radius_m} to a side")
    if not np.all(valid(a[None])):
        return _unsolved(MotionStatus.INVALID_START, 0)
    if not np.all(valid(b[None])):
        return _unsolved(MotionStatus.INVALID_GOAL, 0)
    room = _REACH_RADII * turning_radius_m
    curves = _Curves(turning_radius_m, np.minimum(a, b)[:2] - room, np.maximum(a, b)[:2] + room)
    before = _lead(a, lead_m, lead_radius_m)
    led = before[-1]
    direct = _finished(before, curves, np.stack([led, b]), 0)
    if np.all(valid(direct.poses)):
        return direct
    corners, iterations = _search(curves, led, b, valid, seed, max_iterations)
    if corners is not None:
        for candidate in (_shorten(curves, corners, valid, np.random.default_rng(seed)), corners):
            result = _finished(before, curves, candidate, iterations)
            if np.all(valid(result.poses)):  # the result has poses, at cusps, that the search did not look at
                return result
    return _unsolved(MotionStatus.NO_SOLUTION, iterations)


def _search(
    curves: _Curves, start: FloatArray, goal: FloatArray, valid: Validity, seed: int, max_iterations: int
) -> tuple[FloatArray | None, int]:
    """Corner poses of a valid way (k, 3) by RRT-Connect, or None; and the iterations used."""
    ou.setLogLevel(ou.LogLevel.LOG_NONE)  # seeding again is an "error" to OMPL, though it works
    ou.RNG.setSeed(seed + 1)
    setup = og.SimpleSetup(curves.space)
    si = setup.getSpaceInformation()

    def state_valid(state: ob.State) -> bool:
        return bool(np.all(valid(np.array([read_state(state)]))))

    setup.setStateValidityChecker(state_valid)
    validator = _CurveValidator(si, curves, valid)  # OMPL does not keep the Python object alive: this name must
    si.setMotionValidator(validator)
    ends = si.allocState(), si.allocState()
    write_state(ends[0], start)
    write_state(ends[1], goal)
    setup.setStartAndGoalStates(*ends, 1e-6)
    setup.setPlanner(og.RRTConnect(si))
    used = 0

    def spent() -> bool:
        nonlocal used
        used += 1
        return used > max_iterations

    setup.solve(ob.PlannerTerminationCondition(spent))
    iterations = min(used, max_iterations)
    if not setup.haveExactSolutionPath():
        return None, iterations
    return np.array([read_state(s) for s in setup.getSolutionPath().getStates()]), iterations


def _shorten(curves: _Curves, corners: FloatArray, valid: Validity, rng: np.random.Generator) -> FloatArray:
    """Replace stretches between random poses of the way by direct curves where those are shorter and valid."""
    for _ in range(_SHORTCUTS):
        lengths = np.array([curves.length(p, q) for p, q in pairwise(corners)])
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        first, last = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (int(np.clip(np.searchsorted(along, s) - 1, 0, len(lengths) - 1)) for s in (first, last))
        if i == j:
            continue
        p, q = (
            curves.sample(corners[k], corners[k + 1], np.array([(s - along[k]) / max(lengths[k], 1e-9)]))[0]
            for k, s in ((i, first), (j, last))
        )
        if curves.length(p, q) > last - first - 1e-3:
            continue
        shorter = np.concatenate([corners[: i + 1], [p, q], corners[j + 1 :]])
        changed = [curves.spaced(shorter[k], shorter[k + 1], _STEP_M) for k in (i, i + 1, i + 2)]
        if np.all(valid(np.concatenate(changed))):
            corners = shorter
    return corners


def _lead(start: FloatArray, length_m: float, radius_m: float) -> FloatArray:
    """Poses of an arc, or a straight line, at most `_STEP_M` apart, shape (k, 3)."""
    n = int(np.ceil(abs(length_m) / _STEP_M))
    s_m = np.linspace(0.0, length_m, n + 1)
    turn = s_m / radius_m
    # Chords of an arc: sinc is sin(pi x) / (pi x).
    chord, heading = s_m * np.sinc(turn / (2 * np.pi)), start[2] + turn / 2
    return np.stack([start[0] + chord * np.cos(heading), start[1] + chord * np.sin(heading), start[2] + turn], axis=1)


def _finished(before: FloatArray, curves: _Curves, corners: FloatArray, iterations: int) -> RejoinResult:
    """A way along the poses `before`, the last of which is the first corner, and then from corner to corner."""
    pieces = [_with_cusps(curves, a, b) for a, b in pairwise(corners)]
    poses = np.concatenate([before[:-1]] + [p[:-1] for p, _ in pieces] + [corners[-1:]])
    directions = np.concatenate([_travel(before)] + [d for _, d in pieces])
    poses[:, 2] = np.unwrap(poses[:, 2])
    moved = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) > 1e-9
    poses = poses[np.concatenate([moved, [True]])]
    directions = directions[moved]
    last = directions[-1:] if len(directions) else np.ones(1, dtype=np.int8)
    return RejoinResult(
        poses=poses,
        directions=np.concatenate([directions, last]).astype(np.int8),
        status=MotionStatus.SOLVED,
        iterations=iterations,
    )


def _with_cusps(curves: _Curves, a: FloatArray, b: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int8]]:
    """Poses of one curve with its cusps among them (k, 3) and the directions between them (k-1,).

    The bindings do not tell the segments of a curve, so the direction comes from the motion against the heading.
    """
    length = curves.length(a, b)
    if length < 1e-9:
        return np.stack([a, b]), np.ones(1, dtype=np.int8)
    n = max(1, int(np.ceil(length / _FINE_M)))
    fraction = np.arange(n + 1) / n
    fine = curves.sample(a, b, fraction)
    sign = _travel(fine)
    cusps = []
    for k in np.flatnonzero(sign[1:] != sign[:-1]):
        # The cusp is within the two intervals around fraction[k + 1]: halve them by the direction at the middle.
        low, high = fraction[k], fraction[k + 2]
        probe = 1e-3 / n
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            here = _travel(curves.sample(a, b, np.array([middle - probe, middle + probe])))[0]
            low, high = (middle, high) if here == sign[k] else (low, middle)
        cusps.append(0.5 * (low + high))
    borders = np.array([0.0, *cusps, 1.0])
    fractions, directions = [np.zeros(1)], []
    for low, high in pairwise(borders):
        m = max(1, int(np.ceil((high - low) * length / _STEP_M)))
        fractions.append(low + (high - low) * np.arange(1, m + 1) / m)
        middle_sign = sign[min(int(0.5 * (low + high) * n), n - 1)]
        directions.append(np.full(m, middle_sign, dtype=np.int8))
    poses = curves.sample(a, b, np.concatenate(fractions))
    poses[0], poses[-1] = a, b
    return poses, np.concatenate(directions)


def _travel(poses: FloatArray) -> npt.NDArray[np.int8]:
    """+1 or -1 between neighbours: along or against the heading half-way."""
    step = np.diff(poses[:, :2], axis=0)
    half_turn = 0.5 * np.angle(np.exp(1j * np.diff(poses[:, 2])))
    yaw = poses[:-1, 2] + half_turn
    return np.where(step[:, 0] * np.cos(yaw) + step[:, 1] * np.sin(yaw) >= 0.0, 1, -1).astype(np.int8)


def _unsolved(status: MotionStatus, iterations: int) -> RejoinResult:
    return RejoinResult(
        poses=np.empty((0, 3)), directions=np.empty(0, dtype=np.int8), status=status, iterations=iterations
    )
