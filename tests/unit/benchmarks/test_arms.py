"""The benchmark of arms: every group gives its rows, and a wrong answer is told instead of timed."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.arms import GROUPS, camera, checks, free, inverse, plans
from benchmarks.arms.bin_cell import BinCell, Pick
from benchmarks.harness import Trial
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.collision.collision import CollisionChecker
from planners.motion.search.rrt_connect_native import RrtConnectNative


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Trial:
    for module, name, value in (
        (camera, "QUICK_BINS", 1),
        (camera, "N_PARCELS", (2, 2)),
        (checks, "QUICK_STATES", 400),
        (checks, "QUICK_TIMED", 200),
        (checks, "QUICK_USUAL", 50),
        (free, "QUICK_QUERIES", 8),
        (inverse, "QUICK_POSES", 40),
        (plans, "QUICK_PROBLEMS", 3),
        (plans, "QUICK_COMPARED", 1),
        (plans, "QUICK_REFERENCE_S", 0.05),
    ):
        monkeypatch.setattr(module, name, value)
    return Trial(quick=True, seeds=(0,))


@pytest.mark.slow
@pytest.mark.bullet
@pytest.mark.parametrize("group", GROUPS)
def test_a_group_measures_right_answers(trial: Trial, group: str) -> None:
    rows = list(GROUPS[group](trial))
    assert trial.failures == []
    assert len(rows) >= 5
    assert all(np.isfinite(row.value) for row in rows)
    assert all(row.value == 100 for row in rows if row.unit == "%" and "solved" in row.name)


@pytest.mark.bullet
def test_an_unsafe_answer_is_told(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CollisionChecker, "batch", lambda self, q: np.ones(len(q), dtype=np.bool_))
    list(checks.measure_checks(trial))
    assert "called free that collide in the engine" in trial.failures[0]


def test_a_path_that_collides_is_told(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    checker = free.workcell_checker()
    ends = np.random.default_rng(0).uniform(checker.model.lower, checker.model.upper, (40, 7))
    ends = ends[checker.batch(ends)]
    blocked = next(k for k in range(0, len(ends) - 1, 2) if not checker.edge(ends[k], ends[k + 1]))
    result = RrtConnectNative().plan(free.query(checker, ends, blocked))
    through = type(result)(path=ends[blocked : blocked + 2], status=result.status, iterations=0)
    monkeypatch.setattr(RrtConnectNative, "plan", lambda self, problem: through)
    free.run(trial, "native", RrtConnectNative(), checker, ends[blocked : blocked + 2])
    assert trial.failures == ["native: query 0: the path collides"]


def test_a_solution_beside_the_pose_is_told(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = inverse.workcell.spec()
    limits = (arm.base_from_joint, arm.lower_rad, arm.upper_rad)
    monkeypatch.setattr(NumericInverse, "ik_all", lambda self, pose: np.zeros((1, 7)))
    list(inverse.solver_rows(trial, "x", NumericInverse.from_joints(*limits), limits))
    assert "x: pose 0:" in trial.failures[0]


@pytest.mark.slow
def test_paths_that_differ_when_planned_again_are_told(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plans, "_digest", lambda route: str(id(route)))
    list(plans.measure_plans(trial))
    assert [failure.removeprefix("plans: the same seeds gave other paths") for failure in trial.failures] == [
        "",
        " in another process",
    ]


@pytest.mark.bullet
def test_a_parcel_located_elsewhere_is_told(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BinCell, "error", lambda self, box: (0.2, 0.0))
    monkeypatch.setattr(BinCell, "pick", lambda self, box, seed: Pick(picked=False, reason="not tried", sim_s=0.0))
    rows = {row.name.strip(): row.value for row in camera.measure_camera(trial)}
    assert "is located 0.200 m from where it is" in trial.failures[0]
    assert rows["bins emptied"] == 0
    assert trial.notes[0].startswith("camera: attempts that failed: not tried: 6")
