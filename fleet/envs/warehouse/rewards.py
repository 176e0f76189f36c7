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
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.envs.warehouse.control.actions import LegalActions
from fleet.envs.warehouse.observations import Observer
from fleet.tasks.board import Task, TaskState


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """What things are worth; the terms of an agent's reward, by name.

    Of what is loaded, delivered, lost and touched an agent is paid for its own part, or for its team's, as the
    environment's `team_share` says.
    """

    progress: float = 1.0
    """Per metre: a car comes nearer to its goal; an arm's tip to its parcel, and the parcel to its place."""
    docked: float = 2.0
    """To a car, each time that it stands at the dock it was bound for and its service begins."""
    gripped: float = 2.0
    """To an arm, once per transfer, when it has the parcel in its grip."""
    loaded: float = 5.0
    """Per parcel set into a tray."""
    delivered: float = 10.0
    """Per parcel set on its slot."""
    failed: float = -10.0
    """Per task that has failed."""
    contact: float = -1.0
    """Per new contact between robots or with walls, shelves and pedestals."""
    effort: float = 0.0
    """Per second at full action: the mean of the squares of an agent's entries, grip left out."""
    time: float = 0.0
    """Per second of the episode, for every agent."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = tuple(field.name for field in fields(RewardWeights))
"""Names of the terms."""
_PROGRESS, _DOCKED, _GRIPPED, _LOADED, _DELIVERED, _FAILED, _CONTACT, _EFFORT, _TIME = range(len(TERMS))
_AT_WORK = (TaskState.LOADING, TaskState.UNLOADING)


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


class _Counts(NamedTuple):
    """What has happened in a step, by term."""

    own: FloatArray
    """What each agent was part of, shape (n_agents, n_terms)."""
    team: FloatArray
    """What anybody was part of, shape (n_terms,)."""
    share: FloatArray
    """Share of the team's part in what an agent is paid for, shape (n_terms,)."""


class Rewards:
    """Judges one run, step by step.

    Progress is the decrease of a distance, so that going back and forth earns nothing. It is not counted over a step in
    which the goal changed.

    Args:
        simulation: The run, before its first tick.
        observer: Has looked at it.
        weights: What things are worth.
        team_share: Share of what the whole team does in what each agent is paid for.
        step_s: Length of a step [s].
    """

    def __init__(
        self,
        simulation: AgentSimulation,
        observer: Observer,
        weights: RewardWeights,
        team_share: float,
        step_s: float,
    ) -> None:
        self._simulation = simulation
        self._observer = observer
        self._weights = np.array([getattr(weights, term) for term in TERMS])
        self._step_s = step_s
        self._n_cars, self._n_arms = simulation.n_cars, simulation.n_arms
        self._counts = _Counts(
            own=np.zeros((self._n_cars + self._n_arms, len(TERMS))),
            team=np.zeros(len(TERMS)),
            share=np.zeros(len(TERMS)),
        )
        self._counts.share[[_LOADED, _DELIVERED, _FAILED, _CONTACT]] = team_share
        self._touched = simulation.world.contacts_of()
        self._n_touches = self._touches()
        self._gripped_for = [-1] * self._n_arms
        self._lanes = [_NOWHERE] * self._n_cars
        self._left = self._measured()
        simulation.board.subscribe(self._count)

    def step(self, actions: LegalActions) -> FloatArray:
        """Weighted terms since the last call.

        Args:
            actions: Of all agents, as they were played.

        Returns:
            Terms in the order of `TERMS`, 1 for an illegal action, and the sum of the terms, cars first, shape
            (n_agents, n_terms + 2).
        """
        counts = self._counts
        self._count_contacts()
        self._count_grips()
        counts.own[:, _TIME] = self._step_s
        before, self._left = self._left, self._measured()
        table = np.empty((len(before.keys), len(TERMS) + 2))
        _fill(table, self._weights, counts, before, self._left, actions, self._step_s)
        counts.own[:] = 0.0
        counts.team[:] = 0.0
        return table

    def _count(self, task: Task, before: TaskState, now_s: float) -> None:
        """Count what has become of a task, for those who had to do with it."""
        del now_s
        if task.state in _AT_WORK:
            if task.car is not None and task.car < self._n_cars:
                self._counts.own[task.car, _DOCKED] += 1.0
            return
        if task.state is TaskState.CARRIED and before is TaskState.LOADING:
            self._add(_LOADED, task, before)
        elif task.state is TaskState.DELIVERED:
            self._add(_DELIVERED, task, before)
        elif task.state is TaskState.FAILED:
            self._add(_FAILED, task, before)

    def _add(self, term: int, task: Task, before: TaskState) -> None:
        counts = self._counts
        counts.team[term] += 1.0
        if task.car is not None and task.car < self._n_cars:
            counts.own[task.car, term] += 1.0
        if before in _AT_WORK and task.visit is None:
            name = task.pick if before is TaskState.LOADING else task.delivery.drop
            arm = self._simulation.missions.stations.named(name).arm
            if arm < self._n_arms:
                counts.own[self._n_cars + arm, term] += 1.0

    def _count_contacts(self) -> None:
        n_touches, n_before = self._touches(), self._n_touches
        if n_touches == n_before:
            return
        counts, n_cars = self._counts, self._n_cars
        (cars, arms), (cars_before, arms_before) = self._simulation.world.contacts_of(), self._touched
        counts.team[_CONTACT] = n_touches - n_before
        counts.own[:n_cars, _CONTACT] = (cars - cars_before)[:n_cars]
        counts.own[n_cars:, _CONTACT] = (arms - arms_before)[: self._n_arms]
        self._touched, self._n_touches = (cars, arms), n_touches

    def _touches(self) -> int:
        contacts = self._simulation.world.contacts()
        return contacts.robot + contacts.static

    def _count_grips(self) -> None:
        held = self._simulation.world.held()
        for arm in range(self._n_arms):
            key = self._observer.transfer_keys[arm]
            if key < 0:
                self._gripped_for[arm] = -1
            elif key != self._gripped_for[arm] and held[arm] == key // 2:
                self._gripped_for[arm] = key
                self._counts.own[self._n_cars + arm, _GRIPPED] = 1.0

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
    counts: _Counts,
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
            share = counts.share[term]
            value = (1.0 - share) * counts.own[agent, term] + share * counts.team[term]
            if term == _PROGRESS and before.keys[agent] == now.keys[agent]:
                value = before.ways[agent] - now.ways[agent]
            elif term == _EFFORT:
                value = square * step_s
            table[agent, term] = weights[term] * value + 0.0  # + 0.0: no negative zeros
            total += table[agent, term]
        table[agent, n_terms + 1] = total
