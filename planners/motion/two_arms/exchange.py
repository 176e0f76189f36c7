"""Exchange: one arm leaves a place as another comes to it, so that the second arrives as soon as it may.

The first arm hurries to the place, the second away from it; what counts in between is how soon one follows the other.
Both have time to spare then: the first is done early anyway, the second waits. So the joints are pushed at their limits
to where the arms part, also if they have to come back from there. Which way that is tells the deepest overlap along the
exchange: each joint is worth what it moves the overlapping spheres apart.

Whether the arms are apart is asked of their hulls at samples, which is a promise and no proof: `turns` has the last
word. Which way they part is told by their spheres, which say how deep they overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planners.motion.arm.hulls import SCRATCH, ArmStep, Bodies, step_apart
from planners.motion.arm.kinematics import link_frames_into
from planners.motion.arrays import FloatArray, Int, IntArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.scene_kernel import SceneArrays, path_free
from planners.motion.kernel import borrowing, inlined, inner_borrowing, kernel
from planners.motion.path.trajectory import Trajectory
from planners.motion.two_arms.asynchronous import SMOOTHING_S, asynchronous, smoothed, soonest, steps_into
from planners.motion.two_arms.swept import ArmInWorld

PUSH_S = 0.25
"""How long joints are pushed apart [s]: 0.2 and 0.3 changed makespans by 0.1 %."""
_STEP_S = 0.04
_SAMPLES = 23  # of an exchange: 0.9 s
_BOW_M = 0.001
_BEYOND_M = 0.03  # by how much spheres reach beyond hulls, both together, at most
_FINE_S = 0.01
_FINE_SAMPLES = int(_SAMPLES * _STEP_S / _FINE_S) + 1
_MOST_POLISHED = 42  # joints at most whose push is tried to change at last
_NEAR_M = 0.02  # spheres nearer than this are pushed apart, too
_KEPT = 0.5  # how much of what joints were worth counts in the next round
_IDLE = 0.03  # joints worth less than this share of the best are not pushed
_ALIKE_RAD = 0.3
_N_POSTURES = 24
_FIRST_FRAME = 2  # what is below meets nobody
_N_TRIES = 60
_UNKNOWN, _FORWARDS, _BACKWARDS, _BLOCKED = 0, 1, 2, 3  # whether joints move as soon as they can, seen from the place
_N_ROUNDS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Stay:
    """One arm that comes from where it rests to a place, stays, and goes on."""

    arm: ArmInWorld
    checker: CollisionChecker
    max_velocity: FloatArray
    """[rad/s], shape (n,)."""
    max_acceleration: FloatArray
    """[rad/s^2], shape (n,)."""
    start: FloatArray
    """[rad], shape (n,)."""
    place: FloatArray
    """Postures at the place [rad], shape (k, n)."""
    beyond: FloatArray
    """Where it may go on to [rad], shape (m, n)."""
    stay_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Exchange:
    """Motions of two arms; the first rests at the place until the second follows it."""

    first: int
    """Which arm is there first."""
    segments: tuple[tuple[Trajectory, Trajectory], tuple[Trajectory, Trajectory]]
    """Way to the place and away from it, of arms 0 and 1."""
    gap_s: float
    """How long after one's leaving the other may arrive [s]; it may be later for other reasons."""


class _Arm(NamedTuple):
    """One arm as the kernels see it; everything in the world's frame."""

    joints: FloatArray
    """Shape (n, 3, 4); the first brings the base along."""
    spheres: FloatArray
    """Centre and radius in the frame of the link [m], spheres before hulls, shape (s, 4)."""
    frame: IntArray
    """Of each sphere, shape (s,)."""
    parts: IntArray
    """As of `SweptArm`."""
    bodies: Bodies
    limits: FloatArray
    """Speed, acceleration, lowest and highest angle of each joint, shape (4, n)."""


class _Side(NamedTuple):
    """What one arm has to do, and among which obstacles."""

    arm: _Arm
    scene: SceneArrays
    start: FloatArray
    place: FloatArray
    end: FloatArray
    """Where each posture at the place goes on to, shape (k, n)."""
    come: FloatArray
    """Least time of each posture [s], shape (k,)."""
    leave: FloatArray
    stay: float


