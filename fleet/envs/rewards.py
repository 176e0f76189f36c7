"""Rewards: progress, finished work and contacts as weighted terms that add up to each agent's reward."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.envs.agent_simulation import AgentSimulation
from fleet.envs.observations import Observer, top_of
from fleet.simulation import Event
from fleet.tasks.board import TaskState


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """What things are worth."""

    progress: float = 1.0
    """Per metre: a car comes nearer to its goal; an arm's tip to its parcel, and the parcel to its place."""
    loaded: float = 5.0
    """Per parcel set into a tray, for every agent."""
    delivered: float = 10.0
    """Per parcel set on its slot, for every agent."""
    contact: float = -1.0
    """Per new contact between robots or with walls, shelves and pedestals, for every agent."""


TERMS = ("progress", "loaded", "delivered", "contact")
"""Names of the terms."""
_WORK = {TaskState.CARRIED: "loaded", TaskState.DELIVERED: "delivered"}


class Rewards:
    """Judges one run, step by step.

    Progress is the decrease of a distance, so that going back and forth earns nothing. It is not counted over a step in
    which the goal changed.

    Args:
        simulation: The run, before its first tick.
        observer: Knows where parcels should go.
        weights: What things are worth.
    """

    def __init__(self, simulation: AgentSimulation, observer: Observer, weights: RewardWeights) -> None:
        self._simulation = simulation
        self._observer = observer
        self._weights = weights
        self._work = dict.fromkeys(_WORK.values(), 0)
        self._contacts = 0
        self._cars = self._car_distances()
        self._arms = self._arm_distances()
        simulation.on_event = self._count

    def step(self) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
        """Terms since the last call, weighted: one dictionary per car, one per arm."""
        weights, contacts = self._weights, self._simulation.world.contacts()
        touched = contacts.robot + contacts.static
        shared = {
            "loaded": weights.loaded * self._work["loaded"],
            "delivered": weights.delivered * self._work["delivered"],
            "contact": weights.contact * (touched - self._contacts),
        }
        self._contacts = touched
        self._work = dict.fromkeys(self._work, 0)
        cars, arms = self._car_distances(), self._arm_distances()
        car_terms = [{"progress": weights.progress * gain, **shared} for gain in _gains(self._cars, cars)]
        arm_terms = [{"progress": weights.progress * gain, **shared} for gain in _gains(self._arms, arms)]
        self._cars, self._arms = cars, arms
        return car_terms, arm_terms

    def _count(self, event: Event) -> None:
        if event.kind == "task" and event.facts["state"] in _WORK:
            self._work[_WORK[TaskState(str(event.facts["state"]))]] += 1

    def _car_distances(self) -> list[tuple[int, float]]:
        """Goal of each car and the way there: straight to its next granted state, then along the lanes [m]."""
        simulation = self._simulation
        traffic, graph = simulation.traffic, simulation.graph
        poses = simulation.world.car_poses()
        found = []
        for car, goal in enumerate(traffic.goals.tolist()):
            state = simulation.driver.next_state(car) if simulation.cars_by_agent else -1
            if goal < 0 or state < 0:
                found.append((-1, 0.0))
                continue
            straight_m = math.hypot(*(graph.state_pose[state, :2] - poses[car, :2]))
            # One move of the lane graph is one cell.
            lanes_m = float(traffic.tables.to(goal)[state]) * simulation.site.grid.cell_m
            found.append((goal, straight_m + lanes_m))
        return found

    def _arm_distances(self) -> list[tuple[int, float]]:
        """Transfer of each arm, and the way of its tip to the parcel and of the parcel to its place [m]."""
        simulation = self._simulation
        world = simulation.world
        found = []
        tips = self._observer.tips() if simulation.arms_by_agent else np.empty((0, 3))
        for arm in range(world.n_arms):
            transfer = simulation.desk.transfer(arm)
            if transfer is None:
                found.append((-1, 0.0))
                continue
            centre = world.parcel_poses()[int(np.searchsorted(world.parcel_ids(), transfer.parcel)), :3]
            way_m = np.linalg.norm(top_of(centre, transfer.size_m) - tips[arm]) + np.linalg.norm(
                self._observer.place(transfer) - centre
            )
            found.append((2 * transfer.parcel + (transfer.place_via < 0), float(way_m)))
        return found


def _gains(before: list[tuple[int, float]], after: list[tuple[int, float]]) -> list[float]:
    """How much shorter the ways to unchanged goals have become [m]."""
    return [was[1] - now[1] if was[0] == now[0] else 0.0 for was, now in zip(before, after, strict=True)]
