"""TableArm: plans how one arm takes a thing and puts it down among all others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.arms import ARMS
from fleet.robots.arms.kind import ArmKind, OwnHand
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_motions import backwards, shown
from fleet.stations.arms.arm_spheres import PlannedArm, cache_dir, planned_arm
from fleet.tabletop.errors import TabletopError
from fleet.tabletop.hand import Grasp, cup_grasps, down, finger_grasps
from fleet.world.bullet.confirm import PathConfirmer
from fleet.world.scene import StaticBox
from planners.motion import RrtConnectNative
from planners.motion.arm.arm_model import ArmModel, assemble
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.arm.kinematics import turn_about_z
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes, Capsules
from planners.motion.path.route import Route, RoutePlanner, RouteProblem
from planners.motion.path.timed_path import Dwell
from planners.motion.path.trajectory import Trajectory
from planners.motion.two_arms.swept import ArmInWorld, at_rest

if TYPE_CHECKING:
    from fleet.world.bullet.bench.arm_file import ArmFile


LIFT_M = 0.12
"""Straight way up from the table, and down to it."""
GRIP_S, RELEASE_S = 0.5, 0.3
_TRAVEL_MARGIN_M, _LINE_MARGIN_M = 0.01, 0.001
_ARM_MARGIN_M = 0.05
"""Distance to the other arm's resting spheres: those of a schedule are wider by what an arm moves in half a step."""
_FEET_FRAME = 2
"""Links below this stand on the table."""
_OFF_TABLE_M = 0.002
_SQUARE_SIDE = 0.74
"""Half the side of the square whose four spheres cover a circle of radius 1."""
_N_GRASPS = 3
"""Grasps of a thing that are tried."""
_TOUCH_M = 0.003
"""Depth of a touch that the engine lets pass: things rest on the table, and on each other."""

Segment = Trajectory | Dwell
NOBODY = Capsules()
"""No other arm."""


def load_model(arm: str, tool: str) -> PlannedArm:
    """The model of an arm by the names a `TableScene` has for it and its tool.

    Raises:
        TabletopError: There is none of these names.
    """
    models = [(kind.name, name) for kind in ARMS.values() for name in TOOLS]
    if (arm, tool) not in models:
        raise TabletopError(f"arm {arm!r} with tool {tool!r}; valid: {', '.join(f'{a} with {b}' for a, b in models)}")
    kind = ARMS[arm]
    if kind.hand is not None and kind.hand.tool.name == tool:
        return _with_own_hand(kind, kind.hand)
    return planned_arm(kind.spec(TOOLS[tool]))


def _with_own_hand(kind: ArmKind, hand: OwnHand) -> PlannedArm:
    """An arm as its file describes it."""
    # Only here: the engine reads the file, and tables of arms with our tools do without.
    from fleet.world.bullet.bench.arm_file import read_arm

    file = read_arm(
        kind.urdf,
        frozen=hand.open_at,
        allowed=kind.touching_links(),
        tool_length_m=hand.tool.length_m,
        cache_dir=cache_dir(),
    )
    spec = replace(
        kind.spec(),
        description=kind.whole_text(),
        base_from_joint=file.model.base_from_joint,
        lower_rad=file.model.lower,
        upper_rad=file.model.upper,
        tool=hand.tool,
        home_rad=np.array(hand.home_rad),
        visuals=(),
        touching=file.touching,
    )
    return PlannedArm(spec=spec, spheres=_with_fine_hand(file, hand))