class _Meeting(NamedTuple):
    """Two arms that are at the place after each other; in arrays, row 0 is the first one's."""

    first: Int
    """Which of the two stays that is."""
    one: _Arm
    other: _Arm
    here: FloatArray
    """Their postures at the place, shape (2, n)."""
    there: FloatArray
    """Where the first goes on to, and where the second comes from, shape (2, n)."""
    most: Int
    """Steps of the longest gap that is of use."""
    spare: FloatArray
    """How long the motions may take [s]: the first goes on while the second stays and leaves, the second waits at its
    start; shape (2,)."""


class _Memory(NamedTuple):
    """What the kernels write into, as they make no array themselves; those for both arms have the first one's before
    the other's."""

    ends: FloatArray
    """`here` and `there` of a meeting, shape (2, 2, n)."""
    spare: FloatArray
    """Of a meeting, shape (2,)."""
    q: FloatArray
    """Joint angles, shape (2, k, n)."""
    points: FloatArray
    """Centres of spheres, shape (2, k, s, 3)."""
    frames: FloatArray
    """Link frames, shape (2, k, n+1, 3, 4)."""
    middle: FloatArray
    """Middles of bodies, shape (2, k, b, 3)."""
    fine_q: FloatArray
    """Joint angles of one arm at finer samples, shape (f, n)."""
    fine_frames: FloatArray
    """Link frames there, two copies for each arm, shape (2, 2, f, n+1, 3, 4)."""
    fine_middle: FloatArray
    """Middles of bodies there, shape (2, 2, f, b, 3)."""
    copies: IntArray
    """Which of its copies is that of an arm's motion, shape (2,)."""
    way: FloatArray
    """By which arm is first and for each pair of bodies, the direction that kept it apart last, shape (2, b, b, 3)."""
    at: IntArray
    """And the corners, shape (2, b, b, 2); see `step_apart`."""
    scratch: FloatArray
    """Of `step_apart`."""
    gaps: IntArray
    """Gaps that were found, shape (r,)."""
    pushes: FloatArray
    """The pushes for each of them, and at last those that are tried, shape (r+1, 2, n)."""
    worth: FloatArray
    """What joints were worth in the tries before, by which arm is first, shape (2, 2, n)."""
    leg: FloatArray
    """Joint angles of a whole motion, shape (l, n)."""
    steps: FloatArray
    """When the acceleration of a joint rises, and by how much, shape (2, 5)."""
    away: FloatArray
    """A direction, shape (3,)."""
    posture: FloatArray
    """Link frames of one posture, shape (n+1, 3, 4)."""


def exchange(stays: Sequence[Stay], margin_m: float, sample_s: float) -> Exchange | None:
    """Find the exchange that ends soonest among a number that is tried.

    Args:
        stays: Of two arms with as many joints, to one place.
        margin_m: Distance kept between them [m].
        sample_s: Sample period of the segments [s].

    Returns:
        Motions free of obstacles; None if none were found.
    """
    sides = (_side(stays[0]), _side(stays[1]))
    if sides[0].start.shape != sides[1].start.shape:
        return None
    found, push = np.array([0, -1, -1, 0, 0, 0]), np.zeros((2, len(sides[0].start)))
    gap_s = _search(sides, *_pairs(sides), margin_m + _BOW_M, _memory(sides), _ways(sides), found, push)
    first, i, j = found[:3].tolist()
    came_back, left_back = found[3:5].astype(bool).tolist()
    if i < 0:
        return None
    rows = (i, j) if first == 0 else (j, i)
    segments = []
    for k, (stay, side, row) in enumerate(zip(stays, sides, rows, strict=True)):
        limits = stay.max_velocity, stay.max_acceleration, sample_s
        here = side.place[row]
        if k == first:
            came = asynchronous(stay.start, here, *limits, late=not came_back)
            goes = asynchronous(here, side.end[row], *limits, push=push[0], push_s=PUSH_S)
        else:
            came = asynchronous(stay.start, here, *limits, late=True, push=push[1], push_s=PUSH_S)
            goes = asynchronous(here, side.end[row], *limits, late=left_back)
        segments.append((came, goes))
    return Exchange(first=first, segments=(segments[0], segments[1]), gap_s=gap_s)


