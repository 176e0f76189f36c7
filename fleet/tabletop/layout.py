"""Layout: which things lie where on a table, which arm is to bring each to which place; drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.tabletop.errors import TabletopError
from fleet.world.scene import StaticBox
from fleet.world.tabletop import TableObject, TableScene

KINDS = ("cube", "sphere", "cylinder")
_COLOURS = {"cube": (0.80, 0.25, 0.22, 1.0), "sphere": (0.20, 0.45, 0.75, 1.0), "cylinder": (0.30, 0.62, 0.30, 1.0)}
_MOST_SEED = 2**31 - 1
_MASS_KG = (0.05, 0.3)
_EDGE_M = (0.04, 0.055)
_APART_M = 0.10
"""Least distance between the middles of things that lie about."""
_SLOT_M = 0.085
_RIM_M = 0.02
"""Height of the rim around a place."""
_RIM_HALF_M = 0.006
_FILE_SCALE, _FILE_EDGE_M = 0.6, 0.055
"""They are 90 mm wide, more than the Panda's hand opens: at this scale, most are 55 mm wide."""
_N_FILES = 900
"""`random_urdfs` has a thousand objects; the first of them are used, as in pybullet_data's own training sets."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SortingPlace:
    """A part of the table with a rim, where things of one kind belong."""

    name: str
    centre_m: tuple[float, float]
    half_m: tuple[float, float]
    slots: FloatArray
    """Where things are put down, in this order, x and y in the world [m], shape (k, 2)."""

    def holds(self, point: FloatArray) -> bool:
        """Whether a point (3,) [m] lies inside its borders, on or a little above the table."""
        offset = np.abs(point[:2] - np.array(self.centre_m))
        return bool((offset <= np.array(self.half_m)).all() and -0.02 < point[2] < 0.15)


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """A table that is to be sorted."""

    name: str
    scene: TableScene
    places: tuple[SortingPlace, ...]
    place_of: tuple[int, ...]
    """Where each thing belongs."""
    arm_of: tuple[int, ...]
    """Which arm brings each thing."""
    drop_m: float = 0.0
    """How far above its slot a thing is let go, besides a few millimetres."""


def sort_layout(seed: int, objects: int = 9) -> Layout:
    """One arm; cubes, spheres and cylinders lie in front of it and belong left, right and behind.

    Raises:
        TabletopError: The seed or the number of things is outside its range.
    """
    _check("seed", seed, 0, _MOST_SEED)
    _check("--objects", objects, 1, 10)
    rng = np.random.default_rng(seed)
    places = (
        _place("cubes", (0.05, 0.55), (3, 2)),
        _place("spheres", (0.05, -0.55), (3, 2)),
        _place("cylinders", (-0.52, 0.0), (2, 3)),
    )
    spots = _scattered(rng, objects, (0.40, 0.68), (-0.26, 0.26))
    kinds = [KINDS[i % 3] for i in range(objects)]
    scene = TableScene(
        arm="iiwa",
        tool="suction",
        arm_base=np.zeros((1, 4)),
        boxes=(_table((0.1, 0.0), (0.9, 0.9)), *_rims(places)),
        objects=tuple(_thing(rng, kind, spot) for kind, spot in zip(kinds, spots, strict=True)),
    )
    place_of = tuple(KINDS.index(kind) for kind in kinds)
    return Layout(name="sort", scene=scene, places=places, place_of=place_of, arm_of=(0,) * objects)


def pair_layout(seed: int, objects: int = 10) -> Layout:
    """Two arms side by side; cubes and cylinders lie between them, each arm brings one kind to its own side.

    Raises:
        TabletopError: The seed or the number of things is outside its range.
    """
    _check("seed", seed, 0, _MOST_SEED)
    _check("--objects", objects, 1, 12)
    rng = np.random.default_rng(seed)
    places = (_place("cubes", (0.05, 0.93), (3, 2)), _place("cylinders", (0.05, -0.93), (3, 2)))
    spots = _scattered(rng, objects, (0.25, 0.525), (-0.185, 0.185), apart_m=0.09)
    kinds = [("cube", "cylinder")[i % 2] for i in range(objects)]
    scene = TableScene(
        arm="iiwa",
        tool="suction",
        arm_base=np.array([[-0.08, 0.38, 0.0, 0.0], [-0.08, -0.38, 0.0, 0.0]]),
        boxes=(_table((0.1, 0.0), (0.9, 1.3)), *_rims(places)),
        objects=tuple(_thing(rng, kind, spot) for kind, spot in zip(kinds, spots, strict=True)),
    )
    belongs = tuple(i % 2 for i in range(objects))
    return Layout(name="pair", scene=scene, places=places, place_of=belongs, arm_of=belongs)


def tray_layout(seed: int, objects: int = 6) -> Layout:
    """One Panda; objects of `random_urdfs` lie in a tray in front of it and belong into a box beside it.

    Raises:
        TabletopError: The seed or the number of things is outside its range, or the data of pybullet are missing.
    """
    _check("seed", seed, 0, _MOST_SEED)
    _check("--objects", objects, 1, 8)
    rng = np.random.default_rng(seed)
    place = _place("box", (0.05, 0.50), (3, 2), half_m=(0.18, 0.16))
    tray = _place("tray", (0.50, 0.0), (1, 1), half_m=(0.18, 0.24))
    spots = _scattered(rng, objects, (0.38, 0.62), (-0.20, 0.20))
    data = Path(pybullet_data.getDataPath()) / "random_urdfs"
    things = []
    for number, spot in zip(rng.choice(_N_FILES, objects, replace=False), spots, strict=True):
        path = data / f"{number:03d}" / f"{number:03d}.urdf"
        if not path.is_file():
            raise TabletopError(f"{path}: no such file; valid: an installation of pybullet with its data")
        yaw = rng.uniform(-np.pi, np.pi)
        pose = np.array([*spot, 0.10, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
        size = (_FILE_EDGE_M,) * 3
        things.append(
            TableObject(
                name=f"object_{number:03d}",
                size_m=size,
                mass_kg=0.1,
                pose=pose,
                rgba=(0.6, 0.6, 0.6, 1.0),
                path=path,
                scale=_FILE_SCALE,
            )
        )
    scene = TableScene(
        arm="panda",
        tool="friction",
        arm_base=np.zeros((1, 4)),
        boxes=(_table((0.1, 0.0), (0.9, 0.9)), *_rims((tray,), kind="tray"), *_rims((place,), rim_m=0.05)),
        objects=tuple(things),
    )
    return Layout(
        name="tray",
        scene=scene,
        places=(place,),
        place_of=(0,) * objects,
        arm_of=(0,) * objects,
        drop_m=0.07,
    )


LAYOUTS: dict[str, Callable[..., Layout]] = {"sort": sort_layout, "tray": tray_layout, "pair": pair_layout}


def _check(name: str, value: int, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise TabletopError(f"{name} is {value!r}; valid: an integer from {least} to {most}")


def _scattered(
    rng: np.random.Generator,
    n: int,
    x: tuple[float, float],
    y: tuple[float, float],
    apart_m: float = _APART_M,
) -> FloatArray:
    """Points of a rectangle that keep their distance: shuffled cells of a grid, moved in their slack; (n, 2) [m]."""
    nx, ny = (max(1, int((high - low) / apart_m)) for low, high in (x, y))
    if nx * ny < n:
        raise TabletopError(f"--objects is {n}; valid: an integer from 1 to {nx * ny}")
    size = np.array([(x[1] - x[0]) / nx, (y[1] - y[0]) / ny])
    cells = np.array(list(product(range(nx), range(ny))), dtype=np.float64)[rng.permutation(nx * ny)[:n]]
    slack = np.maximum(size - apart_m, 0.0)
    points: FloatArray = np.array([x[0], y[0]]) + (cells + 0.5) * size + rng.uniform(-0.5, 0.5, (n, 2)) * slack
    return points


def _thing(rng: np.random.Generator, kind: str, spot: FloatArray) -> TableObject:
    edge, mass, yaw = rng.uniform(*_EDGE_M), rng.uniform(*_MASS_KG), rng.uniform(-np.pi, np.pi)
    return TableObject(
        name=kind,
        size_m=(edge, edge, edge),
        mass_kg=mass,
        pose=np.array([*spot, edge / 2, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]),
        rgba=_COLOURS[kind],
    )


def _place(
    name: str,
    centre: tuple[float, float],
    shape: tuple[int, int],
    half_m: tuple[float, float] | None = None,
) -> SortingPlace:
    steps = [(np.arange(n) - (n - 1) / 2) * _SLOT_M for n in shape]
    slots = np.array(list(product(*steps))) + np.array(centre)
    half = half_m or (shape[0] * _SLOT_M / 2 + 0.01, shape[1] * _SLOT_M / 2 + 0.01)
    return SortingPlace(name=name, centre_m=centre, half_m=half, slots=slots)


def _table(centre: tuple[float, float], half: tuple[float, float]) -> StaticBox:
    return StaticBox(kind="table", centre_m=(*centre, -0.05), half_m=(*half, 0.05))


def _rims(places: tuple[SortingPlace, ...], kind: str = "rim", rim_m: float = _RIM_M) -> list[StaticBox]:
    boxes = []
    for place in places:
        (x, y), (u, v) = place.centre_m, place.half_m
        z = rim_m / 2
        for side in (-1, 1):
            boxes.append(
                StaticBox(
                    kind=kind,
                    centre_m=(x + side * (u + _RIM_HALF_M), y, z),
                    half_m=(_RIM_HALF_M, v + 2 * _RIM_HALF_M, z),
                )
            )
            boxes.append(
                StaticBox(kind=kind, centre_m=(x, y + side * (v + _RIM_HALF_M), z), half_m=(u, _RIM_HALF_M, z))
            )
    return boxes
