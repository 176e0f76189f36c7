"""Rewards: progress, finished work and contacts as weighted terms that add up to each agent's reward."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.envs.core.weights import check_weights
from fleet.envs.warehouse.agent_simulation import AgentSimulation
from fleet.envs.warehouse.observations import Observer
from fleet.run.events import Event
from fleet.tasks.board import TaskState
from fleet.world.protocol import FloatArray


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
        n = simulation.cars_n + simulation.arms_n
        self._keys = np.full(n, -1, dtype=np.int64)
        self._ways = np.zeros(n)
        self._lanes = [_NOWHERE] * simulation.cars_n
        self._measure()
        simulation.events.subscribe(self._count)

    def step(
        self,
        cars: FloatArray,
        arms: FloatArray,
        illegal_cars: npt.NDArray[np.bool_],
        illegal_arms: npt.NDArray[np.bool_],
    ) -> FloatArray:
        """Weighted terms since the last call.

        Args:
            cars: The cars' actions, shape (n_cars, 2).
            arms: The arms' actions, grip last, shape (n_arms, n_entries).
            illegal_cars: Whether they were made legal, shape (n_cars,).
            illegal_arms: Whether they were made legal, shape (n_arms,).

        Returns:
            Terms in the order of `TERMS`, 1 for an illegal action, and the sum of the terms, cars first, shape
            (n_agents, n_terms + 2).
        """
        contacts = self._simulation.world.contacts()
        touched = contacts.robot + contacts.static
        self._shared[4] = touched - self._contacts
        self._contacts = touched
        keys, ways = self._keys, self._ways
        self._measure()
        table = np.empty((len(keys), len(TERMS) + 2))
        illegal = illegal_cars, illegal_arms
        _fill(
            table, self._weights, self._shared, keys, ways, self._keys, self._ways, cars, arms, *illegal, self._step_s
        )
        self._shared[1:4] = 0.0
        return table

    def _count(self, event: Event) -> None:
        if event.kind == "task" and event.facts["state"] in _WORK:
            self._shared[_WORK[TaskState(str(event.facts["state"]))]] += 1.0

    def _measure(self) -> None:
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
        self._keys, self._ways = np.array(keys, dtype=np.int64), np.array(ways)

    def _lane(self, goal: int, state: int) -> _Lane:
        """The way from a state to a goal: one move of the lane graph is one cell."""
        simulation = self._simulation
        x, y, _ = simulation.graph.state_pose[state].tolist()
        moves_n = float(simulation.traffic.tables.to(goal)[state])
        return _Lane(goal=goal, state=state, x=x, y=y, way_m=moves_n * simulation.site.grid.cell_m)


@njit(cache=True)
def _fill(  # one kernel for all agents, on flat arrays
    table, weights, shared, keys, ways, keys_now, ways_now, cars, arms, illegal_cars, illegal_arms, step_s
):  # fmt: skip
    """Fill the terms, who was illegal and, in the last column, the sums of the terms."""
    n_terms = len(weights)
    for agent in range(len(table)):
        square = 0.0
        if agent < len(cars):
            table[agent, n_terms] = illegal_cars[agent]
            for k in range(cars.shape[1]):
                square += cars[agent, k] * cars[agent, k] / cars.shape[1]
        else:
            table[agent, n_terms] = illegal_arms[agent - len(cars)]
            moves_n = arms.shape[1] - 1
            for k in range(moves_n):
                square += arms[agent - len(cars), k] * arms[agent - len(cars), k] / moves_n
        total = 0.0
        for term in range(n_terms):
            value = shared[term]
            if term == 0 and keys[agent] == keys_now[agent]:
                value = ways[agent] - ways_now[agent]
            elif term == 5:
                value = square * step_s
            table[agent, term] = weights[term] * value + 0.0  # + 0.0: no negative zeros
            total += table[agent, term]
        table[agent, n_terms + 1] = total