def _side(stay: Stay) -> _Side:
    arm, model = stay.arm, stay.checker.model
    joints = arm.joints.copy()
    joints[0] = (arm.world_from_base @ np.vstack([joints[0], [0.0, 0.0, 0.0, 1.0]]))[:3]
    frame = arm.spheres[:, 4].astype(np.int64)
    limits = stay.max_velocity, stay.max_acceleration
    leave, row = soonest(stay.place, stay.beyond, *limits)
    bodies = arm.bodies
    meets = bodies.frame >= _FIRST_FRAME
    bodies = bodies._replace(
        hulls=bodies.hulls._replace(first=bodies.hulls.first[meets]),
        frame=bodies.frame[meets],
        radius=bodies.radius[meets],
        ball=bodies.ball[meets],
    )
    return _Side(
        arm=_Arm(
            joints=joints,
            spheres=np.ascontiguousarray(arm.spheres[:, :4]),
            frame=frame,
            parts=arm.parts[frame[arm.parts[:, 0]] >= _FIRST_FRAME],
            bodies=bodies,
            limits=np.array([*limits, model.lower, model.upper], dtype=np.float64),
        ),
        scene=stay.checker.scene,
        start=np.array(stay.start, dtype=np.float64),
        place=np.array(stay.place, dtype=np.float64),
        end=np.array(stay.beyond, dtype=np.float64)[row],
        come=soonest(stay.place, stay.start[None], *limits)[0] + SMOOTHING_S,
        leave=leave + SMOOTHING_S,
        stay=float(stay.stay_s),
    )


def _pairs(sides: tuple[_Side, _Side]) -> tuple[IntArray, FloatArray]:
    """Pairs of postures that may be tried, and when all would be done without a gap between them.

    Returns:
        Which arm is first, its posture and that of the second, shape (p, 3), the soonest first; and [s], shape (p,).
    """
    pairs, totals = [], []
    for first in range(2):
        one, other = sides[first], sides[1 - first]
        come, leave = (
            _different(postures, np.argsort(times, kind="stable"))
            for postures, times in ((one.place, one.come), (other.place, other.leave))
        )
        i, j = np.repeat(come, len(leave)), np.tile(leave, len(come))
        pairs.append(np.column_stack([np.full(len(i), first), i, j]))
        totals.append(np.maximum(one.come[i] + one.stay, other.come[j]) + other.stay + other.leave[j])
    total = np.concatenate(totals)
    order = np.argsort(total, kind="stable")
    return np.concatenate(pairs)[order], total[order]


def _ways(sides: tuple[_Side, _Side]) -> IntArray:
    """What is known of the ways of each arm to and from each of its postures, shape (2, 2, k)."""
    return np.full((2, 2, max(len(side.place) for side in sides)), _UNKNOWN)


def _memory(sides: tuple[_Side, _Side]) -> _Memory:
    n = len(sides[0].start)
    n_spheres = max(len(side.arm.spheres) for side in sides)
    n_bodies = max(len(side.arm.bodies.frame) for side in sides)
    n_leg = 0
    for side in sides:
        turn = np.ptp(np.concatenate([side.start[None], side.place, side.end]), axis=0)
        velocity, acceleration = side.arm.limits[:2]
        # Pushed the other way, a joint takes as long again to stop and has further to go: no motion takes longer.
        longest = 2 * PUSH_S + (turn + acceleration * PUSH_S**2) / velocity + velocity / acceleration + SMOOTHING_S
        n_leg = max(n_leg, int(longest.max() / _STEP_S) + 2)
    return _Memory(
        ends=np.empty((2, 2, n)),
        spare=np.empty(2),
        q=np.empty((2, _SAMPLES, n)),
        points=np.empty((2, _SAMPLES, n_spheres, 3)),
        frames=np.empty((2, _SAMPLES, n + 1, 3, 4)),
        middle=np.empty((2, _SAMPLES, n_bodies, 3)),
        fine_q=np.empty((_FINE_SAMPLES, n)),
        fine_frames=np.empty((2, 2, _FINE_SAMPLES, n + 1, 3, 4)),
        fine_middle=np.empty((2, 2, _FINE_SAMPLES, n_bodies, 3)),
        copies=np.zeros(2, dtype=np.int64),
        way=np.empty((2, n_bodies, n_bodies, 3)),
        at=np.full((2, n_bodies, n_bodies, 2), -1),
        scratch=np.empty(SCRATCH),
        gaps=np.empty(_N_ROUNDS, dtype=np.int64),
        pushes=np.empty((_N_ROUNDS + 1, 2, n)),
        worth=np.zeros((2, 2, n)),
        leg=np.empty((n_leg, n)),
        steps=np.empty((2, 5)),
        away=np.empty(3),
        posture=np.empty((n + 1, 3, 4)),
    )


