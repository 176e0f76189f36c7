"""Words of multi-agent path finding on a lane graph: the instance and the plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, Int64Array, IntArray
from planners.status import Status

NO_GOAL = -1
"""Goal of an agent that has none."""
NOBODY = -1
"""Where an agent is named and there is none."""


class InstanceError(PlanningError):
    """An instance contradicts itself or its graph."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Instance:
    """One window of a lifelong problem: who stands where, who wants to go where.

    A cell carries one agent at a time. Following into a cell that is vacated in the same timestep is legal,
    swapping is not, and a closed ring of followers is legal only with `allow_rotation`.

    Raises:
        InstanceError: An array has the wrong length, a state does not exist, or two agents start in one cell.
    """

    graph: LaneGraph
    starts: IntArray
    """State of each agent at timestep 0, shape (n,)."""
    goals: IntArray
    """Goal state of each agent, shape (n,); `NO_GOAL` = rather stay where it is."""
    priorities: npt.NDArray[np.float64]
    """Larger goes first, shape (n,)."""
    stay: BoolArray
    """Once at its goal the agent is immovable; otherwise it is lowest in priority there and can be pushed on."""
    fixed: BoolArray
    """The agent never moves in this window, shape (n,)."""
    blocked: BoolArray
    """Cells nobody may enter, shape (n_cells,). An agent that starts in one may wait there and leave."""
    allow_rotation: bool
    """Whether a closed ring of followers is legal."""
    horizon: int
    """Timesteps to plan, >= 0."""
    comes: Int64Array | None = None
    """Timestep at which each agent comes to its start, shape (n,): until then it cannot move on, and nobody else can be
    there. Planners that do not heed it (`planner.heeds_comes`) take everybody to be there; None = so it is."""

    def __post_init__(self) -> None:
        n, graph = len(self.starts), self.graph
        for name in ("starts", "goals", "priorities", "stay", "fixed"):
            shape = np.shape(getattr(self, name))
            if shape != (n,):
                raise InstanceError(f"instance: {name} has shape {shape}; valid: ({n},), one entry per agent")
        if self.comes is not None and np.shape(self.comes) != (n,):
            raise InstanceError(f"instance: comes has shape {np.shape(self.comes)}; valid: ({n},), one entry per agent")
        if np.shape(self.blocked) != (graph.n_cells,):
            raise InstanceError(f"instance: blocked has shape {np.shape(self.blocked)}; valid: ({graph.n_cells},)")
        if self.horizon < 0:
            raise InstanceError(f"instance: horizon = {self.horizon}; valid: an integer >= 0")
        if _is_sound(self.starts, self.goals, self.priorities, graph.state_cell, graph.n_cells):
            return
        for name, states, least in (("starts", self.starts, 0), ("goals", self.goals, NO_GOAL)):
            bad = np.flatnonzero((states < least) | (states >= graph.n_states))
            if bad.size:
                raise InstanceError(
                    f"instance: {name}[{bad[0]}] = {states[bad[0]]}; valid: states {least}..{graph.n_states - 1}"
                )
        if np.isnan(self.priorities).any():
            agent = int(np.flatnonzero(np.isnan(self.priorities))[0])
            raise InstanceError(f"instance: priorities[{agent}] = nan; valid: a number")
        cells = graph.state_cell[self.starts]
        order = np.argsort(cells, kind="stable")
        twice = np.flatnonzero(np.diff(cells[order]) == 0)
        if twice.size:
            a, b = order[twice[0]], order[twice[0] + 1]
            raise InstanceError(f"instance: agents {a} and {b} both start in cell {cells[a]}; valid: distinct cells")

    @property
    def n_agents(self) -> int:
        """Number of agents."""
        return len(self.starts)


@njit(cache=True, nogil=True)
def _is_sound(
    starts: IntArray, goals: IntArray, priorities: npt.NDArray[np.float64], state_cell: IntArray, n_cells: int
) -> bool:  # pragma: no cover - compiled
    """Whether all states exist, no priority is nan, and no two agents start in one cell."""
    n_states = len(state_cell)
    taken = np.zeros(n_cells, np.bool_)
    for agent in range(len(starts)):
        if not 0 <= starts[agent] < n_states or not NO_GOAL <= goals[agent] < n_states:
            return False
        cell = state_cell[starts[agent]]
        if taken[cell] or np.isnan(priorities[agent]):
            return False
        taken[cell] = True
    return True


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A configuration per timestep."""

    states: IntArray
    """State of each agent at each timestep, shape (T + 1, n); row 0 = the starts."""
    status: Status
    """`feasible`: the whole horizon; `timeout`: a legal prefix; `infeasible`: an agent cannot reach its goal."""
    iterations: int
    """Work done, in the solver's own unit."""
