"""Pods: how exactly a lifter sets one down that it carried over twenty metres, and what the pod touched."""

from __future__ import annotations

import math

from benchmarks.harness import Row, Trial
from fleet.proving.pods import carry


def measure_pods(trial: Trial) -> list[Row]:
    """Carry a pod with each seed."""
    carried = [carry(seed) for seed in trial.seeds]
    for seed, report in zip(trial.seeds, carried, strict=True):
        trial.check(report.arrived, f"pod, seed {seed}: the lifter did not arrive")
    return [
        Row(
            name="pod carried 20 m: off its place, largest",
            value=1000 * max(report.off_m for report in carried),
            unit="mm",
            target="<= 20",
        ),
        Row(
            name="pod carried 20 m: off its yaw, largest",
            value=math.degrees(max(report.off_rad for report in carried)),
            unit="degrees",
            target="<= 2",
        ),
        Row(
            name="pod carried 20 m: touches beside the plate",
            value=sum(report.n_touches for report in carried),
            unit="",
            target="<= 0",
        ),
    ]
