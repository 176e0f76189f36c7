"""RollingPlan: a plan of a window that moves on with time and is improved all the while."""

from __future__ import annotations

import numpy as np

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, Distances, IntArray
from planners.mapf.chance import chance_of
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.options import open_moves
from planners.mapf.roads import roads_of
from planners.mapf.window_search import timetable
from planners.mapf.window_search.chains import Chain, ChainSearch, WindowFrontier, work
from planners.mapf.window_search.timetable import FREE, WayCosts, WindowTimetable

LONGEST = 100
"""Timesteps of a window at most."""
_POOL = 2**14
"""Nodes of one search; one that needs more is given up."""
_MOST_LOSS = 1023
"""Units of cost that a path found may lose."""
_MOST_MEMBERS = 64
"""Agents of a chain. In a narrow aisle a whole queue goes back."""
_MOST_STAMPS = 2**30


class RollingPlan:
    """Moves a fleet timestep by timestep along a plan that it improves all the while.

    The plan says where everybody is in each timestep of the window. With each timestep the window moves on, and what
    was found stays. An agent that loses time is led anew through the window, and whomever it drives out of their way
    after it, as long as all of them together lose no more than before. Who comes no nearer in the whole window may
    drive out those behind it in the order at any cost.

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

    Source: Li, Tinka, Kiesel, Durham, Kumar, Koenig, "Lifelong Multi-Agent Path Finding in Large-Scale Warehouses",
    AAAI 2021, https://arxiv.org/abs/2005.07371 (a window that moves on); Li, Chen, Harabor, Stuckey, Koenig, "Anytime
    multi-agent path finding via large neighborhood search", IJCAI 2021. That whoever is driven out joins the
    neighbourhood is taken from priority inheritance: Okumura et al., Artificial Intelligence 310, 2022.
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
        if not 1 <= window <= LONGEST:
            raise PlanningError(f"window search: window = {window}; valid: 1 to {LONGEST}")
        self.graph = graph
        self._blocked = blocked.copy()
        self._roads = roads_of(graph, blocked)
        moves = graph.out_move[open_moves(graph, blocked)[graph.out_move]]
        self._move_cost = (np.ones(graph.n_moves) if move_cost is None else move_cost)[moves].astype(np.int32)
        self._unit = unit
        self._chance = chance_of(np.random.default_rng(seed))

        def ints(*shape: int) -> IntArray:
            return np.zeros(shape, dtype=np.int32)

        def longs(*shape: int) -> np.typing.NDArray[np.int64]:
            return np.zeros(shape, dtype=np.int64)

        self._table = WindowTimetable(
            path=ints(n, window + 1), occupant=ints(window + 1, self._roads.n_cells), loss=longs(n)
        )
        n_keys = (window + 1) * (FREE + 1) * graph.n_states
        self._frontier = WindowFrontier(
            state=ints(_POOL),
            timestep=ints(_POOL),
            leg=ints(_POOL),
            parent=ints(_POOL),
            below=ints(_POOL),
            buckets=np.full(_MOST_LOSS + 1, -1, dtype=np.int32),
            seen=ints(n_keys),
            least=ints(n_keys),
            stamp=ints(1),
            expanded=longs(1),
        )
        self._chain = Chain(
            member=ints(_MOST_MEMBERS),
            kept=ints(_MOST_MEMBERS, window + 1),
            kept_loss=longs(_MOST_MEMBERS),
            mark=ints(n),
            stamp=ints(1),
            place=ints(n),
        )
        self._locked = np.zeros(n, dtype=np.bool_)
        self._stay = np.zeros(n, dtype=np.bool_)
        self._begun = False

    @property
    def stuck_share(self) -> float:
        """Share of the agents that come no nearer in the whole window, as of the last timestep decided."""
        stuck = self._unit * (self._table.path.shape[1] - 1)
        return float(np.mean(self._table.loss >= stuck)) if len(self._locked) else 0.0

    def fits(self, graph: LaneGraph, blocked: BoolArray, n: int) -> bool:
        """Whether this is the floor and the size of fleet it was made for."""
        return graph is self.graph and n == len(self._locked) and np.array_equal(blocked, self._blocked)

    def begin(self, states: IntArray) -> None:
        """Let agents stand in `states`, shape (n,), and stay; if they are where the plan has led them, it goes on."""
        if not self._begun or not np.array_equal(self._table.path[:, 0], states):
            timetable.begin(self._roads, self._table, states)
            self._begun = True

    def hold(self, stay: BoolArray, locked: BoolArray) -> None:
        """Say who does not move. Who was about to is stopped, and then everybody is led anew.

        Args:
            stay: Agents that are immovable once they are at their goal, shape (n,).
            locked: Agents that do not move now, shape (n,).
        """
        self._stay[:], self._locked[:] = stay, locked
        path = self._table.path
        if (path[locked] != path[locked, :1]).any():
            timetable.begin(self._roads, self._table, path[:, 0].copy())

    def step(
        self, distances: Distances, wishes: Wishes, sequence: IntArray, *, nodes: int, allow_rotation: bool
    ) -> IntArray:
        """Decide a timestep and let it pass.

        Args:
            distances: What is left to do from each state to each goal, shape (goals, n_states).
            wishes: Where the agents want to go.
            sequence: Agents, the one that goes first in front, shape (n,).
            nodes: Nodes that searches expand.
            allow_rotation: Whether a closed ring of followers is legal.

        Returns:
            State of each agent after the timestep, shape (n,).
        """
        chain, frontier = self._chain, self._frontier
        if max(chain.stamp[0], frontier.stamp[0]) > _MOST_STAMPS:
            chain.mark[:], frontier.seen[:] = 0, 0
            chain.stamp[0], frontier.stamp[0] = 1, 1
        chain.place[sequence] = np.arange(len(sequence), dtype=np.int32)
        ways = WayCosts(
            move_cost=self._move_cost,
            unit=self._unit,
            table=distances,
            wishes=wishes,
            stay=self._stay,
            locked=self._locked,
        )
        search = ChainSearch(
            roads=self._roads,
            ways=ways,
            table=self._table,
            frontier=frontier,
            chain=chain,
            chance=self._chance,
            allow_rotation=allow_rotation,
        )
        work(search, sequence, nodes)
        after: IntArray = self._table.path[:, 1].copy()
        timetable.go_on(self._roads, self._table)
        return after