def _with_fine_hand(file: ArmFile, hand: OwnHand) -> ArmModel:
    """An arm with many small spheres around its hand: few large ones would touch whatever lies beside a thing."""
    model, n = file.model, len(file.joint_names)
    parts = model.sphere_frame if model.sphere_part is None else model.sphere_part
    covers = [(i, model.sphere_centre[parts == i], model.sphere_radius[parts == i]) for i in range(n + 1)]
    turn = turn_about_z(hand.tool.finger_turn_rad)
    for low, high, cells in hand.boxes_m:
        centre, radius = box_spheres((np.array(high) - np.array(low)) / 2, cells)
        covers.append((n + 1, (centre + (np.array(low) + np.array(high)) / 2) @ turn.T, radius))
    return assemble(
        base_from_joint=model.base_from_joint,
        lower=model.lower,
        upper=model.upper,
        covers=covers,
        tool_length=hand.tool.length_m,
        touching=file.touching,
        cache_dir=cache_dir(),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Chore:
    """One thing brought to one spot, as motions with rests for gripping and letting go."""

    thing: int
    segments: tuple[Segment, ...]
    grips_at: int
    """Segment that is the rest for gripping."""
    frees_at: int
    """Segment that is the rest for letting go."""
    reach_m: tuple[float, float]
    """Reach of the thing below the tool's tip, and to the side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Around:
    """What is in an arm's way, in its base frame."""

    boxes: Boxes
    arms: Capsules


class TableArm:
    """One arm on its place; the physics engine has the last word on its paths, beside the moving world.

    Attributes:
        n_refused: Paths that the engine did not let pass.

    Args:
        model: The arm.
        base: Feet x, y, z, yaw; upright and not turned, shape (4,).
        fixed: What stands on the table.
    """

    def __init__(self, model: PlannedArm, base: FloatArray, fixed: tuple[StaticBox, ...]) -> None:
        self._model, self._base = model, np.asarray(base, dtype=np.float64)
        spec = model.spec
        self._inverse = inverse_kinematics(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
        self._fixed = Boxes.join(
            *(
                Boxes.one(
                    np.array(box.centre_m) - self._base[:3],
                    box.half_m,
                    min_frame=_FEET_FRAME if box.kind == "table" else 0,
                )
                for box in fixed
            )
        )
        self._confirmer = PathConfirmer.of_spec(spec)
        self._confirmer.set_boxes(self._fixed.centre, self._fixed.half, self._fixed.yaw, self._fixed.min_frame)
        self.n_refused = 0

    def meet(self, other: TableArm) -> None:
        """Let the engine know an arm that stands beside this one."""
        model = self._model
        self._confirmer.set_neighbour(model.spec, other._base[:3] - self._base[:3])

    def touches(self, own: FloatArray, theirs: FloatArray) -> str:
        """Where this arm touches the one it has met in motions (k, n) of the same moments; empty if nowhere."""
        verdict = self._confirmer.confirm_beside(own, theirs)
        self.n_refused += not verdict.free
        return verdict.what

    def close(self) -> None:
        """Free the engine; calling twice is harmless."""
        self._confirmer.close()

    @property
    def home(self) -> FloatArray:
        """Where the arm begins and ends [rad], shape (n,)."""
        return self._model.spec.home_rad

    def in_world(self, held_m: tuple[float, float] | None) -> ArmInWorld:
        """The arm as others have to keep clear of it, with a thing that reaches (below the tip, to the side) [m]."""
        pose = np.eye(4)
        pose[:3, 3] = self._base[:3]
        return ArmInWorld(self._model.spheres, pose, None if held_m is None else self._held(*held_m))

    def resting(self, q: FloatArray) -> Capsules:
        """The room that the arm takes at q (n,), spheres in the world."""
        own = at_rest(self.in_world(None), q)
        n_spheres = own.parts[:, 2].max()
        return Capsules.spheres(own.centre[0, :n_spheres], own.radius[0, :n_spheres])

    def bring(
        self,
        start: FloatArray,
        thing: int,
        pose: FloatArray,
        corners: list[FloatArray],
        spot: FloatArray,
        seed: int,
        other: Capsules = NOBODY,
    ) -> Chore | str:
        """Plan to take a thing and put it on a spot.

        Args:
            start: Where the arm rests, its tool up [rad], shape (n,).
            thing: Which of the things.
            pose: Centre and orientation of it, shape (7,).
            corners: Corners of all things in the world, each (v, 3).
            spot: Where to put it: x, y, and height of its underside when it is let go [m], shape (3,).
            seed: Seed of the searches.
            other: Another arm at rest, in the world.

        Returns:
            The chore, or why there is none.
        """
        own = corners[thing]
        others = [other for number, other in enumerate(corners) if number != thing]
        around = self._around(corners, other, thing)
        self._confirmer.set_things(corner - self._base[:3] for corner in others)
        why = "nothing to take hold of it by"
        for grasp in self._grasps(pose, own, others)[:_N_GRASPS]:
            pick = self._route(start, grasp.tips, around, None, seed)
            if not pick.solved:
                why = f"way to it: {pick.status.value}"
                continue
            wrong = self._refused(pick.segments)
            if wrong:
                why = f"way to it: the physics engine refuses it: {wrong}"
                continue
            held = self._held(grasp.below_m, grasp.half_width_m)
            tips = np.stack(
                [
                    down(yaw, np.array([spot[0], spot[1], spot[2] + grasp.below_m]))
                    for yaw in np.linspace(-np.pi, np.pi, 8, endpoint=False)
                ]
            )
            lift = backwards(pick.segments[-1])
            place = self._route(lift.q[-1], tips, around, held, seed + 1)
            if not place.solved:
                why = f"way from it: {place.status.value}"
                continue
            back = backwards(place.segments[-1])
            wrong = self._refused((lift, *place.segments), self._in_hand(own, lift.q[0])) or self._refused((back,))
            if wrong:
                why = f"way from it: the physics engine refuses it: {wrong}"
                continue
            return Chore(
                thing=thing,
                segments=(
                    *pick.segments,
                    Dwell(duration_s=GRIP_S),
                    lift,
                    *place.segments,
                    Dwell(duration_s=RELEASE_S),
                    back,
                ),
                grips_at=len(pick.segments),
                frees_at=len(pick.segments) + 2 + len(place.segments),
                reach_m=(grasp.below_m, grasp.half_width_m),
            )
        return why

    def go_home(
        self, start: FloatArray, corners: list[FloatArray], seed: int, other: Capsules = NOBODY
    ) -> tuple[Trajectory, ...] | str:
        """Plan the way to the home posture; see `bring`."""
        route = self._router(self._around(corners, other), None).travel(start, self.home[None], seed)
        if not route.solved:
            return f"way home: {route.status.value}"
        self._confirmer.set_things(own - self._base[:3] for own in corners)
        wrong = self._refused(route.segments)
        return f"way home: the physics engine refuses it: {wrong}" if wrong else route.segments

    def _refused(self, segments: tuple[Trajectory, ...], held: FloatArray | None = None) -> str:
        """What the engine has against motions, empty if nothing; `held` are a thing's corners in the last link."""
        verdict = self._confirmer.confirm(
            np.concatenate([shown(segment) for segment in segments]), held, allowance_m=_TOUCH_M
        )
        self.n_refused += not verdict.free
        return verdict.what

    def _in_hand(self, corners: FloatArray, q: FloatArray) -> FloatArray:
        """Corners of a thing (v, 3) in the last link's frame, as they lie there when the arm grips it at q (n,)."""
        flange = self._inverse.flange(q)
        inside: FloatArray = (corners - self._base[:3] - flange[:3, 3]) @ flange[:3, :3]
        return inside

    def _around(self, corners: list[FloatArray], other: Capsules, but: int = -1) -> _Around:
        """What is in the way: all that stands on the table, all things but one, and another arm."""
        feet = self._base[:3]
        return _Around(
            boxes=Boxes.join(self._fixed, *(self._box(own) for number, own in enumerate(corners) if number != but)),
            arms=replace(other, start=other.start - feet, end=other.end - feet, radius=other.radius + _ARM_MARGIN_M),
        )

    def _grasps(self, pose: FloatArray, own: FloatArray, others: list[FloatArray]) -> list[Grasp]:
        tool = self._model.spec.tool
        if tool.finger_joints:
            return finger_grasps(own, others, 2 * tool.finger_travel_m, tool.finger_turn_rad)
        return cup_grasps(pose, own)

    def _route(
        self,
        start: FloatArray,
        tips: FloatArray,
        around: _Around,
        held: tuple[FloatArray, FloatArray] | None,
        seed: int,
    ) -> Route:
        base_tips = tips.copy()
        base_tips[:, :3, 3] -= self._base[:3]
        problem = RouteProblem(
            start=start, tips=base_tips, leave=np.zeros(3), arrive=np.array([0.0, 0.0, LIFT_M]), seed=seed
        )
        return self._router(around, held).plan(problem)

    def _router(self, around: _Around, held: tuple[FloatArray, FloatArray] | None) -> RoutePlanner:
        spec, model = self._model.spec, self._model.spheres
        return RoutePlanner(
            self._inverse,
            CollisionChecker(model, around.boxes, held, margin=_TRAVEL_MARGIN_M, capsules=around.arms),
            CollisionChecker(model, around.boxes, margin=_LINE_MARGIN_M, capsules=around.arms),
            RrtConnectNative(),
            spec.max_velocity_radps,
            spec.max_acceleration_radps2,
        )

    def _held(self, below_m: float, half_width_m: float) -> tuple[FloatArray, FloatArray]:
        """Spheres around the upright box that holds a thing below the tip, in the last link's frame.

        They end with the thing's underside, which stands on the table where lines begin and end; the margin of the
        travel makes up for the corners that they leave out there.
        """
        side = _SQUARE_SIDE * half_width_m
        half = np.array([side, side, max(below_m / 2, 0.005)])
        centre, radius = box_spheres(half)
        lift = float((centre[:, 2] + radius).max()) - half[2] + _OFF_TABLE_M
        return centre + np.array([0.0, 0.0, self._model.spec.tool_length_m + half[2] - lift]), radius

    def _box(self, corners: FloatArray) -> Boxes:
        low, high = corners.min(axis=0), corners.max(axis=0)
        return Boxes.one((low + high) / 2 - self._base[:3], np.maximum((high - low) / 2, 0.002))