@kernel
def _different(postures: FloatArray, order: IntArray) -> IntArray:
    """Rows of the first postures, in this order, that differ from all before."""
    rows = np.empty(_N_POSTURES, dtype=np.int64)
    count = 0
    for row in order:
        new = True
        for k in range(count):
            apart = 0.0
            for a in range(postures.shape[1]):
                apart = max(apart, abs(postures[row, a] - postures[rows[k], a]))
            if apart <= _ALIKE_RAD:
                new = False
                break
        if new:
            rows[count] = row
            count += 1
            if count == _N_POSTURES:
                break
    return rows[:count]


# A plain number in a call would be a type of its own, for which numba compiles the callee once more; so `np.int64(0)`.


@borrowing
def _search(
    sides: tuple[_Side, _Side],
    pairs: IntArray,
    total: FloatArray,
    margin: float,
    memory: _Memory,
    ways: IntArray,
    found: IntArray,
    push: FloatArray,
) -> float:
    """Try pairs of postures; the gap that was found [s].

    Fills `found` (6,) with which arm is first, the postures of the first and the second, whether they come and go
    backwards, and the gap in steps; and `push` (2, n).
    """
    best = np.inf
    tries = 0
    for k in range(len(total)):
        if total[k] >= best or tries == _N_TRIES:
            break
        first, i, j = pairs[k, 0], pairs[k, 1], pairs[k, 2]
        one, other = sides[first], sides[1 - first]
        if ways[first, 0, i] == _UNKNOWN:
            ways[first, 0, i] = _way(one, one.place[i], one.start, memory)
        if ways[first, 0, i] == _BLOCKED:
            continue
        if ways[1 - first, 1, j] == _UNKNOWN:
            ways[1 - first, 1, j] = _way(other, other.place[j], other.end[j], memory)
        if ways[1 - first, 1, j] == _BLOCKED:
            continue
        tries += 1
        most: Int = np.int64(_SAMPLES - 2)
        after = one.come[i] + one.stay + other.stay + other.leave[j]  # without a gap
        if best < np.inf:
            most = min(most, int(np.ceil((best - after) / _STEP_S - 1e-6)) - 1)
        row, gap = _parted(_meeting(first, one, i, other, j, most, memory), one.scene, other.scene, margin, memory)
        if gap > most:
            continue
        promised = max(total[k], after + gap * _STEP_S, one.come[i] + one.stay + one.leave[i])
        if promised >= best:
            continue
        best = promised
        found[0], found[1], found[2] = first, i, j
        found[3], found[4] = ways[first, 0, i] == _BACKWARDS, ways[1 - first, 1, j] == _BACKWARDS
        found[5] = gap
        _copy(memory.pushes[row], push)
    if found[1] < 0 or found[5] == 0:
        return float(found[5]) * _STEP_S
    one, other = sides[found[0]], sides[1 - found[0]]
    meeting = _meeting(found[0], one, found[1], other, found[2], found[5], memory)
    return _polished(meeting, one.scene, other.scene, margin, memory, push)


@inner_borrowing
def _copy(rows: FloatArray, out: FloatArray) -> None:
    for s in range(rows.shape[0]):
        for a in range(rows.shape[1]):
            out[s, a] = rows[s, a]


@inlined
def _meeting(first: Int, one: _Side, i: Int, other: _Side, j: Int, most: Int, memory: _Memory) -> _Meeting:
    """Posture i of the first arm, and posture j of the second."""
    spare = memory.spare
    spare[0] = most * _STEP_S + other.stay + other.leave[j]
    spare[1] = one.come[i] + one.stay + most * _STEP_S
    _set_out(one.place[i], other.place[j], one.end[i], other.start, memory.ends)
    return _Meeting(first, one.arm, other.arm, memory.ends[0], memory.ends[1], most, spare)


