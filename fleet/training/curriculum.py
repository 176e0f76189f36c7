"""Curriculum: which stage of a recipe a training run is in."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from fleet.training.recipes.recipe import TrainingStage


class Curriculum:
    """Counts steps and keeps the latest figures of a stage.

    Args:
        stages: One after the other; at least one.
        n_steps: Of the whole run.
    """

    def __init__(self, stages: Sequence[TrainingStage], n_steps: int) -> None:
        self._stages, self._n_steps = tuple(stages), n_steps
        self.index = 0
        """Of the stage."""
        self._n_taken = 0
        self._figures: deque[float] = deque(maxlen=self.stage.n_last)

    @property
    def stage(self) -> TrainingStage:
        """The one that is learned now."""
        return self._stages[self.index]

    def note(self, n_steps: int, episodes: Sequence[Mapping[str, float]]) -> None:
        """Take an update into account.

        Args:
            n_steps: Steps of agents.
            episodes: Figures of the episodes that ended in it.
        """
        self._n_taken += n_steps
        if self.stage.figure is not None:
            self._figures.extend(one[self.stage.figure] for one in episodes)

    def advance(self) -> bool:
        """Go on to the next stage if this one is over; returns whether it was."""
        stage = self.stage
        if self.index == len(self._stages) - 1 or not self._is_over(stage):
            return False
        self.index += 1
        self._n_taken = 0
        self._figures = deque(maxlen=self.stage.n_last)
        return True

    def state(self) -> dict[str, Any]:
        """All there is to remember."""
        return {"index": self.index, "taken_n": self._n_taken, "figures": list(self._figures)}

    def recall(self, state: Mapping[str, Any]) -> None:
        """Return to a `state`."""
        self.index, self._n_taken = state["index"], state["taken_n"]
        self._figures = deque(state["figures"], maxlen=self.stage.n_last)

    def _is_over(self, stage: TrainingStage) -> bool:
        share = self._n_taken / self._n_steps
        known = stage.figure is not None and len(self._figures) == stage.n_last
        reached = known and sum(self._figures) / stage.n_last >= stage.reached
        return share >= stage.longest or (reached and share >= stage.shortest)
