"""Reach: whether the arms of a site can serve their stations, with the words of a run that would refuse them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.config import ArmConfig, Grip
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_planner import ArmSetup, LocalArmPlanner, ReachError
from fleet.world.site_scene import scene_of
from maps.site import Site


def reach_refusals(site: Site, grip: Grip, told: Callable[[str], None]) -> tuple[str, ...]:
    """Prepare the arms of a site as at the start of a run with physics, which is the strictest.

    Args:
        site: The site.
        grip: The arms' tool.
        told: Hears the name of each station before it is looked at.

    Returns:
        One line for each station that cannot be served: which slot, why, and what would be valid.
    """
    arms = ArmConfig()
    scene = scene_of(site, np.empty((0, 3)), grip)
    setup = ArmSetup(
        cells=arm_cells(site, scene),
        names=tuple(station.name for station in site.stations),
        spec=scene.arm,
        tool=str(grip),
        planner=arms.planner,
        n_iterations=arms.iterations_n,
        confirm=True,
    )
    try:
        LocalArmPlanner(setup, told).close()
    except ReachError as error:
        return error.refusals
    return ()