@inner_borrowing
def _set_out(here: FloatArray, their_here: FloatArray, there: FloatArray, their_there: FloatArray, ends: FloatArray) -> None:  # noqa: E501  # fmt: skip
    for a in range(here.shape[0]):
        ends[0, 0, a], ends[0, 1, a] = here[a], their_here[a]
        ends[1, 0, a], ends[1, 1, a] = there[a], their_there[a]


@inner_borrowing
def _polished(
    meeting: _Meeting, scene: SceneArrays, their_scene: SceneArrays, margin: float, memory: _Memory, push: FloatArray
) -> float:
    """Change the pushes joint by joint as long as that shortens the gap; which is returned [s]."""
    one, other, here, there, spare = meeting.one, meeting.other, meeting.here, meeting.there, meeting.spare
    q, frames, middle, copies = memory.fine_q, memory.fine_frames, memory.fine_middle, memory.copies
    way, at, scratch, steps = memory.way[meeting.first], memory.at[meeting.first], memory.scratch, memory.steps
    n = here.shape[1]
    guess: Int = np.int64(0)
    for s in range(2):
        copies[s] = 0
        _move(meeting, s, push, _FINE_S, steps, q, frames[s, 0], middle[s, 0])
    gap = int(np.ceil(meeting.most * _STEP_S / _FINE_S))
    met: Int = np.int64(-1)
    while gap > 0 and met < 0:
        f, g = copies[0], copies[1]
        met = _met(one, other, frames[0, f], frames[1, g], middle[0, f], middle[1, g], gap - 1, margin, way, at, scratch, guess)  # noqa: E501  # fmt: skip
        if met < 0:
            gap -= 1
    idle = 0  # joints since the last that helped
    turn = 0
    while gap > 0 and idle < 2 * n and turn < _MOST_POLISHED:
        s, a = turn // n % 2, turn % n
        limits = one.limits if s == 0 else other.limits
        turn += 1
        idle += 1
        kept = push[s, a]
        for side in (-1.0, 0.0, 1.0):
            if side == kept or not _allowed(here[s, a], there[s, a], limits, a, side, spare[s], steps):
                continue
            push[s, a] = side
            copies[s] = 1 - copies[s]
            _move(meeting, s, push, _FINE_S, steps, q, frames[s, copies[s]], middle[s, copies[s]])
            f, g = copies[0], copies[1]
            met = _met(one, other, frames[0, f], frames[1, g], middle[0, f], middle[1, g], gap - 1, margin, way, at, scratch, guess)  # noqa: E501  # fmt: skip
            if met < 0 and _leg_free(limits, scene if s == 0 else their_scene, here[s], there[s], push[s], memory):
                kept = side
                idle = 0
                while gap > 0 and met < 0:
                    gap -= 1
                    if gap > 0:
                        met = _met(one, other, frames[0, f], frames[1, g], middle[0, f], middle[1, g], gap - 1, margin, way, at, scratch, guess)  # noqa: E501  # fmt: skip
                    else:
                        met = np.int64(0)
            else:
                copies[s] = 1 - copies[s]
            guess = max(met, np.int64(0))
        push[s, a] = kept
    return gap * _FINE_S


@inner_borrowing
def _way(side: _Side, here: FloatArray, there: FloatArray, memory: _Memory) -> int:
    """In which direction of time a motion without pushes meets no obstacle."""
    nothing = memory.pushes[_N_ROUNDS, 0]
    for a in range(len(nothing)):
        nothing[a] = 0.0
    if _leg_free(side.arm.limits, side.scene, here, there, nothing, memory):
        return _FORWARDS
    return _BACKWARDS if _leg_free(side.arm.limits, side.scene, there, here, nothing, memory) else _BLOCKED


@inner_borrowing
def _sampled(
    here: FloatArray,
    there: FloatArray,
    limits: FloatArray,
    push: FloatArray,
    step: float,
    steps: FloatArray,
    q: FloatArray,
) -> None:
    """Fill samples (k, n) of the motion from `here` with its push; `steps` (2, 5) is overwritten."""
    at, height = steps[0], steps[1]
    for j in range(here.shape[0]):
        steps_into(there[j] - here[j], limits[0, j], limits[1, j], push[j], PUSH_S, at, height)
        for k in range(q.shape[0]):
            if k * step >= at[4] + SMOOTHING_S:
                q[k, j] = there[j]
            else:
                q[k, j] = here[j] + smoothed(k * step, at, height, SMOOTHING_S)[0]


