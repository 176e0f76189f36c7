"""Camera picking: bins of scattered parcels are emptied by an arm that knows only what the camera sees."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.arms.bin_cell import FLOOR_Z_M, BinCell
from benchmarks.harness import Kind, Row, Trial
from fleet.sensors.boxes import LocateStatus, locate_boxes

N_BINS, QUICK_BINS = 100, 2
N_PARCELS = (4, 7)
"""Fewest and most parcels of a bin."""
N_TRIES = 3
"""A parcel whose pick failed so often is left to the tally of what was not picked."""
WRONG_M = 0.05
"""A located parcel that is not even this near is a wrong answer, not an inexact one [m]."""


@dataclass
class _Tally:
    """What is counted over all bins."""

    parcels: int = 0
    located: int = 0
    picked: int = 0
    first_try: int = 0
    bins_empty: int = 0
    leaning: int = 0
    errors_m: list[float] = field(default_factory=list)
    turns_rad: list[float] = field(default_factory=list)
    render_s: list[float] = field(default_factory=list)
    locate_s: list[float] = field(default_factory=list)
    pick_s: list[float] = field(default_factory=list)
    reasons: Counter[str] = field(default_factory=Counter)


def measure_camera(trial: Trial) -> Iterable[Row]:
    """Fill a bin, then look, locate, pick the best and look again until nothing is left that can be picked."""
    n_bins = QUICK_BINS if trial.quick else N_BINS
    cell, tally = BinCell(), _Tally()
    try:
        for rng in np.random.default_rng(trial.seeds[0]).spawn(n_bins):
            _empty(trial, cell, rng, tally)
    finally:
        cell.close()
    if tally.reasons:
        found = ", ".join(f"{reason}: {n}" for reason, n in tally.reasons.most_common())
        trial.notes.append(f"camera: attempts that failed: {found}")
    errors_mm, turns_deg = 1e3 * np.array(tally.errors_m), np.degrees(tally.turns_rad)
    yield Row(
        name=f"camera: {tally.parcels} parcels in {n_bins} bins, located",
        value=100 * tally.located / tally.parcels,
        unit="%",
        target=">= 95",
    )
    yield Row(
        name="  picked",
        value=100 * tally.picked / tally.parcels,
        unit="%",
        target=">= 95",
    )
    yield Row(name="  picked at the first try", value=100 * tally.first_try / tally.parcels, unit="%")
    yield Row(name="  bins emptied", value=100 * tally.bins_empty / n_bins, unit="%")
    yield Row(name="  parcels that leaned by 3 deg or more", value=100 * tally.leaning / len(errors_mm), unit="%")
    yield Row(name="  pose error, median", value=float(np.median(errors_mm)), unit="mm", target="<= 5")
    yield Row(name="  pose error, 95th percentile", value=float(np.percentile(errors_mm, 95)), unit="mm")
    yield Row(name="  pose error, most", value=float(errors_mm.max()), unit="mm")
    yield Row(name="  yaw error, median", value=float(np.median(turns_deg)), unit="deg")
    yield Row(name="  yaw error, most", value=float(turns_deg.max()), unit="deg")
    yield Row(
        name="  time to render an image, mean", value=1e3 * float(np.mean(tally.render_s)), unit="ms", kind=Kind.TIME
    )
    yield Row(
        name="  time to locate all its parcels, mean",
        value=1e3 * float(np.mean(tally.locate_s)),
        unit="ms",
        kind=Kind.TIME,
    )
    yield Row(
        name="  pick and place, simulated, mean",
        value=float(np.mean(tally.pick_s or [np.nan])),
        unit="s",
        kind=Kind.PLAIN,
    )


def _empty(trial: Trial, cell: BinCell, rng: np.random.Generator, tally: _Tally) -> None:
    """One bin, until it is empty or nothing in it can be picked any more."""
    n = int(rng.integers(*N_PARCELS, endpoint=True))
    cell.fill(rng, n)
    inside = set(cell.in_bin())
    tally.parcels += len(inside)
    tries: Counter[int] = Counter()
    located: set[int] = set()
    while True:
        begin_s = time.process_time()
        image = cell.look()
        looked_s = time.process_time()
        search = locate_boxes(cell.camera, image.depth_m, image.parcel, support_z_m=FLOOR_Z_M)
        tally.render_s.append(looked_s - begin_s)
        tally.locate_s.append(time.process_time() - looked_s)
        located.update(box.label for box in search.boxes if not box.obstructed)
        wanted = [box for box in search.boxes if not box.obstructed and tries[box.label] < N_TRIES]
        if not wanted:
            if search.status is not LocateStatus.NOTHING_SEEN:
                tally.reasons[f"nothing left to pick ({search.status.value})"] += 1
            break
        box = min(wanted, key=lambda box: tries[box.label])
        apart_m, turn_rad = cell.error(box)
        trial.check(apart_m < WRONG_M, f"camera: parcel {box.label} is located {apart_m:.3f} m from where it is")
        tally.errors_m.append(apart_m)
        tally.turns_rad.append(turn_rad)
        tally.leaning += box.tilt_rad >= math.radians(3.0)
        pick = cell.pick(box, seed=int(rng.integers(1 << 31)))
        tries[box.label] += 1
        if pick.picked:
            tally.picked += 1
            tally.first_try += tries[box.label] == 1
            tally.pick_s.append(pick.sim_s)
        else:
            tally.reasons[pick.reason] += 1
    tally.located += len(located & inside)
    tally.bins_empty += not cell.in_bin()
