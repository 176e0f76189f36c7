"""Plays an episode of POGEMA with a planner that decides one timestep after the other."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from benchmarks.mapf.pogema.episode import Episode
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.problem import Plan
from planners.status import Status


class OnlinePlanner(Protocol):
    """Decides the timesteps of an episode, one by one."""

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep.

        Args:
            states: State of each agent, shape (n,).
            goals: Cell each agent is sent to, shape (n,).
            next_goals: Cell it will be sent to after that, shape (n,).

        Returns:
            State of each agent one timestep later, shape (n,).
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """An episode that was played."""

    plan: Plan
    """What the agents did."""
    finished: npt.NDArray[np.int64]
    """Goals reached in each timestep, shape (steps,)."""
    cpu_s: float
    """CPU time of the planner's decisions [s]."""

    @property
    def throughput(self) -> float:
        """Goals reached per timestep."""
        return float(self.finished.mean())

    @property
    def step_ms(self) -> float:
        """CPU time of a decision [ms]."""
        return 1e3 * self.cpu_s / len(self.finished)


def play(episode: Episode, graph: LaneGraph, planner: OnlinePlanner, *, steps: int) -> Played:
    """Play an episode.

    POGEMA's soft collisions carry out any legal step as it stands, closed rings of followers too.

    Args:
        episode: The episode.
        graph: Lane graph of its floor, of pebbles.
        planner: Decides.
        steps: Timesteps.
    """
    streams = [episode.goals(agent) for agent in range(episode.n)]
    return drive(planner, graph, graph.state_index[episode.starts, 0], streams, steps=steps)


def drive(
    planner: OnlinePlanner, graph: LaneGraph, starts: IntArray, streams: Sequence[Iterator[int]], *, steps: int
) -> Played:
    """Let agents go to one goal after the other: it counts in the timestep that reaches it, and the next one is given.

    Args:
        planner: Decides.
        graph: Lane graph, of pebbles.
        starts: State of each agent, shape (n,).
        streams: Goal cells of each agent.
        steps: Timesteps.
    """
    goals, next_goals = (np.array([next(stream) for stream in streams], dtype=np.int32) for _ in range(2))
    states = np.empty((steps + 1, len(starts)), dtype=np.int32)
    states[0] = starts
    finished = np.zeros(steps, dtype=np.int64)
    cpu_s = 0.0
    for t in range(steps):
        begin = time.thread_time()
        states[t + 1] = planner.step(states[t], goals, next_goals)
        cpu_s += time.thread_time() - begin
        there = np.flatnonzero(graph.state_cell[states[t + 1]] == goals)
        finished[t] = len(there)
        goals[there] = next_goals[there]
        next_goals[there] = [next(streams[agent]) for agent in there.tolist()]
    return Played(plan=Plan(states=states, status=Status.FEASIBLE, iterations=steps), finished=finished, cpu_s=cpu_s)
