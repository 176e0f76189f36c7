"""Coordination of arms that share a workspace: each keeps its path, and a schedule says who waits where.

The coordination diagram of two arms has the progress of one along one axis and that of the other along the other; a
cell is free if the arms do not meet there. A schedule is a path through free cells, from the start of both to the end
of both, that never goes back. (O'Donnell and Lozano-Perez, Deadlock-free and collision-free coordination of two robot
manipulators, ICRA 1989; more robots: LaValle and Hutchinson, Optimal motion planning for multiple robots having
independent goals, IEEE T-RA 1998.) Here an arm waits only where its motion rests anyway: a schedule is therefore inside
the same velocity and acceleration limits as the motions it is made of, and nothing has to be timed again.

What lies between grid points is covered, not sampled: a cell stands for the half steps before and after both its
samples, and every sphere in it is larger by a bound on its way during these. Neighbouring cells of a schedule thus
cover all of the time between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.arm_model import ArmModel
from planners.motion.arm.hulls import bodies_of
from planners.motion.arm.kinematics import joint_rows, link_frames_into
from planners.motion.arrays import BoolArray, FloatArray, IntArray
from planners.motion.path.timed_path import TimedPath

MARGIN_M = 0.01
"""Distance kept between arms unless said otherwise [m]: a physical arm follows its set-points to some millimetres."""
MAX_CELLS = 20_000_000
"""Largest diagram that is searched: 0.2 GB, seconds."""
_STEP_COST = 1 << 32  # one step of everybody; the steps of single arms count below that
_NEVER = np.iinfo(np.int64).max


class ArmInWorld:
    """An arm, what it holds, and where it stands.

    Args:
        model: The arm.
        world_from_base: Pose of the base, shape (4, 4).
        held_spheres: Centres in the last link frame (m, 3) and radii (m,) of a held parcel [m].

    Raises:
        PlanningError: Malformed input.
    """

    def __init__(
        self,
        model: ArmModel,
        world_from_base: npt.ArrayLike,
        held_spheres: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    ) -> None:
        pose = checks.rigid("ArmInWorld: world_from_base", world_from_base)
        held_centre, held_radius = checks.spheres("ArmInWorld: held spheres", held_spheres)
        self.model = model
        self.world_from_base = pose
        self.joints = joint_rows(model.base_from_joint)
        n = model.n_joints
        own = model.sphere_frame if model.sphere_part is None else model.sphere_part
        part = np.concatenate([own, np.full(len(held_radius), n + 2)]).astype(np.int64)
        order = np.argsort(part, kind="stable")  # the kernels want each rigid part's spheres side by side
        centre = np.concatenate([model.sphere_centre, held_centre])[order]
        radius = np.concatenate([model.sphere_radius, held_radius])[order]
        self.spheres, self.parts = _with_hulls(centre, radius, part[order], n)
        """Centre, radius and link frame of each sphere, hulls last, shape (s, 5); parts as in `SweptArm`."""
        self.lever = _levers(self.joints, self.spheres)
        """Greatest distance of each sphere's centre from each joint's axis [m], shape (s, n)."""
        self.bodies = bodies_of(model.hulls, self.spheres[: len(order), :4], part[order], np.minimum(part[order], n))
        """Hulls where they are known, else spheres."""
        balls = np.column_stack([self.bodies.ball, self.bodies.frame])
        moved = self.bodies.frame[:, None] > np.arange(n)
        self.body_lever = _levers(self.joints, balls) + moved * self.bodies.ball[:, 3:]
        """Greatest distance of each body's points from each joint's axis [m], shape (b, n)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SweptArm:
    """The room an arm takes at each sample of its path: spheres in the world that cover the half steps around it."""

    centre: FloatArray
    """Shape (k, s, 3) [m]; the last rows are hulls, one around each rigid part."""
    radius: FloatArray
    """Shape (k, s) [m]."""
    parts: IntArray
    """Row of the hull, first sphere and end sphere of each rigid part, shape (m, 3)."""
    change: FloatArray
    """Bound on how much nearer than at a sample the arm can be to anything at the next one [m], shape (k-1,)."""
    rests: BoolArray
    """Where the arm may wait, shape (k,)."""

    def __len__(self) -> int:
        return len(self.rests)

    def thinned(self, every: int) -> SweptArm:
        """One of `every` samples, the last one among them: what lies between them is not covered."""
        kept = np.arange(len(self) - 1, -1, -every)[::-1]
        total = np.concatenate([[0.0], np.cumsum(self.change)])
        # A rest between two samples that are kept counts for the later one.
        rested = np.concatenate([[0], np.cumsum(self.rests)])
        before = np.concatenate([[-1], kept[:-1]])
        return SweptArm(
            centre=self.centre[kept],
            radius=self.radius[kept],
            parts=self.parts,
            change=np.diff(total[kept]),
            rests=rested[kept + 1] > rested[before + 1],
        )


