"""Learned PIBT as a planner of windows: the weights come from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.mapf.learned.learned_stepper import LearnedStepper, Moment
from benchmarks.mapf.learned.scores import Scores, read_scores
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.distance_table import DistanceTable, tables_of
from planners.mapf.multi_step.stagnation import Stagnation
from planners.mapf.problem import Instance, Plan
from planners.mapf.window import plan_window, reachable_goals


@dataclass(frozen=True, kw_only=True)
class LearnedPibtConfig:
    """Settings of `LearnedPibt`."""

    weights: str = "weights.npz"
    """File with the weights, as `python -m benchmarks.mapf.learned` writes it."""
    patience: int = 30
    """Timesteps without coming nearer to its goal, from which on an agent goes by distances alone."""
    eagerness: float = 0.5
    """What is taken from the score of waiting; teachers wait where it costs nothing, and others stand behind."""
    impatience: float = 1.0
    """Priority an agent gains with each timestep of the window that ends away from its goal."""

    def __post_init__(self) -> None:
        if self.patience < 0:
            raise PlanningError(f"learned pibt: patience = {self.patience}; valid: an integer >= 0")
        if not np.isfinite(self.eagerness):
            raise PlanningError(f"learned pibt: eagerness = {self.eagerness}; valid: a finite number")
        if not self.impatience >= 0:
            raise PlanningError(f"learned pibt: impatience = {self.impatience}; valid: a number >= 0")


class LearnedPibt:
    """PIBT that goes by learned scores of moves, on grids without headings.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Raises:
        WeightsError: The file holds no weights for these observations.

    Source: see `LearnedStepper`.
    """

    def __init__(self, config: LearnedPibtConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = LearnedPibtConfig() if config is None else config
        self._scores: Scores = read_scores(Path(self.config.weights))
        self._rng = np.random.default_rng(seed)
        self._stepper: LearnedStepper | None = None
        self._stagnation = Stagnation(0)

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan one window.

        Args:
            instance: The window.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one timestep of all agents.

        Returns:
            A plan that is legal from its first row to its last, whatever its status.

        Raises:
            PlanningError: `tables` belong to another graph, or the graph is none of pebbles on a grid.
        """
        graph, n = instance.graph, instance.n_agents
        tables = tables_of(instance, tables, "learned pibt")
        deadline = Deadline() if deadline is None else deadline
        if self._stepper is None or not self._stepper.fits(graph, instance.blocked, n):
            self._stepper = LearnedStepper(graph, instance.blocked, n, self._scores, seed=self._rng)
            self._stagnation = Stagnation(n)
        stepper, stagnation, config = self._stepper, self._stagnation, self.config
        distances, row = tables.rows(instance.goals)
        reachable = reachable_goals(instance, distances, row)
        row = np.where(reachable, row, np.int32(-1))

        def step(now: IntArray, after: IntArray, *, order: IntArray, locked: BoolArray) -> None:
            left = np.where(row >= 0, distances[row, now], np.uint16(0)).astype(np.int32)
            moment = Moment(
                distances=distances,
                row=row,
                order=order,
                waited=stagnation.look(left, instance.goals),
                locked=locked,
                unit=1,
                patience=config.patience,
                eagerness=config.eagerness,
                allow_rotation=instance.allow_rotation,
            )
            stepper.step(now, after, moment)

        return plan_window(instance, step, deadline, impatience=config.impatience, reachable=reachable)
