"""YardWatch: turns the state of a yard into frames of a recording."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fleet.recording import DrawnFloor, Frame, Header, RerunRecorder, versions
from fleet.yard.run import YardRun
from maps.yard import KINDS

_LINES_S = 0.2
"""Between looks at ways and words [s]."""


class YardWatch:
    """Writes a recording of a yard, until it is closed.

    Args:
        run: The run.
        path: File to write; replaced if it exists.

    Raises:
        RecordingError: The file cannot be opened.
    """

    def __init__(self, run: YardRun, path: Path) -> None:
        self._run = run
        yard, car = run.yard, run.scene.car
        middle = 0.5 * (car.front_m - car.rear_m)
        ahead = np.column_stack((np.cos(yard.spots[:, 2]), np.sin(yard.spots[:, 2])))
        bays = yard.spots[:, :2] + middle * ahead
        # A name for each kind, beyond the spot in the middle of those.
        in_the_middle = [int(spots[len(spots) // 2]) for spots in (yard.picks, yard.drops)]
        wall = bays[in_the_middle] + ahead[in_the_middle]
        floor = DrawnFloor(
            name=yard.name,
            lanes=np.empty((0, 2, 2)),
            station_names=KINDS,
            station_xy=wall,
            dock_xy=bays[in_the_middle],
            parking_xy=bays,
        )
        header = Header(scene=run.scene, floor=floor, about={"cars": len(run.scene.car_start), **versions()})
        self._recorder = RerunRecorder(path, header, tick_s=run.world.tick_s)
        self._looked_s = -math.inf
        self._words: tuple[str, ...] = ()

    def look(self) -> None:
        """Record the present tick if a frame is due."""
        run, world = self._run, self._run.world
        if not self._recorder.due(run.ticks):
            return
        looks = run.time_s - self._looked_s >= _LINES_S
        if looks:
            self._looked_s, self._words = run.time_s, run.car_words
        granted, planned = run.ways() if looks else (None, None)
        self._recorder.record(
            Frame(
                tick=run.ticks,
                sim_s=run.time_s,
                car_poses=world.car_poses(),
                car_steering=world.car_steering(),
                car_speeds=world.car_speeds(),
                arm_q=np.empty((0, 0)),
                parcel_ids=np.empty(0, dtype=np.int64),
                parcel_poses=np.empty((0, 7)),
                parcel_size_m=np.empty((0, 3)),
                car_state=self._words,
                arm_state=(),
                paths=granted,
                plans=planned,
                metrics={"deliveries": float(run.deliveries)} if looks else {},
            )
        )

    def close(self) -> None:
        """Write what is left.

        Raises:
            RecordingError: Writing failed.
        """
        self._recorder.close()
