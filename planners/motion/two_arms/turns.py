"""Turns: two motions that nobody waits in, once the second arm has begun late enough.

What an arm is made of goes nearly straight from a sample to the next, and by how much it does not is bounded; so one
direction that separates two bodies at both samples proves the time in between. Nothing is covered by larger spheres for
it: what is kept is the distance that was asked for, to a millimetre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.errors import PlanningError
from planners.motion.arm.hulls import SCRATCH, ArmStep, Bodies, step_apart
from planners.motion.arm.kinematics import link_frames_into
from planners.motion.arrays import FloatArray, Int, IntArray
from planners.motion.kernel import borrowing, inner_borrowing, kernel
from planners.motion.path.timed_path import TimedPath
from planners.motion.status import MotionStatus
from planners.motion.two_arms.diagram import MARGIN_M
from planners.motion.two_arms.schedule import Schedule
from planners.motion.two_arms.swept import ArmInWorld

_TOUCH_M = 1e-6  # without any distance no direction could be told from none


class _Moving(NamedTuple):
    """One arm on its way."""

    bodies: Bodies
    frames: FloatArray
    """In the world at each sample, shape (k, n+1, 3, 4)."""
    middle: FloatArray
    """Centre of the ball around each body at each sample, shape (k, b, 3)."""
    wide: FloatArray
    """Radius of that ball, and how far it goes until the next sample [m], shape (k, b)."""
    bow: FloatArray
    """How far its points may leave their straight lines until then, and its own rounding [m], shape (k, b)."""


def in_turn(
    arms: tuple[ArmInWorld, ArmInWorld],
    paths: tuple[TimedPath, TimedPath],
    delays: range,
    margin_m: float = MARGIN_M,
) -> Schedule:
    """The shortest schedule of two motions in which the second begins late and nobody waits after that.

    Args:
        arms: The one that begins at once, and the other.
        paths: Their motions, with the same step.
        delays: Steps that the second may wait, >= 0, shortest first.
        margin_m: Distance kept between them [m], >= 0.

    Returns:
        Samples of both; without a solution if no delay keeps the arms apart.

    Raises:
        PlanningError: The margin is negative, or the steps differ.
    """
    step_s = paths[0].step_s
    if not margin_m >= 0 or paths[1].step_s != step_s:
        steps = [path.step_s for path in paths]
        raise PlanningError(f"in_turn: margin_m {margin_m}, steps {steps} s; valid: >= 0, and equal steps")
    first, second = (_moving(arm, path) for arm, path in zip(arms, paths, strict=True))
    n_bodies = first.middle.shape[1], second.middle.shape[1]
    way, at = np.empty((*n_bodies, 3)), np.full((*n_bodies, 2), -1)
    distance = max(float(margin_m), _TOUCH_M)
    delay = _least_delay(first, second, delays.start, delays.stop, distance, way, at, np.empty(SCRATCH))
    if delay < 0:
        return Schedule(status=MotionStatus.NO_SOLUTION, index=np.empty((0, 2), dtype=np.int64), step_s=step_s)
    k, m = len(paths[0].q), len(paths[1].q)
    number = np.arange(max(k, m + delay))
    index = np.stack([np.minimum(number, k - 1), np.clip(number - delay, 0, m - 1)], axis=1)
    return Schedule(status=MotionStatus.SOLVED, index=index, step_s=step_s)


def _moving(arm: ArmInWorld, path: TimedPath) -> _Moving:
    bodies, n = arm.bodies, arm.model.n_joints
    change = np.abs(np.diff(path.q, axis=0))
    # A point leaves the line by an eighth of what joints turn times what they move it, and by what they leave theirs.
    stray = path.bow + np.abs(path.between - 0.5 * (path.q[1:] + path.q[:-1]))
    stray += 0.125 * change.sum(axis=1, keepdims=True) * change
    balls = np.column_stack([bodies.ball, bodies.frame])
    bow = np.zeros((len(path.q), len(balls)))
    bow[:-1] = stray @ arm.body_lever.T
    frames = np.empty((len(path.q), n + 1, 3, 4))
    middle = np.empty((len(path.q), len(balls), 3))
    _place(arm.joints, np.ascontiguousarray(arm.world_from_base[:3]), path.q, balls, frames, middle)
    wide = bow + bodies.ball[:, 3]
    wide[:-1] += np.linalg.norm(np.diff(middle, axis=0), axis=2)
    return _Moving(bodies=bodies, frames=frames, middle=middle, wide=wide, bow=bow + bodies.radius)


@kernel
def _place(
    joints: FloatArray, base: FloatArray, q: FloatArray, balls: FloatArray, frames: FloatArray, middle: FloatArray
) -> None:
    """Fill `frames` (k, n+1, 3, 4) and `middle` (k, b, 3), in the world."""
    own = np.empty((frames.shape[1], 3, 4))
    for k in range(q.shape[0]):
        link_frames_into(joints, q[k], own)
        for f in range(own.shape[0]):
            for a in range(3):
                for b in range(4):
                    entry = base[a, 3] if b == 3 else 0.0
                    for c in range(3):
                        entry += base[a, c] * own[f, c, b]
                    frames[k, f, a, b] = entry
        for s in range(balls.shape[0]):
            f = int(balls[s, 4])
            for a in range(3):
                entry = frames[k, f, a, 3]
                for c in range(3):
                    entry += frames[k, f, a, c] * balls[s, c]
                middle[k, s, a] = entry


@borrowing
def _least_delay(
    one: _Moving,
    other: _Moving,
    first: int,
    end: int,
    margin: float,
    way: FloatArray,
    at: IntArray,
    scratch: FloatArray,
) -> int:
    """Steps that the other arm has to begin late, at least `first` and below `end`; -1 for none.

    What `step_apart` knows of each pair of bodies is kept in `way` (b, b, 3) and `at` (b, b, 2).
    """
    met: Int = np.int64(0)  # as a plain 0 it would be a type of its own, for which all would be compiled once more
    for delay in range(first, end):
        met = _met(one, other, delay, margin, way, at, scratch, met)
        if met < 0:
            return delay
    return -1


@inner_borrowing
def _met(
    one: _Moving,
    other: _Moving,
    delay: int,
    margin: float,
    way: FloatArray,
    at: IntArray,
    scratch: FloatArray,
    guess: Int,
) -> int:
    """A step during which the arms are not apart, looking from a guess onwards; -1 for none."""
    middle, their_middle, wide, their_wide = one.middle, other.middle, one.wide, other.wide
    k, m = middle.shape[0], their_middle.shape[0]
    steps = max(k, m + delay)
    for turn in range(steps):
        step = (guess + turn) % steps
        i, end = min(step, k - 1), min(step + 1, k - 1)
        j, their_end = min(max(step - delay, 0), m - 1), min(max(step + 1 - delay, 0), m - 1)
        for p in range(middle.shape[1]):
            for r in range(their_middle.shape[1]):
                size = wide[i, p] + their_wide[j, r] + margin
                x = middle[i, p, 0] - their_middle[j, r, 0]
                y = middle[i, p, 1] - their_middle[j, r, 1]
                z = middle[i, p, 2] - their_middle[j, r, 2]
                if x * x + y * y + z * z < size * size:
                    f, g = one.bodies.frame[p], other.bodies.frame[r]
                    distance = margin + one.bow[i, p] + other.bow[j, r]
                    mine = ArmStep(one.bodies.hulls, p, one.frames[i, f], one.frames[end, f])
                    theirs = ArmStep(other.bodies.hulls, r, other.frames[j, g], other.frames[their_end, g])
                    if not step_apart(mine, theirs, distance, way[p, r], at[p, r], scratch):
                        return int(step)
    return -1
