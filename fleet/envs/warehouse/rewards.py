"""Rewards: progress, finished work and contacts as weighted terms that add up to each agent's reward."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.core.weights import check_weights
from fleet.envs.warehouse.actions import LegalActions
from fleet.envs.warehouse.agent_simulation import AgentSimulation
from fleet.envs.warehouse.observations import Observer
from fleet.run.events import Event
from fleet.tasks.board import TaskState


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """What things are worth; the terms of an agent's reward, by name."""

    progress: float = 1.0
    """Per metre: a car comes nearer to its goal; an arm's tip to its parcel, and the parcel to its place."""
    loaded: float = 5.0
    """Per parcel set into a tray, for every agent."""
    delivered: float = 10.0
    """Per parcel set on its slot, for every agent."""
    failed: float = -10.0
    """Per task that has failed, for every agent."""
    contact: float = -1.0
    """Per new contact between robots or with walls, shelves and pedestals, for every agent."""
    effort: float = 0.0
    """Per second at full action: the mean of the squares of an agent's entries, grip left out."""
    time: float = 0.0
    """Per second of the episode, for every agent."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = tuple(field.name for field in fields(RewardWeights))
"""Names of the terms."""
_WORK = {TaskState.CARRIED: 1, TaskState.DELIVERED: 2, TaskState.FAILED: 3}
"""Terms that events count for."""


@dataclass(frozen=True, kw_only=True)
class _Lane:
    """What is left of a car's way, from where it comes to next."""

    goal: int
    state: int
    x: float
    y: float
    way_m: float

    def left_m(self, x: float, y: float) -> float:
        """Length of the way from a place, straight to where the rest begins [m]."""
        return self.way_m + math.hypot(self.x - x, self.y - y)


_NOWHERE = _Lane(goal=-1, state=-1, x=0.0, y=0.0, way_m=0.0)


class _WaysLeft(NamedTuple):
    """What each agent is about and how far it is from it, cars first."""

    keys: npt.NDArray[np.int64]
    """Goal of a car, transfer of an arm, negative = none, shape (n_agents,)."""
    ways: FloatArray
    """What is left of its way [m], shape (n_agents,)."""


class Rewards:
    """Judges one run, step by step.

    Progress is the decrease of a distance, so that going back and forth earns nothing. It is not counted over a step in
    which the goal changed.

    Args:
        simulation: The run, before its first tick.
        observer: Has looked at it.
        weights: What things are worth.
        step_s: Length of a step [s].
    """

    def __init__(self, simulation: AgentSimulation, observer: Observer, weights: RewardWeights, step_s: float) -> None:
        self._simulation = simulation
        self._observer = observer
        self._weights = np.array([getattr(weights, term) for term in TERMS])
        self._step_s = step_s
        self._contacts = 0
        self._shared = np.zeros(len(TERMS))
        self._shared[6] = step_s
        self._lanes = [_NOWHERE] * simulation.n_cars
        self._left = self._measured()
        simulation.events.subscribe(self._count)

    def step(self, actions: LegalActions) -> FloatArray:
        """Weighted terms since the last call.

        Args:
            actions: Of all agents, as they were played.

        Returns:
            Terms in the order of `TERMS`, 1 for an illegal action, and the sum of the terms, cars first, shape
            (n_agents, n_terms + 2).
        """
        contacts = self._simulation.world.contacts()
        touched = contacts.robot + contacts.static
        self._shared[4] = touched - self._contacts
        self._contacts = touched
        before, self._left = self._left, self._measured()
        table = np.empty((len(before.keys), len(TERMS) + 2))
        _fill(table, self._weights, self._shared, before, self._left, actions, self._step_s)
        self._shared[1:4] = 0.0
        return table

    def _count(self, event: Event) -> None:
        if event.kind == "task" and event.facts["state"] in _WORK:
            self._shared[_WORK[TaskState(str(event.facts["state"]))]] += 1.0

    def _measured(self) -> _WaysLeft:
        """What each agent is about, and the way that is left: of a car straight to its next state, then along lanes."""
        observer, keys, ways = self._observer, [], []
        states = self._simulation.driver.next_states
        goals = self._simulation.traffic.goals[: len(self._lanes)].tolist()
        for car, (goal, lane, (x, y, _)) in enumerate(zip(goals, self._lanes, observer.agent_poses, strict=True)):
            keys.append(goal)
            if goal < 0:
                ways.append(0.0)
                continue
            if lane.state != states[car] or lane.goal != goal:
                self._lanes[car] = self._lane(goal, states[car])
            ways.append(self._lanes[car].left_m(x, y))
        for key, way in zip(observer.transfer_keys, observer.arm_ways.tolist(), strict=True):
            keys.append(key)
            ways.append(way if key >= 0 else 0.0)
        return _WaysLeft(keys=np.array(keys, dtype=np.int64), ways=np.array(ways))

    def _lane(self, goal: int, state: int) -> _Lane:
        """The way from a state to a goal: one move of the lane graph is one cell."""
        simulation = self._simulation
        x, y, _ = simulation.graph.state_pose[state].tolist()
        n_moves = float(simulation.traffic.tables.to(goal)[state])
        return _Lane(goal=goal, state=state, x=x, y=y, way_m=n_moves * simulation.site.grid.cell_m)


@njit(cache=True)
def _fill(
    table: FloatArray,
    weights: FloatArray,
    shared: FloatArray,
    before: _WaysLeft,
    now: _WaysLeft,
    actions: LegalActions,
    step_s: float,
) -> None:  # pragma: no cover - compiled
    """Fill the terms, 1 for an illegal action and, in the last column, the sums of the terms."""
    cars, arms = actions.cars, actions.arms
    n_terms = len(weights)
    for agent in range(len(table)):
        square = 0.0
        if agent < len(cars):
            table[agent, n_terms] = actions.illegal_cars[agent]
            for k in range(cars.shape[1]):
                square += cars[agent, k] * cars[agent, k] / cars.shape[1]
        else:
            table[agent, n_terms] = actions.illegal_arms[agent - len(cars)]
            n_moves = arms.shape[1] - 1
            for k in range(n_moves):
                square += arms[agent - len(cars), k] * arms[agent - len(cars), k] / n_moves
        total = 0.0
        for term in range(n_terms):
            value = shared[term]
            if term == 0 and before.keys[agent] == now.keys[agent]:
                value = before.ways[agent] - now.ways[agent]
            elif term == 5:
                value = square * step_s
            table[agent, term] = weights[term] * value + 0.0  # + 0.0: no negative zeros
            total += table[agent, term]
        table[agent, n_terms + 1] = total
