"""Auto: the planner that measured best on floors of this kind and this density."""

from __future__ import annotations

import numpy as np

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.multi_step_pibt import MultiStepPibt
from planners.mapf.planner import MapfPlanner
from planners.mapf.problem import Instance, Plan
from planners.mapf.window_search.window_search import WindowSearch

MOST_ROOM = 1 / 3
"""Agents for each free cell up to which `WindowSearch` wins where agents go both ways and have no heading.

Source: `python -m benchmarks.mapf --only pogema`."""


class Auto:
    """`WindowSearch` where agents have no heading, go both ways, have room and are at hand, else `MultiStepPibt`.

    It chooses with the first window, and anew for another graph or another number of agents.

    Args:
        seed: Seed of the planner that is chosen.
    """

    heeds_comes = True

    def __init__(self, *, seed: int | np.random.Generator = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._graph: LaneGraph | None = None
        self._n_agents = 0
        self.chosen: MapfPlanner | None = None
        """What plans; None before the first window."""

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan one window.

        Args:
            instance: The window.
            tables: Distances on the same graph, kept from call to call; None = built by the planner that is chosen.
            deadline: Budget; an iteration is one timestep of all agents.

        Returns:
            A plan that is legal from its first row to its last, whatever its status.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        if self.chosen is None or self._graph is not instance.graph or self._n_agents != instance.n_agents:
            self._graph, self._n_agents = instance.graph, instance.n_agents
            n_free = len(np.unique(instance.graph.state_cell))
            # Window search knows nothing of when agents come to where they are.
            timeless = instance.graph.motion == "pebble" and instance.comes is None
            roomy = timeless and instance.n_agents <= MOST_ROOM * n_free
            self.chosen = WindowSearch(seed=self._rng) if roomy else MultiStepPibt(seed=self._rng)
        return self.chosen.plan(instance, tables, deadline)
