"""Header: what a recording says of a run before its first frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fleet.arrays import FloatArray
from fleet.world.scene import Scene


@dataclass(frozen=True, kw_only=True)
class DrawnFloor:
    """The parts of a site that are drawn but do not take part in the physics."""

    name: str
    lanes: FloatArray
    """From and to of every directed lane [m], shape (k, 2, 2)."""
    station_names: tuple[str, ...]
    station_xy: FloatArray
    """Where to write the names: the arms' bases [m], shape (s, 2)."""
    dock_xy: FloatArray
    """Centres of the dock cells in the order of `station_names` [m], shape (s, 2)."""
    parking_xy: FloatArray
    """Centres of the parking cells [m], shape (p, 2)."""
    cell_xy: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Centres of all cells in the order of their ids [m], shape (n_cells, 2)."""
    cell_m: float = 1.0
    """Edge of a cell [m]."""


@dataclass(frozen=True, kw_only=True)
class Header:
    """What a recording says once, before the first frame."""

    scene: Scene
    """Robots and boxes."""
    floor: DrawnFloor
    """Lanes, stations, parking."""
    about: Mapping[str, object]
    """Facts on the run for the reader: seed, settings, versions."""
    plots: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Title -> names of the metrics drawn together; empty = all metrics in one plot."""
    cameras: Sequence[str] = ()
    """Names of the cameras whose views come with frames."""
    internals: bool = False
    """Whether frames come with what the planners think."""