@inner_borrowing
def _leg_free(
    limits: FloatArray, scene: SceneArrays, here: FloatArray, there: FloatArray, push: FloatArray, memory: _Memory
) -> bool:
    """Whether the motion from `here` meets no obstacle."""
    longest = 0.0
    for j in range(here.shape[0]):
        longest = max(longest, _joint_s(here[j], there[j], limits, j, push[j], memory.steps))
    q = memory.leg[: int(np.ceil(longest / _STEP_S)) + 1]
    _sampled(here, there, limits, push, _STEP_S, memory.steps, q)
    return path_free(q, scene)


@inner_borrowing
def _allowed(here: float, there: float, limits: FloatArray, a: int, side: float, spare: float, steps: FloatArray) -> bool:  # noqa: E501  # fmt: skip
    """Whether a push keeps a joint inside its limits and its time."""
    swing = here + side * limits[1, a] * PUSH_S**2
    inside = limits[2, a] <= swing <= limits[3, a]
    return side == 0.0 or (inside and _joint_s(here, there, limits, a, side, steps) <= spare)


@inner_borrowing
def _joint_s(here: float, there: float, limits: FloatArray, j: int, push: float, steps: FloatArray) -> float:
    """Time of one joint's motion."""
    return steps_into(there - here, limits[0, j], limits[1, j], push, PUSH_S, steps[0], steps[1]) + SMOOTHING_S


@inner_borrowing
def _parted(
    meeting: _Meeting, scene: SceneArrays, their_scene: SceneArrays, margin: float, memory: _Memory
) -> tuple[int, Int]:
    """Shortest gap found between one's leaving and the other's arrival in steps (most + 1: none), after its push's row.

    The pushes are in that row of `memory.pushes`.
    """
    one, other, here, there, spare = meeting.one, meeting.other, meeting.here, meeting.there, meeting.spare
    q, points, frames, middle, steps = memory.q, memory.points, memory.frames, memory.middle, memory.steps
    way, at, scratch = memory.way[meeting.first], memory.at[meeting.first], memory.scratch
    gaps, pushes, worth = memory.gaps, memory.pushes, memory.worth[meeting.first]
    push = pushes[_N_ROUNDS]
    n = here.shape[1]
    n_found = 0
    gap: Int = meeting.most
    guess: Int = np.int64(0)
    for s in range(2):
        for a in range(n):
            push[s, a] = 0.0
    _choose(worth, here, there, push)
    for turn in range(_N_ROUNDS):
        for s in range(2):
            limits = one.limits if s == 0 else other.limits
            for a in range(n):
                if not _allowed(here[s, a], there[s, a], limits, a, push[s, a], spare[s], steps):
                    push[s, a] = 0.0
            _move(meeting, s, push, _STEP_S, steps, q[s], frames[s], middle[s])
        better = False
        low: Int = -1  # no gap below is looked for, this one meets
        while gap > low:
            half = gap if turn > 0 and low < 0 else (gap + low + 1) // 2
            met = _met(one, other, frames[0], frames[1], middle[0], middle[1], half, margin, way, at, scratch, guess)
            if met < 0:
                gap = half - 1
                better = True
            else:
                guess = met
                if half == gap:
                    break
                low = half
        if better:
            gaps[n_found] = gap + 1
            _copy(push, pushes[n_found])
            n_found += 1
        if gap < 0 or turn == _N_ROUNDS - 1:
            break
        _place_spheres(one, frames[0], points[0])
        _place_spheres(other, frames[1], points[1])
        for s in range(2):
            for a in range(n):
                worth[s, a] *= _KEPT
        _weigh(one, other, q, points, gap, margin - _BEYOND_M, worth, memory.away, memory.posture)
        same = _choose(worth, here, there, push)
        if same:
            break
    for k in range(n_found - 1, -1, -1):
        mine = _leg_free(one.limits, scene, here[0], there[0], pushes[k, 0], memory)
        if mine and _leg_free(other.limits, their_scene, here[1], there[1], pushes[k, 1], memory):
            return k, gaps[k]
    return _N_ROUNDS, meeting.most + 1


