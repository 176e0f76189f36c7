"""LearnedStepper: one timestep of PIBT whose agents try their moves in the order of learned scores."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.mapf.learned.observation import (
    N_SEEN,
    WAIT,
    Outlook,
    Seen,
    Surroundings,
    forget,
    look_out,
    move_in,
    observe,
    outlook_of,
    surroundings_of,
)
from benchmarks.mapf.learned.scores import Layers, Scores, layers_of, score
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, Distances, Int64Array, IntArray
from planners.mapf.inheritance import PUSHED, UNDECIDED, Claims, claims_of, clear, enter, push, stay
from planners.mapf.kernel import Int, kernel
from planners.mapf.options import Options, options_of

# A key orders the options of an agent: what a score lacks to the best one, or what is left, then chance.
_KEY_BIT = 24
_OCCUPIED = 1 << 23
_CHANCE = (1 << 22) - 1
_PER_SCORE = 256.0
_MOST = 1000.0
_USED_UP = 2**62
_UNRANKED = -1


class Moment(NamedTuple):
    """What is asked of one timestep; n agents."""

    distances: Distances
    """What is left to goals, shape (n_rows, n_states)."""
    row: IntArray
    """Row of each agent's goal, negative = none, shape (n,)."""
    order: IntArray
    """Agents, the one that chooses first in front, shape (n,)."""
    waited: IntArray
    """Timesteps in which each agent has come no nearer than before, shape (n,)."""
    locked: BoolArray
    """Agents that do not move, shape (n,)."""
    unit: int
    """What a wait costs, in the unit of the distances."""
    patience: int
    """Timesteps without coming nearer, from which on an agent goes by what is left alone."""
    eagerness: float
    """What is taken from the score of waiting."""
    allow_rotation: bool
    """Whether a closed ring of followers is legal."""


class Desk(NamedTuple):
    """Working memory of a timestep; n agents."""

    claims: Claims
    outlook: Outlook
    layers: Layers
    seen: Seen
    """What each agent has seen, shape (n, N_SEEN)."""
    keys: Int64Array
    """The lower, the sooner an option is tried, shape (n, widest + 1)."""


class LearnedStepper:
    """Decides one timestep of all agents.

    Whoever's turn it is, or is pushed, looks around, sees where those go who have decided before, and tries its moves
    in the order of their scores. Whether it can move is for PIBT to say, so every timestep is legal whatever the
    weights.

    Args:
        graph: Lane graph, of pebbles.
        blocked: Cells nobody may enter, shape (n_cells,).
        n: Number of agents.
        scores: The network.
        seed: Seed of the tie-breaking; each step draws on.

    Raises:
        PlanningError: The graph is none of pebbles on a grid.

    Source: R. Veerapaneni et al., "Improving Learnt Local MAPF Policies with Heuristic Search", 2024,
    https://arxiv.org/abs/2403.20300 (CS-PIBT). That agents see what has been decided is our own.
    """

    def __init__(
        self, graph: LaneGraph, blocked: BoolArray, n: int, scores: Scores, *, seed: int | np.random.Generator = 0
    ) -> None:
        self.graph = graph
        self._blocked = blocked.copy()
        self.around = surroundings_of(graph, blocked)
        self._options = options_of(graph, blocked)
        self._heading = _headings(self.around, self._options)
        self._scores = scores
        self.desk = Desk(
            claims=claims_of(self._options, graph.n_cells, n),
            outlook=outlook_of(graph.n_states, n),
            layers=layers_of(scores),
            seen=np.zeros((n, N_SEEN), dtype=np.int8),
            keys=np.empty((n, self._options.widest + 1), dtype=np.int64),
        )
        self._salt = int(np.random.default_rng(seed).integers(2**62))

    def fits(self, graph: LaneGraph, blocked: BoolArray, n: int) -> bool:
        """Whether this is the floor and the size of fleet it was made for."""
        return graph is self.graph and n == len(self.desk.seen) and np.array_equal(blocked, self._blocked)

    def step(self, now: IntArray, after: IntArray, moment: Moment) -> None:
        """Decide a timestep.

        Args:
            now: State of each agent, shape (n,), in distinct cells.
            after: Receives the state of each agent one timestep later, shape (n,).
            moment: What is asked.
        """
        self._salt += 1
        _decide(self._options, self._heading, self.around, self._scores, self.desk, moment, self._salt, now, after)

    def observe_along(self, now: IntArray, after: IntArray, moment: Moment) -> Seen:
        """What agents would see if they decided for given moves, one after the other in the order of `moment`.

        Args:
            now: State of each agent, shape (n,).
            after: State of each agent one timestep later, shape (n,).
            moment: What is asked.

        Returns:
            Shape (n, N_SEEN); holds until the next call.
        """
        _observe_along(self.around, self.desk, moment, now, after)
        return self.desk.seen


