"""Guidance: costs of moves that make opposing traffic take different ways, learnt by letting the fleet drive."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maps.lane_graph import TURN, LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import FloatArray, IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.multi_step_kernel import wishes_to_stay
from planners.mapf.multi_step.multi_step_pibt import Mover, rank_weights
from planners.mapf.multi_step.priorities import NearestFirst

THREADS = 2
"""Candidates that are learnt at once; what comes out does not depend on it."""
UNIT = 8
"""Cost of a wait, a turn or an unhindered move; a whole number, so that hindrance counts in eighths."""


@dataclass(frozen=True, kw_only=True)
class GuidanceConfig:
    """Settings of `learn_guidance`."""

    candidates: int = 6
    """Times learning begins anew, with other draws; the costs that the fleet gets most done with are kept."""
    rounds: int = 40
    """Times the fleet drives with the costs of the round before."""
    timesteps: int = 100
    """Timesteps of a round."""
    trial_timesteps: int = 800
    """Timesteps that an outcome is tried for."""
    meeting: float = 30.0
    """Units that a move costs more for each robot a timestep that makes it the other way."""
    most: float = 6.0
    """Most units that meeting others adds to a move."""
    waiting: float = 1.0
    """Units that a move costs more into a cell somebody waits in all the time."""
    memory: float = 0.85
    """Share of the traffic seen before that counts on in each round."""
    length: int = 3
    """Timesteps of an operation."""

    def __post_init__(self) -> None:
        for name, least in (("candidates", 1), ("rounds", 0), ("timesteps", 1), ("trial_timesteps", 1), ("length", 1)):
            if getattr(self, name) < least:
                raise PlanningError(f"guidance: {name} = {getattr(self, name)}; valid: an integer >= {least}")
        for name in ("meeting", "most", "waiting"):
            if not 0 <= getattr(self, name) <= 1000:
                raise PlanningError(f"guidance: {name} = {getattr(self, name)}; valid: 0 to 1000")
        if not 0 <= self.memory < 1:
            raise PlanningError(f"guidance: memory = {self.memory}; valid: 0 <= memory < 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Errands:
    """What the fleet drives for while it learns: tasks of one or more goal cells each, as CSR."""

    ptr: IntArray
    cell: IntArray


class _Seen(NamedTuple):
    """What was seen while the fleet drove."""

    made: FloatArray
    """How often each move was made, shape (n_moves,)."""
    waited: FloatArray
    """Timesteps somebody spent in each cell without a move, shape (n_cells,)."""
    n_done: int
    """Errands done."""


def learn_guidance(
    graph: LaneGraph,
    costs: GoalCosts,
    starts: IntArray,
    errands: Errands,
    *,
    config: GuidanceConfig | None = None,
    deadline: Deadline | None = None,
    seed: int | np.random.Generator = 0,
) -> IntArray:
    """Let a fleet drive, make moves against the traffic and into waiting crowds dearer, and again.

    Where more robots drive one way than the other, the other way gets dearer, so the next round has more of one and
    less of the other: two-way aisles become lanes. Which lanes come out is chance, and some serve a fleet a tenth
    better than others, so this is done several times and the outcomes are tried on the same draws of tasks.

    Args:
        graph: Rotating lane graph.
        costs: Costs on it, exact ones; they hold what is returned afterwards.
        starts: State of each robot, shape (n,).
        errands: Tasks to draw from at random.
        config: Settings.
        deadline: Budget; an iteration is a round or a trial.
        seed: Seed of the draws.

    Returns:
        Cost of each move, `UNIT` or more, shape (n_moves,).

    Source: Zhang, Jiang, Bhatt, Nikolaidis, Li, "Guidance Graph Optimization for Lifelong Multi-Agent Path Finding",
    IJCAI 2024, https://arxiv.org/abs/2402.01446, section 4.3 (update from simulated traffic); the rule is our own.
    """
    config = GuidanceConfig() if config is None else config
    deadline = Deadline() if deadline is None else deadline
    *streams, trial = np.random.default_rng(seed).spawn(config.candidates + 1)
    trial_config = replace(config, timesteps=config.trial_timesteps, length=config.length + 1)

    def outcome(number: int) -> tuple[int, IntArray]:
        if number > 0 and not deadline.spend():
            return -1, unweighed
        own = copy(costs)
        move_cost = _learn(graph, own, starts, errands, config, deadline, streams[number])
        if config.candidates == 1:
            return 0, move_cost  # there is nothing to choose from
        return _drive(graph, own, move_cost, starts, errands, trial_config, deepcopy(trial)).n_done, move_cost

    unweighed = np.full(graph.n_moves, UNIT, dtype=np.int32)
    # Iterations that are counted are spent in order.
    with ThreadPoolExecutor(1 if deadline.counts else THREADS) as pool:
        _, best = max(pool.map(outcome, range(config.candidates)), key=itemgetter(0))
    costs.weigh(best)
    return best


def _learn(
    graph: LaneGraph,
    costs: GoalCosts,
    starts: IntArray,
    errands: Errands,
    config: GuidanceConfig,
    deadline: Deadline,
    rng: np.random.Generator,
) -> IntArray:
    """Costs of the moves after some rounds; `costs` holds them too."""
    drives = np.flatnonzero(graph.move_kind != TURN)
    origin, target = graph.state_cell[graph.move_from[drives]], graph.state_cell[graph.move_to[drives]]
    back = reverse_moves(origin, target, graph.n_cells)
    move_cost = np.full(graph.n_moves, UNIT, dtype=np.int32)
    traffic, waiting = np.zeros(len(drives)), np.zeros(graph.n_cells)
    costs.weigh(move_cost)
    for _ in range(config.rounds):
        if not deadline.spend():
            break
        seen = _drive(graph, costs, move_cost, starts, errands, config, rng)
        traffic = config.memory * traffic + (1 - config.memory) * seen.made[drives]
        waiting = config.memory * waiting + (1 - config.memory) * seen.waited
        opposing = np.where(back >= 0, traffic[back], 0.0) / config.timesteps
        extra = np.minimum(config.meeting * opposing, config.most)
        extra += config.waiting * waiting[target] / config.timesteps
        move_cost[drives] = np.round(UNIT * (1.0 + extra)).astype(np.int32)
        costs.weigh(move_cost)
    return move_cost


def reverse_moves(origin: IntArray, target: IntArray, n_cells: int) -> npt.NDArray[np.int64]:
    """For each drive the one between the same cells the other way, or -1."""
    forth = origin.astype(np.int64) * n_cells + target
    order = np.argsort(forth)
    wanted = target.astype(np.int64) * n_cells + origin
    place = np.minimum(np.searchsorted(forth[order], wanted), len(forth) - 1)
    return np.where(forth[order[place]] == wanted, order[place], -1)


def _drive(
    graph: LaneGraph,
    costs: GoalCosts,
    move_cost: IntArray,
    starts: IntArray,
    errands: Errands,
    config: GuidanceConfig,
    rng: np.random.Generator,
) -> _Seen:
    """Let every robot do tasks drawn at random."""
    n = len(starts)
    mover = Mover(
        graph,
        np.zeros(graph.n_cells, dtype=np.bool_),
        n,
        length=config.length,
        look=costs.look,
        dearest=int(move_cost.max()),
        seed=rng,
    )
    nearest_first = NearestFirst(graph)
    place = errands.ptr[rng.integers(len(errands.ptr) - 1, size=n)].astype(np.int64)
    end = np.zeros(len(errands.cell), dtype=np.bool_)
    end[errands.ptr[1:] - 1] = True
    wishes = wishes_to_stay(np.full(n, -1, dtype=np.int32))
    states, n_done = [starts], 0
    mover.begin(starts)
    for _ in range(config.timesteps):
        cell = errands.cell[place]
        row = costs.rows(cell)
        to_go = left(costs.costs, states[-1], row)
        sequence = nearest_first.of(states[-1], to_go)
        after = mover.step(
            costs.costs,
            wishes._replace(row=row),
            sequence,
            weight=rank_weights(sequence),
            most_tries=1000,
            allow_rotation=True,
            polish=_never,
        )
        states.append(after)
        there = graph.state_cell[after] == cell
        n_done += int(there.sum())
        drawn = errands.ptr[rng.integers(len(errands.ptr) - 1, size=n)]
        place = np.where(there, np.where(end[place], drawn, place + 1), place)
    path = np.array(states)
    begun, ended = path[:-1].ravel().astype(np.int64), path[1:].ravel()
    moved = begun != ended
    ends = graph.move_from.astype(np.int64) * graph.n_states + graph.move_to
    order = np.argsort(ends)
    made = order[np.searchsorted(ends[order], begun[moved] * graph.n_states + ended[moved])]
    return _Seen(
        made=np.bincount(made, minlength=graph.n_moves).astype(np.float64),
        waited=np.bincount(graph.state_cell[begun[~moved]], minlength=graph.n_cells).astype(np.float64),
        n_done=n_done,
    )


def _never() -> bool:
    return False
