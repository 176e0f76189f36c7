"""Reach: whether the arms of a site can serve their stations, with the words of a run that would refuse them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.config import Fidelity, Grip, RunConfig
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_planner import LocalArmPlanner, ReachError, arm_setup
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
    scene = scene_of(site, np.empty((0, 3)), grip)
    names = tuple(station.name for station in site.stations)
    config = RunConfig(grip=grip, fidelity=Fidelity.PHYSICS)
    setup = arm_setup(arm_cells(site, scene), names, scene.arm, config)
    try:
        LocalArmPlanner(setup, told).close()
    except ReachError as error:
        return error.refusals
    return ()
