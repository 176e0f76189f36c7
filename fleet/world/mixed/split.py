"""Split: which arms share a region, and what stands there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fleet.arrays import FloatArray
from fleet.world.arm_groups import arm_groups
from fleet.world.mixed.config import MixedConfig
from fleet.world.scene import Scene

_ASIDE_M = -50.0
_ASIDE_STEP_M = 2.0


def regions_of(scene: Scene, config: MixedConfig) -> list[list[int]]:
    """Say which arms share a region.

    Args:
        scene: Where arms stand.
        config: How near they share one, and how many regions there may be.

    Returns:
        Indices of the arms of each region, ascending; regions in the order of their first arms.
    """
    xy = np.asarray(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2]
    if not len(xy):
        return []
    cells = arm_groups(xy, config.neighbours_m)
    # Stations are numbered along the walls, so neighbours in number are neighbours on the floor.
    n_regions = min(len(cells), config.n_regions(len(xy)))
    parts = np.array_split(np.arange(len(cells)), n_regions)
    return [sorted(arm for cell in part.tolist() for arm in cells[cell]) for part in parts]


def aside(slot: int) -> FloatArray:
    """Where the body of a slot sleeps while it is not used, off the floor of the site, shape (3,)."""
    return np.array([_ASIDE_M - _ASIDE_STEP_M * slot, _ASIDE_M, 0.0])


def region_scene(scene: Scene, arms: list[int], n_slots: int, near_m: float) -> Scene:
    """The part of a scene that a region is made of, with cars at the places of its slots.

    Args:
        scene: The whole.
        arms: Indices of the region's arms.
        n_slots: Number of cars.
        near_m: Boxes that reach so near to an arm's base belong to it [m].
    """
    base = scene.arm_base[arms]
    boxes = tuple(box for box in scene.boxes if reaches(base, np.array(box.centre_m), np.array(box.half_m), near_m))
    return replace(
        scene,
        boxes=boxes,
        car_start=np.array([aside(slot) for slot in range(n_slots)]).reshape(-1, 3),
        arms=scene.arms.part(arms),
        car_kind_of=None,
        arm_base=base,
        arm_start=scene.arm_start[arms],
    )


def reaches(base: FloatArray, centre_m: FloatArray, half_m: FloatArray, near_m: float) -> bool:
    """Whether a box comes nearer to one of some arms' bases than `near_m`, seen from above."""
    gap = np.maximum(np.abs(base[:, :2] - centre_m[:2]) - half_m[:2], 0.0)
    return bool((np.hypot(gap[:, 0], gap[:, 1]) <= near_m).any())
