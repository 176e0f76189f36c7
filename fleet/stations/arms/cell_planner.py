"""CellPlanner: an arm's transfers as known ways between fixed via points and straight lines to where parcels are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation
from fleet.robots.spec import CarSpec
from fleet.stations.arms.arm_cell import ArmCell
from fleet.stations.arms.arm_motions import (
    SLOW,
    ArmMotions,
    Confirm,
    Held,
    TouchingError,
    UnreachableError,
    backwards,
)
from fleet.stations.arms.arm_spheres import PlannedArm
from fleet.stations.arms.loose import LooseGrips, UngrippableError, loose_grips
from fleet.stations.arms.recent import Recent
from fleet.stations.arms.retrieval import Margins, Retrieval
from fleet.stations.arms.search import Search
from fleet.stations.arms.transfer import (
    LOOSE,
    TRAY,
    DeliverRequest,
    FetchRequest,
    HomeRequest,
    Signal,
    Step,
    Transfer,
    TransferRequest,
)
from fleet.tasks.order import MAX_EDGE_M
from planners.motion.arm.kinematics import flange_from_tip, pointing_down, turn_about_z
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.path.trajectory import Trajectory
from planners.motion.problem import MotionResult
from planners.motion.search.search_tree import SearchTree

HOME = -2
"""Via index of the rest position."""
LIFT_M = 0.14
"""Via points lie this far above the top of the largest parcel [m]."""
MARGIN_M = 0.015
"""Distance kept from obstacles on the ways between via points [m]."""
LINE_MARGIN_M = 0.002
"""Distance kept on the straight lines, which end between tray walls and beside parcels [m]."""
SUCTION_GAP_M = 0.003
"""The cup stops this far above the parcel; suction bridges 10 mm."""
RELEASE_M = 0.004
"""A parcel is let go this far above its support [m]."""
LIMIT_MARGIN_RAD = 0.06
"""Via points keep this far from joint limits, so that lines to parcels beside them stay inside."""
TOOL_YAWS = 16
"""Orientations about the vertical tried for a via point."""
PROBE_M = {"suction": 0.03, "friction": 0.015}
"""A via point must reach this far to the side of the nominal place [m]: parcels never lie exactly on it."""
PICK_ABOVE_BOTTOM_M = 0.026
"""Fingers close at least this far above a parcel's underside, clear of the support [m]."""
EASY_WIDTH_M = 0.09
"""Parcels up to this wide leave open fingers 1 cm of play on each side [m]."""
NEAR_VIA_M = 0.3
"""Parcels that are nearer than this to a slot or the tray are tried to be reached over its via point first [m]."""
NEIGHBOUR_M = 0.2
"""Slots that are nearer than this to such a parcel are taken for empty: it may lie on them [m]."""

N_VIAS = 3
"""Via points of a place that are tried before the place is refused, best first."""
N_LAST_TRANSFERS = 16
"""Ways down that an arm remembers, a few for each slot: equal parcels lie at the same places of a slot."""


class PlaceError(UnreachableError):
    """An arm cannot serve one place of its station, or cannot rest; the message says why."""

    def __init__(self, place: int, why: str) -> None:
        super().__init__(f"{place_name(place)}: {why}")
        self.place = place
        self.why = why


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """How a way is searched and timed."""

    seed: int = 0
    more_m: float = 0.0
    """Kept from obstacles beyond `MARGIN_M` while searching: smoothing leaves the path by up to 0.0013 rad, which is as
    many metres of a tool 1 m away, and the check of an edge may let it dip into the margin [m]."""
    speed: float = 1.0
    """Share of the joint limits."""


ATTEMPTS = (
    Attempt(),
    Attempt(more_m=0.002),
    Attempt(seed=1),
    Attempt(seed=1, more_m=0.005),
    Attempt(seed=2),
    Attempt(seed=3),
    Attempt(speed=SLOW),
    Attempt(seed=1, speed=SLOW),
)
"""Tried in this order until a motion is free; the first is the fastest."""


