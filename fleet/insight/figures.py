"""Figures: what a run achieved and why its robots waited, taken in tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from fleet.arrays import FloatArray
from fleet.insight.cause_watch import CauseWatch
from fleet.insight.codebook import Codebook, codebook_of
from fleet.insight.metrics import Metrics, Summary
from fleet.insight.slip import SlipMeter
from fleet.insight.time_accounts import TimeAccounts
from fleet.robots.angle import wrapped_all
from fleet.run.view import RunView
from fleet.tasks.batches import Batches
from maps.vehicle import TURN_M_PER_RAD


class Figures:
    """All that is counted and measured of a run. Nothing in the run depends on it.

    Args:
        run: The run.
        batches: Its batches.
        halted_by: Tells which cars stand because their granted way leads through another one, and that one.
    """

    def __init__(self, run: RunView, batches: Batches, halted_by: Callable[[], Mapping[int, int]]) -> None:
        self._run = run
        self._batches = batches
        self._halted_by = halted_by
        docks = [station.place.dock.cell for station in run.stations]
        n_places = len(run.places.cells)
        time_accounts = TimeAccounts(run.world.n_cars, run.site.grid.cell_xy(docks), run.graph.n_cells, n_places)
        self._pivots = run.scene.cars.each("steers") == 0.0
        self._any_pivots = bool(self._pivots.any())
        self._yaws = run.world.car_poses()[:, 2].copy()
        self.metrics = Metrics(run.world.n_cars, run.tick_s, time_accounts)

    # Built when first asked for: environments seldom ask.

    @cached_property
    def causes(self) -> CauseWatch:
        """The causes of all robots, tick by tick."""
        return CauseWatch(self._run, self._halted_by)

    @cached_property
    def codebook(self) -> Codebook:
        """What the numbers stand for."""
        return codebook_of(self._run)

    @cached_property
    def slip_meter(self) -> SlipMeter | None:
        """Measures every carry; None without physics, where parcels stick rigidly to their tools."""
        run = self._run
        return SlipMeter(run.scene.arms, run.scene.arm_base) if run.config.fidelity.has_contact else None

    def tick(self, speeds: FloatArray) -> None:
        """Take in the tick that was just done.

        Args:
            speeds: Signed speeds of the cars [m/s], shape (n_cars,).
        """
        run, missions = self._run, self._run.missions
        if self.slip_meter is not None:
            self.slip_meter.tick(run.arm_manager.services, run.world)
        poses = run.world.car_poses()
        paces = self._paces(speeds, poses)
        self.causes.tick(run.now, paces)
        self.metrics.tick(speeds, paces, missions.loaded, missions.bound)
        self.metrics.time_accounts.tick(
            self.causes.rows,
            missions.phase_index,
            missions.loaded,
            missions.bookings.place_of,
            missions.served,
            paces,
            poses,
        )

    def _paces(self, speeds: FloatArray, poses: FloatArray) -> FloatArray:
        """How fast cars move along paths, where turns on the spot have a length, too [m/s], shape (n_cars,)."""
        if not self._any_pivots:
            return speeds
        turned = wrapped_all(poses[:, 2] - self._yaws)
        self._yaws = poses[:, 2].copy()
        return np.maximum(np.abs(speeds), self._pivots * TURN_M_PER_RAD * np.abs(turned) / self._run.tick_s)

    def summary(self) -> Summary:
        """Figures of the run so far."""
        slips = self.slip_meter.slips if self.slip_meter is not None else ()
        return self.metrics.summary(self._run, self._batches, slips, self.codebook)
