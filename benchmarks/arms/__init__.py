"""Benchmark of arms: checks, inverse kinematics and plans against the usual way in PyBullet; grasps and cameras.

A group is a function from a `Trial` to rows; it checks every answer before it counts a time. A new group is one file
here and one line in `GROUPS`. Times are CPU time of one process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.arms.camera import measure_camera
from benchmarks.arms.checks import measure_checks
from benchmarks.arms.free import measure_free
from benchmarks.arms.grasp import measure_grasp
from benchmarks.arms.inverse import measure_inverse
from benchmarks.arms.pair import measure_pair
from benchmarks.arms.plans import measure_plans
from benchmarks.harness import Row, Trial, grouped

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "plans": measure_plans,
    "collision": measure_checks,
    "ik": measure_inverse,
    "free": measure_free,
    "pair": measure_pair,
    "grasp": measure_grasp,
    "camera": measure_camera,
}


BENCHMARK = grouped(
    GROUPS,
    name="arms",
    summary="arms: collision checks, inverse kinematics, plans, grasps and picking by camera",
    seeds=(0,),
    quick_seeds=(0,),
)