class KnownCell:
    """What is known of an arm among its surroundings; cells with the same surroundings share it.

    To make the scenes of collision checks takes ten milliseconds, which a floor with hundreds of arms of few kinds need
    not spend on each of them.

    Args:
        cell: The surroundings.
        arm: The arm with its tool.
        confirm: The physics engine's last word, if there is an engine.
    """

    def __init__(self, cell: ArmCell, arm: PlannedArm, confirm: Confirm | None) -> None:
        spec, model = arm.spec, arm.spheres
        self.motions = ArmMotions(spec, confirm)
        self.boxes = Boxes(centre=cell.box_centre, half=cell.box_half, yaw=cell.box_yaw, min_frame=cell.box_min_frame)
        self.line_boxes = without_slots(self.boxes, cell.slots)
        """The obstacles of straight lines."""
        held = box_spheres((MAX_EDGE_M / 2,) * 3)
        below = np.array([0.0, 0.0, spec.tool.length_m + MAX_EDGE_M / 2])
        dock = Boxes.one(cell.dock_box[0], cell.dock_box[1], yaw=cell.dock_yaw)
        self.empty = CollisionChecker(model, self.boxes, margin=MARGIN_M)
        self.over_cars = CollisionChecker(model, Boxes.join(self.boxes, dock), margin=MARGIN_M)
        self.loaded = CollisionChecker(model, self.boxes, held_spheres=(held[0] + below, held[1]), margin=MARGIN_M)
        self.line = CollisionChecker(model, self.line_boxes, margin=LINE_MARGIN_M)
        self.vias: dict[int, FloatArray] = {HOME: spec.home_rad}
        """Configuration of each via point, shape (n,)."""
        self.ways: dict[tuple[int, int, bool], Trajectory] = {}
        """From, to, loaded -> the motion."""
        self.attempts: dict[tuple[int, int, bool], Attempt] = {}
        """The same -> how it was found."""

    def forget(self, place: int) -> None:
        """Drop a via point and its ways."""
        del self.vias[place]
        for key in [key for key in self.ways if place in key[:2]]:
            del self.ways[key], self.attempts[key]


def without_slots(boxes: Boxes, slots: FloatArray) -> Boxes:
    """Obstacles without the parcels assumed on some slots, whose places are the targets.

    Args:
        boxes: All obstacles.
        slots: Centres of the slots' top surfaces [m], shape (k, 3).
    """
    half = MAX_EDGE_M / 2
    tops = slots + np.array([0.0, 0.0, half])
    gap = np.linalg.norm(boxes.centre[:, None] - tops[None], axis=2).min(axis=1, initial=np.inf)
    keep = (gap > 1e-6) | (np.abs(boxes.half - half).max(axis=1) > 1e-6)
    return Boxes(centre=boxes.centre[keep], half=boxes.half[keep], yaw=boxes.yaw[keep], min_frame=boxes.min_frame[keep])


