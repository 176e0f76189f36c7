"""One collision check from Python and in a batch: its time, its caution, and that it is never unsafe."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from benchmarks.arms import workcell
from benchmarks.arms.engine import Engine
from benchmarks.harness import Kind, Row, Trial
from planners.motion.collision.collision import CollisionChecker

N_STATES, QUICK_STATES = 100_000, 2_000
N_TIMED, QUICK_TIMED = 20_000, 2_000
N_USUAL, QUICK_USUAL = 4_000, 300
EDGE_RAD = 0.4
"""Length of a timed edge in joint space."""


def measure_checks(trial: Trial) -> Iterable[Row]:
    """Random states of the workcell, without a margin, against the engine's hulls of the arm's meshes."""
    model = workcell.model()
    checker = CollisionChecker(model, workcell.boxes(), margin=0.0)
    rng = np.random.default_rng(trial.seeds[0])
    q = rng.uniform(model.lower, model.upper, (QUICK_STATES if trial.quick else N_STATES, model.n_joints))
    ours = checker.batch(q)
    engine = Engine()
    begin_s = time.process_time()
    n_usual = QUICK_USUAL if trial.quick else N_USUAL
    usual = np.array([engine.free(state) for state in q[:n_usual]])
    usual_us = 1e6 * (time.process_time() - begin_s) / n_usual
    theirs = np.concatenate([usual, np.array([engine.free(state) for state in q[n_usual:]], dtype=np.bool_)])
    unsafe = np.flatnonzero(ours & ~theirs)
    first = f"; first: state {unsafe[0]}, {sorted(engine.touching(q[unsafe[0]]))}" if len(unsafe) else ""
    engine.close()
    trial.check(len(unsafe) == 0, f"{len(unsafe)} of {len(q)} states called free that collide in the engine{first}")
    one_us, batch_us, free_us, edge_us = _times(checker, q[: QUICK_TIMED if trial.quick else N_TIMED])
    yield Row(name="one check from Python", value=one_us, unit="us", kind=Kind.TIME, target="<= 2.5")
    yield Row(name="  in a batch", value=batch_us, unit="us", kind=Kind.TIME, target="<= 1")
    yield Row(name="  in a batch of free states", value=free_us, unit="us", kind=Kind.TIME)
    yield Row(name=f"  an edge of {EDGE_RAD:g} rad", value=edge_us, unit="us", kind=Kind.TIME)
    yield Row(name="the usual way in PyBullet", value=usual_us, unit="us", kind=Kind.TIME)
    yield Row(name="  over ours", value=usual_us / one_us, unit="x")
    yield Row(name=f"unsafe answers of {len(q):,}", value=len(unsafe), unit="", target="<= 0")
    refused = 100 * float((~ours & theirs).sum()) / max(1, int(theirs.sum()))
    yield Row(name=f"refused of {int(theirs.sum()):,} free states", value=refused, unit="%", target="<= 6")


def _times(checker: CollisionChecker, q: np.ndarray) -> tuple[float, float, float, float]:
    """One call, batch, batch of free states, edge [us]; CPU time."""

    def mean_us(call, n: int) -> float:  # type: ignore[no-untyped-def]
        best = np.inf
        for _ in range(3):
            begin_s = time.process_time()
            call()
            best = min(best, time.process_time() - begin_s)
        return 1e6 * float(best) / n

    free = q[checker.batch(q)]
    step = np.random.default_rng(0).normal(size=free.shape)
    ends = np.clip(
        free + EDGE_RAD * step / np.linalg.norm(step, axis=1, keepdims=True), checker.model.lower, checker.model.upper
    )
    checker.free(q[0])
    checker.edge(free[0], ends[0])
    return (
        mean_us(lambda: [checker.free(state) for state in q], len(q)),
        mean_us(lambda: checker.batch(q), len(q)),
        mean_us(lambda: checker.batch(free), len(free)),
        mean_us(lambda: [checker.edge(a, b) for a, b in zip(free, ends, strict=True)], len(free)),
    )
