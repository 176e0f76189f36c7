"""MultiStepController: plays the League by multi-step PIBT or window search, with guidance and ever new schedules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.errors import FleetError
from fleet.league.arena import Arena
from fleet.league.rehearsal import problem_to_rehearse
from fleet.league.rules import NO_TASK, Tasks
from fleet.league.schedule import TaskSchedule
from fleet.league.view import LeagueView
from maps.formats.lorr import Ints
from maps.lane_graph import grid_lane_graph
from planners.deadline import Deadline
from planners.mapf.multi_step.crowd_costs import CrowdCosts
from planners.mapf.multi_step.floor_guidance import guide_floor
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.guidance import UNIT, Errands, GuidanceConfig, learn_guidance
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.multi_step_pibt import Mover, rank_weights
from planners.mapf.multi_step.operations import LONGEST
from planners.mapf.multi_step.pockets import pocket_depth
from planners.mapf.window_search.steady_plan import SteadyPlan

_ROOMY = 0.25
"""Share of the floor that may be full of robots while all of them push on."""
_HOLD_BACK = 0.6
"""Share of the robots that only make room, for each share of the floor that is fuller than that."""
_PATIENCE = 10
"""Timesteps that a robot stands in one cell of a large floor before it counts as stuck."""
_LONG_PATIENCE = 60
"""The same on small floors, where everybody waits so long at times that haste for all would be haste for none."""
_HASTE = 50
"""Moves by which the way ahead counts as shorter for each further timestep. The first in a knot may be the one who
cannot get out; sooner or later each of them is the first, and the knot comes loose."""
_SHUT_IN = 40
"""Timesteps that a robot spends in a pocket before it counts more than those who are nearer to the way out."""
_OUT_FIRST = 8.0
"""How much more, for each bottleneck between them. Rounds of improvement would otherwise give a robot at the mouth of a
dead end its way back that had to leave it, since what it gains is more than what the one inside loses; for ever."""
_DEEPEST = 300
"""Bottlenecks that are counted so: a power of 8 that a float still holds."""
_UNHURRIED_S = 0.1
"""Budget of a step from which on robots of a large floor look farther ahead, and all decide in each timestep."""
_CROWD = 12
"""Moves that a cell of a large floor counts as farther in the midst of a crowd."""
_DELAY, _DELAY_REACH, _DELAY_ROOMY = 200, 8, 0.2
"""Moves by which an errand in the midst of a crowd counts as longer when tasks are given out on a large floor, how many
cells to each side count as around it, and the share of them that may be taken at no cost."""
_LARGE = 2**20
"""More than any way costs."""
_SEARCHED = 1 / 3
"""Share of the floor that robots may take where window search is tried; beyond it `auto` does without as well."""
_WINDOW = 16
"""Timesteps that window search plans ahead; a robot that turns on the spot makes some ten moves in them."""
_NODES_PER_MS, _MOST_NODES = 2_000, 60_000
"""Nodes that searches expand in a timestep, for each millisecond of its budget and at most. Ten thousand take one."""
_REHEARSED_ROUNDS = 3
"""Rounds of improvement in a timestep of a rehearsal; a run has time for about as many in steps of 10 ms."""


class Method(NamedTuple):
    """How robots of a small floor may be led."""

    strength: float
    """Share of what guidance adds to the costs of moves. It is learnt from robots that look three timesteps ahead; who
    looks farther needs less of it to keep out of each other's way, and every detour costs time."""
    searched: bool
    """Whether by search in a window instead of multi-step PIBT."""


METHODS = (
    Method(1.0, searched=False),
    Method(0.25, searched=False),
    Method(0.25, searched=True),
    Method(0.0, searched=True),
)
"""Those that are rehearsed; the first one is that of floors where nothing is."""


