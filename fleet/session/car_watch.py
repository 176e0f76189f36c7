"""CarWatch: turns the state of a run of cars alone, without arms and parcels, into frames of a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol

import numpy as np

from fleet.arrays import FloatArray
from fleet.recording import DrawnFloor, Frame, Header, RerunRecorder, versions
from fleet.world.protocol import World
from fleet.world.scene import Scene

_LINES_S = 0.2
"""Between looks at ways and words [s]."""


class CarRun(Protocol):
    """A run of cars alone."""

    scene: Scene
    world: World

    @property
    def ticks(self) -> int:
        """Control periods so far."""

    @property
    def time_s(self) -> float:
        """Simulated time so far [s]."""

    @property
    def deliveries(self) -> int:
        """Times that a car has set down."""

    @property
    def car_words(self) -> tuple[str, ...]:
        """What each car is about, in the words of the time accounts."""

    def ways(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Line of every car that is granted, and what is planned beyond [m], shape (k, 2) each."""


class CarWatch:
    """Writes a recording of a run, until it is closed.

    Args:
        run: The run.
        floor: What is drawn beside its scene.
        path: File to write; replaced if it exists.

    Raises:
        RecordingError: The file cannot be opened.
    """

    def __init__(self, run: CarRun, floor: DrawnFloor, path: Path) -> None:
        self._run = run
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
