"""Plans from the rack to the car: solved share, time, and length against AORRTC's after a second."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.arms import workcell
from benchmarks.harness import Kind, Row, Trial
from planners.motion import MotionProblem, OmplPlanner, RrtConnectNative
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.arm.kinematics import flange_from_tip
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.path.route import Route, RoutePlanner, RouteProblem
from planners.motion.problem import path_length

FloatArray = npt.NDArray[np.float64]

N_PROBLEMS, QUICK_PROBLEMS = 1_000, 12
N_COMPARED, QUICK_COMPARED = 60, 2
REFERENCE_S, QUICK_REFERENCE_S = 1.0, 0.2
N_AGAIN = 20
"""Problems that are solved again, in this process and in another."""
PARCEL_M = 0.08
"""Edge of the parcel in the grip; its upper third is between the fingers."""
BELOW_TIP_M = 0.02
LEAVE_M = np.array([-0.12, 0.0, 0.02])
ARRIVE_M = np.array([0.0, 0.0, 0.12])
TRAVEL_MARGIN_M, LINE_MARGIN_M = 0.01, 0.002
DROP_M = 0.09
"""Tip above the tray's floor when the parcel is let go."""
LIMIT_MARGIN_RAD = 0.06
"""Parcels are gripped so far from joint limits, as at the stations: postures at a limit may have no way out at all."""
YAWS = 8
"""Orientations about the vertical that the parcel may be put down in."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What plans are made with."""

    travel: CollisionChecker
    line: CollisionChecker
    router: RoutePlanner


def digests(seed: int, n: int = N_AGAIN) -> list[str]:
    """Digests of the routes of the first problems, to be compared across processes."""
    bench = _bench()
    return [_digest(bench.router.plan(problem)) for problem in _problems(bench, np.random.default_rng(seed), n)]