@dataclass(frozen=True, kw_only=True)
class MultiStepControllerConfig:
    """Settings of `MultiStepController`."""

    length: int = 4
    """Timesteps of an operation; two more where there is room for long ones, and on floors too large for exact costs
    one less. Where a step may take long they are as long as told in caves, and one longer where a floor is laid out in
    streets: in a cave twice as many would begin in each state, and what that is worth was not measured."""
    most_tries: int = 3000
    """Operations that a chain of pushes tries before it gives up."""
    rounds: int = 40
    """Most rounds of improvement in a timestep."""
    budget_share: float = 0.7
    """Share of a step's budget after which no further round of improvement begins."""
    guidance: GuidanceConfig = field(default_factory=GuidanceConfig)
    rehearsal_timesteps: int = 200
    """Timesteps of a small floor's rehearsals, of which the one that gets most done decides how robots are led there;
    0 = none, by multi-step PIBT."""
    startup_s: float = 40.0
    """Wall time for preparations [s]."""

    def __post_init__(self) -> None:
        if self.rehearsal_timesteps < 0:
            raise FleetError(
                f"multi_step_pibt: rehearsal_timesteps = {self.rehearsal_timesteps}; valid: an integer >= 0"
            )
        if not 0 < self.budget_share <= 1:
            raise FleetError(f"multi_step_pibt: budget_share = {self.budget_share}; valid: 0 < budget_share <= 1")


