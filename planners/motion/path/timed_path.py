"""TimedPath: what an arm does over time, cut into equal steps, with bounds on what it does between the samples."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import BoolArray, FloatArray
from planners.motion.kernel import inlined, kernel
from planners.motion.path.trajectory import MOST_SAMPLES, Trajectory

_SAME_RAD = 1e-6  # segments that join end and start at the same configuration


@dataclass(frozen=True, kw_only=True)
class Dwell:
    """An arm that rests for a while, such as to grip."""

    duration_s: float
    """How long [s], >= 0."""

    def __post_init__(self) -> None:
        checks.positive("Dwell: duration_s", self.duration_s, zero=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedPath:
    """One arm's motion, sampled at multiples of `step_s`."""

    step_s: float
    q: FloatArray
    """Joint angles at the samples [rad], shape (k, n)."""
    between: FloatArray
    """Joint angles half-way between neighbouring samples [rad], shape (k-1, n)."""
    bow: FloatArray
    """No joint is farther than this from the straight lines over samples and what is between [rad], shape (k-1, n)."""
    rests: BoolArray
    """Samples at which the arm stands still, so that it may wait there for as long as it likes, shape (k,)."""
    segments: tuple[Trajectory | Dwell, ...]
    """What it was made of."""
    starts: tuple[int, ...]
    """Sample at which each segment begins."""

    @property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return (len(self.q) - 1) * self.step_s

    def at(self, along_s: float) -> FloatArray:
        """Configuration when `along_s` of the motion is done [s], shape (n,)."""
        return self.state(along_s)[0]

    def state(self, along_s: float) -> tuple[FloatArray, FloatArray]:
        """Configuration [rad] and velocity [rad/s] when `along_s` of the motion is done [s], each shape (n,)."""
        number = max(0, bisect_right(self.starts, along_s / self.step_s + 1e-9) - 1)
        segment, start = self.segments[number], self.starts[number]
        if isinstance(segment, Dwell):
            return self.q[start].copy(), np.zeros(self.q.shape[1])
        return segment.sample(along_s - start * self.step_s)


def timed_path(segments: Sequence[Trajectory | Dwell], step_s: float) -> TimedPath:
    """Cut motions and rests that follow each other into equal steps.

    Every segment takes a whole number of steps: the arm rests for the remainder of its last one. Between its samples a
    trajectory is a cubic in each joint, which stays between its four Bezier points; that bounds how far the arm is from
    straight lines over half steps, whatever lies between them (Farin, Curves and Surfaces for CAGD, 2002, convex hull
    property).

    Args:
        segments: Motions from rest to rest and rests between them, at least one motion.
        step_s: Length of a step [s], > 0.

    Raises:
        PlanningError: Malformed input, or a segment does not start where the one before ends.
    """
    motions = [segment for segment in segments if isinstance(segment, Trajectory)]
    step_s = checks.positive("timed_path: step_s", step_s)
    others = [segment for segment in segments if not isinstance(segment, Trajectory | Dwell)]
    if not motions or others:
        raise PlanningError(f"timed_path: {len(motions)} motions, {others[:1]}; valid: motions, at least 1, and rests")
    if not all(np.isfinite(segment.q).all() and np.isfinite(segment.qd).all() for segment in motions):
        raise PlanningError("timed_path: a motion that is not finite")
    lasts_s = sum(segment.duration_s for segment in segments)
    if not lasts_s / step_s < MOST_SAMPLES:
        raise PlanningError(f"timed_path: {lasts_s} s in steps of {step_s} s; valid: at most {MOST_SAMPLES} samples")
    here = motions[0].q[0]
    q, rests = [here[None]], [np.array([True])]
    between: list[FloatArray] = []
    bow: list[FloatArray] = []
    starts, count = [], 1
    for number, segment in enumerate(segments):
        starts.append(count - 1)
        if isinstance(segment, Dwell):
            steps = int(np.ceil(segment.duration_s / step_s - 1e-9))
            q.append(np.repeat(here[None], steps, axis=0))
            between.append(q[-1])
            bow.append(np.zeros((steps, len(here))))
            rests.append(np.ones(steps, dtype=np.bool_))
        else:
            if segment.q.shape[1] != len(here) or np.abs(segment.q[0] - here).max() > _SAME_RAD:
                raise PlanningError(
                    f"timed_path: segment {number} starts at {segment.q[0]}, the one before ends at {here}"
                )
            steps = int(np.ceil(segment.duration_s / step_s - 1e-9))
            halves, bows = np.empty((2 * steps + 1, len(here))), np.zeros((steps, len(here)))
            _sample_halves(
                segment.t[-1] / max(1, len(segment.t) - 1), segment.q, segment.qd, 0.5 * step_s, halves, bows
            )
            q.append(halves[2::2])
            between.append(halves[1::2])
            bow.append(bows)
            rests.append(np.arange(1, steps + 1) == steps)
            here = segment.q[-1]
        count += steps
    return TimedPath(
        step_s=float(step_s),
        q=np.concatenate(q),
        between=np.concatenate(between),
        bow=np.concatenate(bow),
        rests=np.concatenate(rests),
        segments=tuple(segments),
        starts=tuple(starts),
    )


