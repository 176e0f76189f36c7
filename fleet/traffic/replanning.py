"""Traffic: asks the planner for the next window of moves and hands it to the executor when its time has come."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fleet.arrays import CellArray
from fleet.config import TrafficConfig
from fleet.traffic.crowding import WAITS_AFTER_S, Crowding
from fleet.traffic.drivers import MOVE_S
from fleet.traffic.executor import Executor
from fleet.traffic.floor_distances import FloorDistances
from fleet.traffic.head_on import HeadOn
from fleet.traffic.open_lanes import OpenLanes
from fleet.traffic.single_file import SingleFile
from fleet.traffic.tides import Tides
from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.planner import begins, heeds_comes
from planners.mapf.problem import NO_GOAL, Instance, Plan

NO_CELL = -1
NO_CAR = -1
QUEUE_MOVES = 6
"""Who waits so near to where it goes waits for its turn there, which no other way would spare it."""
HEAD_ON_RANK_S = 1e7
"""Head start of a car that cannot step aside for one it has met: the other one has to [s]."""
LEAVES_RANK_S = (1e6, 1e5)
"""Head start of a car that drives out of an outer dead end, and out of an inner one: who wants to go in
has to make room [s]."""
AISLE_RANK_S = 1e5
"""Head start of a car that drives through a narrow aisle: who waits before it has to make room [s]."""
TURN_RANK_S = 1e4
"""Head start of a car whose turn it is at a dead end [s]."""
COMMIT_MOVES = 2
"""Moves that a car keeps beyond the granted ones if the planner takes it to stand where they end: with fewer, more of
the order in which cars meet is decided by where they are not yet."""
THREAD_CARS = 200
"""Plans for so many cars are made in a thread of their own while the run goes on; for fewer that takes longer."""
GREAT_FLEET_CARS = 100
"""From so many cars on, some arm begins or ends all the time: a plan that is being made is kept then, and the next one
is asked for a little later. With 1,000 cars four plans of five were thrown away before, see decision 69."""
GREAT_FLEET_GAP_S = 0.3
"""Time from one request to the next in such a fleet, if no period asks for one earlier [s]."""
STANDING_COST = 100
"""What a cell costs that somebody stands in who makes no room, in moves: more than most ways round it."""
REPRICE_S = 5.0
"""Time after which ways are found anew if cars wait elsewhere [s]."""


@dataclass(frozen=True, kw_only=True)
class _Pending:
    due_tick: int
    goals: npt.NDArray[np.int32]
    fixed: npt.NDArray[np.bool_]
    """Cars that could not move when it was asked for."""
    plan: Callable[[], Plan]
    """Waits for the plan, if it is still being made."""


def _plain(plan: Callable[[], Plan]) -> Plan:
    return plan()


class Traffic:
    """Goals of all cars, and the planning requests that serve them.

    A request is answered at once and its plan is kept back until `latency_s` of simulated time has passed,
    so that the outcome does not depend on how fast the machine is; its budget is one of iterations for the same reason.

    Args:
        graph: Lane graph of the site.
        executor: Receives the plans.
        config: Planner, window, period, latency and budget.
        tick_s: Length of a tick [s].
        seed: Seed of the planner's tie-breaking.
        free: Distances of the floor with nothing blocked, that other runs know already; None = without docks.
    """

    def __init__(
        self,
        graph: LaneGraph,
        executor: Executor,
        config: TrafficConfig,
        tick_s: float,
        seed: int,
        free: FloorDistances | None = None,
    ) -> None:
        n_cars = len(executor.tail_states())
        self.executor = executor
        self.lanes = OpenLanes(graph)
        self._single_file = SingleFile(self.lanes)
        self._head_on = HeadOn(self.lanes)
        self._tides = Tides(graph)
        self.goals = np.full(n_cars, NO_GOAL, dtype=np.int32)
        self.stay = np.zeros(n_cars, dtype=np.bool_)
        """Cars that must not be pushed once they are at their goal (docks)."""
        self.fixed = np.zeros(n_cars, dtype=np.bool_)
        """Cars that cannot move (served, dead, recovering)."""
        self.rank = np.zeros(n_cars)
        """Added to a car's priority: loaded cars go first."""
        self.blocked = np.zeros(graph.n_cells, dtype=np.bool_)
        """Cells nobody may be sent into."""
        self._n_blocks = np.zeros(graph.n_cells, dtype=np.int64)
        self._n_for_good = np.zeros(graph.n_cells, dtype=np.int64)
        self._dead_cells: dict[int, list[int]] = {}
        self.wreck_of = np.full(graph.n_cells, NO_CAR, dtype=np.int32)
        """The dead car that blocks each cell, shape (n_cells,)."""
        self.landed_goals = np.full(n_cars, NO_GOAL, dtype=np.int32)
        """The goals that the last plan was made for, shape (n_cars,)."""
        self._free = FloorDistances(graph, ()) if free is None else free
        self._distances = self._free
        self._crowding = Crowding(graph.n_cells)
        self._crowd_costs = self._crowding.costs()
        self._standing = np.zeros(graph.n_cells, dtype=np.int64)
        self._priced_tick = 0
        self.ways = self._distances.around
        """What ways cost past all that is blocked and crowded: the distances that plans are made with."""
        self.n_ways = 0
        """Grows whenever ways cost something else."""
        self.n_plans = 0
        self.call: Callable[[Callable[[], Plan]], Plan] = _plain
        """By which the planner is called, in whichever thread; others may watch the calls."""
        self.priorities = np.zeros(n_cars)
        """What the last request ranked the cars by, the greatest first to go."""
        self._seed = seed
        self._tick_s = tick_s
        self._late_ticks, self._silent = 0, False
        self._planner = config.make_planner(seed)
        self._follow(config)
        self._goal_since = np.zeros(n_cars)
        self._tie_break = np.arange(n_cars) * 1e-6
        self._pending: _Pending | None = None
        self._thread: ThreadPoolExecutor | None = None
        self._wanted = True
        self._gap = round(GREAT_FLEET_GAP_S / tick_s) if n_cars >= GREAT_FLEET_CARS else 0
        self._next_tick = 0

    def change(self, config: TrafficConfig) -> None:
        """Go on with other settings; another planner begins anew, and a plan that is under way still lands."""
        old = self._config
        if (old.planner, old.planner_settings) != (config.planner, config.planner_settings):
            self._planner = config.make_planner(self._seed)
        self._follow(config)

    def _follow(self, config: TrafficConfig) -> None:
        self._config = config
        self._period = max(1, round(config.period_s / self._tick_s))
        self._latency = round(config.latency_s / self._tick_s)

    def send(self, car: int, goal: int, *, stay: bool, tick: int) -> None:
        """Give a car a goal state; a new goal starts with no waiting time."""
        if self.goals[car] != goal:
            self.goals[car] = goal
            self._goal_since[car] = tick
            self._wanted = True
        self.stay[car] = stay

    def let_wait(self, car: int) -> None:
        """Leave a car without a goal: it waits where it comes to stand, and whoever wants to pass pushes it on."""
        self.goals[car] = NO_GOAL
        self.stay[car] = False

    def set_fixed(self, car: int, fixed: bool) -> None:
        """Say that a car cannot move, or that it can again."""
        self.fixed[car] = fixed
        self.discard()

    def set_served(self, car: int, served: bool) -> None:
        """Say that an arm begins to work on a car, which stands at its goal, or that it may drive on.

        In a great fleet plans under way are kept, as far as they hold; in a small one they are made anew.
        """
        if len(self.fixed) < GREAT_FLEET_CARS:
            self.set_fixed(car, served)
            return
        self.fixed[car] = served
        self._wanted = True

    def set_dead(self, car: int, cells: list[int]) -> None:
        """A car will never move again, and these cells are no longer a way; called again, others take their place."""
        self.fixed[car] = True
        self.goals[car] = NO_GOAL
        self._count_blocked(self._dead_cells.get(car, []), -1, for_good=True)
        self._dead_cells[car] = cells
        self.wreck_of[self.wreck_of == car] = NO_CAR
        self.wreck_of[cells] = car
        self._count_blocked(cells, 1, for_good=True)

    def set_alive(self, car: int) -> None:
        """A dead car will move again: its cells are a way again; it stays fixed until that is said."""
        self._count_blocked(self._dead_cells.pop(car, []), -1, for_good=True)
        self.wreck_of[self.wreck_of == car] = NO_CAR

    def set_blocked(self, cell: int, blocked: bool, *, for_good: bool = False) -> None:
        """Take a cell out of the lanes, or give it back; it is open again when all that blocked it is over.

        Args:
            cell: The cell.
            blocked: Whether it is taken out.
            for_good: Whether nobody knows when it will be given back; said alike both times.
        """
        self._count_blocked([cell], 1 if blocked else -1, for_good=for_good)

    @property
    def graph(self) -> LaneGraph:
        """The lanes as they may be driven at present."""
        return self.lanes.planned

    def reachable(self, state: int, goal: int) -> bool:
        """Whether there is a way from a state to another past all that is blocked."""
        return int(self.tables.to(goal)[state]) < UNREACHABLE

    @property
    def tables(self) -> DistanceTable:
        """Exact distances past all that is blocked."""
        return self._distances.exact

    def next_plan_tick(self, car: int, tick: int) -> int:
        """When the next plan lands that knows where a car is to go."""
        if self._pending is None:
            return (tick // self._period + 1) * self._period + self._latency
        known = self._pending.goals[car] == self.goals[car]
        return self._pending.due_tick + (0 if known else self._latency)

    def next_cells(self, states: CellArray, goals: CellArray) -> CellArray:
        """The cell that comes next on the shortest way from each state to the goal beside it, `NO_CELL` = no way."""
        after = self.ways.next_states(states, goals)
        return np.where(after >= 0, self.graph.state_cell[after], NO_CELL).astype(np.int32)

    def obstacle(self, state: int, goal: int) -> int:
        """The first blocked cell on what would be the shortest way to a goal, `NO_CELL` if there would be none."""
        while state != goal:
            cell, state = self._step(self._free.exact, state, goal)
            if cell == NO_CELL or self.blocked[cell]:
                return cell
        return NO_CELL

    def _step(self, tables: DistanceTable, state: int, goal: int) -> tuple[int, int]:
        """Cell and state that come next on the shortest way."""
        after = tables.next_state(state, goal)
        return (int(tables.graph.state_cell[after]), after) if after >= 0 else (NO_CELL, state)

    def _count_blocked(self, cells: list[int], change: int, *, for_good: bool) -> None:
        self.discard()
        self._n_blocks[cells] += change
        self._n_for_good[cells] += change * for_good
        self.blocked = self._n_blocks > 0
        if self.lanes.block(self._n_for_good > 0):
            self.executor.extend_lanes(self.lanes.granted)
        self._distances = self._free.past(self.blocked, self.graph)
        self.ways = self._distances.around
        self._price()

    def go_round(self, cells: CellArray) -> None:
        """Let ways lead round cells whose cars make no room, if there is another way.

        Args:
            cells: All such cells, shape (k,).
        """
        standing = np.zeros_like(self._standing)
        standing[cells] = STANDING_COST
        if np.array_equal(standing, self._standing):
            return
        self._standing = standing
        self.ways = self._distances.ways()  # to all goals they may be others now
        self._price()

    def delay(self, delay_s: float) -> None:
        """Let plans that are asked for from now on land so much later than usual."""
        self._late_ticks = round(delay_s / self._tick_s)

    def silence(self, silent: bool) -> None:
        """Let the planner answer nothing more, or again."""
        self._silent = silent
        self.discard()

    def discard(self) -> None:
        """Throw away the plan that has not landed yet, because it rests on what is no longer so, and ask anew."""
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.plan()  # what it reads may change from now on
        self._wanted = True

    def close(self) -> None:
        """End the thread that plans, if there is one."""
        if self._thread is not None:
            self._thread.shutdown()

    def tick(self, tick: int) -> bool:
        """Land the plan that is due and make the request that is due.

        Returns:
            True when a plan landed.
        """
        landed = False
        due = tick % self._period == 0 or (self._wanted and tick >= self._next_tick)
        if self._pending is None and not self._silent and due:
            due_tick = tick + self._latency + self._late_ticks
            fixed = self.fixed.copy()
            self._pending = _Pending(due_tick=due_tick, goals=self.goals.copy(), fixed=fixed, plan=self._plan(tick))
            self._wanted, self._next_tick = False, tick + self._gap
        if self._pending is not None and self._pending.due_tick <= tick:
            self.executor.accept(self._landed(self._pending))
            self.landed_goals = self._pending.goals
            self._pending = None
            self.n_plans += 1
            landed = True
        return landed

    def _landed(self, pending: _Pending) -> Plan:
        """A plan as far as cars stay where they are that can no longer move, though they could when it was begun."""
        plan = pending.plan()
        fixed = plan.states[:, self.fixed & ~pending.fixed]
        moved = (fixed != fixed[0]).any(axis=1)
        return replace(plan, states=plan.states[: moved.argmax()]) if moved.any() else plan

    def _see_crowd(self, tick: int) -> None:
        """Note where cars wait; now and then, let ways go round them."""
        tails = self.executor.tail_states()
        waiting = (self.executor.still_s > WAITS_AFTER_S) & (self.goals != NO_GOAL) & (tails != self.goals)
        cars = waiting.nonzero()[0]
        rows, row = self._distances.exact.rows(self.goals[cars])
        in_lanes = cars[rows[row, tails[cars]] > QUEUE_MOVES]
        cells = self.graph.state_cell[tails[in_lanes]]
        self._crowding.see(cells, tick * self._tick_s)
        if (tick - self._priced_tick) * self._tick_s < REPRICE_S:
            return
        self._priced_tick = tick
        costs = self._crowding.costs()
        if not np.array_equal(costs, self._crowd_costs):
            self._crowd_costs = costs
            self._price()

    def _price(self) -> None:
        """Let ways cost what is known of the crowd; those to where nobody is on the way are left as they were."""
        self.n_ways += 1
        costs = self._crowd_costs + self._standing
        if self.ways is self._distances.around:
            if not costs.any():
                return
            self.ways = self._distances.ways()
        on_the_way = (self.goals != NO_GOAL) & (self.goals != self.executor.tail_states())
        self.ways.reprice(self._distances.costs + costs, np.unique(self.goals[on_the_way]))

    def _n_commits(self) -> int:
        """Moves beyond the granted ones that cars keep when plans are made anew."""
        if self._config.commit_moves_n is not None:
            return self._config.commit_moves_n
        if not heeds_comes(self._planner):
            return COMMIT_MOVES
        moves = math.ceil((self._latency + self._late_ticks) * self._tick_s / MOVE_S)
        # The first of the granted moves may be all but done.
        return max(0, moves - self._config.grant_moves_n + 1)

    def _plan(self, tick: int) -> Callable[[], Plan]:
        self._see_crowd(tick)
        starts = self.executor.cut(self._n_commits())
        waited_s = (tick - self._goal_since) * self._tick_s
        self.priorities = waited_s + self.rank + self._tie_break
        now_s = tick * self._tick_s
        goals = self._single_file.goals(self.goals.copy(), starts, self.stay, self.ways, self.executor.still_s, now_s)
        self.priorities[self._single_file.first] += TURN_RANK_S
        goals = self._tides.goals(goals, starts, self.stay, self.fixed, self.ways, now_s)
        self.priorities[self._tides.first] += AISLE_RANK_S
        sent = (self.goals != NO_GOAL).nonzero()[0]
        for leaves, rank_s in zip(self.lanes.leave(starts[sent], self.goals[sent]), LEAVES_RANK_S, strict=False):
            self.priorities[sent[leaves]] += rank_s
        first = self._head_on.first(self.goals, starts, self.ways, self.executor.still_s, self.fixed)
        self.priorities[first] += HEAD_ON_RANK_S
        instance = Instance(
            graph=self.graph,
            starts=starts,
            goals=goals,
            priorities=self.priorities,
            stay=self.stay & (goals == self.goals),
            fixed=self.fixed.copy(),
            blocked=self.blocked.copy(),
            allow_rotation=False,
            horizon=self._config.horizon_n,
            comes=self.executor.timesteps_left() if heeds_comes(self._planner) else None,
        )
        deadline, planner = Deadline(self._config.iterations_n), begins(self._planner)
        if planner is not None and len(starts) >= THREAD_CARS and self.ways.keeps_all:
            if self._thread is None:
                self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="fleet-plan")
            return self._thread.submit(self.call, planner.begin(instance, self.ways, deadline)).result
        plan = self.call(lambda: self._planner.plan(instance, self.ways, deadline))
        return lambda: plan
