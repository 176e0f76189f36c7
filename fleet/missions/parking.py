"""Parking: where cars wait."""

from __future__ import annotations

from fleet.missions.roster import ON_VISIT, PARKED, Roster
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic


class Parking:
    """Parking places and who is bound for them.

    Args:
        states: Lane-graph state of each parking place.
        roster: Tells which cars wait.
        traffic: Takes goals and gives distances.
        executor: Tells where cars are.
    """

    def __init__(self, states: tuple[int, ...], roster: Roster, traffic: Traffic, executor: Executor) -> None:
        self.states = states
        self._roster = roster
        self._traffic = traffic
        self._executor = executor

    def send(self, tick: int) -> None:
        """Send every car that waits to the nearest parking place that no other such car has, or visits."""
        phases = self._roster.phase
        waiting = [car for car, phase in enumerate(phases) if phase in PARKED]
        visited = {int(self._traffic.goals[car]) for car, phase in enumerate(phases) if phase in ON_VISIT}
        taken = visited | {int(self._traffic.goals[car]) for car in waiting}
        tails = self._executor.tail_states()
        for car in waiting:
            goal, tail = int(self._traffic.goals[car]), int(tails[car])
            if goal in self.states and goal not in visited and self._traffic.reachable(tail, goal):
                self._traffic.stay[car] = False  # after a visit to this place it stays no longer than it likes
                continue
            free = [state for state in self.states if state not in taken and self._traffic.reachable(tail, state)]
            if not free:
                continue
            goal = min(free, key=lambda state: (int(self._traffic.tables.to(state)[tail]), state))
            taken.add(goal)
            self._traffic.rank[car] = 0.0
            self._traffic.send(car, goal, stay=False, tick=tick)
