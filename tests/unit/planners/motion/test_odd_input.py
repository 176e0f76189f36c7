"""Odd input to arm planning: named errors, and never a free path through NaN, a crash or a wait without end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion import MotionProblem, RrtConnectConfig, RrtConnectNative, motion_planner
from planners.motion.arm.arm_model import ArmModel, assemble
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.arm.kinematics import flange_from_tip, link_frames
from planners.motion.arm.spheres import box_spheres, fit_spheres, read_binary_stl
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes, Capsules
from planners.motion.path.cartesian import cartesian_line
from planners.motion.path.lines import straight_line
from planners.motion.path.route import RouteConfig, RoutePlanner, RouteProblem, RouteStatus
from planners.motion.path.timed_path import Dwell, timed_path
from planners.motion.path.trajectory import Trajectory, retime
from planners.motion.search.shortcut import shorten
from planners.motion.two_arms.asynchronous import asynchronous, soonest
from planners.motion.two_arms.swept import ArmInWorld

NAN, INF = np.nan, np.inf
Q = np.array([0.0, 0.3, 0.0, -1.2, 0.0, 0.8, 0.0])
PATH = np.array([Q, Q + 0.3])
SPEED, ACCELERATION = np.full(7, 1.5), np.full(7, 5.0)


class Bench:
    """What the cases need of one arm."""

    def __init__(self, model: ArmModel, station: Boxes) -> None:
        self.model, self.boxes = model, station
        self.arm = (model.base_from_joint, model.lower, model.upper)
        self.srs, self.descent = SrsGeometry.from_joints(*self.arm), NumericInverse.from_joints(*self.arm)
        self.checker = CollisionChecker(model, station)
        self.pose = self.srs.flange(Q)
        self.mirrored, self.scaled, self.lost = self.pose.copy(), self.pose.copy(), self.pose.copy()
        self.mirrored[:3, 0] *= -1
        self.scaled[:3, :3] *= 2
        self.lost[0, 3] = NAN
        self.motion = retime(PATH, SPEED, ACCELERATION, 0.01)

    def problem(self, **changes: object) -> MotionProblem:
        return MotionProblem(**({"checker": self.checker, "start": Q, "goals": PATH[1:]} | changes))  # type: ignore[arg-type]

    def router(self, speed: object = SPEED, config: RouteConfig | None = None) -> RoutePlanner:
        checker = self.checker
        return RoutePlanner(self.srs, checker, checker, RrtConnectNative(), speed, ACCELERATION, config)  # type: ignore[arg-type]

    def route(self, **changes: object) -> RouteProblem:
        still = {"leave": np.zeros(3), "arrive": np.zeros(3)}
        return RouteProblem(**({"start": Q, "tips": self.pose[None]} | still | changes))  # type: ignore[arg-type]

    def timed(self, **changes: object) -> Trajectory:
        usual = {"path": PATH, "max_velocity": SPEED, "max_acceleration": ACCELERATION, "dt_s": 0.01}
        return retime(**(usual | changes))  # type: ignore[arg-type]

    def loose(self, **changes: object) -> Trajectory:
        usual = {"start": Q, "goal": Q + 0.3, "max_velocity": SPEED, "max_acceleration": ACCELERATION, "dt_s": 0.01}
        return asynchronous(**(usual | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def bench(iiwa: ArmModel, station: Boxes) -> Bench:
    return Bench(iiwa, station)


Case = Callable[[Bench], object]
CASES: dict[str, tuple[str, Case]] = {
    "a pose that is no number": ("base_from_flange", lambda b: b.srs.ik_all(b.lost)),
    "a pose in a mirror": ("rotation", lambda b: b.srs.ik_all(b.mirrored)),
    "a scaled pose": ("rotation", lambda b: b.descent.ik_all(b.scaled)),
    "a rotation for a pose": (r"\(3, 3\)", lambda b: b.descent.ik_all(np.eye(3))),
    "a word for a pose": ("numbers", lambda b: b.srs.ik_all("here")),
    "no arm angles": ("n_arm_angles 0", lambda b: b.srs.ik_all(b.pose, 0)),
    "a branch between two": ("branch 1.5", lambda b: b.srs.ik_branch(b.pose, 0.0, 1.5)),  # type: ignore[arg-type]
    "no solutions wanted": ("n_wanted -1", lambda b: b.descent.ik_all(b.pose, -1)),
    "descent from a short configuration": ("q", lambda b: b.descent.ik_near(b.pose, Q[:3])),
    "the flange of half an arm": (r"\(3,\)", lambda b: b.srs.flange(Q[:3])),
    "limits of half an arm": (r"\(4,\)", lambda b: b.srs.within_limits(Q[:4])),
    "limits the wrong way round": ("lower < upper", lambda b: inverse_kinematics(b.arm[0], b.arm[2], b.arm[1])),
    "limits that are no numbers": ("lower < upper", lambda b: inverse_kinematics(b.arm[0], b.arm[1] * NAN, b.arm[2])),
    "a joint nowhere": ("finite", lambda b: link_frames(np.where(np.eye(4) > 0, 1.0, NAN)[None], [0.0])),
    "angles in words": ("numbers", lambda b: link_frames(b.arm[0], "home")),
    "the flange of an arm nowhere": ("finite", lambda b: b.srs.flange(Q * NAN)),
    "a tip without a place": (r"\(3, 3\)", lambda b: flange_from_tip(np.eye(3), 0.1)),
    "a short configuration": (r"\(2,\)", lambda b: b.checker.free(Q[:2])),
    "a configuration in words": ("home", lambda b: b.checker.free("home")),
    "a batch in one row": (r"\(14,\)", lambda b: b.checker.batch(np.zeros(14))),
    "clearance of nothing": ("finite", lambda b: b.checker.clearance(Q * NAN)),
    "an endless margin": ("margin inf", lambda b: CollisionChecker(b.model, b.boxes, margin=INF)),
    "no boxes": ("NoneType", lambda b: CollisionChecker(b.model, None)),  # type: ignore[arg-type]
    "a held thing nowhere": ("held", lambda b: CollisionChecker(b.model, b.boxes, ([[NAN, 0, 0]], [0.1]))),
    "a held thing of no size": ("held", lambda b: CollisionChecker(b.model, b.boxes, ([[0, 0, 0]], [-0.1]))),
    "an endless box": ("finite", lambda b: Boxes.one((0, 0, 0), (INF, 1, 1))),
    "a box in lists": ("array", lambda b: Boxes(centre=[[0, 0, 0]], half=[[1, 1, 1]], yaw=[0], min_frame=[0])),  # type: ignore[arg-type]
    "an endless capsule": ("finite", lambda b: Capsules.one((0, 0, 0), (0, 0, 1), INF)),
    "half a seed": ("seed 1.5", lambda b: b.problem(seed=1.5)),
    "a budget that is no number": ("max_iterations nan", lambda b: b.problem(max_iterations=NAN)),
    "a start in a list": ("start", lambda b: b.problem(start=list(Q))),
    "no scene": ("checker", lambda b: b.problem(checker=None)),
    "a planner that is no name": ("arm planner 3", lambda b: motion_planner(3)),  # type: ignore[arg-type]
    "an endless edge": ("range_rad inf", lambda b: RrtConnectConfig(range_rad=INF)),
    "a motion without acceleration": ("max_acceleration", lambda b: b.timed(max_acceleration=ACCELERATION * 0)),
    "a motion of endless acceleration": ("max_acceleration", lambda b: b.timed(max_acceleration=ACCELERATION * INF)),
    "one sample an age": ("dt_s", lambda b: b.timed(dt_s=INF)),
    "too many samples": ("samples", lambda b: b.timed(dt_s=1e-12)),
    "a motion of ages": ("samples", lambda b: b.timed(max_velocity=SPEED * 1e-12)),
    "a motion of no push": ("samples", lambda b: b.timed(max_acceleration=ACCELERATION * 1e-300)),
    "a path around the world": ("rad in one joint", lambda b: b.timed(path=PATH * 1e12)),
    "too many loose samples": ("samples", lambda b: b.loose(dt_s=1e-12)),
    "loose and endless": ("finite", lambda b: b.loose(dt_s=INF)),
    "the nearest of none": ("others", lambda b: soonest(PATH, np.empty((0, 7)), SPEED, ACCELERATION)),
    "the nearest of other arms": ("soonest", lambda b: soonest(PATH, PATH[:, :3], SPEED, ACCELERATION)),
    "the nearest without speed": ("> 0", lambda b: soonest(PATH, PATH, SPEED * 0, ACCELERATION)),
    "shortening nothing": ("path", lambda b: shorten(PATH * NAN, b.checker, rounds=3, seed=0)),
    "shortening another arm's": ("path", lambda b: shorten(PATH[:, :5], b.checker, rounds=3, seed=0)),
    "shortening backwards": ("rounds -1", lambda b: shorten(PATH, b.checker, rounds=-1, seed=0)),
    "a line in halves": ("n_steps 2.5", lambda b: cartesian_line(b.srs, Q, b.pose, 2.5)),  # type: ignore[arg-type]
    "a line to nowhere": ("base_from_tip", lambda b: straight_line(b.srs, b.descent, Q, b.lost, 0.1)),
    "routes without speed": ("max_velocity", lambda b: b.router(SPEED * 0)),
    "routes of another arm": ("max_velocity", lambda b: b.router(SPEED[:3])),
    "a route into a mirror": ("tips", lambda b: b.route(tips=b.mirrored[None])),
    "a route's seed in words": ("seed", lambda b: b.route(seed="a")),
    "a route without goals": ("n_goals 0", lambda b: RouteConfig(n_goals=0)),
    "a route without speed on lines": ("line_speed 0", lambda b: RouteConfig(line_speed=0.0)),
    "travel to nowhere": ("goals", lambda b: b.router().travel(Q, np.empty((0, 7)))),
    "travel of another arm": ("start", lambda b: b.router().travel(Q[:3], PATH)),
    "a cover of thousands": ("k = 5000", lambda b: fit_spheres(np.random.default_rng(0).random((9, 3)), 5000, 0)),
    "a mesh nowhere": ("vertices", lambda b: fit_spheres(np.full((9, 3), NAN), 2, 0)),
    "a box nowhere": ("half extent", lambda b: box_spheres((NAN, 1, 1))),
    "no mesh": ("binary STL", lambda b: read_binary_stl(__file__ + ".stl")),  # type: ignore[arg-type]
    "a rest before time": ("duration_s -1", lambda b: Dwell(duration_s=-1)),
    "a rest of ages": ("samples", lambda b: timed_path([b.motion, Dwell(duration_s=1e12)], 0.02)),
    "segments in words": ("motions", lambda b: timed_path([b.motion, "rest"], 0.02)),  # type: ignore[list-item]
    "a motion without samples": ("Trajectory", lambda b: Trajectory(t=np.empty(0), q=PATH[:0], qd=PATH[:0])),
    "a motion from a second on": ("equal steps", lambda b: replace(b.motion, t=b.motion.t + 1.0)),
    "a motion that runs back": ("equal steps", lambda b: replace(b.motion, t=-b.motion.t)),
    "a motion with a gap": ("equal steps", lambda b: replace(b.motion, t=b.motion.t**2)),
    "a motion at no time": ("time_s nan", lambda b: b.motion.sample(NAN)),
    "an arm of twice its size": ("world_from_base", lambda b: ArmInWorld(b.model, np.eye(4) * 2)),
    "spheres of no size": ("radii", lambda b: replace(b.model, sphere_radius=-b.model.sphere_radius)),
    "parts of other spheres": ("sphere_part", lambda b: replace(b.model, sphere_part=b.model.sphere_frame[:3])),
    "an arm of nothing": ("assemble", lambda b: assemble(base_from_joint=b.arm[0], lower=Q, upper=Q + 1, covers=[])),
}


@pytest.mark.parametrize("name", CASES)
def test_odd_input_is_named(bench: Bench, name: str) -> None:
    message, case = CASES[name]
    with pytest.raises(PlanningError, match=message):
        case(bench)


@pytest.mark.parametrize("value", [NAN, INF, 1e300])
def test_what_is_not_finite_is_not_free(bench: Bench, value: float) -> None:
    """Nothing touches a NaN: these were free, and so was every motion to them."""
    nowhere = np.full(7, value)
    assert bench.checker.free(Q)
    assert bench.checker.edge(Q, Q + 0.1)
    assert not bench.checker.free(nowhere)
    assert bench.checker.batch(np.array([Q, nowhere])).tolist() == [True, False]
    assert not bench.checker.edge(Q, nowhere)
    assert not bench.checker.edge(nowhere, Q)
    assert not bench.checker.path_free(np.array([Q, nowhere]))


def test_motions_without_a_speed_limit_are_as_fast_as_they_can_be(bench: Bench) -> None:
    """Descriptions of arms may name no speed; such a motion took four times as long as a slow one."""
    fast = bench.timed(max_velocity=np.full(7, 1e3)).duration_s
    assert bench.timed(max_velocity=np.full(7, INF)).duration_s == pytest.approx(fast, abs=0.011)


def test_far_lines_and_bad_starts_are_statuses(bench: Bench) -> None:
    far = bench.pose.copy()
    far[:3, 3] = 1e9
    assert straight_line(bench.srs, bench.descent, Q, far, 0.1) is None
    assert bench.router().plan(bench.route(start=Q + 9.0)).status is RouteStatus.START_COLLIDES
    folded = np.array([0.0, 2.05, 0.0, 0.5, 0.0, 0.0, 0.0])
    assert bench.router().plan(bench.route(start=folded)).status is RouteStatus.START_COLLIDES
    assert bench.router().travel(folded, PATH).status is RouteStatus.START_COLLIDES
