"""Findings: what the rows of a study say: curves with intervals, differences, the knee, the bottleneck."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.charts.statistics import Estimate, estimate, paired
from fleet.insight.metrics import BUSY
from fleet.study.knee import find_knee
from fleet.study.table import Row

DEMAND_MET = 0.97
"""Share of the released orders that must be delivered for the orders, not the site, to set the throughput; from 1 is
missing what is under way at the end of a run."""

SPARE = 0.1
"""Share of their time that cars have nothing to do, although orders are open, from which more cars would be no help."""

NOTHING = "none"
"""Name of the bottleneck where there is none."""

Figure = Callable[[Row], float | None]


@dataclass(frozen=True, kw_only=True)
class Bottleneck:
    """What limits a fleet."""

    name: str
    """A station, `cars`, `traffic` or `orders`; `NOTHING` where no station has enough to do to be one."""
    share: float
    """Share of the time it is in use; of `traffic`, share of the cars' time lost in it; of `orders`, share done; of
    `NOTHING`, share of the time in which the busiest station works."""
    contended_share: float = 0.0
    """Of a station: share of the time in which it is, and cars wait for it."""
    idle_share: float = 0.0
    """Share of the cars' time in which they have nothing to do although orders are open; 0 below `SPARE`."""
    busiest: str = ""
    """Of `NOTHING`: the busiest station."""

    @property
    def brief(self) -> str:
        """What a narrow column has room for."""
        return self.name if self.name == NOTHING else f"{self.name} {100.0 * self.share:.0f} %"

    def __str__(self) -> str:
        if self.name == "orders":
            return f"orders ({100.0 * self.share:.0f} % of them delivered)"
        if self.name == "traffic":
            return f"traffic (cars stand in it {100.0 * self.share:.0f} % of their time)"
        name = f"{NOTHING}, the busiest station is {self.busiest}" if self.name == NOTHING else self.name
        said = f"{name} (at work {100.0 * self.share:.0f} % of the time"
        if self.name != "cars":
            said += f", cars waiting for it {100.0 * self.contended_share:.0f} %"
        if self.idle_share:
            said += f"; cars are idle {100.0 * self.idle_share:.0f} % of their time"
        return f"{said})"


@dataclass(frozen=True, kw_only=True)
class Bound:
    """What could be delivered at most."""

    name: str
    """`cars`, `arms`, `lanes` or `orders`: what binds."""
    per_h: float
    """Deliveries an hour, mean over seeds."""
    share: float
    """Part of it that was delivered."""

    def __str__(self) -> str:
        return f"{self.per_h:.0f} ({self.name}), {100.0 * self.share:.0f} % of it"


@dataclass(frozen=True, kw_only=True)
class Point:
    """One fleet size of one allocator, over all seeds."""

    allocator: str
    robots: int
    throughput_per_h: Estimate
    lateness_s: Estimate | None
    """Tardiness, or task time where orders have no due dates [s]; None when nothing was delivered."""
    waiting_share: Estimate
    """Share of the cars' time in which they stood in traffic or queued for a station."""
    on_time_share: Estimate | None
    step_per_h: float
    """What one delivery more or less makes of the throughput."""
    gain_per_h: Estimate | None
    """Throughput less that of the reference allocator, on the same seeds; None for the reference itself."""
    bottleneck: Bottleneck
    bound: Bound | None
    """The least of the bounds; None if nothing was delivered."""
    n_open: float
    """Orders that were open at the end, mean over seeds."""
    n_stalled: int
    """Runs that came to a stand."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One allocator over all fleet sizes."""

    allocator: str
    points: tuple[Point, ...]
    """Ascending in fleet size."""
    knee: int | None
    """Fleet size from which more cars bring clearly less; None if there is none in the range."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a study found."""

    curves: tuple[Curve, ...]
    """In the order in which the allocators were named."""
    has_due_dates: bool
    """Whether `Point.lateness_s` is tardiness; else it is task time."""


