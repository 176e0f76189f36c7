"""Display: draws lanes, paths and names in the physics engine's own window, and reads its sliders."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np

from fleet.arrays import FloatArray
from fleet.recording.rerun_stream.palette import identity_colour
from fleet.recording.rerun_stream.poses import at_height
from fleet.run.view import RunView
from fleet.terminal.pacing import NAP_S, Pace

LOOK_S = 0.25
"""Least wall time between two looks at the sliders and two drawings of paths [s]."""
REST = 4.0
"""Each look waits for the window; it is followed by so many times as long without one."""
SPEED_MOST = 10.0
"""Right end of the slider for the speed, unless the run begins faster."""
_PAUSED = 0.5
"""Right of this the slider for the pause stops the run."""
_LANE_STEP_M, _PATH_STEP_M = 0.25, 0.12
_LANE_Z_M, _PLANNED_Z_M, _GRANTED_Z_M = 0.012, 0.03, 0.04
_LANE_RGB = (0.80, 0.82, 0.86)
_HEAD_RGB = (0.15, 0.35, 0.75)
_NAME_Z_M, _STATION_Z_M = 0.45, 1.3


class Window(Protocol):
    """What a display asks of a window, see `fleet.world.bullet.engine.window`."""

    def held(self) -> AbstractContextManager[None]: ...

    def frame(self, size_m: tuple[float, float]) -> None: ...

    def name_cars(self, names: Sequence[str], height_m: float) -> None: ...

    def name_places(self, names: Sequence[str], points: FloatArray) -> None: ...

    def dots(self, key: str, points: FloatArray, rgb: FloatArray, size: float) -> None: ...

    def slider(self, name: str, low: float, high: float, start: float) -> int: ...

    def value(self, slider: int) -> float: ...


class Display:
    """Keeps a window up to date and a run at the pace that its sliders say.

    Lanes are dotted lines with a blue dot where they end. A car's path is dotted in its colour: thick where its moves
    are granted, thin where they are only planned.

    Args:
        run: The run.
        window: Of its world.
        pace: Told what the sliders say.
    """

    def __init__(self, run: RunView, window: Window, pace: Pace) -> None:
        self._run = run
        self._window = window
        self._pace = pace
        self._next = 0.0
        self._paused = False
        n_cars = run.world.n_cars
        self._colors = np.array([_rgb(identity_colour(car, value=0.85)) for car in range(n_cars)]).reshape(-1, 3)
        self._draw_floor()
        self._speed_slider = window.slider(
            "speed: times real time, 0 = fastest", 0.0, max(SPEED_MOST, pace.speed), pace.speed
        )
        self._pause_slider = window.slider("pause: right = stand still", 0.0, 1.0, 0.0)
        self._slid = pace.speed

    def look(self, interrupted: Sequence[int]) -> None:
        """Draw and read the sliders if it is time; returns when the run is not paused, or was interrupted."""
        begin = time.perf_counter()
        if begin < self._next:
            return
        self._draw_paths()
        self._read()
        took_s = time.perf_counter() - begin
        if self._paused:
            while self._paused and not interrupted:
                time.sleep(NAP_S)
                self._read()
            self._pace.change(self._pace.speed, self._run.sim_s)
        self._next = time.perf_counter() + max(LOOK_S, REST * took_s)

    def _read(self) -> None:
        self._paused = self._window.value(self._pause_slider) > _PAUSED
        speed = round(self._window.value(self._speed_slider), 2)
        if speed != round(self._slid, 2):
            self._slid = speed
            self._pace.change(speed, self._run.sim_s)

    def _draw_floor(self) -> None:
        run = self._run
        site = run.site
        lanes = site.grid.cell_xy(site.lanes.ravel()).reshape(-1, 2, 2)
        along = np.arange(_LANE_STEP_M / 2, 1.0, _LANE_STEP_M)
        points = (lanes[:, None, 0] + along[:, None] * (lanes[:, None, 1] - lanes[:, None, 0])).reshape(-1, 2)
        rgb = np.tile(_LANE_RGB, (len(points), 1))
        rgb[len(along) - 1 :: len(along)] = _HEAD_RGB
        stations = np.array([station.place.arm.pose[:2] for station in run.stations]).reshape(-1, 2)
        self._window.frame(run.scene.size_m)
        with self._window.held():
            self._window.dots("lanes", at_height(points, _LANE_Z_M), rgb, 2.0)
            self._window.name_cars([f"car_{car}" for car in range(run.world.n_cars)], _NAME_Z_M)
            self._window.name_places([station.name for station in run.stations], at_height(stations, _STATION_Z_M))

    def _draw_paths(self) -> None:
        run = self._run
        for key, lines, height, size in (
            ("granted", run.driver.remaining_lines(), _GRANTED_Z_M, 5.0),
            ("planned", run.executor.planned_lines(), _PLANNED_Z_M, 2.5),
        ):
            dotted = [_dotted(line) for line in lines]
            points = np.concatenate([*dotted, np.empty((0, 2))])
            rgb = np.repeat(self._colors, [len(line) for line in dotted], axis=0)
            self._window.dots(key, at_height(points, height), rgb, size)


def _dotted(line: FloatArray) -> FloatArray:
    """Points at equal steps along a polyline, shape (k, 2)."""
    if len(line) < 2:
        return np.empty((0, 2))
    s_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0.0, s_m[-1], _PATH_STEP_M)
    return np.column_stack([np.interp(at, s_m, line[:, 0]), np.interp(at, s_m, line[:, 1])])


def _rgb(packed: int) -> tuple[float, float, float]:
    return (packed >> 24 & 255) / 255, (packed >> 16 & 255) / 255, (packed >> 8 & 255) / 255
