"""SweptArm: the room that an arm takes during its motion, covered with spheres.

What lies between samples is covered, not sampled: a sample stands for the half steps before and after it, and every
sphere is larger by a bound on its way during these. Neighbouring samples thus cover all of the time between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.arm_model import ArmModel
from planners.motion.arm.hulls import bodies_of
from planners.motion.arm.kinematics import joint_rows, link_frames_into
from planners.motion.arrays import BoolArray, FloatArray, IntArray
from planners.motion.kernel import kernel
from planners.motion.path.timed_path import TimedPath


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
        raise PlanningError(f"swept: path of {q.shape[1]} joints; valid: {arm.model.n_joints}")
    size = len(q), len(arm.spheres)
    return np.empty((*size, 3)), np.empty(size), np.ascontiguousarray(arm.world_from_base[:3], dtype=np.float64)


def at_rest(arm: ArmInWorld, q: FloatArray) -> SweptArm:
    """Cover an arm that stands still at q (n,)."""
    return cover(arm, q[None], np.zeros((1, len(q))), np.array([True]))


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


@kernel
def _place_all(
    joints: FloatArray,
    spheres: FloatArray,
    lever: FloatArray,
    base: FloatArray,
    q: FloatArray,
    stray: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
) -> None:
    """Fill `centre` (k, s, 3) and `radius` (k, s); see `cover`."""
    for k in range(q.shape[0]):
        place_spheres(joints, spheres, base, q[k], centre[k])
        for s in range(spheres.shape[0]):
            bound = 0.0
            for j in range(q.shape[1]):
                bound += lever[s, j] * stray[k, j]
            radius[k, s] = spheres[s, 3] + bound


@kernel
def _sweep_all(
    joints: FloatArray,
    spheres: FloatArray,
    lever: FloatArray,
    base: FloatArray,
    q: FloatArray,
    between: FloatArray,
    bow: FloatArray,
    centre: FloatArray,
    radius: FloatArray,
) -> None:
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


@kernel
def _changes(centre: FloatArray, radius: FloatArray) -> FloatArray:
    """How much nearer than at a sample any sphere can be to anything at the next one (k-1,)."""
    change = np.zeros(centre.shape[0] - 1)
    for k in range(change.shape[0]):
        for s in range(centre.shape[1]):
            square = 0.0
            for a in range(3):
                square += (centre[k + 1, s, a] - centre[k, s, a]) ** 2
            change[k] = max(change[k], np.sqrt(square) + abs(radius[k + 1, s] - radius[k, s]))
    return change


@kernel
def place_spheres(joints: FloatArray, spheres: FloatArray, base: FloatArray, q: FloatArray, points: FloatArray) -> None:
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
