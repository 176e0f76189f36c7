"""Window search as a planner: the plan of a window is kept from call to call and improved with each timestep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.distance_table import DistanceTable, tables_of
from planners.mapf.multi_step.multi_step_kernel import wishes_to_stay
from planners.mapf.problem import Instance, Plan
from planners.mapf.window import goals_to_look_up, plan_window, reachable_goals
from planners.mapf.window_search.rolling_plan import LONGEST
from planners.mapf.window_search.steady_plan import SteadyPlan


@dataclass(frozen=True, kw_only=True)
class WindowSearchConfig:
    """Settings of `WindowSearch`."""

    window: int = 12
    """Timesteps that are planned ahead."""
    nodes: int = 6000
    """Nodes that searches expand in a timestep; ten thousand take about a millisecond."""
    impatience: float = 1.0
    """Priority an agent gains with each timestep of the window that ends away from its goal."""

    def __post_init__(self) -> None:
        if not 1 <= self.window <= LONGEST:
            raise PlanningError(f"window search: window = {self.window}; valid: 1 to {LONGEST}")
        if self.nodes < 1:
            raise PlanningError(f"window search: nodes = {self.nodes}; valid: an integer >= 1")
        if not self.impatience >= 0:
            raise PlanningError(f"window search: impatience = {self.impatience}; valid: a number >= 0")


class WindowSearch:
    """Plans a longer window than it is asked for, hands out its beginning, and keeps the rest; see `SteadyPlan`.

    Where there is room it finds better ways than PIBT, which sees a step or a few; what it costs is set beforehand.

    Args:
        config: Settings.
        seed: Seed of the choices. Each call draws on: the same sequence of calls gives the same plans.
    """

    def __init__(self, config: WindowSearchConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = WindowSearchConfig() if config is None else config
        self._rng = np.random.default_rng(seed)
        self._plan: SteadyPlan | None = None

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan one window.

        Args:
            instance: The window.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one timestep of all agents.

        Returns:
            A plan that is legal from its first row to its last, whatever its status.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        graph, n = instance.graph, instance.n_agents
        tables = tables_of(instance, tables, "window search")
        deadline = Deadline() if deadline is None else deadline
        if self._plan is None or not self._plan.fits(graph, instance.blocked, n):
            self._plan = SteadyPlan(graph, instance.blocked, n, window=self.config.window, seed=self._rng)
        plan = self._plan
        table, row = tables.rows(goals_to_look_up(instance, tables))
        reachable = reachable_goals(instance, table, row)
        wishes = wishes_to_stay(np.where(reachable, row, np.int32(-1)))
        plan.begin(instance.starts)

        def step(now: IntArray, after: IntArray, *, order: IntArray, locked: BoolArray) -> None:
            wishes.row[now == instance.goals] = -1  # whoever has been there makes room for others
            plan.hold(instance.stay, locked)
            after[:] = plan.step(table, wishes, order, nodes=self.config.nodes, allow_rotation=instance.allow_rotation)

        return plan_window(instance, step, deadline, impatience=self.config.impatience, reachable=reachable)