def samples_of(
    segment: Trajectory, step_s: float, *, begin_s: float = 0.0, pace: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Sample what is left of a trajectory.

    Args:
        segment: From rest to rest.
        step_s: Time between samples [s], > 0.
        begin_s: How much of it is done at the first sample [s].
        pace: How fast it is played, 1 for as planned, > 0.

    Returns:
        Joint angles, the last sample at the end [rad], shape (k, n), and bounds on how far each joint is from them
        during the half steps before and after [rad], shape (k, n).
    """
    if len(segment.t) == 1:
        return segment.q.copy(), np.zeros_like(segment.q)
    fine_s = float(segment.t[1] - segment.t[0])
    steps = max(1, int(np.ceil((segment.duration_s - begin_s) / (step_s * pace) - 1e-9)))
    q = np.empty((steps + 1, segment.q.shape[1]))
    stray = np.empty_like(q)
    _sample_all(segment.q, segment.qd, fine_s, float(begin_s), step_s * pace, q, stray)
    q[-1] = segment.q[-1]
    return q, stray


@kernel
def _sample_all(
    fine_q: FloatArray,
    fine_qd: FloatArray,
    fine_s: float,
    begin_s: float,
    step_s: float,
    q: FloatArray,
    stray: FloatArray,
) -> None:
    """Fill `q` and `stray` (k, n) from samples (m, n) that are `fine_s` apart."""
    last = fine_q.shape[0] - 2
    for k in range(q.shape[0]):
        time = begin_s + k * step_s
        at = min(int(time / fine_s + 1e-9), last)
        u = min(1.0, time / fine_s - at)
        begin = max(0, min(int(np.floor((time - step_s / 2) / fine_s + 1e-9)), last))
        end = max(begin, min(int(np.ceil((time + step_s / 2) / fine_s - 1e-9)) - 1, last))
        for j in range(q.shape[1]):
            rise = fine_q[at + 1, j] - fine_q[at, j]
            m0 = fine_s * fine_qd[at, j]
            m1 = fine_s * fine_qd[at + 1, j]
            q[k, j] = fine_q[at, j] + u * (m0 + u * (3.0 * rise - 2.0 * m0 - m1 + u * (m0 + m1 - 2.0 * rise)))
            low = q[k, j]
            high = q[k, j]
            for f in range(begin, end + 1):
                b1 = fine_q[f, j] + fine_s * fine_qd[f, j] / 3.0
                b2 = fine_q[f + 1, j] - fine_s * fine_qd[f + 1, j] / 3.0
                low = min(low, fine_q[f, j], b1, b2, fine_q[f + 1, j])
                high = max(high, fine_q[f, j], b1, b2, fine_q[f + 1, j])
            stray[k, j] = max(high - q[k, j], q[k, j] - low)


@kernel
def _sample_halves(
    fine_s: float, fine_q: FloatArray, fine_qd: FloatArray, half_s: float, q: FloatArray, bow: FloatArray
) -> None:
    """Fill `q` (2k+1, n) with samples every half step and `bow` (k, n) with how far the curve is from lines over them.

    Each fine piece that a half step touches is cut to it; the Bezier points of what is left are compared with the line.
    """
    last = fine_q.shape[0] - 1
    for k in range(q.shape[0]):
        for j in range(q.shape[1]):
            if k * half_s >= last * fine_s - 1e-9:
                q[k, j] = fine_q[last, j]
            else:
                at = int(k * half_s / fine_s + 1e-9)
                u = k * half_s / fine_s - at
                q[k, j] = _blossom(fine_s, fine_q, fine_qd, at, j, u, u, u)
    for k in range(q.shape[0] - 1):
        first = int(k * half_s / fine_s + 1e-9)
        end = int(np.ceil((k + 1) * half_s / fine_s - 1e-9))
        for at in range(first, min(end, last)):
            u = max(0.0, k * half_s / fine_s - at)
            v = min(1.0, (k + 1) * half_s / fine_s - at)
            for j in range(q.shape[1]):
                for point in range(4):
                    time = (at + u + (v - u) * point / 3.0) * fine_s / half_s - k
                    line = q[k, j] + (q[k + 1, j] - q[k, j]) * time
                    x = (u, u, u, v)[point]
                    y = (u, u, v, v)[point]
                    z = (u, v, v, v)[point]
                    away = abs(_blossom(fine_s, fine_q, fine_qd, at, j, x, y, z) - line)
                    bow[k // 2, j] = max(bow[k // 2, j], away)


@inlined
def _blossom(
    fine_s: float, fine_q: FloatArray, fine_qd: FloatArray, at: int, j: int, x: float, y: float, z: float
) -> float:
    """Bezier points of parts of a piece: (u, u, u), (u, u, v), (u, v, v), (v, v, v) are those from u to v."""
    rise = fine_q[at + 1, j] - fine_q[at, j]
    m0 = fine_s * fine_qd[at, j]
    m1 = fine_s * fine_qd[at + 1, j]
    c2 = 3.0 * rise - 2.0 * m0 - m1
    c3 = m0 + m1 - 2.0 * rise
    angle: float = fine_q[at, j] + m0 * (x + y + z) / 3.0 + c2 * (x * y + y * z + z * x) / 3.0 + c3 * x * y * z
    return angle