def find(rows: Sequence[Row], allocators: Sequence[str]) -> Findings:
    """Draw the conclusions from rows.

    Args:
        rows: In any order; variants may be missing, as after an interrupt.
        allocators: In order; the first one is the reference.
    """
    has_due_dates = any(row.tardiness_s is not None for row in rows)
    curves = []
    for allocator in allocators:
        mine = [row for row in rows if row.allocator == allocator]
        points = tuple(
            _point(
                sorted((row for row in mine if row.robots == robots), key=lambda row: row.seed),
                {row.seed: row for row in rows if row.allocator == allocators[0] and row.robots == robots},
                has_due_dates,
            )
            for robots in sorted({row.robots for row in mine})
        )
        if points:
            knee = find_knee([p.robots for p in points], [p.throughput_per_h.mean for p in points])
            curves.append(Curve(allocator=allocator, points=points, knee=None if knee is None else points[knee].robots))
    return Findings(curves=tuple(curves), has_due_dates=has_due_dates)


def bottleneck(rows: Sequence[Row]) -> Bottleneck:
    """What is in use for the greatest share of the time, mean over the rows of one variant.

    Orders limit a fleet that delivers them as they come. Else the candidates are every station's arm, the cars
    (driving, being served or visiting) unless they are idle for a good part of it, and traffic, by the share of their
    time that cars lose in it. A station that works less than `BUSY` of the time is none, here as in a run's result.

    Source: the bottleneck is the device of greatest utilisation: P. J. Denning, J. P. Buzen, "The Operational Analysis
    of Queueing Network Models", ACM Computing Surveys 10(3), 1978.
    """
    released = sum(row.released for row in rows)
    done = sum(row.done for row in rows)
    if released and done >= DEMAND_MET * released:
        return Bottleneck(name="orders", share=done / released)
    idle = float(np.mean([row.idle for row in rows]))
    stations = {
        name: np.mean([row.station_shares[name] for row in rows], axis=0).tolist() for name in rows[0].station_shares
    }
    shares = {name: busy for name, (busy, _) in stations.items()}
    shares["traffic"] = float(np.mean([row.traffic + row.plan_late for row in rows]))
    if idle < SPARE:
        used = [row.driving_loaded + row.driving_empty + row.served + row.visiting for row in rows]
        shares["cars"] = float(np.mean(used))
    name = max(shares, key=lambda key: shares[key])
    spare = name in stations and shares[name] < BUSY
    return Bottleneck(
        name=NOTHING if spare else name,
        share=shares[name],
        contended_share=stations[name][1] if name in stations else 0.0,
        idle_share=idle if idle >= SPARE else 0.0,
        busiest=name if spare else "",
    )


def least_bound(rows: Sequence[Row]) -> Bound | None:
    """What binds in the rows of one variant: the least of the bounds that all of them know, each as a mean."""
    known = [row.bounds_per_h for row in rows]
    shared = [name for name in known[0] if all(name in bounds for bounds in known)]
    per_h = {name: float(np.mean([bounds[name] for bounds in known])) for name in shared}
    if not per_h:
        return None
    name = min(per_h, key=lambda key: per_h[key])
    delivered = float(np.mean([row.throughput_per_h for row in rows]))
    return Bound(name=name, per_h=per_h[name], share=delivered / per_h[name])


def _point(rows: list[Row], reference: dict[int, Row], has_due_dates: bool) -> Point:
    """`rows` are those of one variant, at least one; `reference` those of the reference of that size by seed."""
    is_reference = rows[0] == reference.get(rows[0].seed)
    both = [row for row in rows if row.seed in reference]
    step_per_h = max(row.step_per_h for row in rows)
    gain = paired(
        [r.throughput_per_h for r in both], [reference[r.seed].throughput_per_h for r in both], step=step_per_h
    )
    return Point(
        allocator=rows[0].allocator,
        robots=rows[0].robots,
        throughput_per_h=_known(rows, lambda row: row.throughput_per_h),
        lateness_s=_mean(rows, (lambda row: row.tardiness_s) if has_due_dates else (lambda row: row.task_time_s)),
        waiting_share=_known(rows, lambda row: row.traffic + row.plan_late + row.queue),
        on_time_share=_mean(rows, lambda row: row.on_time_share),
        step_per_h=step_per_h,
        gain_per_h=None if is_reference else gain,
        bottleneck=bottleneck(rows),
        bound=least_bound(rows),
        n_open=float(np.mean([row.released - row.done - row.failed for row in rows])),
        n_stalled=sum(row.stalled for row in rows),
    )


def _mean(rows: Sequence[Row], figure: Figure) -> Estimate | None:
    return estimate([value for value in map(figure, rows) if value is not None])


def _known(rows: Sequence[Row], figure: Callable[[Row], float]) -> Estimate:
    found = estimate([figure(row) for row in rows])
    if found is None:
        raise ValueError("a point of a curve without rows")
    return found
