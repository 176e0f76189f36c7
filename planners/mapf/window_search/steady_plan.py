"""SteadyPlan: a rolling plan that hands over to multi-step PIBT where it jams, and takes over again."""

from __future__ import annotations

import numpy as np

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, Distances, IntArray
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.multi_step_pibt import Mover, exact_costs, rank_weights
from planners.mapf.window_search.rolling_plan import RollingPlan

_JAM = 0.2
"""Share of the agents that come no nearer in the whole window, from which on the fleet is jammed."""
_LENGTH, _ROUNDS, _MOST_TRIES = 3, 5, 1000
"""Multi-step PIBT: timesteps of an operation, rounds of improvement, operations that a chain of pushes tries."""
_PATIENT_SPELL = 4
"""Windows of a spell from which on there are no rounds of improvement, which take back what whoever has the right of
way has won: then a crowd moves on however dense it is."""
_FIRST_SPELL = 2
"""Windows that it drives for at first."""
_LONGEST_SPELL = 100
"""Windows that it drives for at most."""


class SteadyPlan:
    """Moves a fleet timestep by timestep along a `RollingPlan`, and out of jams by multi-step PIBT.

    Search in a window finds the better ways, but in a crowd it comes to a stand: chains get long, and no agent has the
    right of way for long enough. Where a fifth of the agents get nowhere, multi-step PIBT drives for two windows; if
    the fleet jams again soon after, for twice as long as before.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
        n: Number of agents.
        window: Timesteps that are planned ahead.
        move_cost: Cost of each move, shape (n_moves,); None = 1 each.
        unit: Cost of a wait.
        seed: Seed of the choices.

    Raises:
        PlanningError: The window is out of range.
    """

    def __init__(
        self,
        graph: LaneGraph,
        blocked: BoolArray,
        n: int,
        *,
        window: int,
        move_cost: IntArray | None = None,
        unit: int = 1,
        seed: int | np.random.Generator = 0,
    ) -> None:
        rng = np.random.default_rng(seed)
        self._plan = RollingPlan(graph, blocked, n, window=window, move_cost=move_cost, unit=unit, seed=rng)
        dearest = 1 if move_cost is None else int(move_cost.max(initial=1))
        self._mover = Mover(graph, blocked, n, length=_LENGTH, dearest=dearest, seed=rng)
        self._graph, self._window = graph, window
        self._spell = 0
        self._pushing = 0
        self._searched = 0
        self._expected = np.full(n, -1, dtype=np.int32)

    @property
    def is_pushing(self) -> bool:
        """Whether multi-step PIBT drives."""
        return self._pushing > 0

    def fits(self, graph: LaneGraph, blocked: BoolArray, n: int) -> bool:
        """Whether this is the floor and the size of fleet it was made for."""
        return self._plan.fits(graph, blocked, n)

    def begin(self, states: IntArray) -> None:
        """Let agents stand in `states`, shape (n,), and stay; if they are where they have been led, all goes on."""
        if self.is_pushing and not np.array_equal(states, self._expected):
            self._mover.begin(states)
        self._plan.begin(states)

    def hold(self, stay: BoolArray, locked: BoolArray) -> None:
        """Say who does not move; see `RollingPlan.hold`."""
        self._plan.hold(stay, locked)
        if self.is_pushing:
            self._mover.lock(locked)

    def step(
        self, distances: Distances, wishes: Wishes, sequence: IntArray, *, nodes: int, allow_rotation: bool
    ) -> IntArray:
        """Decide a timestep and let it pass; see `RollingPlan.step`."""
        if self.is_pushing:
            self._pushing -= 1
            self._expected = self._mover.step(
                exact_costs(distances, self._graph.n_states),
                wishes,
                sequence,
                weight=rank_weights(sequence),
                most_tries=_MOST_TRIES,
                allow_rotation=allow_rotation,
                polish=lambda: True,
                rounds=_ROUNDS if self._spell < _PATIENT_SPELL else 0,
            )
            if self._pushing == 0:
                self._plan.begin(self._expected)
            return self._expected
        self._expected = self._plan.step(distances, wishes, sequence, nodes=nodes, allow_rotation=allow_rotation)
        self._searched += 1
        if self._searched > self._window and self._plan.stuck_share > _JAM:
            again = self._searched <= self._spell * self._window
            self._spell = min(2 * self._spell, _LONGEST_SPELL) if again else _FIRST_SPELL
            self._pushing, self._searched = self._spell * self._window, 0
            self._mover.begin(self._expected)
        return self._expected
