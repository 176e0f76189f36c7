"""Two arms, one tray: both bring parcels to the tray of one car; who waits for whom is scheduled."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pybullet
from scipy.interpolate import CubicHermiteSpline

from benchmarks.arms.exclusion import least_makespans_s
from benchmarks.harness import Kind, Row, Trial
from fleet.robots import ARMS
from fleet.tabletop.exchange import SharedTray
from planners.motion.path.timed_path import Dwell, TimedPath
from planners.motion.two_arms.schedule import Schedule
from planners.motion.two_arms.together import Way, plan_together

FloatArray = npt.NDArray[np.float64]

N_INSTANCES, N_QUICK_INSTANCES = 200, 10
N_AGAIN = 10
"""Instances that are solved again, in this process and in another."""
REFEREE_S = 0.01
TARGET_MS = 15.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One instance."""

    way: Way
    paths: tuple[TimedPath, ...]
    found: Schedule
    cpu_ms: float
    alone_s: tuple[float, ...]
    """How long each arm takes at least when there is no other [s]."""


class Cell(SharedTray):
    """The arms and their tray, timed."""

    def solve(self, places: Sequence[Sequence[FloatArray]], seed: int) -> Outcome | None:
        """Plan every segment, then the schedule; None if nothing was found."""
        trips = self.trips(places)
        begin = time.process_time()
        both = plan_together(trips, self.planner, seed=seed)
        if both.found is None:
            return None
        cpu_ms = (time.process_time() - begin) * 1e3
        least_s = self.bounds_s(places, both, seed)
        return Outcome(way=both.way, paths=both.paths, found=both.found, cpu_ms=cpu_ms, alone_s=least_s)


class Referee:
    """Plays motions in PyBullet and measures distances there; knows nothing of hulls, samples or diagrams.

    The engine rounds every mesh by 1 mm, so that it finds arms 2 mm nearer than they are.
    """

    def __init__(self, cell: Cell) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "arm.urdf"
            path.write_text(ARMS["iiwa"].text(cell.tool), encoding="utf-8")
            self._arms = [
                pybullet.loadURDF(str(path), base.tolist(), useFixedBase=True, physicsClientId=self._client)
                for base in cell.bases
            ]

    def least_m(self, motions: Sequence[FloatArray], cutoff_m: float = 0.1) -> float:
        """Smallest distance over motions of both arms, each (t, 7), at most `cutoff_m`; negative if they overlap."""
        least = cutoff_m
        for angles in zip(*motions, strict=True):
            for arm, q in zip(self._arms, angles, strict=True):
                pybullet.resetJointStatesMultiDof(arm, list(range(7)), [[x] for x in q], physicsClientId=self._client)
            points = pybullet.getClosestPoints(*self._arms, distance=least, physicsClientId=self._client)
            least = min([least, *(point[8] for point in points)])
        return least

    def close(self) -> None:
        """End the connection."""
        pybullet.disconnect(self._client)


def digests(seed: int, cell: Cell | None = None) -> list[str]:
    """Digests of the first `N_AGAIN` instances' paths and schedules, to be compared across processes."""
    cell = cell or Cell()
    places = [cell.places(np.random.default_rng((seed, number)), 1) for number in range(N_AGAIN)]
    return [_digest(cell.solve(own, number)) for number, own in enumerate(places)]