def measure_plans(trial: Trial) -> Iterable[Row]:
    """Each plan: inverse kinematics, straight way out, search, shortening, straight way in, timing."""
    bench = _bench()
    n = QUICK_PROBLEMS if trial.quick else N_PROBLEMS
    problems = _problems(bench, np.random.default_rng(trial.seeds[0]), n)
    bench.router.plan(problems[0])  # compiles
    spent_ms, routes = [], []
    for problem in problems:
        begin_s = time.process_time()
        route = bench.router.plan(problem)
        spent_ms.append(1e3 * (time.process_time() - begin_s))
        routes.append(route)
    for k, (problem, route) in enumerate(zip(problems, routes, strict=True)):
        if route.solved:
            _check(trial, bench, k, problem, route)
        else:
            trial.notes.append(f"plan {k}: {route.status.value}")
    first = [_digest(route) for route in routes[:N_AGAIN]]
    again = digests(trial.seeds[0], len(first))
    trial.check(again == first, "plans: the same seeds gave other paths")
    command = f"from benchmarks.arms.plans import digests; print(*digests({trial.seeds[0]}, {len(first)}))"
    other = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    trial.check(
        other.stdout.split()[-len(first) :] == first, "plans: the same seeds gave other paths in another process"
    )
    solved = [route for route in routes if route.solved]
    yield Row(name=f"rack to car, {n:,} plans solved", value=100 * len(solved) / n, unit="%", target=">= 100")
    yield Row(
        name="  time of a plan, median", value=float(np.median(spent_ms)), unit="ms", kind=Kind.TIME, target="<= 8"
    )
    yield Row(
        name="  95th percentile", value=float(np.percentile(spent_ms, 95)), unit="ms", kind=Kind.TIME, target="<= 50"
    )
    yield Row(
        name="  motion, median",
        value=float(np.median([r.duration_s for r in solved] or [0])),
        unit="s",
        kind=Kind.PLAIN,
    )
    count = QUICK_COMPARED if trial.quick else N_COMPARED
    picked = [k for k in range(0, n, max(1, n // count)) if routes[k].solved][:count]
    ratios = [
        path_length(routes[k].travel)
        / _reference_rad(bench, routes[k], k, QUICK_REFERENCE_S if trial.quick else REFERENCE_S)
        for k in picked
    ]
    yield Row(
        name=f"length over AORRTC's of {len(ratios)}, median",
        value=float(np.median(ratios)),
        unit="x",
        target="<= 1.15",
    )
    yield Row(name="  95th percentile", value=float(np.percentile(ratios, 95)), unit="x", target="<= 1.6")


def _bench() -> Bench:
    model, spec = workcell.model(), workcell.spec()
    centre, radius = box_spheres((PARCEL_M / 2,) * 3)
    held = (centre + np.array([0.0, 0.0, spec.tool_length_m + BELOW_TIP_M]), radius)
    travel = CollisionChecker(model, workcell.boxes(), held, margin=TRAVEL_MARGIN_M)
    line = CollisionChecker(model, workcell.boxes(), held, margin=LINE_MARGIN_M)
    inverse = inverse_kinematics(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
    router = RoutePlanner(
        inverse, travel, line, RrtConnectNative(), spec.max_velocity_radps, spec.max_acceleration_radps2
    )
    return Bench(travel=travel, line=line, router=router)


def _problems(bench: Bench, rng: np.random.Generator, n: int) -> list[RouteProblem]:
    """Parcels anywhere on two shelves, held from the front by any posture that can pull them out; put down anywhere."""
    spec = workcell.spec()
    inverse = inverse_kinematics(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
    problems: list[RouteProblem] = []
    while len(problems) < n:
        shelf = workcell.RACK_SHELVES_M[rng.integers(len(workcell.RACK_SHELVES_M))]
        pick = _pointing((1.0, 0.0, 0.0), rng.choice([0.0, np.pi]))
        side = rng.choice([-1.0, 1.0])
        pick[:3, 3] = rng.uniform(0.62, 0.68), side * rng.uniform(0.12, 0.40), shelf + rng.uniform(0.10, 0.16)
        starts = inverse.ik_all(flange_from_tip(pick, spec.tool_length_m))
        inside = (starts > spec.lower_rad + LIMIT_MARGIN_RAD) & (starts < spec.upper_rad - LIMIT_MARGIN_RAD)
        starts = starts[inside.all(axis=1)]
        starts = starts[bench.line.batch(starts)]
        x, y, floor = workcell.TRAY_M
        where = x + rng.uniform(-0.08, 0.08), y + rng.uniform(-0.05, 0.05), floor + DROP_M
        tips = np.stack([_pointing((0.0, 0.0, -1.0), yaw) for yaw in np.linspace(-np.pi, np.pi, YAWS, endpoint=False)])
        tips[:, :3, 3] = where
        for row in rng.permutation(len(starts))[:8]:
            problem = RouteProblem(start=starts[row], tips=tips, leave=LEAVE_M, arrive=ARRIVE_M, seed=len(problems))
            if bench.router.can_leave(problem):
                problems.append(problem)
                break
    return problems


def _pointing(axis: tuple[float, float, float], roll: float) -> FloatArray:
    """Orientation of a tool along an axis, turned about it, as a 4x4 pose at the origin."""
    z = np.array(axis)
    x = np.cross((0.0, 1.0, 0.0), z)
    pose = np.eye(4)
    y = np.cross(z, x)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x, z
    return pose


def _check(trial: Trial, bench: Bench, k: int, problem: RouteProblem, route: Route) -> None:
    spec = workcell.spec()
    for path, checker in ((route.out, bench.line), (route.travel, bench.travel), (route.into, bench.line)):
        trial.check(checker.path_free(path), f"plan {k}: a path collides")
    ends = route.out[0], route.out[-1], route.travel[-1]
    starts = problem.start, route.travel[0], route.into[0]
    for a, b in zip(ends, starts, strict=True):
        trial.check(np.abs(a - b).max() < 1e-9, f"plan {k}: the segments do not meet")
    reached = bench.router.tip(route.into[-1])
    apart = np.abs(problem.tips - reached).max(axis=(1, 2)).min()
    trial.check(apart < 1e-3, f"plan {k}: ends {apart} off every wanted pose")
    for segment in route.segments:
        dt_s = segment.t[1] - segment.t[0]
        for order, limit in ((1, spec.max_velocity_radps), (2, spec.max_acceleration_radps2)):
            still = np.concatenate([segment.q[:1], segment.q, segment.q[-1:]])
            share = float((np.abs(np.diff(still, order, axis=0)) / dt_s**order / limit).max())
            trial.check(share <= 1.0, f"plan {k}: difference {order} of a joint is {share:.4f} times its limit")


def _digest(route: Route) -> str:
    """Of every path, and of what it becomes in time."""
    paths = [route.out, route.travel, route.into]
    timed = [array for segment in route.segments for array in (segment.t, segment.q, segment.qd)]
    return hashlib.sha256(b"".join(array.tobytes() for array in [*paths, *timed])).hexdigest()


def _reference_rad(bench: Bench, route: Route, seed: int, limit_s: float) -> float:
    """Length of AORRTC's path after some CPU time, from where the straight way out ends to the same goals."""
    goals = route.goals if route.goals is not None else route.travel[-1:]
    problem = MotionProblem(checker=bench.travel, start=route.travel[0], goals=goals, seed=seed)

    def budget(share: float) -> Callable[[], bool]:
        end_s = time.process_time() + share * limit_s
        return lambda: time.process_time() > end_s

    path = OmplPlanner("AORRTC").search(problem, goals, budget)
    return np.inf if path is None else path_length(path)
