"""Joint loop: an arm alone swings all its joints at once, and how exactly its motors follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.stations.arms.arm_spheres import cache_dir
from fleet.world.bullet.bench.bench import ArmBench
from fleet.world.bullet.bench.replay import open_bench

PERIOD_S = 4.0
"""Of the swing [s]."""
SPEED_SHARE = 0.6
"""Part of its greatest speed that a joint reaches."""
RANGE_SHARE = 0.3
"""Part of its range by which it swings to either side at most."""
_N_PERIODS = 2


@dataclass(frozen=True, kw_only=True)
class JointLoopReport:
    """Figures of the loop."""

    time_s: float
    rms_rad: float
    """Root mean square error over all joints."""
    worst_rad: float
    speed_share: float
    """Greatest speed of any joint, of its limit."""


class JointLoop:
    """An arm on a bench of its own, in the middle of its range.

    Args:
        arm: Name that `open_bench` knows.
    """

    def __init__(self, arm: str) -> None:
        self.bench: ArmBench = open_bench(arm, cache_dir())
        limits = self.bench.drive.limits
        self._middle = (limits.lower_rad + limits.upper_rad) / 2
        rate = 2.0 * math.pi / PERIOD_S
        self._swing = np.minimum(
            RANGE_SHARE * (limits.upper_rad - limits.lower_rad), SPEED_SHARE * limits.max_velocity_radps / rate
        )
        self.bench.drive.place(self._middle)
        # Hulls of neighbours meet in every posture; those of a Panda's links 6 and 8, by 25 mm, would lock its wrist.
        self.bench.step()
        client, body = self.bench.client, self.bench.body
        for point in client.getContactPoints(body, body):
            client.setCollisionFilterPair(body, body, point[3], point[4], 0)
        self.bench.drive.place(self._middle)

    def run(self) -> JointLoopReport:
        """Swing, the amplitude growing over the first period and the joints told where and how fast."""
        bench, limits = self.bench, self.bench.drive.limits
        rate = 2.0 * math.pi / PERIOD_S
        errors, fastest = [], 0.0
        n_steps = round(_N_PERIODS * PERIOD_S / bench.step_s)
        for step in range(1, n_steps + 1):
            time = step * bench.step_s
            share, growth = (time / PERIOD_S, 1.0 / PERIOD_S) if time < PERIOD_S else (1.0, 0.0)
            q = self._middle + share * self._swing * math.sin(rate * time)
            qd = self._swing * (growth * math.sin(rate * time) + share * rate * math.cos(rate * time))
            bench.drive.position(q, qd)
            bench.step()
            got, speed = bench.drive.state()
            errors.append(got - q)
            fastest = max(fastest, float((np.abs(speed) / limits.max_velocity_radps).max()))
        off = np.array(errors)
        return JointLoopReport(
            time_s=n_steps * bench.step_s,
            rms_rad=float(np.sqrt((off**2).mean())),
            worst_rad=float(np.abs(off).max()),
            speed_share=fastest,
        )

    def close(self) -> None:
        """End its engine."""
        self.bench.close()