def measure_pair(trial: Trial) -> Iterable[Row]:
    """Solve instances with one delivery each, and with three, and let the referee judge them."""
    cell, n = Cell(), N_QUICK_INSTANCES if trial.quick else N_INSTANCES
    referee = Referee(cell)
    try:
        yield from _one_each(trial, cell, referee, n)
        yield from _three_each(trial, cell, referee, max(5, n // 10))
    finally:
        referee.close()


def _one_each(trial: Trial, cell: Cell, referee: Referee, n: int) -> Iterator[Row]:
    instances = [(seed, cell.places(np.random.default_rng((trial.seeds[0], seed)), 1)) for seed in range(n)]
    cell.solve(instances[0][1], 0)  # compiles
    outcomes = [cell.solve(places, seed) for seed, places in instances]
    solved = [outcome for outcome in outcomes if outcome is not None]
    distances = [referee.least_m(_played(outcome)) for outcome in solved]
    for distance_m in distances:
        trial.check(distance_m > 0.0, f"pair: arms overlap by {-distance_m * 1e3:.1f} mm in a schedule")
    blind = sum(referee.least_m(_unscheduled(outcome)) <= 0.0 for outcome in solved)
    first = [_digest(outcome) for outcome in outcomes[:N_AGAIN]]
    trial.check(digests(trial.seeds[0], cell) == first, "pair: schedules differ when solved again")
    command = f"from benchmarks.arms.pair import digests; print(*digests({trial.seeds[0]}))"
    other = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    trial.check(other.stdout.split() == first, "pair: schedules differ in another process")
    makespan_s = np.array([outcome.found.makespan_s for outcome in solved])
    ratio = makespan_s / [max(outcome.alone_s) for outcome in solved]
    bounds_s = np.array([least_makespans_s(cell.trips(places)) for _, places in instances])
    turns = np.array([outcome.found.makespan_s / sum(outcome.alone_s) for outcome in solved])
    cpu_ms = np.array([outcome.cpu_ms for outcome in solved])
    composite = sum(outcome.way is Way.COMPOSITE for outcome in solved)
    trial.notes.append(f"Two arms, one tray: {composite} of {n} instances needed a composite plan.")
    yield Row(
        name="two arms, one tray: solved and collision-free", value=100 * len(solved) / n, unit="%", target=">= 100"
    )
    yield Row(name="... without a schedule they collide in", value=100 * blind / n, unit="%")
    yield Row(name="... least distance by PyBullet's meshes", value=min(distances) * 1e3, unit="mm", target=">= 0")
    yield Row(
        name="... makespan over collision-blind bound, median", value=float(np.median(ratio)), unit="", target="<= 1.1"
    )
    yield Row(name="... the same, 95th percentile", value=float(np.percentile(ratio, 95)), unit="")
    yield Row(
        name="... lower bound that knows of both arms over the blind one, median",
        value=float(np.median(bounds_s[:, 1] / bounds_s[:, 0])),
        unit="",
    )
    yield Row(name="... makespan, median", value=float(np.median(makespan_s)), unit="s", kind=Kind.PLAIN)
    yield Row(name="... makespan over taking turns, median", value=float(np.median(turns)), unit="")
    yield Row(
        name="... plan and schedule, median",
        value=float(np.median(cpu_ms)),
        unit="ms CPU",
        kind=Kind.TIME,
        target=f"<= {TARGET_MS:g}",
    )
    yield Row(
        name="... the same, 95th percentile", value=float(np.percentile(cpu_ms, 95)), unit="ms CPU", kind=Kind.TIME
    )


def _three_each(trial: Trial, cell: Cell, referee: Referee, n: int) -> Iterator[Row]:
    ratios = []
    for seed in range(n):
        outcome = cell.solve(cell.places(np.random.default_rng((trial.seeds[0], 1, seed)), 3), seed)
        trial.check(outcome is not None, f"pair: three deliveries each, seed {seed}: no schedule")
        if outcome is not None:
            distance_m = referee.least_m(_played(outcome))
            trial.check(distance_m > 0.0, f"pair: three deliveries each, seed {seed}: arms overlap")
            ratios.append(outcome.found.makespan_s / max(outcome.alone_s))
    yield Row(
        name="three parcels each: makespan over blind bound, median",
        value=float(np.median(ratios)) if ratios else np.nan,
        unit="",
        target="<= 1.1",
    )


def _played(outcome: Outcome) -> list[FloatArray]:
    """Both motions as scheduled, densely, each (t, 7)."""
    times = np.arange(0.0, outcome.found.makespan_s + REFEREE_S, REFEREE_S)
    return [
        _densely(path, np.array([outcome.found.along_s(arm, float(t)) for t in times]))
        for arm, path in enumerate(outcome.paths)
    ]


def _unscheduled(outcome: Outcome) -> list[FloatArray]:
    """Both motions when nobody waits."""
    times = np.arange(0.0, max(path.duration_s for path in outcome.paths) + REFEREE_S, REFEREE_S)
    return [_densely(path, times) for path in outcome.paths]


def _densely(path: TimedPath, along_s: FloatArray) -> FloatArray:
    """Configurations at times of an arm's own motion, interpolated by SciPy, shape (t, 7)."""
    out = np.empty((len(along_s), 7))
    begin_s, rest = 0.0, np.zeros(7)
    for segment in path.segments:
        steps_s = np.ceil((segment.duration_s / path.step_s) - 1e-9) * path.step_s
        now = along_s >= begin_s - 1e-9
        if isinstance(segment, Dwell):
            out[now] = rest
        else:
            rest = segment.q[-1]
            out[now] = CubicHermiteSpline(segment.t, segment.q, segment.qd)(
                np.clip(along_s[now] - begin_s, 0.0, segment.duration_s)
            )
        begin_s += steps_s
    return out


def _digest(outcome: Outcome | None) -> str:
    if outcome is None:
        return ""
    parts = [outcome.found.index.tobytes(), *(path.q.tobytes() for path in outcome.paths)]
    return hashlib.sha256(b"".join(parts)).hexdigest()
