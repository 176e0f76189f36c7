"""Arm planning by OMPL's RRT-Connect over our own edge check: the default."""

from __future__ import annotations

from planners.motion.search.ompl_planner import OmplPlanner
from planners.motion.search.rrt_connect_config import RrtConnectConfig


class RrtConnect(OmplPlanner):
    """RRT-Connect of OMPL; see `OmplPlanner`.

    Source: Kuffner and LaValle, RRT-Connect, ICRA 2000.
    """

    def __init__(self, config: RrtConnectConfig | None = None) -> None:
        super().__init__("RRTConnect", config)