class CellPlanner:
    """Plans for one arm in its cell; everything in the base frame.

    Ways between via points (rest, above each slot, above the tray) do not depend on what lies where: they are planned
    once, with the rack full, a car at the dock and, between slots and tray, the largest parcel in the grip.

    Args:
        cell: The surroundings.
        arm: The arm; its tool decides how a parcel is approached.
        car: Gives the tray's orientation-free size.
        search: Finds the ways between via points.
        known: What cells with the same surroundings share; None = nothing is shared, and there is no engine.
    """

    def __init__(
        self,
        cell: ArmCell,
        arm: PlannedArm,
        car: CarSpec,
        search: Search,
        *,
        known: KnownCell | None = None,
    ) -> None:
        self.cell = cell
        self._spec, self._tool, self._car = arm.spec, arm.spec.tool, car
        self._search = search
        self._known = known = known or KnownCell(cell, arm, None)
        self._motions = known.motions
        self._retrieval = Retrieval(arm, known.motions, search, Margins(travel_m=MARGIN_M, line_m=LINE_MARGIN_M))
        self._via_tips: dict[int, FloatArray] = {}
        self._crossings: Recent[FloatArray] = Recent(N_LAST_TRANSFERS)
        self._admissions: Recent[FloatArray] = Recent(N_LAST_TRANSFERS)
        self._descents: Recent[tuple[Trajectory, Trajectory]] = Recent(N_LAST_TRANSFERS)
        self._way_trees: dict[tuple[int, int, bool, Attempt], list[SearchTree]] = {}

    def keep_trees(self) -> None:
        """Keep the trees of searches from now on, if the planner grows any; `take_trees` hands them over."""
        self._search.keep_trees()

    def take_trees(self) -> FloatArray:
        """Edges of the trees behind the answers since the last call, as the tool's tip in the world.

        Returns:
            Ends of the edges [m], shape (e, 2, 3).
        """
        x, y, z, yaw = self.cell.base_pose
        turn = turn_about_z(yaw)
        edges = [np.empty((0, 2, 3))]
        for tree in self._search.take_trees():
            tips = np.array([self._motions.tip(q)[:3, 3] for q in tree.vertices]).reshape(-1, 3)
            edges.append((tips @ turn.T + (x, y, z))[tree.edges])
        return np.concatenate(edges)

    def prepare(self, places: Sequence[int] | None = None) -> None:
        """Find via points and the ways between them.

        Args:
            places: Slots that count; None = all. The tray counts always.

        Raises:
            PlaceError: A slot or the tray cannot be served, or the arm cannot rest.
        """
        if not self._known.over_cars.free(self._spec.home_rad):
            raise PlaceError(HOME, "something stands where the arm rests, or too near")
        self._settle(TRAY, ((HOME, False),))
        for slot in range(len(self.cell.slots)):
            if places is None or slot in places:
                self._settle(slot, ((TRAY, True), (HOME, False)))

    def _settle(self, place: int, others: Sequence[tuple[int, bool]]) -> None:
        """Find the ways of a place to others and back, over its best via point from which there are some.

        Args:
            place: Slot index or `TRAY`.
            others: Where the ways lead to, and whether with a parcel.
        """
        known, refusal = self._known, None
        if place in known.vias:
            return
        for q in islice(self._good_vias(place), N_VIAS):
            known.vias[place] = q
            try:
                for other, loaded in others:
                    self._way(place, other, loaded=loaded)
                    self._way(other, place, loaded=loaded)
                return
            except UnreachableError as error:
                refusal = refusal or error
                known.forget(place)
        raise PlaceError(place, str(refusal or "the arm cannot reach it from above by straight lines"))

    def transfer(self, request: TransferRequest) -> Transfer:
        """Plan a transfer; a `reason` instead of steps when there is none."""
        try:
            return self._retrieved(request) if request.pick_via == LOOSE else self._transfer(request)
        except (UnreachableError, UngrippableError) as error:
            return Transfer(arm=request.arm, parcel=request.parcel, steps=(), reason=str(error))

    def fetch(self, request: FetchRequest) -> Transfer:
        """Plan to take a parcel and wait with it over its slot, and to put it back; a `reason` when there is no way."""
        try:
            down, grip_height = self._grasp(request)
            held = Held(size_m=request.size_m, below_tip_m=grip_height - request.size_m[2] / 2)
            lower, lift = self._lines(down, None, held)
        except UnreachableError as error:
            return Transfer(arm=request.arm, parcel=request.parcel, steps=(), reason=str(error))
        via = request.pick_via
        # Upwards with the parcel is as free as downwards with it.
        back = (backwards(lift), Signal.RELEASE, backwards(lower), self._way(via, HOME, loaded=False))
        return Transfer(
            arm=request.arm,
            parcel=request.parcel,
            steps=(self._way(HOME, via, loaded=False), lower, Signal.GRIP, lift),
            back=back,
            grip_height_m=grip_height,
        )

    def deliver(self, request: DeliverRequest) -> Transfer:
        """Plan the rest of a transfer whose parcel was fetched; a `reason` when there is no way."""
        try:
            steps = self._delivery(request, request.pick_via, request.place_via, request.grip_height_m)
        except UnreachableError as error:
            return Transfer(arm=request.arm, parcel=request.parcel, steps=(), reason=str(error))
        return Transfer(arm=request.arm, parcel=request.parcel, steps=steps)

    def home(self, request: HomeRequest) -> Transfer:
        """Plan the way home from anywhere."""
        # A failed line ends low, beside things: first straight up, then home.
        up = self._climb(request.q)
        result = self._search.way(self._known.empty, up[-1], self._spec.home_rad[None])
        if not result.solved:
            return Transfer(arm=request.arm, parcel=-1, steps=(), reason=f"no way home ({result.status.value})")
        moves = [] if len(up) == 1 else [self._motions.timed_line(up, self._known.line)]
        moves.append(self._motions.timed(result.path, 1.0, self._known.empty))
        return Transfer(arm=request.arm, parcel=-1, steps=tuple(moves))

    def _transfer(self, request: TransferRequest) -> Transfer:
        down, grip_height = self._grasp(request)
        held = Held(size_m=request.size_m, below_tip_m=grip_height - request.size_m[2] / 2)
        pick, place = request.pick_via, request.place_via
        lower, lift = self._lines(down, None, held)
        steps = (
            self._way(HOME, pick, loaded=False),
            lower,
            Signal.GRIP,
            lift,
            *self._delivery(request, pick, place, grip_height),
        )
        return Transfer(arm=request.arm, parcel=request.parcel, steps=steps)

    def _retrieved(self, request: TransferRequest) -> Transfer:
        """Take a parcel from wherever it lies, by a way that is searched for, and place it as any other."""
        pose = np.eye(4)
        pose[:3, 3] = self.cell.base_from_world(request.pick_pose[:3])
        pose[:3, :3] = turn_about_z(-self.cell.base_pose[3]) @ rotation(request.pick_pose[3:])
        grips = loose_grips(pose, request.size_m, self._tool, SUCTION_GAP_M, PICK_ABOVE_BOTTOM_M)
        held = Held(size_m=grips.size_m, below_tip_m=grips.height_m - grips.size_m[2] / 2)
        over = self._from_via(grips, held, request.place_via)
        if over is None:
            near = np.linalg.norm(self.cell.slots[:, :2] - pose[:2, 3], axis=1) < NEIGHBOUR_M
            boxes = without_slots(self._known.boxes, self.cell.slots[near])
            try:
                over = self._retrieval.steps(grips, held, boxes, self._via(request.place_via))
            except UnreachableError as error:
                x, y, z = np.round(pose[:3, 3], 3)
                raise UnreachableError(f"{error}, which lies at ({x}, {y}, {z}) in the arm's base frame") from error
        down = self._setting_down(request, request.place_via, grips.height_m, held)
        return Transfer(arm=request.arm, parcel=request.parcel, steps=over + down)

    def _from_via(self, grips: LooseGrips, held: Held, place: int) -> tuple[Step, ...] | None:
        """The way over the nearest via point, down to the parcel, up again and on, if straight lines lead there."""
        at = grips.tips[0, :2, 3]
        places = {TRAY: self.cell.tray, **dict(enumerate(self.cell.slots))}
        via = min(places, key=lambda k: float(np.hypot(*(places[k][:2] - at))))
        if np.hypot(*(places[via][:2] - at)) > NEAR_VIA_M:
            return None
        alike = np.einsum("kij,ij->k", grips.tips[:, :3, :3], self._via_tip(via)[:3, :3])
        for k in np.argsort(-alike, kind="stable"):
            try:
                lower, lift = self._lines(self._admission(via, grips.tips[k]), None, held)
                over = () if via == place else (self._way(via, place, loaded=True),)
                return (self._way(HOME, via, loaded=False), lower, Signal.GRIP, lift, *over)
            except UnreachableError:
                continue
        return None

    def _delivery(
        self, request: TransferRequest | DeliverRequest, pick: int, place: int, grip_height: float
    ) -> tuple[Step, ...]:
        """From above where the parcel was picked to where it is placed, and home."""
        held = Held(size_m=request.size_m, below_tip_m=grip_height - request.size_m[2] / 2)
        return (self._way(pick, place, loaded=True), *self._setting_down(request, place, grip_height, held))

    def _setting_down(
        self, request: TransferRequest | DeliverRequest, place: int, grip_height: float, held: Held
    ) -> tuple[Step, ...]:
        """From above a place down to it, and home."""
        down = self._admission(place, self._place_tip(request, grip_height))
        lower, lift = self._lines(down, held, None)
        return (
            lower,
            Signal.RELEASE,
            lift,
            Signal.CLEAR,
            self._way(place, HOME, loaded=False),
        )

    def _lines(self, down: FloatArray, before: Held | None, after: Held | None) -> tuple[Trajectory, Trajectory]:
        """The motions down a line and up again, with what is in the grip on each."""

        def timed() -> tuple[Trajectory, Trajectory]:
            lower, lift = (
                self._motions.confirmed(self._motions.timed_line(path, self._known.line), self._known.line_boxes, load)
                for path, load in ((down, before), (down[::-1], after))
            )
            return lower, lift

        return self._descents.of((down.tobytes(), before, after), timed)

    def _grasp(self, request: TransferRequest | FetchRequest) -> tuple[FloatArray, float]:
        """The way down to the first grip that can be reached, and the tip's height over the parcel's underside."""
        refusal: UnreachableError | None = None
        for tip, height in self._grips(request):
            try:
                return self._admission(request.pick_via, tip), height
            except UnreachableError as error:
                refusal = refusal or error
        raise refusal or UnreachableError("the parcel cannot be gripped from above")

    def _grips(self, request: TransferRequest | FetchRequest) -> list[tuple[FloatArray, float]]:
        """Tip poses that grip the parcel, best first, each with the tip's height over the parcel's underside."""
        centre = self.cell.base_from_world(request.pick_pose[:3])
        matrix = rotation(request.pick_pose[3:])
        half = np.asarray(request.size_m) / 2
        half_height = float(np.abs(matrix[2]) @ half)
        via_tip = self._via_tip(request.pick_via)
        if not self._tool.finger_joints:
            tip = via_tip.copy()
            tip[:3, 3] = centre[0], centre[1], centre[2] + half_height + SUCTION_GAP_M
            return [(tip, 2 * half_height + SUCTION_GAP_M)]
        height = max(half_height, PICK_ABOVE_BOTTOM_M)
        grips = []
        for turn in self._finger_turns(matrix, half, via_tip):
            tip = _yawed(via_tip, turn)
            tip[:3, 3] = centre[0], centre[1], centre[2] - half_height + height
            grips.append((tip, height))
        return grips

    def _finger_turns(self, matrix: FloatArray, half: FloatArray, via_tip: FloatArray) -> list[float]:
        """Turns that put the fingers across two opposite sides: small turns first, and across wide sides last.

        A turn costs more time than anything else on the way down.
        """
        across = [k for k in range(3) if abs(matrix[2, k]) < np.sqrt(0.5)]
        present = np.arctan2(via_tip[1, 0], via_tip[0, 0])
        turns: list[tuple[bool, float]] = []
        for k in across:
            wide = bool(2 * half[k] > EASY_WIDTH_M)
            # The parcel's axes are in the world frame, the tip's in the base frame.
            wanted = np.arctan2(matrix[1, k], matrix[0, k]) - self.cell.base_pose[3]
            small = float((wanted - present + np.pi / 2) % np.pi - np.pi / 2)
            turns += [(wide, small), (wide, small - np.pi if small > 0 else small + np.pi)]
        return [turn for _, turn in sorted(turns, key=lambda turn: (turn[0], abs(turn[1])))]

    def _place_tip(self, request: TransferRequest | DeliverRequest, grip_height: float) -> FloatArray:
        if request.place_via == TRAY:
            x, y, yaw = request.car_pose
            ahead, left = self._car.tray_x_m + request.tray_at_m[0], request.tray_at_m[1]
            cos, sin = np.cos(yaw), np.sin(yaw)
            world = np.array([x + ahead * cos - left * sin, y + ahead * sin + left * cos, self._car.tray_floor_z_m])
            support = self.cell.base_from_world(world)
        else:
            support = self.cell.slots[request.place_via]
        tip = self._via_tip(request.place_via).copy()
        tip[:3, 3] = support[0], support[1], support[2] + RELEASE_M + grip_height
        return tip

    def _admission(self, via: int, tip: FloatArray) -> FloatArray:
        """Straight lines from a via point to above a tip pose and down to it, shape (k, n)."""
        above = tip.copy()
        above[2, 3] = self._via_tip(via)[2, 3]

        def across() -> FloatArray:
            return self._reached(self._via(via), above)

        def found() -> FloatArray:
            # Parcels on a slot differ in height only, so that the way to above them is the same.
            path = self._crossings.of((via, above.tobytes()), across)
            return np.concatenate((path, self._reached(path[-1], tip)[1:]))

        return self._admissions.of((via, tip.tobytes()), found)

    def _reached(self, q: FloatArray, tip: FloatArray) -> FloatArray:
        """The straight line to a tip pose, shape (k, n)."""
        line = self._straight(q, tip)
        if line is None:
            x, y, z = np.round(tip[:3, 3], 3)
            raise UnreachableError(f"no straight line to ({x}, {y}, {z}) in the arm's base frame")
        return line

    def _straight(self, q: FloatArray, tip: FloatArray) -> FloatArray | None:
        line = self._motions.line(q, tip)
        return line if line is not None and self._known.line.path_free(line) else None

    def _climb(self, q: FloatArray) -> FloatArray:
        """As far up as it goes, at most `LIFT_M`; at least the present configuration, shape (k, n)."""
        for lift in (LIFT_M, LIFT_M / 2):
            tip = self._motions.tip(q)
            tip[2, 3] += lift
            line = self._motions.line(q, tip)
            if line is not None and self._known.empty.free(line[-1]):
                return line
        return q[None]

    def _via(self, place: int) -> FloatArray:
        vias = self._known.vias
        if place not in vias:
            self.prepare()
        return vias[place]

    def _via_tip(self, place: int) -> FloatArray:
        """Pose of the tool's tip at a via point, shape (4, 4), read-only."""
        if place not in self._via_tips:
            tip = self._motions.tip(self._via(place))
            tip.flags.writeable = False
            self._via_tips[place] = tip
        return self._via_tips[place]

    def _good_vias(self, place: int) -> Iterator[FloatArray]:
        """Configurations above a place from which parcels around it can be reached, nearest to rest and tray first."""
        support = self.cell.tray if place == TRAY else self.cell.slots[place]
        anchors = [self._spec.home_rad] + ([] if place == TRAY else [self._via(TRAY)])
        candidates = []
        for yaw in np.linspace(-np.pi, np.pi, TOOL_YAWS, endpoint=False):
            tip = pointing_down(yaw)
            tip[:3, 3] = support[0], support[1], support[2] + MAX_EDGE_M + LIFT_M
            candidates.append(self._motions.inverse.ik_all(flange_from_tip(tip, self._tool.length_m)))
        q = np.concatenate(candidates)
        inside = ((q > self._spec.lower_rad + LIMIT_MARGIN_RAD) & (q < self._spec.upper_rad - LIMIT_MARGIN_RAD)).all(1)
        q = q[inside]
        q = q[self._known.loaded.batch(q)] if len(q) else q
        travel_s = sum(np.abs((q - anchor) / self._spec.max_velocity_radps).max(axis=1) for anchor in anchors)
        for k in np.argsort(travel_s, kind="stable") if len(q) else ():
            if self._serves(q[k], support):
                yield q[k]

    def _serves(self, q: FloatArray, support: FloatArray) -> bool:
        """Whether straight lines lead from a configuration to the lowest grips on and around a support."""
        lowest = PICK_ABOVE_BOTTOM_M if self._tool.finger_joints else 0.04
        r = PROBE_M[self._tool.name]
        for dx, dy in ((0.0, 0.0), (r, r), (r, -r), (-r, r), (-r, -r)):
            tip = self._motions.tip(q)
            tip[:3, 3] = support[0] + dx, support[1] + dy, tip[2, 3]
            across = self._straight(q, tip)
            if across is None:
                return False
            tip[2, 3] = support[2] + lowest
            if self._straight(across[-1], tip) is None:
                return False
        return True

    def _way(self, a: int, b: int, *, loaded: bool) -> Trajectory:
        """The motion between two via points; the way back is the same path, unless it touches something that way."""
        known, key = self._known, (a, b, loaded)
        if key not in known.ways:
            known.ways[key], known.attempts[key] = self._found_way(a, b, loaded=loaded)
        self._recall(a, b, loaded=loaded)
        return known.ways[key]

    def _found_way(self, a: int, b: int, *, loaded: bool) -> tuple[Trajectory, Attempt]:
        """The first motion between two via points that touches nothing, and how it was found."""
        checker = self._way_checker(loaded=loaded)
        held = Held(size_m=(MAX_EDGE_M,) * 3, below_tip_m=MAX_EDGE_M / 2) if loaded else None
        refusal: TouchingError | None = None
        for attempt in ATTEMPTS:
            result, trees = self._searched(a, b, attempt, loaded=loaded)
            if not result.solved:
                self._search.add_trees(trees)
            if not result.solved and attempt.more_m == 0.0:
                # A budget that is spent would be spent again, and ends that touch something do so again.
                raise UnreachableError(f"no way {_between(a, b)} ({result.status.value})")
            if result.solved:
                path = result.path if a < b else result.path[::-1]
                try:
                    motion = self._motions.timed(path, attempt.speed, checker)
                    return self._motions.confirmed(motion, self._known.boxes, held), attempt
                except TouchingError as error:
                    refusal = refusal or error
        raise UnreachableError(f"no way {_between(a, b)}: {refusal}")

    def _way_checker(self, *, loaded: bool) -> CollisionChecker:
        """Without a parcel an arm only comes to a car or leaves it: cars may drive below it."""
        return self._known.loaded if loaded else self._known.over_cars

    def _searched(self, a: int, b: int, attempt: Attempt, *, loaded: bool) -> tuple[MotionResult, list[SearchTree]]:
        """What a search from the lower via point to the higher finds, and its trees apart from those of others."""
        checker, low, high = self._way_checker(loaded=loaded), min(a, b), max(a, b)
        if attempt.more_m > 0.0:
            checker = checker.with_margin(MARGIN_M + attempt.more_m)
        others = self._search.take_trees()
        result = self._search.way(checker, self._via(low), self._via(high)[None], seed=attempt.seed)
        trees = self._search.take_trees()
        self._search.add_trees(others)
        return result, trees

    def _recall(self, a: int, b: int, *, loaded: bool) -> None:
        """Search a known way again, once and only if trees are wanted: the same search grows the same tree."""
        if not self._search.keeps_trees:
            return
        attempt = self._known.attempts[a, b, loaded]
        key = (min(a, b), max(a, b), loaded, attempt)
        if key not in self._way_trees:
            self._way_trees[key] = self._searched(a, b, attempt, loaded=loaded)[1]
        self._search.add_trees(self._way_trees[key])


def place_name(place: int) -> str:
    """A place in words; as in site files, slots count from 1."""
    return {HOME: "rest", TRAY: "the tray"}.get(place, f"slot {place + 1}")


def _between(a: int, b: int) -> str:
    return f"from above {place_name(max(a, b))} to {place_name(min(a, b))}"


def _yawed(tip: FloatArray, yaw: float) -> FloatArray:
    """A tip pose turned about the vertical through it."""
    turned = tip.copy()
    turned[:3, :3] = turn_about_z(yaw) @ tip[:3, :3]
    return turned