def swept(arm: ArmInWorld, path: TimedPath) -> SweptArm:
    """Cover an arm's motion with spheres.

    A sphere goes from where it is at a sample to where it is half a step away nearly straight: as its joints go, it
    leaves the straight line by no more than an eighth of what they turn times what they move it, and joints that leave
    their own straight lines by an angle move it by at most that times its greatest distance from their axes.

    Args:
        arm: The arm; what it holds is held all along.
        path: Its motion.

    Raises:
        PlanningError: The path is another arm's.
    """
    centre, radius, base = _room(arm, path.q)
    _sweep_all(arm.joints, arm.spheres, arm.lever, base, path.q, path.between, path.bow, centre, radius)
    return SweptArm(centre=centre, radius=radius, parts=arm.parts, change=_changes(centre, radius), rests=path.rests)


def cover(arm: ArmInWorld, q: FloatArray, stray: FloatArray, rests: BoolArray) -> SweptArm:
    """Cover samples of an arm's motion with spheres; see `swept`.

    Args:
        arm: The arm.
        q: Joint angles [rad], shape (k, n).
        stray: How far joints may be from them [rad], shape (k, n).
        rests: Where the arm may wait, shape (k,).

    Raises:
        PlanningError: The samples are another arm's.
    """
    centre, radius, base = _room(arm, q)
    _place_all(arm.joints, arm.spheres, arm.lever, base, np.ascontiguousarray(q), stray, centre, radius)
    return SweptArm(centre=centre, radius=radius, parts=arm.parts, change=_changes(centre, radius), rests=rests)