@inner_borrowing
def _choose(worth: FloatArray, here: FloatArray, there: FloatArray, push: FloatArray) -> bool:
    """Fill the pushes of the joints that are worth most (2, n); whether they were the same before."""
    same = True
    for s in range(2):
        most_worth = 0.0
        for a in range(worth.shape[1]):
            most_worth = max(most_worth, abs(worth[s, a]))
        for a in range(worth.shape[1]):
            side = 0.0
            if abs(worth[s, a]) > _IDLE * most_worth:
                side = np.sign(worth[s, a])
                if (there[s, a] - here[s, a]) * side > _ALIKE_RAD:
                    side = 0.0  # it goes there anyway
            same = same and side == push[s, a]
            push[s, a] = side
    return same


@inner_borrowing
def _move(
    meeting: _Meeting,
    s: int,
    push: FloatArray,
    step: float,
    steps: FloatArray,
    q: FloatArray,
    frames: FloatArray,
    middle: FloatArray,
) -> None:
    """Fill samples (k, n) of one arm's motion away from the place, its link frames and the middles of its bodies."""
    arm = meeting.one if s == 0 else meeting.other
    _sampled(meeting.here[s], meeting.there[s], arm.limits, push[s], step, steps, q)
    _place(arm.joints, arm.bodies.ball, arm.bodies.frame, q, frames, middle)


@inner_borrowing
def _place(
    joints: FloatArray, ball: FloatArray, frame: IntArray, q: FloatArray, frames: FloatArray, middle: FloatArray
) -> None:
    """Fill link frames (k, n+1, 3, 4) and middles of bodies (k, b, 3) in the world."""
    for k in range(q.shape[0]):
        link_frames_into(joints, q[k], frames[k])
        for b in range(ball.shape[0]):
            f = frame[b]
            for a in range(3):
                middle[k, b, a] = frames[k, f, a, 3]
                for c in range(3):
                    middle[k, b, a] += frames[k, f, a, c] * ball[b, c]


@inner_borrowing
def _place_spheres(arm: _Arm, frames: FloatArray, points: FloatArray) -> None:
    """Fill sphere centres (k, s, 3) in the world."""
    spheres, frame = arm.spheres, arm.frame
    for k in range(frames.shape[0]):
        for s in range(spheres.shape[0]):
            f = frame[s]
            if f < _FIRST_FRAME:
                continue
            x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
            for a in range(3):
                points[k, s, a] = frames[k, f, a, 0] * x + frames[k, f, a, 1] * y + frames[k, f, a, 2] * z + frames[k, f, a, 3]  # noqa: E501  # fmt: skip


@inner_borrowing
def _deepest(
    spheres: FloatArray,
    parts: IntArray,
    points: FloatArray,
    their_spheres: FloatArray,
    their_parts: IntArray,
    their_points: FloatArray,
    margin: float,
    least: float,
) -> tuple[float, Int, Int]:
    """The least distance of two spheres beyond the margin, if below `least`, and which these are (-1: none)."""
    s_least: Int = np.int64(-1)
    t_least: Int = np.int64(-1)
    for p in range(parts.shape[0] - 1, -1, -1):  # tips first: they meet most
        hull = parts[p, 0]
        for m in range(their_parts.shape[0] - 1, -1, -1):
            against = their_parts[m, 0]
            size = spheres[hull, 3] + their_spheres[against, 3] + margin + least
            if size <= 0.0 or _square(points, hull, their_points, against) >= size * size:
                continue
            for s in range(parts[p, 1], parts[p, 2]):
                size = spheres[s, 3] + their_spheres[against, 3] + margin + least
                if size <= 0.0 or _square(points, s, their_points, against) >= size * size:
                    continue
                for t in range(their_parts[m, 1], their_parts[m, 2]):
                    size = spheres[s, 3] + their_spheres[t, 3] + margin
                    square = _square(points, s, their_points, t)
                    if size + least > 0.0 and square < (size + least) ** 2:
                        least = np.sqrt(square) - size
                        s_least = s
                        t_least = t
    return least, s_least, t_least


@inner_borrowing
def _square(points: FloatArray, s: Int, others: FloatArray, t: Int) -> float:
    """Square of the distance of two points of two arrays."""
    x = points[s, 0] - others[t, 0]
    y = points[s, 1] - others[t, 1]
    z = points[s, 2] - others[t, 2]
    square: float = x**2 + y**2 + z**2
    return square


