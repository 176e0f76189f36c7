"""Inverse kinematics of reachable poses: every one solved, exactly and inside the limits, and how fast."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pybullet_data

from benchmarks.arms import workcell
from benchmarks.harness import Kind, Row, Trial
from fleet.stations.arms.arm_spheres import cache_dir
from fleet.world.bullet.bench.arm_file import read_arm
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import InverseKinematics, inverse_kinematics
from planners.motion.arm.kinematics import link_frames

FloatArray = npt.NDArray[np.float64]

N_POSES, QUICK_POSES = 10_000, 300
POSITION_M, TURN_RAD = 1e-3, np.radians(0.6)
TARGET_US = "<= 120"
N_CHECKED = 20
"""One pose in so many has all of its solutions checked; the others have the first."""


def measure_inverse(trial: Trial) -> Iterable[Row]:
    """Poses of random configurations inside the limits, for three arms."""
    spec = workcell.spec()
    data = Path(pybullet_data.getDataPath())
    panda = read_arm(data / "franka_panda/panda.urdf", cache_dir=cache_dir()).model
    xarm = read_arm(data / "xarm/xarm6_robot.urdf", cache_dir=cache_dir()).model
    arms = {
        "iiwa": (spec.base_from_joint, spec.lower_rad, spec.upper_rad),
        "Panda": (panda.base_from_joint, panda.lower, panda.upper),
        "xArm 6": (xarm.base_from_joint, xarm.lower, xarm.upper),
    }
    for name, arm in arms.items():
        descent = NumericInverse.from_joints(*arm)
        if name != "xArm 6":
            yield from solver_rows(trial, f"{name}, closed form", inverse_kinematics(*arm), arm)
        yield from solver_rows(trial, f"{name}, descent", descent, arm)


def solver_rows(
    trial: Trial, name: str, inverse: InverseKinematics, arm: tuple[FloatArray, FloatArray, FloatArray]
) -> Iterable[Row]:
    """One solver on one arm: joint transforms (n, 4, 4) and limits (n,), (n,)."""
    base_from_joint, lower, upper = arm
    rng = np.random.default_rng(trial.seeds[0])
    q = rng.uniform(lower, upper, (QUICK_POSES if trial.quick else N_POSES, len(lower)))
    poses = np.ascontiguousarray(link_frames(base_from_joint, q)[:, -1])
    inverse.ik_all(poses[0])  # compiles
    spent_s, found = [], []
    for pose in poses:
        begin_s = time.process_time()
        found.append(inverse.ik_all(pose))
        spent_s.append(time.process_time() - begin_s)
    solved = [k for k, solutions in enumerate(found) if len(solutions)]
    for k in solved:
        some = found[k] if k % N_CHECKED == 0 else found[k][:1]
        reached = link_frames(base_from_joint, some)[:, -1]
        apart = float(np.linalg.norm(reached[:, :3, 3] - poses[k, :3, 3], axis=1).max())
        trace = np.einsum("nij,ij->n", reached[:, :3, :3], poses[k, :3, :3])
        turn = float(np.arccos(np.clip((trace - 1) / 2, -1, 1)).max())
        trial.check(apart <= POSITION_M and turn <= TURN_RAD, f"{name}: pose {k}: {apart} m and {turn} rad off")
        trial.check(bool(np.all((some >= lower) & (some <= upper))), f"{name}: pose {k}: outside the limits")
    yield Row(name=f"{name}: {len(q):,} poses solved", value=100 * len(solved) / len(q), unit="%", target=">= 100")
    yield Row(
        name="  time of a pose, mean", value=1e6 * float(np.mean(spent_s)), unit="us", kind=Kind.TIME, target=TARGET_US
    )
    yield Row(name="  solutions of a pose, median", value=float(np.median([len(s) for s in found])), unit="")
