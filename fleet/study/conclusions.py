"""Conclusions: the findings of a study as a person would say them."""

from __future__ import annotations

import math

from fleet.charts.statistics import Estimate
from fleet.study.findings import Curve, Findings

LEAST_SEEDS = 3
"""With fewer an interval is too wide to tell anything, or narrow by chance."""


def between(value: Estimate | None, *, scale: float = 1.0, sign: bool = False) -> str:
    """A mean and half its interval, such as ``612 ± 14``; a dash for nothing."""
    if value is None:
        return "-"
    mean, half = scale * value.mean, scale * value.half_width
    digits = 0 if abs(mean) >= 100 else 1
    said = f"{mean:+.{digits}f}" if sign else f"{mean:.{digits}f}"
    return f"{said} ± {half:.{digits}f}" if math.isfinite(half) else said


def sentences(findings: Findings) -> list[str]:
    """Knee, best size and bottleneck of each allocator, then what each one gains on the first."""
    said = [sentence for curve in findings.curves for sentence in _curve(curve)]
    if len(findings.curves) > 1:
        step_per_h = max(point.step_per_h for curve in findings.curves for point in curve.points)
        said.append(f"One delivery more or less in a run is {step_per_h:.1f} an hour.")
    for curve in findings.curves[1:]:
        n_seeds = min((point.gain_per_h.n for point in curve.points if point.gain_per_h is not None), default=0)
        if n_seeds < LEAST_SEEDS:
            said.append(
                f"Whether {curve.allocator} delivers better than {findings.curves[0].allocator} cannot be told from "
                f"{n_seeds} seed{'s' if n_seeds != 1 else ''}; take {LEAST_SEEDS} or more."
            )
            continue
        surer = [point for point in curve.points if point.gain_per_h is not None and point.gain_per_h.low > 0]
        worse = [point for point in curve.points if point.gain_per_h is not None and point.gain_per_h.high < 0]
        first = findings.curves[0].allocator
        if surer or worse:
            for points, word in ((surer, "better"), (worse, "worse")):
                if points:
                    sizes = ", ".join(str(point.robots) for point in points)
                    cars = "car" if sizes == "1" else "cars"
                    said.append(f"{curve.allocator} delivers {word} than {first} with {sizes} {cars} (95 % interval).")
        else:
            said.append(f"{curve.allocator} and {first} differ in no fleet size by more than chance (95 % interval).")
    return said


def _curve(curve: Curve) -> list[str]:
    best = max(curve.points, key=lambda point: point.throughput_per_h.mean)
    low, high = curve.points[0].robots, curve.points[-1].robots
    if curve.knee is not None:
        knee = next(point for point in curve.points if point.robots == curve.knee)
        said = [
            f"{curve.allocator}: knee at {curve.knee} cars with {between(knee.throughput_per_h)} tasks/h; "
            f"bottleneck there: {knee.bottleneck}."
        ]
    else:
        said = [f"{curve.allocator}: no knee from {low} to {high} cars."] if low < high else []
    if best.throughput_per_h.mean > 0.0:
        cars = f"{best.robots} car{'s' if best.robots > 1 else ''}"
        said.append(
            f"{curve.allocator}: most tasks with {cars}, {between(best.throughput_per_h)} per hour; "
            f"bottleneck there: {best.bottleneck}."
        )
    else:
        said.append(f"{curve.allocator}: nothing was done.")
    stalled = sum(point.n_stalled for point in curve.points)
    if stalled:
        said.append(f"{curve.allocator}: {stalled} run{'s' if stalled > 1 else ''} came to a stand.")
    return said