@inner_borrowing
def _moment(k: Int, gap: Int, samples: int) -> tuple[Int, Int]:
    """Samples of both arms at moment k of an exchange: in step, then each against the other at the place."""
    if k <= gap:
        return k, gap - k
    if k < samples:
        return k, np.int64(0)
    return np.int64(0), k - samples + gap + 1


@inner_borrowing
def _met(
    one: _Arm,
    other: _Arm,
    frames: FloatArray,
    their_frames: FloatArray,
    middle: FloatArray,
    their_middle: FloatArray,
    gap: Int,
    margin: float,
    way: FloatArray,
    at: IntArray,
    scratch: FloatArray,
    guess: Int,
) -> int:
    """A moment of an exchange at which the arms are not apart, looking from a guess onwards; -1 for none."""
    samples = frames.shape[0]
    last = 2 * samples - gap - 2
    ball, theirs = one.bodies.ball, other.bodies.ball
    for turn in range(last + 1):
        k = (guess + turn) % (last + 1)
        s, t = _moment(k, gap, samples)
        for p in range(ball.shape[0]):
            for r in range(theirs.shape[0]):
                size = ball[p, 3] + theirs[r, 3] + margin
                x = middle[s, p, 0] - their_middle[t, r, 0]
                y = middle[s, p, 1] - their_middle[t, r, 1]
                z = middle[s, p, 2] - their_middle[t, r, 2]
                if x * x + y * y + z * z < size * size:
                    s_end, t_end = _moment(min(k + 1, last), gap, samples)
                    f, g = one.bodies.frame[p], other.bodies.frame[r]
                    distance = margin + one.bodies.radius[p] + other.bodies.radius[r]
                    mine = ArmStep(one.bodies.hulls, p, frames[s, f], frames[s_end, f])
                    others = ArmStep(other.bodies.hulls, r, their_frames[t, g], their_frames[t_end, g])
                    if not step_apart(mine, others, distance, way[p, r], at[p, r], scratch):
                        return int(k)
    return -1


@inner_borrowing
def _weigh(
    one: _Arm,
    other: _Arm,
    q: FloatArray,
    points: FloatArray,
    gap: Int,
    margin: float,
    worth: FloatArray,
    away: FloatArray,
    frames: FloatArray,
) -> None:
    """Add what joints are worth (2, n): how far a push of each moves the deepest spheres of each moment apart.

    `away` (3,) and `frames` (n+1, 3, 4) are overwritten.
    """
    for k in range(2 * _SAMPLES - gap - 1):
        s, t = _moment(k, gap, _SAMPLES)
        mine, theirs = points[0, s], points[1, t]
        least, u, v = _deepest(one.spheres, one.parts, mine, other.spheres, other.parts, theirs, margin, _NEAR_M)
        if u < 0:
            continue
        length = np.sqrt(_square(mine, u, theirs, v)) + 1e-9
        for a in range(3):
            away[a] = (_NEAR_M - least) * (points[0, s, u, a] - points[1, t, v, a]) / length
        _weigh_joints(one.joints, one.limits[1], q[0, s], one.frame[u], points[0, s, u], away, s, frames, worth[0])
        for a in range(3):
            away[a] = -away[a]
        _weigh_joints(
            other.joints, other.limits[1], q[1, t], other.frame[v], points[1, t, v], away, t, frames, worth[1]
        )


@inner_borrowing
def _weigh_joints(
    joints: FloatArray,
    acceleration: FloatArray,
    q: FloatArray,
    frame: Int,
    point: FloatArray,
    away: FloatArray,
    step: Int,
    frames: FloatArray,
    worth: FloatArray,
) -> None:
    pushed = max(0.0, step * _STEP_S - 0.5 * SMOOTHING_S)
    if pushed == 0.0:
        return
    link_frames_into(joints, q, frames)
    for j in range(min(frame, q.shape[0])):
        x = point[0] - frames[j + 1, 0, 3]
        y = point[1] - frames[j + 1, 1, 3]
        z = point[2] - frames[j + 1, 2, 3]
        ax, ay, az = frames[j + 1, 0, 2], frames[j + 1, 1, 2], frames[j + 1, 2, 2]
        turn = away[0] * (ay * z - az * y) + away[1] * (az * x - ax * z) + away[2] * (ax * y - ay * x)
        worth[j] += turn * acceleration[j] * pushed * pushed