def _headings(around: Surroundings, options: Options) -> IntArray:
    """Heading of each option, -1 behind the last one, shape (n_states, widest)."""
    target = options.aim[:, :, 0]
    heading = np.full(target.shape, -1, dtype=np.int32)
    for h in range(4):
        heading[(target == around.beside[:, h, None]) & (target >= 0)] = h
    return heading


@kernel
def _decide(
    options: Options,
    headings: IntArray,
    around: Surroundings,
    scores: Scores,
    desk: Desk,
    moment: Moment,
    salt: int,
    now: IntArray,
    after: IntArray,
) -> None:  # pragma: no cover - compiled
    """The main loop of PIBT; options are ranked when they are asked for."""
    claims, keys = desk.claims, desk.keys
    look_out(around, desk.outlook, moment.distances, moment.row, now, moment.order, moment.unit)
    for agent in range(len(now)):
        enter(claims, agent, around.cell[now[agent]])
        keys[agent, 0] = _UNRANKED
        if moment.locked[agent]:
            stay(claims, now, after, agent)
    for leader in moment.order:
        if claims.goes[leader] != UNDECIDED:
            continue
        claims.stack[0] = leader
        end, depth = PUSHED, np.int64(0)
        while end == PUSHED:
            pushed = claims.stack[depth]
            if keys[pushed, 0] == _UNRANKED:
                _rank(options, headings, around, scores, desk, moment, salt, now, pushed)
            end, depth = push(options, claims, keys, _USED_UP, now, after, depth, moment.allow_rotation)
    forget(desk.outlook, now)
    clear(options, claims, now)


@kernel
def _look_around(
    around: Surroundings, desk: Desk, moment: Moment, now: IntArray, agent: Int
) -> None:  # pragma: no cover - compiled
    """Note what an agent sees."""
    observe(
        around,
        desk.outlook,
        moment.distances,
        moment.row,
        now,
        moment.waited,
        desk.claims.goes,
        moment.unit,
        agent,
        desk.seen[agent],
    )


@kernel
def _rank(
    options: Options,
    headings: IntArray,
    around: Surroundings,
    scores: Scores,
    desk: Desk,
    moment: Moment,
    salt: int,
    now: IntArray,
    agent: Int,
) -> None:  # pragma: no cover - compiled
    """Give every option of an agent its key; option 0 is to wait.

    Who has no goal, or is there, would rather stay. Who has waited for long goes where least is left to do, so that
    agents that do not agree do not stand for ever.
    """
    state, row, last = now[agent], moment.row[agent], desk.layers.last
    aimless = row < 0 or moment.distances[row, state] == 0
    scored = not aimless and moment.waited[agent] < moment.patience
    best = np.float32(0.0)
    if scored:
        _look_around(around, desk, moment, now, agent)
        score(scores, desk.seen[agent], desk.layers)
        last[WAIT] -= np.float32(moment.eagerness)
        best = last[WAIT]
        for move in range(WAIT):
            best = max(best, last[move])
    noise = (salt ^ (agent * 0x9E3779B97F4A7C1)) * 0x2545F4914F6CDD1D
    noise ^= noise >> 29
    for option in range(-1, options.aim.shape[1]):
        target = state if option < 0 else options.aim[state, option, 0]
        if target < 0:
            desk.keys[agent, option + 1 :] = _USED_UP
            break
        noise ^= noise << 13
        noise ^= noise >> 7
        noise ^= noise << 17
        key = noise & _CHANCE
        if scored:
            move = WAIT if option < 0 else move_in(desk.outlook.frame[agent], headings[state, option])
            key |= np.int64(_PER_SCORE * min(best - last[move], _MOST)) << _KEY_BIT
        elif aimless:
            key |= np.int64(option >= 0) << _KEY_BIT
        else:
            key |= np.int64(moment.distances[row, target]) << _KEY_BIT
            if desk.outlook.stands[target] >= 0:
                key |= _OCCUPIED
        desk.keys[agent, option + 1] = key


@kernel
def _observe_along(
    around: Surroundings, desk: Desk, moment: Moment, now: IntArray, after: IntArray
) -> None:  # pragma: no cover - compiled
    goes = desk.claims.goes
    look_out(around, desk.outlook, moment.distances, moment.row, now, moment.order, moment.unit)
    goes[:] = UNDECIDED
    for agent in moment.order:
        _look_around(around, desk, moment, now, agent)
        goes[agent] = around.cell[after[agent]]
    forget(desk.outlook, now)
