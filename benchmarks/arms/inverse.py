"""Inverse kinematics of reachable poses: every one solved, exactly and inside the limits, and how fast."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from benchmarks.arms import workcell
from benchmarks.harness import Row, Trial
from planners.motion.ik import SrsGeometry

N_POSES, QUICK_POSES = 10_000, 500
POSITION_M, TURN_RAD = 1e-3, np.radians(0.6)


def measure_inverse(trial: Trial) -> Iterable[Row]:
    """Poses of random configurations inside the limits, each solved for all branches."""
    spec = workcell.spec()
    srs = SrsGeometry.from_joints(spec.base_from_joint, spec.lower_rad, spec.upper_rad)
    rng = np.random.default_rng(trial.seeds[0])
    q = rng.uniform(srs.lower, srs.upper, (QUICK_POSES if trial.quick else N_POSES, 7))
    poses = [srs.flange(state) for state in q]
    srs.ik_all(poses[0])
    spent_s, found, solved = [], [], 0
    for pose in poses:
        begin_s = time.process_time()
        solutions = srs.ik_all(pose)
        spent_s.append(time.process_time() - begin_s)
        found.append(len(solutions))
        if len(solutions) == 0:
            continue
        solved += 1
        # All of one pose in ten: the error of a closed form does not depend on the branch.
        for solution in solutions if solved % 10 == 0 else solutions[:1]:
            reached = srs.flange(solution)
            apart = float(np.linalg.norm(reached[:3, 3] - pose[:3, 3]))
            turn = np.arccos(np.clip((np.trace(reached[:3, :3].T @ pose[:3, :3]) - 1) / 2, -1, 1))
            trial.check(apart <= POSITION_M and turn <= TURN_RAD, f"iiwa: {apart} m and {turn} rad off the pose")
            trial.check(srs.within_limits(solution), "iiwa: a solution outside the limits")
    yield Row(name=f"iiwa, {len(q):,} poses solved", value=100 * solved / len(q), unit="%", target=">= 100")
    yield Row(name="  all branches of a pose, mean", value=1e6 * float(np.mean(spent_s)), unit="us", target="<= 120")
    yield Row(name="  solutions of a pose, median", value=float(np.median(found)), unit="")
