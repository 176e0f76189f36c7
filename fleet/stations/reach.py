"""Reach: whether the arms of a site can serve their stations, with the words of a run that would refuse them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fleet.config import ArmConfig, Fidelity, Grip, RunConfig
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_planner import LocalArmPlanner, ReachError, arm_setup
from fleet.world.site_scene import arms_of, scene_of
from maps.site import Site


def reach_refusals(
    site: Site, grips: Sequence[Grip], told: Callable[[str], None], arms: ArmConfig | None = None
) -> dict[Grip, tuple[str, ...]]:
    """Prepare the arms of a site as at the start of a run with physics, which is the strictest.

    Args:
        site: The site.
        grips: Tools of the arms to look at, at least one.
        told: Hears the name of each station before it is looked at.
        arms: Names the arm of stations whose site names none.

    Returns:
        For each tool one line for each station that cannot be served: which slot, why, and what would be valid.
    """
    # What surrounds an arm does not depend on its tool.
    arms = arms or ArmConfig()
    cells = arm_cells(site, scene_of(site, np.empty((0, 3)), grips[0], arms))
    names = tuple(station.name for station in site.stations)
    refusals: dict[Grip, tuple[str, ...]] = {}
    for grip in grips:
        config = RunConfig(grip=grip, fidelity=Fidelity.PHYSICS, arms=arms)
        setup = arm_setup(cells, names, arms_of(site, grip, config.arms), config)
        try:
            LocalArmPlanner(setup, told).close()
            refusals[grip] = ()
        except ReachError as error:
            refusals[grip] = error.refusals
    return refusals