class MultiStepController:
    """A controller for the League.

    Args:
        config: Settings.
        seed: Seed of everything random.
    """

    def __init__(self, config: MultiStepControllerConfig | None = None, *, seed: int = 0) -> None:
        self.config = MultiStepControllerConfig() if config is None else config
        self._rng = np.random.default_rng(seed)

    def prepare(self, arena: LeagueView, budget_s: float) -> None:
        """Compute costs, learn or find guidance, rehearse, and hand out the first tasks."""
        graph, n = arena.graph, len(arena.states)
        self._budget_s = budget_s
        pebble = grid_lane_graph(arena.problem.grid, "pebble")
        self._costs = GoalCosts(graph, pebble)
        errands = _known_errands(arena)
        density = n / np.count_nonzero(arena.problem.grid.free)
        # On a full floor those who have farthest to go come no nearer by pushing, they only cost others time.
        share = 1.0 - _HOLD_BACK * max(density - _ROOMY, 0.0)
        self._length = min(self.config.length + 2, LONGEST) if density <= _ROOMY else self.config.length
        self._patience = 1
        self._crowd = self._delay = None
        if self._costs.exact:
            # Loading or compiling kernels takes no time away from learning.
            short = GuidanceConfig(candidates=1, rounds=1, timesteps=1)
            learn_guidance(graph, self._costs, arena.states, errands, config=short)
        deadline = Deadline(wall_s=self.config.startup_s)
        method, self._n_active = METHODS[0], int(np.ceil(n * share))
        if self._costs.exact:
            self._learnt = learn_guidance(
                graph,
                self._costs,
                arena.states,
                errands,
                config=self.config.guidance,
                deadline=deadline,
                seed=self._rng,
            )
            # A plan of many timesteps is worth nothing where delays undo it.
            searched = density <= _SEARCHED and arena.problem.ticks is None
            method = self._rehearsed(arena, errands, [way for way in METHODS if searched or not way.searched])
        else:
            guidance = guide_floor(arena.problem.grid, pebble, errands, n, seed=self._rng)
            self._costs.weigh_drives(guidance.cost)
            self._n_active = int(np.ceil(n * min(share, guidance.share)))
            hasty = budget_s < _UNHURRIED_S
            longer = min(self.config.length + guidance.in_streets, LONGEST)
            self._length = min(self.config.length, 3) if hasty else longer
            self._patience = self._length if hasty else 1
            grid, unit = arena.problem.grid, self._costs.unit
            self._crowd = CrowdCosts(grid, _CROWD * unit)
            self._delay = CrowdCosts(grid, _DELAY * unit, reach=_DELAY_REACH, roomy=_DELAY_ROOMY)
        self._begin(arena, method)
        self._expect_goals(arena, errands.cell, deadline)
        first = self._assign(arena, everybody=True)
        self._task_of: Tasks | None = first
        # The first step of a process loads or compiles kernels; what it decides is not kept.
        chance = self._mover.chance.copy() if isinstance(self._mover, Mover) else None
        self._move(arena, first, Deadline(iterations=1))
        if isinstance(self._mover, Mover) and chance is not None:
            self._mover.chance = chance
        self._stand(arena.states)

    def step(self, arena: LeagueView) -> tuple[Ints, Tasks]:
        """Decide a timestep."""
        return self._decide(arena, Deadline(wall_s=self._budget_s * self.config.budget_share))

    def _rehearsed(self, arena: LeagueView, errands: Errands, methods: Sequence[Method]) -> Method:
        """The method by which most errands are done with tasks that are known; the costs are those for it."""
        problem = problem_to_rehearse(arena, errands)
        steps = self.config.rehearsal_timesteps
        best, most = methods[0], -1
        for method in methods if steps else ():
            rehearsal = Arena(problem)
            self._weigh(method)
            self._begin(rehearsal, method)
            for _ in range(steps):
                rehearsal.apply(*self._decide(rehearsal, Deadline(iterations=_REHEARSED_ROUNDS)))
            n_done = rehearsal.n_errands_done
            if n_done > most:
                best, most = method, n_done
        self._weigh(best)
        return best

    def _weigh(self, method: Method) -> None:
        """Let the costs of a small floor be those that a method needs."""
        self._move_cost: Ints = np.round(UNIT + method.strength * (self._learnt - UNIT)).astype(np.int32)
        self._costs.weigh(self._move_cost)

    def _begin(self, arena: LeagueView, method: Method) -> None:
        """Be ready for the first timestep."""
        graph, n = arena.graph, len(arena.states)
        blocked = np.zeros(graph.n_cells, dtype=np.bool_)
        self._mover: Mover | SteadyPlan
        if method.searched:
            self._mover = SteadyPlan(
                graph, blocked, n, window=_WINDOW, move_cost=self._move_cost, unit=UNIT, seed=self._rng
            )
        else:
            self._mover = Mover(
                graph,
                blocked,
                n,
                length=self._length,
                look=self._costs.look,
                dearest=self._costs.dearest,
                patience=self._patience,
                seed=self._rng,
            )
        self._depth = pocket_depth(graph)
        self._waited = np.zeros(n, dtype=np.int64)
        self._inside = np.zeros(n, dtype=np.int64)
        self._cells = graph.state_cell[arena.states]
        self._schedule = TaskSchedule(arena, self._costs)
        self._task_of = None
        self._stand(arena.states)

    def _stand(self, states: Ints) -> None:
        """Let robots stand in these states, and stay."""
        self._mover.begin(states)
        self._states = states.copy()

    def _decide(self, arena: LeagueView, deadline: Deadline) -> tuple[Ints, Tasks]:
        """Decide a timestep; a further iteration of the deadline is a round of improvement."""
        task_of, self._task_of = self._task_of, None
        if task_of is None:
            task_of = self._assign(arena)
        if not np.array_equal(arena.states, self._states):
            # Somebody did not get as far as it was told.
            self._stand(arena.states)
        self._states = self._move(arena, task_of, deadline)
        return self._states.copy(), task_of

    def _assign(self, arena: LeagueView, *, everybody: bool = False) -> Tasks:
        if arena.problem.round_robin:
            self._schedule.learn(arena, arena.task_of)
            return arena.task_of
        delay = None if self._delay is None else self._delay.of(arena.graph.state_cell[arena.states])
        return self._schedule.assign(arena, delay=delay, everybody=everybody)

    def _move(self, arena: LeagueView, task_of: Tasks, deadline: Deadline) -> Ints:
        n = len(arena.states)
        busy = task_of != NO_TASK
        done = np.where(task_of == arena.task_of, arena.errand_of, 0)
        row = task_of % arena.problem.n_tasks
        place = np.where(busy, arena.errand_ptr[row] + done, 0)
        further = busy & (place + 1 < arena.errand_ptr[row + 1])
        cell = np.where(busy, arena.errand_cell[place], np.int32(-1))
        after = np.where(further, arena.errand_cell[np.minimum(place + 1, len(arena.errand_cell) - 1)], np.int32(-1))
        if not self._costs.exact:
            # Whoever stands where it has another errand is done there; costs of a large floor begin with a drive.
            after = np.where(after == cell, np.int32(-1), after)
        rows = self._costs.rows(np.concatenate((cell, after)))
        costs = self._costs.costs
        wishes = Wishes(
            row=rows[:n].copy(),
            cell=cell.astype(np.int32),
            next_row=rows[n:].copy(),
            onward=np.where(further, self._schedule.onward_of[place], np.int32(0)).astype(np.int32),
        )
        crew = self._mover.crew if isinstance(self._mover, Mover) else None
        to_go = left(costs, arena.states, wishes.row, crew) + np.where(busy, self._schedule.rest_of[place], _LARGE)
        here = arena.graph.state_cell[arena.states]
        self._waited = np.where(here == self._cells, self._waited + 1, 0)
        self._cells = here
        patience = _LONG_PATIENCE if self._costs.exact else _PATIENCE
        stuck = np.maximum(self._waited - patience, 0) * (_HASTE * self._costs.unit)
        sequence = np.argsort(to_go.astype(np.int64) - stuck - self._depth[here] * (2 * _LARGE), kind="stable").astype(
            np.int32
        )
        wishes.row[sequence[self._n_active :]] = -1
        if isinstance(self._mover, SteadyPlan):
            nodes = max(int(min(_NODES_PER_MS * 1000.0 * self._budget_s, _MOST_NODES)), 1)
            return self._mover.step(costs.table, wishes, sequence, nodes=nodes, allow_rotation=arena.allow_rotation)
        weight = rank_weights(sequence)
        self._inside = np.where(self._depth[here] > 0, self._inside + 1, 0)
        weight *= np.where(self._inside > _SHUT_IN, _OUT_FIRST ** np.minimum(self._depth[here], _DEEPEST), 1.0)
        rounds = count()
        return self._mover.step(
            costs,
            wishes,
            sequence,
            weight=weight,
            most_tries=self.config.most_tries,
            allow_rotation=arena.allow_rotation,
            # One round in any case: without it crossings of narrow aisles fill up with knots.
            polish=lambda: next(rounds) == 0 or deadline.spend(),
            rounds=self.config.rounds,
            crowd=None if self._crowd is None else self._crowd.of(here),
        )

    def _expect_goals(self, arena: LeagueView, known: Ints, deadline: Deadline) -> None:
        """Fill the table of a large floor before the clock runs: the goals that are known, then cells like them."""
        if self._costs.exact:
            return
        marks = arena.problem.marks
        alike = np.flatnonzero(arena.problem.grid.free)
        if marks is not None:
            alike = alike[np.isin(marks[alike], np.unique(marks[known]))]
        self._costs.expect(np.concatenate((np.unique(known), np.setdiff1d(alike, known))), deadline)


def _known_errands(arena: LeagueView) -> Errands:
    """The errands of all tasks that are known."""
    tasks = np.concatenate((arena.pool(), arena.task_of[arena.task_of != NO_TASK]))
    row = np.unique(tasks % arena.problem.n_tasks)
    counts = arena.errand_ptr[row + 1] - arena.errand_ptr[row]
    ptr = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
    place: npt.NDArray[np.int64] = np.repeat(arena.errand_ptr[row] - ptr[:-1], counts) + np.arange(ptr[-1])
    return Errands(ptr=ptr, cell=arena.errand_cell[place])