def _room(arm: ArmInWorld, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Empty centres and radii for samples, and the upper rows of the base's pose."""
    if q.shape[1] != arm.model.n_joints:
        raise PlanningError(f"swept: path of {q.shape[1]} joints, expected {arm.model.n_joints}")
    size = len(q), len(arm.spheres)
    return np.empty((*size, 3)), np.empty(size), np.ascontiguousarray(arm.world_from_base[:3], dtype=np.float64)


def at_rest(arm: ArmInWorld, q: FloatArray) -> SweptArm:
    """Cover an arm that stands still at q (n,)."""
    return cover(arm, q[None], np.zeros((1, len(q))), np.array([True]))


def apart_in_step(a: SweptArm, b: SweptArm, margin_m: float = MARGIN_M) -> bool:
    """Whether two arms keep their distance when neither waits for the other; who is done first rests at its end.

    One diagonal of the coordination diagram, and the cells beside it: it also holds if the clocks of the arms differ by
    up to a step.
    """
    return bool(_in_step(a.centre, a.radius, a.parts, b.centre, b.radius, b.parts, float(margin_m)))


def free_cells(a: SweptArm, b: SweptArm, margin_m: float = MARGIN_M) -> BoolArray:
    """The coordination diagram of two arms.

    Args:
        a: One arm, k samples.
        b: The other, m samples.
        margin_m: Distance kept between them [m], >= 0.

    Returns:
        Where they keep that distance, shape (k, m).

    Raises:
        PlanningError: The margin is negative.
    """
    if not margin_m >= 0:
        raise PlanningError(f"free_cells: margin_m {margin_m}, expected >= 0")
    free = np.empty((len(a), len(b)), dtype=np.bool_)
    _diagram(a.centre, a.radius, a.parts, a.change, b.centre, b.radius, b.parts, b.change, float(margin_m), free)
    return free


class ScheduleStatus(Enum):
    """How a scheduling query ended."""

    SOLVED = "solved"
    INVALID_START = "invalid_start"
    """Two arms are too near each other at the start."""
    INVALID_GOAL = "invalid_goal"
    """Two arms are too near each other when both are done."""
    NO_SOLUTION = "no_solution"
    """These paths cannot be gone whoever waits for whom."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Who is where when."""

    status: ScheduleStatus
    index: IntArray
    """Sample of each arm's path at the beginning of each step, shape (T+1, n_arms); (0, n_arms) if not solved."""
    step_s: float

    @property
    def solved(self) -> bool:
        """Whether there is a schedule."""
        return self.status is ScheduleStatus.SOLVED

    @property
    def makespan_s(self) -> float:
        """Time until all arms are done [s]; inf if not solved."""
        return (len(self.index) - 1) * self.step_s if self.solved else np.inf

    def along_s(self, arm: int, time_s: float) -> float:
        """How much of its own motion an arm has done at a time [s]."""
        step = min(max(int(time_s / self.step_s), 0), len(self.index) - 1)
        here = int(self.index[step, arm])
        moves = step + 1 < len(self.index) and int(self.index[step + 1, arm]) > here
        return here * self.step_s + (time_s - step * self.step_s if moves else 0.0)


def schedule(arms: Sequence[ArmInWorld], paths: Sequence[TimedPath], margin_m: float = MARGIN_M) -> Schedule:
    """The shortest schedule of motions whose paths are given; of several, one in which the arms are done soonest.

    Args:
        arms: Two or more arms.
        paths: Motion of each, all with the same step.
        margin_m: Distance kept between arms [m], >= 0.

    Raises:
        PlanningError: Malformed input, or the diagram is too large.
    """
    if len(arms) != len(paths) or len(arms) < 2 or len({path.step_s for path in paths}) != 1:
        steps = sorted({path.step_s for path in paths})
        raise PlanningError(
            f"schedule: {len(arms)} arms, {len(paths)} paths with steps {steps} s; expected two or more arms, a path "
            "for each, and one step"
        )
    covers = [swept(arm, path) for arm, path in zip(arms, paths, strict=True)]
    tables = [free_cells(covers[i], covers[j], margin_m) for i in range(len(covers)) for j in range(i + 1, len(covers))]
    return schedule_in(tables, [cover.rests for cover in covers], paths[0].step_s)


def schedule_in(free: Sequence[BoolArray], rests: Sequence[BoolArray], step_s: float) -> Schedule:
    """The shortest schedule through given diagrams.

    Exact: dynamic programming from the end over the product of all arms' samples.

    Args:
        free: Diagrams of the pairs (0, 1), (0, 2), ..., (1, 2), ...; shapes (k_i, k_j).
        rests: Where each arm may wait, shapes (k_i,); the last sample counts as one.
        step_s: Length of a step [s].

    Raises:
        PlanningError: The diagrams do not belong to the arms, or the product is too large.
    """
    size = np.array([len(r) for r in rests], dtype=np.int64)
    pairs = [(i, j) for i in range(len(size)) for j in range(i + 1, len(size))]
    shapes = [(int(size[i]), int(size[j])) for i, j in pairs]
    if [table.shape for table in free] != shapes:
        raise PlanningError(f"schedule_in: diagrams {[table.shape for table in free]}, expected {shapes}")
    if np.prod(size.astype(np.float64)) > MAX_CELLS:
        raise PlanningError(
            f"schedule_in: {' x '.join(map(str, size))} cells, expected at most {MAX_CELLS}; lengthen the step"
        )

    def failed(status: ScheduleStatus) -> Schedule:
        return Schedule(status=status, index=np.empty((0, len(size)), dtype=np.int64), step_s=step_s)

    if not all(table[0, 0] for table in free):
        return failed(ScheduleStatus.INVALID_START)
    if not all(table[-1, -1] for table in free):
        return failed(ScheduleStatus.INVALID_GOAL)
    together = np.concatenate(rests)
    if len(size) == 2:
        cost = _costs_of_two(free[0], rests[0], rests[1]).ravel()
    else:
        cost = np.full(int(np.prod(size)), _NEVER)
        _costs_of_arms(np.concatenate([table.ravel() for table in free]), together, size, cost)
    if cost[0] == _NEVER:
        return failed(ScheduleStatus.NO_SOLUTION)
    index = np.zeros((int(cost[0] // _STEP_COST) + 1, len(size)), dtype=np.int64)
    _follow(cost, together, size, index)
    return Schedule(status=ScheduleStatus.SOLVED, index=index, step_s=step_s)


def _with_hulls(centre: FloatArray, radius: FloatArray, part: IntArray, n: int) -> tuple[FloatArray, IntArray]:
    """Append one sphere around each rigid part; the table (s, 5) and the parts (m, 3)."""
    names, first, count = np.unique(part, return_index=True, return_counts=True)
    hulls, parts = [], []
    for k, (name, a, m) in enumerate(zip(names, first, count, strict=True)):
        own, size = centre[a : a + m], radius[a : a + m]
        middle = 0.5 * ((own - size[:, None]).min(axis=0) + (own + size[:, None]).max(axis=0))
        reach = (np.linalg.norm(own - middle, axis=1) + size).max()
        hulls.append([*middle, reach, min(name, n)])
        parts.append([len(centre) + k, a, a + m])
    table = np.concatenate([np.column_stack([centre, radius, np.minimum(part, n)]), np.reshape(hulls, (-1, 5))])
    return np.ascontiguousarray(table), np.array(parts, dtype=np.int64).reshape(-1, 3)


def _levers(joints: FloatArray, spheres: FloatArray) -> FloatArray:
    """Upper bounds of the distance from each joint's axis to each sphere's centre, shape (s, n)."""
    step = np.linalg.norm(joints[:, :, 3], axis=1)
    lever = np.zeros((len(spheres), len(joints)))
    for s, sphere in enumerate(spheres):
        frame, offset = int(sphere[4]), float(np.linalg.norm(sphere[:3]))
        for j in range(frame):
            if frame == j + 1:
                lever[s, j] = np.hypot(sphere[0], sphere[1])
            else:
                # The first offset after a joint is fixed in its frame: only its part off the axis counts.
                lever[s, j] = np.hypot(*joints[j + 1, :2, 3]) + step[j + 2 : frame].sum() + offset
    return lever


@njit(cache=True)
def _place_all(joints, spheres, lever, base, q, stray, centre, radius):  # type: ignore[no-untyped-def]
    """Fill `centre` (k, s, 3) and `radius` (k, s); see `cover`."""
    for k in range(q.shape[0]):
        place_spheres(joints, spheres, base, q[k], centre[k])
        for s in range(spheres.shape[0]):
            bound = 0.0
            for j in range(q.shape[1]):
                bound += lever[s, j] * stray[k, j]
            radius[k, s] = spheres[s, 3] + bound


@njit(cache=True)
def _sweep_all(joints, spheres, lever, base, q, between, bow, centre, radius):  # type: ignore[no-untyped-def]
    """Fill `centre` (k, s, 3) and `radius` (k, s); see `swept`."""
    middle = np.empty((spheres.shape[0], 3))
    radius[:] = spheres[:, 3]
    for k in range(q.shape[0]):
        place_spheres(joints, spheres, base, q[k], centre[k])
        if k == 0:
            continue
        place_spheres(joints, spheres, base, between[k - 1], middle)
        for end in range(2):
            turn = 0.0
            for j in range(q.shape[1]):
                turn += abs(between[k - 1, j] - q[k - 1 + end, j])
            for s in range(spheres.shape[0]):
                bound = 0.0
                square = 0.0
                for j in range(q.shape[1]):
                    bound += lever[s, j] * (bow[k - 1, j] + 0.125 * turn * abs(between[k - 1, j] - q[k - 1 + end, j]))
                for a in range(3):
                    square += (middle[s, a] - centre[k - 1 + end, s, a]) ** 2
                radius[k - 1 + end, s] = max(radius[k - 1 + end, s], spheres[s, 3] + np.sqrt(square) + bound)


@njit(cache=True)
def _changes(centre, radius):  # type: ignore[no-untyped-def]
    """How much nearer than at a sample any sphere can be to anything at the next one (k-1,)."""
    change = np.zeros(centre.shape[0] - 1)
    for k in range(change.shape[0]):
        for s in range(centre.shape[1]):
            square = 0.0
            for a in range(3):
                square += (centre[k + 1, s, a] - centre[k, s, a]) ** 2
            change[k] = max(change[k], np.sqrt(square) + abs(radius[k + 1, s] - radius[k, s]))
    return change


@njit(cache=True)
def _gap(ca, ra, cb, rb):  # type: ignore[no-untyped-def]
    x = ca[0] - cb[0]
    y = ca[1] - cb[1]
    z = ca[2] - cb[2]
    return np.sqrt(x * x + y * y + z * z) - ra - rb


@njit(cache=True)
def place_spheres(joints, spheres, base, q, points):  # type: ignore[no-untyped-def]
    """Fill `points` (s, 3) with sphere centres in the world; `base` (3, 4) is the arm's pose."""
    frames = np.empty((q.shape[0] + 1, 3, 4))
    link_frames_into(joints, q, frames)
    point = np.empty(3)
    for s in range(spheres.shape[0]):
        f = int(spheres[s, 4])
        for a in range(3):
            point[a] = frames[f, a, 3]
            for b in range(3):
                point[a] += frames[f, a, b] * spheres[s, b]
        for a in range(3):
            points[s, a] = base[a, 3]
            for b in range(3):
                points[s, a] += base[a, b] * point[b]


@njit(cache=True)
def clearance(ca, ra, parts_a, cb, rb, parts_b, margin):  # type: ignore[no-untyped-def]
    """A lower bound on the distance beyond the margin, or, where there is none, minus the depth of some overlap."""
    least = np.inf
    for p in range(parts_a.shape[0] - 1, -1, -1):  # tips first: they meet most
        hull_a = parts_a[p, 0]
        for m in range(parts_b.shape[0] - 1, -1, -1):
            hull_b = parts_b[m, 0]
            gap = _gap(ca[hull_a], ra[hull_a], cb[hull_b], rb[hull_b]) - margin
            if gap > 0.0:
                least = min(least, gap)
                continue
            for s in range(parts_a[p, 1], parts_a[p, 2]):
                for t in range(parts_b[m, 1], parts_b[m, 2]):
                    gap = _gap(ca[s], ra[s], cb[t], rb[t]) - margin
                    if gap < 0.0:
                        return gap
                    least = min(least, gap)
    return least


@njit(cache=True)
def _diagram(ca, ra, parts_a, change_a, cb, rb, parts_b, change_b, margin, free):  # type: ignore[no-untyped-def]
    """Fill `free`; a cell near one whose clearance is known is settled without looking, if it cannot have changed."""
    slack = np.zeros(cb.shape[0])  # clearance, at least, of the row above; minus depth, at most, where arms overlap
    for i in range(ca.shape[0]):
        left = 0.0
        for j in range(cb.shape[0]):
            known = 0.0
            if i > 0:
                known = _carried(slack[j], change_a[i - 1])
            if j > 0:
                beside = _carried(left, change_b[j - 1])
                if abs(beside) > abs(known):
                    known = beside
            if abs(known) < 1e-9:
                known = clearance(ca[i], ra[i], parts_a, cb[j], rb[j], parts_b, margin)
            free[i, j] = known >= 0.0
            slack[j] = known
            left = known


@njit(cache=True)
def _in_step(ca, ra, parts_a, cb, rb, parts_b, margin):  # type: ignore[no-untyped-def]
    k, m = ca.shape[0], cb.shape[0]
    for step in range(max(k, m)):
        for slip in range(-1, 2):
            i = min(step, k - 1)
            j = min(max(step + slip, 0), m - 1)
            if clearance(ca[i], ra[i], parts_a, cb[j], rb[j], parts_b, margin) < 0.0:
                return False
    return True


@njit(cache=True)
def _carried(known, change):  # type: ignore[no-untyped-def]
    """What is left of a clearance or a depth after a change; 0 = nothing is known."""
    if known > 0.0:
        return max(0.0, known - change)
    return min(0.0, known + change)


@njit(cache=True)
def _costs_of_two(free, rests_a, rests_b):  # type: ignore[no-untyped-def]
    """Cost to go from every cell (k, m) of one diagram."""
    k, m = free.shape
    cost = np.full((k, m), _NEVER)
    cost[k - 1, m - 1] = 0
    for i in range(k - 1, -1, -1):
        for j in range(m - 1, -1, -1):
            if not free[i, j] or (i == k - 1 and j == m - 1):
                continue
            best = _NEVER
            if i < k - 1 and j < m - 1:
                best = cost[i + 1, j + 1]
            if i < k - 1 and (rests_b[j] or j == m - 1):
                best = min(best, cost[i + 1, j])
            if j < m - 1 and (rests_a[i] or i == k - 1):
                best = min(best, cost[i, j + 1])
            if best < _NEVER:
                cost[i, j] = best + _STEP_COST + (i < k - 1) + (j < m - 1)
    return cost


@njit(cache=True)
def _costs_of_arms(flat, rests, size, cost):  # type: ignore[no-untyped-def]
    """Fill the cost to go (product of sizes,) of any number of arms."""
    n = size.shape[0]
    stride = np.ones(n, dtype=np.int64)
    first = np.zeros(n, dtype=np.int64)
    for a in range(n - 2, -1, -1):
        stride[a] = stride[a + 1] * size[a + 1]
    for a in range(1, n):
        first[a] = first[a - 1] + size[a - 1]
    here = np.empty(n, dtype=np.int64)
    last = cost.shape[0] - 1
    cost[last] = 0
    for cell in range(last - 1, -1, -1):
        rest = cell
        moving = 0
        for a in range(n):
            here[a] = rest // stride[a]
            rest -= here[a] * stride[a]
            moving += here[a] < size[a] - 1
        ok = True
        offset = 0
        for a in range(n):
            for b in range(a + 1, n):
                ok = ok and flat[offset + here[a] * size[b] + here[b]]
                offset += size[a] * size[b]
        if not ok:
            continue
        best = _NEVER
        for move in range(1, 1 << n):
            ahead = cell
            allowed = True
            for a in range(n):
                at_end = here[a] == size[a] - 1
                if move >> a & 1:
                    allowed = allowed and not at_end
                    ahead += stride[a]
                else:
                    allowed = allowed and (at_end or rests[first[a] + here[a]])
            if allowed and cost[ahead] < best:
                best = cost[ahead]
        if best < _NEVER:
            cost[cell] = best + _STEP_COST + moving


@njit(cache=True)
def _follow(cost, rests, size, index):  # type: ignore[no-untyped-def]
    """Fill `index` (T+1, n) with the cheapest way; of equal moves, one in which the last arms go on."""
    n = size.shape[0]
    stride = np.ones(n, dtype=np.int64)
    first = np.zeros(n, dtype=np.int64)
    for a in range(n - 2, -1, -1):
        stride[a] = stride[a + 1] * size[a + 1]
    for a in range(1, n):
        first[a] = first[a - 1] + size[a - 1]
    cell = 0
    for step in range(1, index.shape[0]):
        best = -1
        chosen = 0
        for move in range((1 << n) - 1, 0, -1):
            ahead = cell
            allowed = True
            for a in range(n):
                here = index[step - 1, a]
                at_end = here == size[a] - 1
                if move >> a & 1:
                    allowed = allowed and not at_end
                    ahead += stride[a]
                else:
                    allowed = allowed and (at_end or rests[first[a] + here])
            if allowed and (best < 0 or cost[ahead] < cost[best]):
                best = ahead
                chosen = move
        cell = best
        for a in range(n):
            index[step, a] = index[step - 1, a] + (chosen >> a & 1)
